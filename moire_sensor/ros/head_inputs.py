"""Subscriptions of the reconstruction node: images and projector state matched by stamp, camera infos the latest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from sensor_msgs.msg import CameraInfo, Image, JointState

from moire_sensor.ros.qos import input_qos, latched_qos, overridable
from moire_sensor.ros.sensor_cache import Calibration, calibration_of
from moire_sensor.ros.set_matcher import MatchedSet, SetMatcher

STREAMS = ("left", "right", "state")
STREAM_TOPICS: dict[str, tuple[str, Any]] = {
    "left": ("left/image_raw", Image),
    "right": ("right/image_raw", Image),
    "state": ("projector/state", JointState),
}
INFO_TOPICS = {device: f"{device}/camera_info" for device in ("left", "right", "projector")}
NANOSECONDS = 1_000_000_000


def stamp_ns(message: Any) -> int:
    """Return the stamp of a stamped message in nanoseconds."""
    return int(message.header.stamp.sec) * NANOSECONDS + int(message.header.stamp.nanosec)


class HeadInputs:
    """Subscribe to a head; ``take`` is called with each whole set, in the executor's thread."""

    def __init__(self, node: Any, reliable: bool, take: Callable[[MatchedSet[Any]], None]) -> None:
        self.matcher: SetMatcher[Any] = SetMatcher(STREAMS)
        self.incompatible: dict[str, str] = {}
        self._take = take
        self._infos: dict[str, CameraInfo] = {}
        self._calibration: Calibration | None = None
        for stream, (topic, kind) in STREAM_TOPICS.items():
            self._subscribe(node, kind, topic, input_qos(reliable), self._stream_callback(stream))
        for device, topic in INFO_TOPICS.items():
            callback = self._info_callback(device)
            self._subscribe(node, CameraInfo, topic, input_qos(reliable), callback)
            # Drivers publish infos with each image, a head or a bag perhaps once and latched: listen to both.
            node.create_subscription(
                CameraInfo,
                topic,
                callback,
                latched_qos(),
                event_callbacks=SubscriptionEventCallbacks(incompatible_qos=_expected),
                qos_overriding_options=overridable("latched"),
            )

    @property
    def missing_infos(self) -> list[str]:
        """Topics of the camera infos that have not come yet."""
        return [topic for device, topic in INFO_TOPICS.items() if device not in self._infos]

    @property
    def calibration(self) -> Calibration:
        """The camera infos in force; only valid while none is missing."""
        if self._calibration is None:
            self._calibration = calibration_of(self._infos)
        return self._calibration

    def clear(self, reason: str) -> None:
        """Forget what was not matched yet."""
        self.matcher.clear(reason)

    def _subscribe(self, node: Any, kind: Any, topic: str, qos: Any, callback: Callable[[Any], None]) -> None:
        def report(event: Any) -> None:
            policy = getattr(event.last_policy_kind, "name", str(event.last_policy_kind)).lower()
            self.incompatible[topic] = policy
            node.get_logger().warning(
                f"a publisher of {topic} offers another {policy} than this node asks for, so nothing comes from it; "
                f"set qos_overrides.{node.resolve_topic_name(topic)}.subscription.{policy} to match"
            )

        node.create_subscription(
            kind,
            topic,
            callback,
            qos,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=report),
            qos_overriding_options=overridable(),
        )

    def _stream_callback(self, stream: str) -> Callable[[Any], None]:
        def take_message(message: Any) -> None:
            matched = self.matcher.add(stream, stamp_ns(message), message)
            if matched is not None:
                self._take(matched)

        return take_message

    def _info_callback(self, device: str) -> Callable[[Any], None]:
        def take_info(message: CameraInfo) -> None:
            self._infos[device] = message
            self._calibration = None

        return take_info


def _expected(event: Any) -> None:
    """A publisher that does not latch is served by the other subscription."""
