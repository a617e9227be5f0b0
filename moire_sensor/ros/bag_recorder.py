"""Records topics into a rosbag2 folder (MCAP or SQLite), bytes as they came over the wire."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from moire_sensor.errors import MoireError, SettingsError
from moire_sensor.ros.bag_topics import BagTopic, message_class, topics_named, type_name_of
from moire_sensor.ros.bag_writer import MEGABYTE, STORAGES, BagWriter, Limits
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.parameters import ParameterSpec, declare, help_text, refuse_unknown

# One second of a 10 Hz head: what may arrive while the disk is busy.
QUEUE_DEPTH = 10
LOOK_FOR_PUBLISHERS_S = 0.1
PARAMETERS = (
    ParameterSpec("folder", "bag", "folder to write, which must not exist", read_only=True),
    ParameterSpec("topics", "head results", "topic names, head or results, separated by spaces", read_only=True),
    ParameterSpec("storage", "mcap", "storage format of the bag", choices=tuple(STORAGES), read_only=True),
    ParameterSpec(
        "part_mb", 1024, "size of a part, which is readable whatever happens later, MB", 1, 1 << 20, read_only=True
    ),
    ParameterSpec("reserve_mb", 64, "free disk space at which recording ends, MB", 1, 1 << 20, read_only=True),
)
USAGE = """
record_bag: records the head's topics and the results until Ctrl-C; the bag is then complete and readable.
usage: record_bag [--ros-args -p folder:=bag -p topics:="head results" -p storage:=mcap -p reserve_mb:=64]
Ends by itself, with exit code 1, when less than reserve_mb of disk space is left; the bag so far is complete.
"""


class BagRecorder:
    """Writes every message of some topics, received through ``node``, until :meth:`close`.

    Parameters
    ----------
    node : spun by the caller; relative topic names are in its namespace.
    folder : the bag; must not exist yet.
    topics : what to record.
    storage : ``"mcap"`` or ``"sqlite3"``.
    limits : size of a part of the bag, and the free space that is kept.

    Raises
    ------
    SettingsError
        The folder exists or cannot be written, or a message class that ROS 2 Jazzy does not define.
    CaptureError
        In a callback: the disk is full, and nothing is recorded from then on.
    """

    def __init__(
        self, node: Node, folder: Path, topics: Sequence[BagTopic], storage: str = "mcap", limits: Limits | None = None
    ) -> None:
        self.counts = {node.resolve_topic_name(topic.name): 0 for topic in topics}
        self._node = node
        self._qualities: dict[str, list[QoSProfile]] = {}
        self._writer = BagWriter(folder, storage, limits)
        self._broken = False
        self._waiting: list[BagTopic] = []
        self._subscriptions: list[Any] = []
        for topic in topics:
            if topic.message is None or topic.latched:
                self._waiting.append(topic)
            else:
                self._subscribe(topic, topic.message, QoSProfile(depth=QUEUE_DEPTH))
        self._timer = node.create_timer(LOOK_FOR_PUBLISHERS_S, self._look_for_publishers)
        self._look_for_publishers()

    def close(self) -> None:
        """Write what has arrived but was not handled yet, then the index; the bag is then complete."""
        self._timer.cancel()
        for subscription in self._subscriptions:
            with subscription.handle:
                while taken := subscription.handle.take_message(subscription.msg_type, subscription.raw):
                    subscription.callback(*taken)
            self._node.destroy_subscription(subscription)
        self._writer.commit()
        self._writer.close()

    def _look_for_publishers(self) -> None:
        """Subscribe to the waiting topics that have a publisher, as it offers them."""
        for topic in list(self._waiting):
            publishers = self._node.get_publishers_info_by_topic(topic.name)
            if publishers:
                message = topic.message or message_class(publishers[0].topic_type)
                self._subscribe(topic, message, offered_to_all([one.qos_profile for one in publishers]))
                self._waiting.remove(topic)

    def _subscribe(self, topic: BagTopic, message: Any, quality: QoSProfile) -> None:
        name = self._node.resolve_topic_name(topic.name)
        type_name = type_name_of(message)
        if not self._writer.knows(type_name):
            raise SettingsError(f"topic {name} has type {type_name}; only message types of ROS 2 Jazzy can be recorded")
        write = partial(self._write, name, type_name)
        self._subscriptions.append(self._node.create_subscription(message, topic.name, write, quality, raw=True))

    def _write(self, name: str, type_name: str, serialized: bytes, info: dict[str, int]) -> None:
        if self._broken:
            return
        if name not in self._qualities:
            self._qualities[name] = [one.qos_profile for one in self._node.get_publishers_info_by_topic(name)]
        try:
            # When the middleware got it, not when this callback ran: callbacks of several topics run in any order.
            self._writer.ensure_room(len(serialized))
            self._writer.write(name, type_name, self._qualities[name], info["received_timestamp"], serialized)
            if self._writer.is_due:
                self._writer.commit()
        except MoireError:
            self._broken = True
            raise
        self.counts[name] += 1


def offered_to_all(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strictest quality that every publisher offers, with room for what they keep for late subscribers."""
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=QUEUE_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class RecordBagNode(Node):
    """Records until it is closed."""

    def __init__(self) -> None:
        super().__init__("record_bag", namespace="head")
        self._values = declare(self, PARAMETERS)
        refuse_unknown(self)
        self._recorder: BagRecorder | None = None
        # A signal may break off the constructor anywhere; a bag begun in the first callback is always completed.
        self._begin = self.create_timer(0.0, self._record)

    def _record(self) -> None:
        self._begin.cancel()
        folder, topics, storage = (self._values[name] for name in ("folder", "topics", "storage"))
        limits = Limits(self._values["part_mb"] * MEGABYTE, self._values["reserve_mb"] * MEGABYTE)
        self._recorder = BagRecorder(self, Path(folder), topics_named(topics), storage, limits)
        self.get_logger().info(f"recording to {folder}; Ctrl-C ends the bag")

    def close(self) -> None:
        """Complete the bag and tell what it holds."""
        if self._recorder is not None:
            self._recorder.close()
            counts = ", ".join(f"{name} {count}" for name, count in self._recorder.counts.items() if count)
            self.get_logger().info(f"the bag holds {counts or 'no message: did anything publish?'}")


def main() -> int:
    """Run the executable ``record_bag``; returns its exit code."""
    return run_node(RecordBagNode, USAGE + help_text(PARAMETERS))


if __name__ == "__main__":
    raise SystemExit(main())
