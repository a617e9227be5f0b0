"""Publishes the messages of a bag again, bytes unchanged, with the quality of service they were recorded with."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2.metadata import parse_qos

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_message import BagMessage
from moire_sensor.ros.bag_reader import Bag
from moire_sensor.ros.bag_topics import message_class

MAX_QUALITY_CHARACTERS = 1 << 16
LEAST_KEPT, MOST_KEPT = 5, 1000


class BagPlayer:
    """Offers the topics of a bag and publishes its messages when told; warns of what cannot be read.

    Parameters
    ----------
    node : publishes; topic names are those of the bag.
    folder : the bag.
    topics : full names of those to play; all others are left out.

    Raises
    ------
    CaptureError
        No readable bag there, or one without any of these topics.
    """

    def __init__(self, node: Node, folder: Path, topics: Collection[str]) -> None:
        self.folder = folder
        self.publishers: dict[str, Any] = {}
        self._node = node
        with Bag(folder) as bag:
            for topic in bag.topics.values():
                if topic.name in topics:
                    message = message_class(topic.type_name)
                    quality = recorded_quality(topic.qualities)
                    self.publishers[topic.name] = node.create_publisher(message, topic.name, quality)
        if not self.publishers:
            raise CaptureError(f"the bag {folder} has none of the topics {', '.join(sorted(topics))}")

    def messages(self) -> Iterator[BagMessage]:
        """Yield the messages in the order they were recorded."""
        with Bag(self.folder) as bag:
            yield from bag.messages(self.publishers)
            for damage in bag.damages:
                self._node.get_logger().warning(f"the bag {self.folder} is damaged: {damage}")

    def publish(self, message: BagMessage) -> None:
        """Publish one message, bytes unchanged."""
        self.publishers[message.topic].publish(message.serialized)


def recorded_quality(text: str) -> QoSProfile:
    """Return the quality to publish with: latched and reliable where every recorded publisher was, keep 5 or more.

    ``text`` : what the publishers offered, YAML as bags hold it; the default where it cannot be understood.
    """
    try:
        offers = parse_qos(yaml.safe_load(text) or []) if len(text) <= MAX_QUALITY_CHARACTERS else []
    except (yaml.YAMLError, RecursionError, KeyError, TypeError, AttributeError):
        offers = []
    reliable = all(offer.reliability == QosReliability.RELIABLE for offer in offers)
    latched = bool(offers) and all(offer.durability == QosDurability.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=min(MOST_KEPT, max([LEAST_KEPT, *(offer.depth for offer in offers)])),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
