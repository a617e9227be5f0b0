"""Faults of the head as the reconstruction sees them, over DDS: bad calibration, late and jumping stamps, damage."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_head import Exposure, TestHead, pixels, running, stamp_of, time_of
from ros_mutations import damaged
from ros_process import ros_node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from moire_sensor.paper_rig import PROJECTOR_SIZE
from moire_sensor.ros.camera_messages import camera_infos
from moire_sim.analytic_scenes import analytic_capture

DEPTH = "depth/image_rect"
CAPTURE = analytic_capture("plane_1000")
WIDE = analytic_capture("plane_1000", bits=16)
# What a process compiles, or keeps once, comes in the first batches; a leak comes in each.
BATCHES, DAMAGED = 4, 100
KEPT_BYTES = 5_000_000
# Large blocks of the node's memory go back to the system once freed, so that a hole between two blocks is no leak.
ALLOCATOR = {"MALLOC_ARENA_MAX": "1", "MALLOC_MMAP_THRESHOLD_": "65536"}
# Fewer than the subscriptions' queues hold.
SENT_AT_ONCE = 6


@pytest.fixture(scope="module")
def head() -> Iterator[TestHead]:
    parameters = ("reliable_input:=true", "queue_depth:=50", "diagnostics_period_s:=0.1")
    with pytest.MonkeyPatch.context() as environment, ros_node("test_head") as node:
        for name, value in ALLOCATOR.items():
            environment.setenv(name, value)
        with running("reconstruction", *parameters) as child:
            under_test = TestHead(node)
            under_test.listen(DEPTH, Image)
            under_test.wait_for_subscribers()
            under_test.process = child  # type: ignore[attr-defined]
            yield under_test


def good_depth(head: TestHead) -> Any:
    """Send a good set; its depth, which shows that the node goes on."""
    return pixels(head.answer(DEPTH, head.send(Exposure.of(CAPTURE))))


def zeroed(infos: dict[str, CameraInfo]) -> None:
    for field in ("k", "r", "p"):
        setattr(infos["left"], field, [0.0] * len(getattr(infos["left"], field)))


def baseline(factor: float) -> Callable[[dict[str, CameraInfo]], None]:
    def change(infos: dict[str, CameraInfo]) -> None:
        p = list(infos["right"].p)
        p[3] *= factor
        infos["right"].p = p

    return change


def other_size(infos: dict[str, CameraInfo]) -> None:
    infos["right"].width, infos["right"].height = 1280, 960


def enormous(infos: dict[str, CameraInfo]) -> None:
    for info in (infos["left"], infos["right"]):
        info.width = info.height = 2**32 - 1


@pytest.mark.parametrize(
    ("change", "reason", "says"),
    [
        (zeroed, "bad calibration", "the left camera info is all zero, an uncalibrated device"),
        (baseline(0.0), "bad calibration", "it must be -fx * baseline_m"),
        (baseline(-1.0), "bad calibration", "P[3] = 117"),
        (other_size, "bad image", "the right image is 640x480 and right/camera_info is for 1280x960"),
        (enormous, "bad image", "left/camera_info is for 4294967295x4294967295"),
    ],
)
def test_a_bad_camera_info_is_refused_by_name_until_a_good_one_comes(
    head: TestHead, change: Callable[[dict[str, CameraInfo]], None], reason: str, says: str
) -> None:
    refused = head.count("reconstruction", f"refused: {reason}")
    infos = camera_infos(CAPTURE.rig, Header(), PROJECTOR_SIZE)
    change(infos)
    head.send_infos(infos)
    head.publish(head.messages(Exposure.of(CAPTURE)))
    head.wait_for_count("reconstruction", f"refused: {reason}", refused + 1)
    assert says in head.facts["reconstruction: reconstruction"][f"last refused: {reason}"]
    good_depth(head)


def test_big_endian_images_give_the_same_depth(head: TestHead) -> None:
    little = pixels(head.answer(DEPTH, head.send(Exposure.of(WIDE))))
    messages = head.messages(Exposure.of(WIDE))
    for side in ("left", "right"):
        image = messages[f"{side}/image_raw"]
        image.is_bigendian = 1
        image.data = np.frombuffer(image.data, "<u2").astype(">u2").tobytes()
    head.publish(messages)
    np.testing.assert_array_equal(pixels(head.answer(DEPTH, head.stamp)), little)


def test_a_state_of_another_stamp_drops_its_set_and_names_what_was_missing(head: TestHead) -> None:
    missing = head.count("input", "dropped: missing state")
    messages = head.messages(Exposure.of(CAPTURE))
    messages["projector/state"].header = Header(stamp=time_of(head.stamp + 1))
    head.publish(messages)
    for _ in range(3):
        good_depth(head)
    head.wait_for_count("input", "dropped: missing state", missing + 1)


def test_a_late_state_still_makes_its_set(head: TestHead) -> None:
    expected = good_depth(head)
    messages = head.messages(Exposure.of(CAPTURE))
    state = {"projector/state": messages.pop("projector/state")}
    head.publish(messages)
    reports = head.reports
    head.wait(lambda: head.reports >= reports + 3, "some reports without the state")
    assert not [one for one in head.received[DEPTH] if stamp_of(one) == head.stamp]
    head.publish(state)
    np.testing.assert_array_equal(pixels(head.answer(DEPTH, head.stamp)), expected)


def test_a_state_later_than_the_next_sets_is_superseded_not_mixed_up(head: TestHead) -> None:
    repeated = head.count("input", "repeated messages")
    messages = head.messages(Exposure.of(CAPTURE))
    late = head.stamp
    state = {"projector/state": messages.pop("projector/state")}
    head.publish(messages)
    for _ in range(3):
        good_depth(head)
    head.publish(state)
    good_depth(head)
    head.wait_for_count("input", "repeated messages", repeated + 1)
    assert late not in map(stamp_of, head.received[DEPTH])


def test_stamps_that_jump_back_and_forth_lose_no_whole_set(head: TestHead) -> None:
    """Each jump by more than the matcher remembers; forward jumps need no word, backward ones are counted."""
    jumps = head.count("input", "jumps back in time")
    begin, rng = head.stamp, random.Random(2)
    expected = good_depth(head)
    for back in range(1, 6):
        head.stamp = begin + rng.randrange(10**9, 10**12)
        np.testing.assert_array_equal(good_depth(head), expected)
        head.stamp = begin - back * 3600 * 10**9
        np.testing.assert_array_equal(good_depth(head), expected)
    head.stamp = begin + 10**13
    good_depth(head)
    head.wait_for_count("input", "jumps back in time", jumps + 5)


def resident_bytes(process_id: int) -> int:
    """Memory of a process that is in RAM."""
    lines = Path(f"/proc/{process_id}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:")) * 1024


def test_hundreds_of_damaged_sets_crash_nothing_leak_nothing_and_are_all_counted(head: TestHead) -> None:
    """Every set but those whose damage is no fault of the message is refused or dropped, with its reason."""
    rng = random.Random(11)
    process_id = head.process.pid  # type: ignore[attr-defined]
    grown = []
    for _ in range(BATCHES):
        good_depth(head)
        before = resident_bytes(process_id)
        for number in range(DAMAGED):
            infos = camera_infos(CAPTURE.rig, Header(), PROJECTOR_SIZE)
            sent: dict[str, Any] = {f"{device}/camera_info": info for device, info in infos.items()}
            sent |= head.messages(Exposure.of(CAPTURE))
            damaged(sent, rng)
            head.publish(sent)
            if number % SENT_AT_ONCE == 0:
                good_depth(head)
        good_depth(head)
        grown.append(resident_bytes(process_id) - before)
    assert min(grown[1:]) < KEPT_BYTES, grown
    check_account(head)


def check_account(head: TestHead) -> None:
    """Everything matched was reconstructed, refused for a reason that the project knows, or never wanted."""
    known = {"bad image", "bad projector state", "bad calibration", "bad settings", "laser off", "no camera info"}

    def settled() -> bool:
        facts = head.facts["reconstruction: reconstruction"]
        refused = {name: int(number) for name, number in facts.items() if name.startswith("refused: ")}
        assert {name.removeprefix("refused: ") for name in refused} <= known, facts
        return int(facts["matched"]) == int(facts["reconstructed"]) + sum(refused.values())

    head.wait(settled, "matched = reconstructed + refused")
    refused = head.facts["reconstruction: reconstruction"]
    assert all(int(refused[f"refused: {reason}"]) > 10 for reason in ("bad image", "bad calibration"))
