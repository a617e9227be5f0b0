"""Records topics into a rosbag2 folder (MCAP or SQLite), bytes as they came over the wire."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_typestore

from moire_sensor.errors import SettingsError
from moire_sensor.ros.bag_topics import BagTopic, message_class, topics_named
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.parameters import ParameterSpec, declare, refuse_unknown

BAG_VERSION: Literal[9] = 9  # of ROS 2 Jazzy
# One second of a 10 Hz head: what may arrive while the disk is busy.
QUEUE_DEPTH = 10
LOOK_FOR_PUBLISHERS_S = 0.1
STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
PARAMETERS = (
    ParameterSpec("folder", "bag", "folder to write, which must not exist", read_only=True),
    ParameterSpec("topics", "head results", "topic names, head or results, separated by spaces", read_only=True),
    ParameterSpec("storage", "mcap", "storage format of the bag", choices=tuple(STORAGES), read_only=True),
)
USAGE = """
record_bag: records the head's topics and the results until Ctrl-C; the bag is then complete and readable.
usage: record_bag [--ros-args -p folder:=bag -p topics:="head results" -p storage:=mcap]
"""


class BagRecorder:
    """Writes every message of some topics, received through ``node``, until :meth:`close`.

    Parameters
    ----------
    node : spun by the caller; relative topic names are in its namespace.
    folder : the bag; must not exist yet.
    topics : what to record.
    storage : ``"mcap"`` or ``"sqlite3"``.

    Raises
    ------
    SettingsError
        The folder exists or cannot be written, or a message class that ROS 2 Jazzy does not define.
    """

    def __init__(self, node: Node, folder: Path, topics: Sequence[BagTopic], storage: str = "mcap") -> None:
        self.counts = {node.resolve_topic_name(topic.name): 0 for topic in topics}
        self._node = node
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self._writer = open_writer(folder, storage)
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
        package, _, kind = message.__module__.partition(".")
        type_name = f"{package}/{kind.partition('.')[0]}/{message.__name__}"
        if type_name not in self._typestore.fielddefs:
            raise SettingsError(f"topic {name} has type {type_name}; only message types of ROS 2 Jazzy can be recorded")
        write = partial(self._write, name, type_name)
        self._subscriptions.append(self._node.create_subscription(message, topic.name, write, quality, raw=True))

    def _write(self, name: str, type_name: str, serialized: bytes, info: dict[str, int]) -> None:
        connection = self._connections.get(name)
        if connection is None:
            offered = [bag_quality(one.qos_profile) for one in self._node.get_publishers_info_by_topic(name)]
            connection = self._writer.add_connection(
                name, type_name, typestore=self._typestore, offered_qos_profiles=offered
            )
            self._connections[name] = connection
        # When the middleware got it, not when this callback ran: callbacks of several topics run in any order.
        self._writer.write(connection, info["received_timestamp"], serialized)
        self.counts[name] += 1


def open_writer(folder: Path, storage: str) -> Writer:
    """Open a new bag, or raise SettingsError."""
    try:
        writer = Writer(folder, version=BAG_VERSION, storage_plugin=STORAGES[storage])
        writer.open()
    except (WriterError, OSError) as error:
        raise SettingsError(f"cannot write a bag to {folder}: {error}; choose a new folder") from error
    return writer


def offered_to_all(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strictest quality that every publisher offers, with room for what they keep for late subscribers."""
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=QUEUE_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def bag_quality(quality: QoSProfile) -> Qos:
    """Return an offered quality of service as the bag's metadata holds it."""
    durations = [
        QosTime(*divmod(duration.nanoseconds, 10**9))
        for duration in (quality.deadline, quality.lifespan, quality.liveliness_lease_duration)
    ]
    return Qos(
        history=QosHistory[quality.history.name],
        depth=quality.depth,
        reliability=QosReliability[quality.reliability.name],
        durability=QosDurability[quality.durability.name],
        deadline=durations[0],
        lifespan=durations[1],
        liveliness=QosLiveliness[quality.liveliness.name],
        liveliness_lease_duration=durations[2],
        avoid_ros_namespace_conventions=quality.avoid_ros_namespace_conventions,
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
        self._recorder = BagRecorder(self, Path(folder), topics_named(topics), storage)
        self.get_logger().info(f"recording to {folder}; Ctrl-C ends the bag")

    def close(self) -> None:
        """Complete the bag and tell what it holds."""
        if self._recorder is not None:
            self._recorder.close()
            counts = ", ".join(f"{name} {count}" for name, count in self._recorder.counts.items() if count)
            self.get_logger().info(f"the bag holds {counts or 'no message: did anything publish?'}")


def main() -> int:
    """Run the executable ``record_bag``; returns its exit code."""
    return run_node(RecordBagNode, USAGE)


if __name__ == "__main__":
    raise SystemExit(main())
