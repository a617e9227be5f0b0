"""Subscriptions of the viewer: the newest message of each topic, how often they come, and why none does."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from rclpy.qos import QoSCompatibility, qos_check_compatible
from sensor_msgs.msg import Image, PointCloud2

from moire_sensor.ros.head_sets import stamp_ns
from moire_sensor.ros.qos import OVERRIDABLE, input_qos, overridable

# What is shown, by the name it has on the page; each with who publishes it.
STREAMS: dict[str, tuple[str, Any, str]] = {
    "left": ("left/image_raw", Image, "the head"),
    "right": ("right/image_raw", Image, "the head"),
    "depth": ("depth/image_rect", Image, "the reconstruction"),
    "confidence": ("confidence/image", Image, "the reconstruction"),
    "cloud": ("points", PointCloud2, "the reconstruction"),
}
# Rates and latencies are those of this time.
WINDOW_S = 3.0
# A stamp this far from now is of another clock: a replayed bag, say.
OTHER_CLOCK_S = 60.0


@dataclass(frozen=True)
class StreamState:
    """What is known of one topic now: rates in Hz, median latency in seconds (NaN: unknown), what is wrong or ""."""

    topic: str
    rate_hz: float
    shown_hz: float
    latency_s: float
    trouble: str


@dataclass
class Stream:
    """One topic while it is subscribed to; ``opened_s`` is of ``time.monotonic``."""

    subscription: Any
    opened_s: float
    newest: Any = None
    arrivals_s: deque[float] = field(default_factory=lambda: deque(maxlen=1000))
    shown_s: deque[float] = field(default_factory=lambda: deque(maxlen=1000))
    latencies_s: deque[float] = field(default_factory=lambda: deque(maxlen=30))
    refusal: str = ""


class ViewerInputs:
    """Subscribe to what is shown between ``open`` and ``close``; all in the executor's thread."""

    def __init__(self, node: Any) -> None:
        self._node = node
        self._streams: dict[str, Stream] = {}

    @property
    def is_open(self) -> bool:
        """Tell whether there are subscriptions."""
        return bool(self._streams)

    def qos_parameters(self) -> set[str]:
        """Return the names of the qos_overrides parameters that the subscriptions have."""
        topics = [self._node.resolve_topic_name(topic) for topic, _, _ in STREAMS.values()]
        return {
            f"qos_overrides.{topic}.subscription.{kind.name.lower()}" for topic in topics for kind in OVERRIDABLE
        }

    def open(self) -> None:
        """Subscribe; what was known of an earlier time is forgotten."""
        for name, (topic, kind, _) in STREAMS.items():
            subscription = self._node.create_subscription(
                kind, topic, partial(self._take, name), input_qos(False), qos_overriding_options=overridable()
            )
            self._streams[name] = Stream(subscription, time.monotonic())

    def close(self) -> None:
        """End all subscriptions."""
        for stream in self._streams.values():
            self._node.destroy_subscription(stream.subscription)
        self._streams.clear()

    def newest(self, name: str) -> Any:
        """Return the newest message of a stream once, None when there is none since; older ones were dropped."""
        stream = self._streams[name]
        message, stream.newest = stream.newest, None
        return message

    def note_shown(self, name: str, refusal: str = "") -> None:
        """A message was shown, or could not be for a reason."""
        stream = self._streams[name]
        stream.refusal = refusal
        if not refusal:
            stream.shown_s.append(time.monotonic())

    def states(self, silent_after_s: float) -> dict[str, StreamState]:
        """Return the state of every stream; one that brought nothing for ``silent_after_s`` is called silent."""
        now_s = time.monotonic()
        return {name: self._state(name, stream, now_s, silent_after_s) for name, stream in self._streams.items()}

    def _take(self, name: str, message: Any) -> None:
        stream = self._streams.get(name)
        if stream is None:
            return
        stream.newest = message
        stream.arrivals_s.append(time.monotonic())
        age_s = (self._node.get_clock().now().nanoseconds - stamp_ns(message)) * 1e-9
        stream.latencies_s.append(age_s if abs(age_s) < OTHER_CLOCK_S else float("nan"))

    def _state(self, name: str, stream: Stream, now_s: float, silent_after_s: float) -> StreamState:
        latencies = stream.latencies_s
        return StreamState(
            self._node.resolve_topic_name(STREAMS[name][0]),
            rate(stream.arrivals_s, now_s),
            rate(stream.shown_s, now_s),
            float(np.median(latencies)) if latencies else float("nan"),
            self._trouble(name, stream, now_s, silent_after_s),
        )

    def _trouble(self, name: str, stream: Stream, now_s: float, silent_after_s: float) -> str:
        quiet_s = now_s - (stream.arrivals_s[-1] if stream.arrivals_s else stream.opened_s)
        if quiet_s < silent_after_s:
            return stream.refusal
        topic, _, publisher = STREAMS[name]
        asked = stream.subscription.qos_profile
        offers = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
        if not offers:
            return f"nobody publishes it; is {publisher} running?"
        for offer in offers:
            fit, reason = qos_check_compatible(offer.qos_profile, asked)
            if fit == QoSCompatibility.ERROR:
                return f"quality of service does not match: {reason.strip(' ;').removeprefix('ERROR: ')}"
        return f"silent for {quiet_s:.0f} s"


def rate(times_s: deque[float], now_s: float) -> float:
    """Return how often something happened a second within the last ``WINDOW_S``; 0 when once or never."""
    recent = [one for one in times_s if now_s - one <= WINDOW_S]
    return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0
