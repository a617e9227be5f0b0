"""Recording and playing bags over real DDS."""

from __future__ import annotations

import resource
import signal
import sysconfig
from collections.abc import Iterable
from pathlib import Path

import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from ros_process import ros_node, spin_until, start, stop
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Image
from small_disk import start_on_small_disk
from std_msgs.msg import Header, String

from moire_sensor.errors import CaptureError, SettingsError
from moire_sensor.ros.bag_message import header_stamp_ns
from moire_sensor.ros.bag_player import BagPlayer
from moire_sensor.ros.bag_reader import Bag, read_messages
from moire_sensor.ros.bag_recorder import BagRecorder
from moire_sensor.ros.bag_topics import HEAD_TOPICS, RESULT_TOPICS, topics_named
from moire_sensor.ros.bag_writer import BagWriter, Limits
from moire_sensor.ros.result_messages import TOPICS

IMAGES: dict[int, bytes] = {}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def image(number: int) -> bytes:
    """A serialised image; bytes, for what fills its alignment gaps is not defined."""
    message = Image(height=2, width=3, encoding="mono8", step=3, data=bytes([number] * 6))
    message.header.stamp.sec, message.header.stamp.nanosec = 1_700_000_000 + number, 5 * number
    message.header.frame_id = "head_left_optical_frame"
    return IMAGES.setdefault(number, bytes(serialize_message(message)))


def publish_images(node: Node, count: int) -> None:
    """Publish latched text and ``count`` images once somebody listens to the images."""
    text = node.create_publisher(String, "robot_description", LATCHED)
    images = node.create_publisher(Image, "left/image_raw", 5)
    text.publish(String(data="<robot/>"))
    spin_until(node, lambda: images.get_subscription_count() > 0, "a subscriber of left/image_raw")
    for number in range(count):
        images.publish(image(number))


def record(folder: Path, count: int, storage: str = "mcap") -> None:
    with ros_node("source") as node:
        recorder = BagRecorder(node, folder, HEAD_TOPICS, storage)
        publish_images(node, count)
        wanted = {"/head/robot_description": 1, "/head/left/image_raw": count}
        spin_until(node, lambda: wanted.items() <= recorder.counts.items(), f"{wanted} in the bag")
        recorder.close()


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_bag_holds_the_bytes_types_and_qualities(tmp_path: Path, storage: str) -> None:
    record(tmp_path / "bag", 3, storage)
    recorded = list(read_messages(tmp_path / "bag"))
    images = [message for message in recorded if message.topic == "/head/left/image_raw"]
    assert [message.serialized for message in images] == [image(n) for n in range(3)]
    assert [message.stamp_ns for message in images] == [(1_700_000_000 + n) * 10**9 + 5 * n for n in range(3)]
    with Reader(tmp_path / "bag") as reader:
        topics = {connection.topic: connection for connection in reader.connections}
        assert topics["/head/left/image_raw"].msgtype == "sensor_msgs/msg/Image"
        assert "uint32 height" in topics["/head/left/image_raw"].msgdef.data
        assert topics["/head/robot_description"].ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        assert topics["/head/left/image_raw"].ext.offered_qos_profiles[0].durability.name == "VOLATILE"
        assert reader.message_count == 4


def test_bag_is_readable_with_its_own_message_definitions(tmp_path: Path) -> None:
    record(tmp_path / "bag", 1)
    typestore = get_typestore(Stores.ROS2_JAZZY)
    with Reader(tmp_path / "bag") as reader:
        connection = next(one for one in reader.connections if one.topic == "/head/left/image_raw")
        serialized = next(raw for one, _, raw in reader.messages([connection]))
        message = typestore.deserialize_cdr(serialized, connection.msgtype)
    assert (message.height, message.width, message.encoding) == (2, 3, "mono8")  # type: ignore[attr-defined]


def test_played_bag_gives_the_same_bytes_and_latched_text_to_latecomers(tmp_path: Path) -> None:
    record(tmp_path / "bag", 3)
    got: dict[str, list[bytes]] = {"left/image_raw": [], "robot_description": []}
    with ros_node("listener") as node:
        player = BagPlayer(node, tmp_path / "bag", ["/head/left/image_raw", "/head/robot_description"])
        node.create_subscription(Image, "left/image_raw", got["left/image_raw"].append, 5, raw=True)
        images = player.publishers["/head/left/image_raw"]
        spin_until(node, lambda: images.get_subscription_count() > 0, "the subscription to match")
        for message in player.messages():
            player.publish(message)
        node.create_subscription(String, "robot_description", got["robot_description"].append, LATCHED, raw=True)
        spin_until(node, lambda: len(got["left/image_raw"]) == 3 and bool(got["robot_description"]), "all messages")
    assert got["left/image_raw"] == [image(n) for n in range(3)]
    assert got["robot_description"] == [bytes(serialize_message(String(data="<robot/>")))]


def test_closing_writes_what_has_arrived(tmp_path: Path) -> None:
    with ros_node("source") as node:
        recorder = BagRecorder(node, tmp_path / "bag", HEAD_TOPICS)
        images = node.create_publisher(Image, "left/image_raw", 10)
        spin_until(node, lambda: images.get_subscription_count() > 0, "the recorder's subscription")
        for number in range(5):
            images.publish(image(number))
        assert images.wait_for_all_acked()
        assert recorder.counts["/head/left/image_raw"] == 0
        recorder.close()
    assert [message.serialized for message in read_messages(tmp_path / "bag")] == [image(n) for n in range(5)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_record_bag_ends_with_a_readable_bag(tmp_path: Path, number: signal.Signals) -> None:
    process = start("record_bag", f"folder:={tmp_path / 'bag'}", "topics:=head")
    try:
        with ros_node("source") as node:
            publish_images(node, 4)
            images = next(one for one in node.publishers if one.topic_name == "/head/left/image_raw")
            assert images.wait_for_all_acked()
        code, output = stop(process, number)
    finally:
        process.kill()
    assert code == 0, output
    assert "Traceback" not in output
    assert sum(message.topic == "/head/left/image_raw" for message in read_messages(tmp_path / "bag")) == 4


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (["storage:=tape"], "storage is 'tape'; allowed are mcap, sqlite3"),
        (["folder:=/proc/no/bag"], "cannot write a bag to /proc/no/bag"),
        (["topics:=''"], "topics is empty"),
        (["folders:=x"], "unknown parameter folders; did you mean folder?"),
    ],
)
def test_record_bag_refuses_in_one_line(tmp_path: Path, parameters: list[str], message: str) -> None:
    folder = [] if "folder:" in parameters[0] else [f"folder:={tmp_path / 'bag'}"]
    process = start("record_bag", *folder, *parameters)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1
    assert message in output
    assert output.count("\n") == 1


def test_existing_folder_is_kept(tmp_path: Path) -> None:
    with ros_node("source") as node, pytest.raises(SettingsError, match="choose a new folder"):
        BagRecorder(node, tmp_path, HEAD_TOPICS)


def test_player_refuses_what_is_no_bag_and_unknown_topics(tmp_path: Path) -> None:
    with ros_node("player") as node:
        with pytest.raises(CaptureError, match="cannot read the bag"):
            BagPlayer(node, tmp_path / "none", ["/head/left/image_raw"])
        record_folder = tmp_path / "bag"
    record(record_folder, 1)
    with ros_node("player") as node, pytest.raises(CaptureError, match="has none of the topics /other"):
        BagPlayer(node, record_folder, ["/other"])


def test_topic_groups() -> None:
    assert topics_named("head") == HEAD_TOPICS
    assert topics_named("head, results") == HEAD_TOPICS + RESULT_TOPICS
    assert set(TOPICS) <= {topic.name for topic in RESULT_TOPICS}
    assert [topic.name for topic in topics_named("left/image_raw tf")] == ["left/image_raw", "tf"]
    assert topics_named("left/image_raw")[0].message is Image


def test_stamp_of_both_byte_orders() -> None:
    header = Header(frame_id="x")
    header.stamp.sec, header.stamp.nanosec = 7, 9
    assert header_stamp_ns(bytes(serialize_message(header))) == 7_000_000_009
    assert header_stamp_ns(b"\0\0\0\0" + (7).to_bytes(4, "big") + (9).to_bytes(4, "big")) == 7_000_000_009


@pytest.mark.parametrize(("part_mb", "reserve_mb"), [(1024, 4), (2, 1)])
def test_full_disk_ends_the_recording_with_a_readable_bag(tmp_path: Path, part_mb: int, reserve_mb: int) -> None:
    disk = tmp_path / "disk"
    command = [str(Path(sysconfig.get_path("scripts")) / "record_bag"), "--ros-args"]
    for parameter in (f"folder:={disk}/bag", "topics:=head", f"part_mb:={part_mb}", f"reserve_mb:={reserve_mb}"):
        command += ["-p", parameter]
    process = start_on_small_disk(disk, 12, command)
    with ros_node("source") as node:
        images = node.create_publisher(Image, "left/image_raw", 5)
        big = Image(height=1000, width=1000, encoding="mono8", step=1000, data=bytes(10**6))
        spin_until(node, lambda: images.get_subscription_count() > 0, "a subscriber of left/image_raw")

        def publish_more() -> bool:
            images.publish(big)
            return process.poll() is not None

        spin_until(node, publish_more, "the disk to be full")
    output = process.communicate()[0]
    assert process.returncode == 1, output
    assert f"error: the disk of {disk}/bag is full" in output
    assert "Traceback" not in output
    # 12 MB, less what is kept free, in messages of 1 MB; the next would not have fitted.
    recorded = list(read_messages(disk / "bag"))
    assert 12 - reserve_mb - 3 <= len(recorded) <= 12 - reserve_mb
    assert all(message.serialized[-(10**6) :] == bytes(10**6) for message in recorded)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_what_cannot_be_written_costs_only_the_last_part(tmp_path: Path, storage: str) -> None:
    """A limit on the size of files: the system refuses the very write, as a quota does."""
    writer = BagWriter(tmp_path / "bag", storage, Limits(part_bytes=1, reserve_bytes=1))
    data = bytes(serialize_message(Image(data=bytes(300_000))))

    def write(numbers: Iterable[int]) -> None:
        for number in numbers:
            writer.write("/image", "sensor_msgs/msg/Image", [QoSProfile(depth=5)], number, data)
        writer.commit()

    for number in range(3):
        write([number])
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, old[1]))
    try:
        with pytest.raises(CaptureError, match="its 3 complete parts are whole"):
            write(range(3, 60))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    with Bag(tmp_path / "bag") as bag:
        times = [message.time_ns for message in bag.messages()]
        assert times[:3] == [0, 1, 2]
        assert times == list(range(len(times)))
        # An MCAP file is readable as far as it goes; a database that was not closed in order holds nothing.
        assert len(times) > 3 or storage == "sqlite3"
        assert any("was broken off while it was written" in damage for damage in bag.damages)


def test_a_killed_recorder_leaves_a_readable_bag(tmp_path: Path) -> None:
    process = start("record_bag", f"folder:={tmp_path / 'bag'}", "topics:=head", "part_mb:=1")
    try:
        with ros_node("source") as node:
            images = node.create_publisher(Image, "left/image_raw", 5)
            spin_until(node, lambda: images.get_subscription_count() > 0, "a subscriber of left/image_raw")
            message = Image(height=600, width=1000, encoding="mono8", step=1000, data=bytes(600_000))

            def two_parts() -> bool:
                images.publish(message)
                return (tmp_path / "bag" / "bag_1.mcap").exists()

            spin_until(node, two_parts, "two parts of the bag")
    finally:
        process.kill()
        process.communicate()
    with Bag(tmp_path / "bag") as bag:
        assert sum(1 for _ in bag.messages()) >= 4
