"""The outputs of the reconstruction node; nothing is computed for a topic that nobody listens to."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Header

from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.qos import destroy_publisher, overridable, publisher_maker, publisher_qos
from moire_sensor.ros.reconstruction_settings import OutputSettings
from moire_sensor.ros.result_messages import TOPICS, result_messages
from moire_sensor.ros.unheard import NO_EVENTS, UnheardWatch
from moire_sensor.shot import Shot


class ResultPublisher:
    """Publish a shot on the topics that have subscribers."""

    def __init__(self, node: Any) -> None:
        self._node = node
        self._publishers = {
            topic: publisher_maker(node)(
                kind, topic, publisher_qos(), event_callbacks=NO_EVENTS, qos_overriding_options=overridable()
            )
            for topic, kind in TOPICS.items()
        }
        self._unheard = UnheardWatch(node, self._publishers.values())

    def close(self) -> None:
        """Give the publishers back."""
        for publisher in self._publishers.values():
            destroy_publisher(self._node, publisher)

    def wanted(self) -> set[str]:
        """Return the topics that have subscribers now."""
        return {topic for topic, publisher in self._publishers.items() if publisher.get_subscription_count()}

    def say_unheard(self) -> None:
        """Say in the log which subscribers get nothing; see :class:`UnheardWatch`."""
        self._unheard.look()

    def publish(self, header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings) -> None:
        """Publish every wanted view of a shot under one header."""
        for topic, message in result_messages(header, sensor, shot, output, self.wanted()):
            self._publishers[topic].publish(message)
