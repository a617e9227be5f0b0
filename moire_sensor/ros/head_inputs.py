"""Subscriptions of the reconstruction node: images and projector state matched by stamp, camera infos the latest."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSCompatibility, QoSDurabilityPolicy, QoSProfile, qos_check_compatible
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
# Sets that came before the camera infos; at 30 Hz the infos may come a third of a second late.
HELD_SETS = 10
INFO_TOPICS = {device: f"{device}/camera_info" for device in ("left", "right", "projector")}
NANOSECONDS = 1_000_000_000
LATCHED = QoSDurabilityPolicy.TRANSIENT_LOCAL
Handler = Callable[[Any], None]
Taker = Callable[[MatchedSet[Any], Calibration | None], None]


def stamp_ns(message: Any) -> int:
    """Return the stamp of a stamped message in nanoseconds."""
    return int(message.header.stamp.sec) * NANOSECONDS + int(message.header.stamp.nanosec)


class HeadInputs:
    """Subscribe to a head; ``take`` is called with each whole set, in the executor's thread.

    With the set comes the calibration in force, None where a camera info is still missing after a while.
    """

    def __init__(self, node: Any, reliable: bool, take: Taker) -> None:
        self.matcher: SetMatcher[Any] = SetMatcher(STREAMS)
        self._node = node
        self._incompatible: dict[str, tuple[str, QoSProfile]] = {}
        self._take = take
        self._infos: dict[str, CameraInfo] = {}
        self._calibration: Calibration | None = None
        self._held: deque[MatchedSet[Any]] = deque()
        # Infos first: of messages that wait together, the executor handles the earlier subscription's first.
        for device, topic in INFO_TOPICS.items():
            callback = self._info_callback(device)
            matched = self._latched_listener(node, topic, callback)
            self._subscribe(node, CameraInfo, topic, input_qos(reliable), callback, matched)
        for stream, (topic, kind) in STREAM_TOPICS.items():
            self._subscribe(node, kind, topic, input_qos(reliable), self._stream_callback(stream))

    @property
    def missing_infos(self) -> list[str]:
        """Topics of the camera infos that have not come yet."""
        return [topic for device, topic in INFO_TOPICS.items() if device not in self._infos]

    @property
    def calibration(self) -> Calibration | None:
        """The camera infos in force, None while one is missing."""
        if self._calibration is None and not self.missing_infos:
            self._calibration = calibration_of(self._infos)
        return self._calibration

    def incompatible(self) -> dict[str, str]:
        """Return the policy that keeps a publisher, still there, from reaching this node, by topic."""
        return {
            topic: policy
            for topic, (policy, qos) in self._incompatible.items()
            if any(
                qos_check_compatible(one.qos_profile, qos)[0] == QoSCompatibility.ERROR
                for one in self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
            )
        }

    def clear(self, reason: str) -> None:
        """Forget what was not matched yet."""
        self.matcher.clear(reason)
        self._held.clear()

    def _subscribe(
        self, node: Any, kind: Any, topic: str, qos: Any, callback: Handler, matched: Handler | None = None
    ) -> None:
        def report(event: Any) -> None:
            policy = event.last_policy_kind.name.lower().removeprefix("rmw_qos_policy_")
            self._incompatible[topic] = (policy, qos)
            node.get_logger().warning(
                f"a publisher of {topic} offers another {policy} than this node asks for, so nothing comes from it; "
                f"set qos_overrides.{node.resolve_topic_name(topic)}.subscription.{policy} to match"
            )

        node.create_subscription(
            kind,
            topic,
            callback,
            qos,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=report, matched=matched),
            qos_overriding_options=overridable(),
        )

    def _latched_listener(self, node: Any, topic: str, callback: Handler) -> Handler:
        """Return a callback that listens to old messages too, once a publisher that keeps them is there.

        Drivers publish infos with each image; a head or a bag publishes them perhaps once, latched. A latched
        subscription from the start would make each publisher that does not latch warn of incompatible settings.
        """
        listening: list[Any] = []

        def listen(event: Any) -> None:
            publishers = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
            if not listening and any(one.qos_profile.durability == LATCHED for one in publishers):
                listening.append(node.create_subscription(CameraInfo, topic, callback, latched_qos()))

        return listen

    def _stream_callback(self, stream: str) -> Handler:
        def take_message(message: Any) -> None:
            matched = self.matcher.add(stream, stamp_ns(message), message)
            if matched is not None:
                self._held.append(matched)
                self._release()

        return take_message

    def _info_callback(self, device: str) -> Handler:
        def take_info(message: CameraInfo) -> None:
            self._infos[device] = message
            self._calibration = None
            self._release()

        return take_info

    def _release(self) -> None:
        """Hand on what is held once all infos are there; before that, only what is too much to hold."""
        most = HELD_SETS if self.missing_infos else 0
        while len(self._held) > most:
            self._take(self._held.popleft(), self.calibration)
