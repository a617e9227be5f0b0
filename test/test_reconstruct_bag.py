"""Bags reconstructed offline: the node's bits, nothing lost or repeated by interruptions, the unreadable named."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bag_runs import DEPTH, HEAD_NAMES, copy_bag, decoded, first_sets, of_topic, summary, task
from rosbags.rosbag2 import Reader

from moire_sensor.ros.bag_message import BagMessage
from moire_sensor.ros.bag_metadata import read_metadata
from moire_sensor.ros.bag_reader import read_messages
from moire_sensor.ros.bag_reconstruction import reconstruct_bag
from moire_sensor.ros.bag_task import DEFAULT_TOPICS
from moire_sensor.ros.bag_writer import MEGABYTE, Limits

SMALL_PARTS = Limits(part_bytes=12 * MEGABYTE, reserve_bytes=MEGABYTE)
LIVE = ("depth/image_rect", "depth/camera_info", "fringe_order/image", "status/image")
EDIT = Callable[[list[BagMessage]], list[BagMessage]]


@pytest.fixture(scope="module")
def results(dense_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recorded bag, reconstructed in one go."""
    target = tmp_path_factory.mktemp("results") / "run"
    assert summary(reconstruct_bag(task(dense_bag, target))) == ("whole", 10, 10)
    return target


@pytest.fixture(scope="module")
def three_sets(dense_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The head's messages of three exposures."""
    return copy_bag(dense_bag, tmp_path_factory.mktemp("three") / "bag", first_sets(3))


def same(old: list[tuple[str, int, Any]], new: list[tuple[str, int, Any]]) -> bool:
    """Tell whether two bags hold the same messages, whatever the order within one instant."""
    return sorted(old, key=lambda one: one[:2]) == sorted(new, key=lambda one: one[:2])


@pytest.mark.parametrize("method", ["dense", "phase_shift"])
def test_results_have_the_bits_of_the_node(request: pytest.FixtureRequest, tmp_path: Path, method: str) -> None:
    bag = request.getfixturevalue(f"{method}_bag")
    target = request.getfixturevalue("results") if method == "dense" else tmp_path / "out"
    if method != "dense":
        assert reconstruct_bag(task(bag, target, values={"method": method})).results == 3
    for topic in LIVE:
        live, offline = of_topic(bag, f"/head/{topic}"), of_topic(target, f"/head/{topic}")
        assert len(live) >= 3
        assert offline == live


def test_written_bag_holds_what_others_need(dense_bag: Path, results: Path) -> None:
    with Reader(results) as reader:
        topics = {connection.topic: connection for connection in reader.connections}
        counts = Counter(connection.topic for connection, _, _ in reader.messages())
        assert reader.message_count == sum(counts.values())
        for connection in reader.connections:
            assert connection.digest.startswith("RIHS01_")
            assert connection.msgdef.data
            assert connection.msgcount == counts[connection.topic]
        quality = topics[DEPTH].ext.offered_qos_profiles[0]
        assert (quality.reliability.name, quality.durability.name, quality.depth) == ("RELIABLE", "VOLATILE", 5)
        latched = topics["/head/robot_description"].ext.offered_qos_profiles[0]
        assert latched.durability.name == "TRANSIENT_LOCAL"
    expected = {f"/head/{topic}" for topic in DEFAULT_TOPICS}
    assert set(topics) == expected | {"/diagnostics", "/head/robot_description", "/head/joint_states"}
    assert {counts[topic] for topic in expected} == {10}
    # Beside the bag it came from, both can be played together.
    recorded = {one.stamp_ns: one.time_ns for one in read_messages(dense_bag) if one.topic in HEAD_NAMES[1:7]}
    written = {one.stamp_ns: one.time_ns for one in read_messages(results) if one.topic == DEPTH}
    assert written == {stamp_ns: recorded[stamp_ns] for stamp_ns in written}


def test_diagnostics_are_those_of_the_node_in_the_time_of_the_bag(dense_bag: Path, results: Path) -> None:
    reports = of_topic(results, "/diagnostics")
    live = next(one for one in reversed(of_topic(dense_bag, "/diagnostics")) if one.status[0].name[:5] == "recon")
    assert {one.name for one in reports[-1].status} == {one.name for one in live.status}
    assert {one.hardware_id for one in reports[-1].status} == {"/head/reconstruction"}
    values = {pair.key: pair.value for one in reports[-1].status for pair in one.values}
    assert (values["matched"], values["reconstructed"]) == ("10", "10")
    last = max(one.time_ns for one in read_messages(dense_bag) if one.topic in HEAD_NAMES)
    assert reports[-1].header.stamp.sec == last // 10**9


def test_interrupted_runs_go_on_where_they_were(dense_bag: Path, tmp_path: Path) -> None:
    bag = copy_bag(dense_bag, tmp_path / "bag", first_sets(5))
    whole = task(bag, tmp_path / "whole")
    assert summary(reconstruct_bag(whole)) == ("whole", 5, 5)
    work = task(bag, tmp_path / "out", limits=SMALL_PARTS)
    for after in (1, 3):
        begun: list[int] = []
        outcome = reconstruct_bag(work, begun.append, lambda after=after, begun=begun: len(begun) >= after)  # type: ignore[misc]
        assert outcome.state == "interrupted"
        assert outcome.results in (after - 1, after)
        # What was written so far is a whole bag, and playable.
        assert len(of_topic(work.target, DEPTH)) == outcome.results
    assert summary(reconstruct_bag(work)) == ("whole", 5, 5)
    assert same(decoded(whole.target), decoded(work.target))
    before = {path: path.stat().st_mtime_ns for path in work.target.iterdir()}
    again = reconstruct_bag(work)
    assert (*summary(again), again.done_before) == ("whole", 5, 5, True)
    assert {path: path.stat().st_mtime_ns for path in work.target.iterdir()} == before


@pytest.mark.parametrize("moved", [False, True])
def test_a_part_folder_without_its_file_is_no_obstacle(three_sets: Path, tmp_path: Path, moved: bool) -> None:
    # What a kill leaves between the folder of a part and its file, or between moving the file and naming it.
    work = task(three_sets, tmp_path / "out", limits=SMALL_PARTS)
    begun: list[int] = []
    assert reconstruct_bag(work, begun.append, lambda: len(begun) >= 1).state == "interrupted"
    parts = len(list(work.target.glob("*.mcap")))
    folder = work.target / f"out_{parts}"
    folder.mkdir()
    if moved:
        (folder / "metadata.yaml").write_text("of a part")
        (work.target / f"out_{parts}.mcap").write_bytes(b"a part that no metadata names")
    outcome = reconstruct_bag(work)
    assert summary(outcome) == ("whole", 3, 3), outcome.error
    assert len(of_topic(work.target, DEPTH)) == 3


def test_interrupted_phase_shift_keeps_its_frames(phase_shift_bag: Path, tmp_path: Path) -> None:
    work = task(phase_shift_bag, tmp_path / "out", values={"method": "phase_shift"})
    whole = replace(work, target=tmp_path / "whole")
    assert reconstruct_bag(whole).results == 3
    for after in (2, 6):
        begun: list[int] = []
        reconstruct_bag(work, begun.append, lambda after=after, begun=begun: len(begun) >= after)  # type: ignore[misc]
    assert reconstruct_bag(work).results == 3
    assert same(decoded(whole.target), decoded(work.target))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"values": {"min_amplitude": 9.0}}, "was made with another min_amplitude"),
        ({"topics": ("points",)}, "was made with another topics"),
        ({"storage": "sqlite3"}, "was made with another storage"),
    ],
)
def test_results_of_something_else_are_not_continued(
    dense_bag: Path, results: Path, changes: dict[str, Any], says: str
) -> None:
    outcome = reconstruct_bag(task(dense_bag, results, **changes))
    assert outcome.state == "failed"
    assert says in outcome.error


def test_nothing_of_others_is_overwritten(dense_bag: Path, three_sets: Path, results: Path, tmp_path: Path) -> None:
    assert "was made from another bag" in reconstruct_bag(task(three_sets, results)).error
    content = sorted(dense_bag.iterdir())
    assert "holds something else" in reconstruct_bag(task(three_sets, dense_bag)).error
    assert sorted(dense_bag.iterdir()) == content
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "bag_0.mcap").write_text("mine")
    assert "holds something else" in reconstruct_bag(task(three_sets, tmp_path / "notes")).error
    assert (tmp_path / "notes" / "bag_0.mcap").read_text() == "mine"


def test_two_runs_do_not_write_into_one_folder(three_sets: Path, tmp_path: Path) -> None:
    work = task(three_sets, tmp_path / "out", topics=("depth/image_rect",))
    errors: list[str] = []
    outcome = reconstruct_bag(work, lambda _: errors.append(reconstruct_bag(work).error))
    assert summary(outcome) == ("whole", 3, 3)
    assert len(errors) == 3
    assert all("somebody else is writing" in error for error in errors)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_either_storage_can_be_written(three_sets: Path, results: Path, tmp_path: Path, storage: str) -> None:
    work = task(three_sets, tmp_path / "out", storage=storage, topics=("depth/image_rect",), limits=Limits(1, MEGABYTE))
    assert summary(reconstruct_bag(work)) == ("whole", 3, 3)
    assert of_topic(work.target, DEPTH) == of_topic(results, DEPTH)[:3]
    assert len(read_metadata(work.target).files) > 3
    with Reader(work.target) as reader:
        assert sum(connection.topic == DEPTH for connection, _, _ in reader.messages()) == 3


def later(messages: list[BagMessage], seconds: int) -> list[BagMessage]:
    """The same messages recorded later."""
    return [replace(one, time_ns=one.time_ns + seconds * 10**9) for one in messages]


def test_stamps_that_jump_back_start_anew(dense_bag: Path, results: Path, tmp_path: Path) -> None:
    loops = 2

    def looped(messages: list[BagMessage]) -> list[BagMessage]:
        return [one for number in range(loops) for one in later(messages, 100 * number)]

    bag = copy_bag(dense_bag, tmp_path / "bag", lambda messages: looped(first_sets(9)(messages)))
    work = task(bag, tmp_path / "out", topics=("depth/image_rect",))
    assert summary(reconstruct_bag(work)) == ("whole", 9 * loops, 9 * loops)
    assert of_topic(work.target, DEPTH) == of_topic(results, DEPTH)[:9] * loops


def test_messages_that_come_twice_count_once(three_sets: Path, tmp_path: Path) -> None:
    bag = copy_bag(three_sets, tmp_path / "bag", lambda messages: [one for one in messages for _ in range(2)])
    work = task(bag, tmp_path / "out", topics=("depth/image_rect",))
    assert summary(reconstruct_bag(work)) == ("whole", 3, 3)


def damaged_image(edit: Callable[[bytearray], object]) -> EDIT:
    """A change for copy_bag: the second left image edited, of 640x480 bytes behind their number."""

    def change(messages: list[BagMessage]) -> list[BagMessage]:
        found = [number for number, one in enumerate(messages) if one.topic == "/head/left/image_raw"][1]
        data = bytearray(messages[found].serialized)
        edit(data)
        messages[found] = replace(messages[found], serialized=bytes(data))
        return messages

    return change


def claim_pixels(data: bytearray) -> None:
    struct.pack_into("<I", data, len(data) - 640 * 480 - 4, 0xFFFF_FFF0)


def claim_rows(data: bytearray) -> None:
    offset = data.index(struct.pack("<II", 480, 640))
    struct.pack_into("<I", data, offset, 0x7FFF_FFFF)


def test_an_image_that_claims_more_than_it_holds_is_named(three_sets: Path, tmp_path: Path) -> None:
    bag = copy_bag(three_sets, tmp_path / "bag", damaged_image(claim_pixels))
    outcome = reconstruct_bag(task(bag, tmp_path / "out"))
    assert summary(outcome) == ("damaged", 2, 2)
    assert outcome.damages == ["1 messages of /head/left/image_raw cannot be decoded"]


def test_an_image_of_absurd_size_is_refused_and_counted(three_sets: Path, tmp_path: Path) -> None:
    bag = copy_bag(three_sets, tmp_path / "bag", damaged_image(claim_rows))
    outcome = reconstruct_bag(task(bag, tmp_path / "out"))
    assert summary(outcome) == ("whole", 3, 2)
    assert outcome.refused == {"bad image": 1}


def test_a_truncated_bag_gives_what_is_left(dense_bag: Path, results: Path, tmp_path: Path) -> None:
    bag = copy_bag(dense_bag, tmp_path / "bag", first_sets(5))
    with (bag / "bag.mcap").open("r+b") as stream:
        stream.truncate(2_000_000)
    work = task(bag, tmp_path / "out", topics=("depth/image_rect",))
    outcome = reconstruct_bag(work)
    # 2 MB hold three sets of two images of 307 kB each.
    assert summary(outcome) == ("damaged", 3, 3)
    assert of_topic(work.target, DEPTH) == of_topic(results, DEPTH)[:3]
    assert any(text.startswith("bag.mcap: no whole record at byte") for text in outcome.damages)
    assert "3 of 5 messages of /head/right/image_raw are there" in outcome.damages
    again = reconstruct_bag(work)
    assert (again.state, again.done_before, again.damages) == ("damaged", True, outcome.damages)


def test_two_heads_in_one_bag_are_both_reconstructed(three_sets: Path, results: Path, tmp_path: Path) -> None:
    def twice(messages: list[BagMessage]) -> list[BagMessage]:
        others = [replace(one, topic=one.topic.replace("/head/", "/other/")) for one in messages]
        return [one for pair in zip(messages, others, strict=True) for one in pair]

    bag = copy_bag(three_sets, tmp_path / "bag", twice)
    work = task(bag, tmp_path / "out", topics=("depth/image_rect",))
    assert summary(reconstruct_bag(work)) == ("whole", 6, 6)
    for name in ("head", "other"):
        assert of_topic(work.target, f"/{name}/depth/image_rect") == of_topic(results, DEPTH)[:3]
    assert {one.hardware_id for one in of_topic(work.target, "/diagnostics")[-1].status} == {
        "/head/reconstruction", "/other/reconstruction",
    }  # fmt: skip


def without(topic: str) -> EDIT:
    """A change for copy_bag: one topic left out."""
    return lambda messages: [one for one in messages if one.topic != f"/head/{topic}"]


@pytest.mark.parametrize(
    ("topic", "says"),
    [
        ("projector/state", "has no head: left/image_raw, right/image_raw and projector/state in one namespace"),
        ("left/camera_info", "no set could be reconstructed of 3: no camera info 3"),
    ],
)
def test_a_bag_that_lacks_a_topic_fails_with_a_reason(three_sets: Path, tmp_path: Path, topic: str, says: str) -> None:
    bag = copy_bag(three_sets, tmp_path / "bag", without(topic))
    outcome = reconstruct_bag(task(bag, tmp_path / "out"))
    assert outcome.state == "failed"
    assert says in outcome.error
