"""Bags for tests: recorded once a session from the nodes as processes, and copies with something else about them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message
from ros_process import ros_node
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from moire_sensor.ros.bag_message import BagMessage
from moire_sensor.ros.bag_reader import Bag, read_messages
from moire_sensor.ros.bag_task import BagOutcome, BagTask
from moire_sensor.ros.bag_topics import HEAD_TOPICS, message_class
from moire_sensor.ros.reconstruction_settings import SPECS
from tools.demo.record import Run, record

DEPTH = "/head/depth/image_rect"
HEAD_NAMES = [f"/head/{topic.name}" for topic in HEAD_TOPICS]
# The queue holds every set, so that a slow machine supersedes none.
RECONSTRUCTION = ("queue_depth:=1000",)
VALUES = {spec.name: spec.default for spec in SPECS}
COMPRESSIONS = {mode.name.lower(): mode for mode in CompressionMode}
STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}


def record_run(folder: Path, method: str, steps: int, exposures: int, results: int) -> Path:
    """Record head and reconstruction, two processes, as the demo does; return the bag."""
    parameters = ("scene:=cylinder_and_box", f"phase_steps:={steps}", "rate_hz:=10.0", f"frames:={exposures}")
    with ros_node("recorder") as node:
        recording = record(Run("replay", "virtual_head", parameters, method, exposures, RECONSTRUCTION), node, folder)
    assert recording.counts["reconstructed"] == results
    return recording.bag


def task(source: Path, target: Path, **changes: Any) -> BagTask:
    """A task with the settings of the node's defaults."""
    return BagTask(source, target, {**VALUES, **changes.pop("values", {})}, **changes)


def decoded(bag: Path) -> list[tuple[str, int, Any]]:
    """Topic, record time and message; messages, since the bytes that fill gaps in serialised ones are not defined."""
    with Bag(bag) as opened:
        kinds = {topic.name: message_class(topic.type_name) for topic in opened.topics.values()}
    messages = read_messages(bag)
    return [(one.topic, one.time_ns, deserialize_message(one.serialized, kinds[one.topic])) for one in messages]


def of_topic(bag: Path, topic: str) -> list[Any]:
    """Messages of a topic in recorded order."""
    return [message for name, _, message in decoded(bag) if name == topic]


def write_bag(
    folder: Path,
    messages: Iterable[BagMessage],
    types: dict[str, str],
    storage: str = "mcap",
    compression: str = "none",
) -> Path:
    """Write a bag with the rosbags library; ``types`` of the messages by topic."""
    typestore = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(folder, version=9, storage_plugin=STORAGES[storage])
    writer.set_compression(COMPRESSIONS[compression], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for message in messages:
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(
                    message.topic, types[message.topic], typestore=typestore
                )
            writer.write(connections[message.topic], message.time_ns, message.serialized)
    return folder


def copy_bag(
    source: Path,
    folder: Path,
    change: Callable[[list[BagMessage]], Iterable[BagMessage]] = list,
    storage: str = "mcap",
    compression: str = "none",
) -> Path:
    """Write the head's messages of a bag again, perhaps changed."""
    with Bag(source) as bag:
        types = {topic.name: topic.type_name for topic in bag.topics.values()}
        messages = list(bag.messages(HEAD_NAMES))
    types |= {topic.replace("/head/", "/other/"): kind for topic, kind in types.items()}
    return write_bag(folder, change(messages), types, storage, compression)


def first_sets(count: int) -> Callable[[list[BagMessage]], list[BagMessage]]:
    """A change for copy_bag: the messages of the first exposures alone."""

    def change(messages: list[BagMessage]) -> list[BagMessage]:
        stamps = sorted({one.stamp_ns for one in messages if one.topic.endswith("projector/state")})[:count]
        return [one for one in messages if one.topic.endswith("description") or one.stamp_ns <= stamps[-1]]

    return change


def summary(outcome: BagOutcome) -> tuple[str, int, int]:
    """State, sets and results."""
    return outcome.state, outcome.sets, outcome.results
