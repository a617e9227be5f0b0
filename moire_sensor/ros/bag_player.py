"""Publishes the messages of a bag again, bytes unchanged, with the quality of service they were recorded with."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_topics import message_class


@dataclass(frozen=True)
class BagMessage:
    """A recorded message: its topic, when it was recorded (nanoseconds), and its serialised bytes (CDR)."""

    topic: str
    time_ns: int
    serialized: bytes

    @property
    def stamp_ns(self) -> int:
        """Stamp of the header, nanoseconds; for messages that begin with one."""
        return header_stamp_ns(self.serialized)


class BagPlayer:
    """Offers the topics of a bag and publishes its messages when told.

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
        self.topics = frozenset(topics)
        self.publishers: dict[str, Any] = {}
        with open_bag(folder) as reader:
            for connection in reader.connections:
                if connection.topic in self.topics:
                    quality = recorded_quality(connection.ext.offered_qos_profiles)  # type: ignore[union-attr]
                    message = message_class(connection.msgtype)
                    self.publishers[connection.topic] = node.create_publisher(message, connection.topic, quality)
        if not self.publishers:
            raise CaptureError(f"the bag {folder} has none of the topics {', '.join(sorted(self.topics))}")

    def messages(self) -> Iterator[BagMessage]:
        """Yield the messages in the order they were recorded."""
        return (message for message in read_messages(self.folder) if message.topic in self.publishers)

    def publish(self, message: BagMessage) -> None:
        """Publish one message, bytes unchanged."""
        self.publishers[message.topic].publish(message.serialized)


def read_messages(folder: Path) -> Iterator[BagMessage]:
    """Yield all messages of a bag in the order they were recorded; raises CaptureError."""
    with open_bag(folder) as reader:
        for connection, time_ns, serialized in reader.messages():
            yield BagMessage(connection.topic, time_ns, bytes(serialized))


def open_bag(folder: Path) -> Reader:
    """Return a reader of a bag, to be used as a context, or raise CaptureError."""
    try:
        return Reader(folder)
    except (ReaderError, OSError) as error:
        raise CaptureError(f"cannot read the bag {folder}: {error}; give a rosbag2 folder") from error


def header_stamp_ns(serialized: bytes) -> int:
    """Stamp in nanoseconds of a serialised message that begins with a std_msgs/Header.

    CDR starts with four bytes, the second of which tells the byte order; then seconds and nanoseconds.
    """
    order = "<" if serialized[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(order + "iI", serialized, 4)
    return int(seconds) * 10**9 + int(nanoseconds)


def recorded_quality(offers: Collection[Qos]) -> QoSProfile:
    """Return the quality to publish with: latched and reliable where every recorded publisher was, keep 5 or more."""
    reliable = all(offer.reliability == QosReliability.RELIABLE for offer in offers)
    latched = bool(offers) and all(offer.durability == QosDurability.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max([5, *(offer.depth for offer in offers)]),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
