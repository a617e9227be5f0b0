"""Subscriptions of the reconstruction node: images and projector state matched by stamp, camera infos the latest."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSCompatibility, QoSDurabilityPolicy, QoSProfile, qos_check_compatible
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image

from moire_sensor.ros.head_sets import INFO_TOPICS, STREAM_TOPICS, HeadSets, Taker, stamp_ns
from moire_sensor.ros.image_messages import MAX_IMAGE_BYTES
from moire_sensor.ros.qos import input_qos, latched_qos, overridable
from moire_sensor.ros.silence import SilenceWatch

LATCHED = QoSDurabilityPolicy.TRANSIENT_LOCAL
# A serialised message begins with four bytes about itself and its stamp.
STAMP_END = 12
RMWError = rclpy_implementation.RMWError
Handler = Callable[[Any], None]
Refuser = Callable[[str, str], None]


class HeadInputs:
    """Subscribe to a head; ``take`` is called with each whole set, in the executor's thread.

    With the set comes the calibration in force, None where a camera info is still missing after a while. ``refuse`` is
    called with reason and text for a message that is not even kept.
    """

    def __init__(self, node: Any, reliable: bool, take: Taker, refuse: Refuser) -> None:
        self.sets = HeadSets(take, node.get_parameter("input_rectified").value)
        self._node = node
        self._refuse = refuse
        self._subscriptions: list[Any] = []
        self._silence = SilenceWatch(STREAM_TOPICS)
        self._first_s: float | None = None
        self._incompatible: dict[str, tuple[str, QoSProfile]] = {}
        self._infos: dict[str, bytes] = {}
        # Infos first: of messages that wait together, the executor handles the earlier subscription's first.
        for device, topic in INFO_TOPICS.items():
            callback = partial(self._take_info, device)
            matched = self._latched_listener(node, topic, callback)
            self._subscribe(node, CameraInfo, topic, input_qos(reliable), callback, matched, raw=True)
        for stream, (topic, kind) in STREAM_TOPICS.items():
            self._subscribe(node, kind, topic, input_qos(reliable), self._stream_callback(stream))

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

    def silent(self, after_s: float) -> list[str]:
        """Return the full names of the topics that the others have run ahead of for ``after_s`` seconds.

        A camera info is among them when there has been none at all.
        """
        now_s = time.monotonic()
        topics = [STREAM_TOPICS[stream][0] for stream in self._silence.silent(after_s, now_s)]
        if self._first_s is not None and now_s - self._first_s >= after_s:
            topics += self.sets.missing_infos
        return [self._node.resolve_topic_name(topic) for topic in topics]

    def unpublished(self) -> list[str]:
        """Return the full names of the topics, infos too, that nobody publishes."""
        topics = [*(topic for topic, _ in STREAM_TOPICS.values()), *INFO_TOPICS.values()]
        names = [self._node.resolve_topic_name(topic) for topic in topics]
        return [name for name in names if not self._node.count_publishers(name)]

    def close(self) -> None:
        """End all subscriptions."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _subscribe(
        self,
        node: Any,
        kind: Any,
        topic: str,
        qos: Any,
        callback: Handler,
        matched: Handler | None = None,
        raw: bool = False,
    ) -> None:
        def report(event: Any) -> None:
            policy = event.last_policy_kind.name.lower().removeprefix("rmw_qos_policy_")
            self._incompatible[topic] = (policy, qos)
            node.get_logger().warning(
                f"a publisher of {topic} offers another {policy} than this node asks for, so nothing comes from it; "
                f"set qos_overrides.{node.resolve_topic_name(topic)}.subscription.{policy} to match"
            )

        subscription = node.create_subscription(
            kind,
            topic,
            callback,
            qos,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=report, matched=matched),
            qos_overriding_options=overridable(),
            raw=raw,
        )
        self._subscriptions.append(subscription)

    def _latched_listener(self, node: Any, topic: str, callback: Handler) -> Handler:
        """Return a callback that listens to what a publisher kept, once one that keeps its messages is there.

        Drivers publish infos with each image; a head or a bag publishes them perhaps once, latched. A latched
        subscription from the start would make each publisher that does not latch warn of incompatible settings.
        """
        listening: list[Any] = []

        def listen(event: Any) -> None:
            publishers = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
            if not listening and any(one.qos_profile.durability == LATCHED for one in publishers):
                listening.append(node.create_subscription(CameraInfo, topic, take_kept, latched_qos(), raw=True))
                self._subscriptions += listening

        def take_kept(message: Any) -> None:
            # What follows comes to the other subscription, and is not to be read twice.
            callback(message)
            if listening and listening[0] in self._subscriptions:
                self._subscriptions.remove(listening[0])
                node.destroy_subscription(listening.pop())

        return listen

    def _take_info(self, device: str, serialized: bytes) -> None:
        """Read a camera info where anything but its stamp is new: a driver sends the same with each image."""
        content = serialized[STAMP_END:]
        if content == self._infos.get(device):
            return
        try:
            self.sets.add_info(device, deserialize_message(serialized, CameraInfo))
        except RMWError as error:
            self._refuse("damaged camera info", f"{INFO_TOPICS[device]} cannot be read: {error}")
            return
        self._infos[device] = content

    def _stream_callback(self, stream: str) -> Handler:
        topic = STREAM_TOPICS[stream][0]

        def take_message(message: Any) -> None:
            now_s = time.monotonic()
            self._first_s = now_s if self._first_s is None else self._first_s
            self._silence.note(stream, stamp_ns(message), now_s)
            size = len(message.data) if isinstance(message, Image) else len(message.name) + len(message.position)
            if size > MAX_IMAGE_BYTES:
                self._refuse("too large", f"{topic} is {size} long; at most {MAX_IMAGE_BYTES} is kept")
                return
            self.sets.add(stream, message)

        return take_message
