"""phase_shift over DDS: a result for each new frame, from the steps that the states tell."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_head import NANOSECONDS, Exposure, TestHead, pixels, running
from ros_process import ros_node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from moire_sensor import FringePattern, Reconstructor
from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_pattern
from moire_sensor.ros.camera_messages import camera_infos
from moire_sim.analytic_scenes import analytic_capture
from moire_sim.score import score_depth

DEPTH = "depth/image_rect"
MIDDLE = 2
# Steps of the real capture's sign, and not the equal ones a node might assume.
PATTERNS = {
    "equal": paper_pattern(4),
    "backwards": FringePattern(paper_pattern().period_px, 0.4, (0.0, -math.pi / 2, -math.pi, -3 * math.pi / 2)),
}
# physics: four steps, one pixel, amplitude 70 and noise 1.5 give 0.33 mm at 1 m; a fifth more for the node to pass.
MEDIAN_MM = 0.4


@cache
def capture(name: str) -> Any:
    return analytic_capture("plane_1000", PATTERNS[name])


@pytest.fixture(scope="module")
def head() -> Iterator[TestHead]:
    """The camera infos are published once, latched, before the reconstruction starts, as from a bag."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with ros_node("test_head") as node:
        kept = []
        for device, info in camera_infos(capture("equal").rig, Header(), PROJECTOR_SIZE).items():
            kept.append(node.create_publisher(CameraInfo, f"{device}/camera_info", latched))
            kept[-1].publish(info)
        process = running("reconstruction", "method:=phase_shift", "reliable_input:=true", "queue_depth:=50",
                          "diagnostics_period_s:=0.1")  # fmt: skip
        with process:
            under_test = TestHead(node)
            under_test.listen(DEPTH, Image)
            under_test.listen("acquisition_done", Header)
            under_test.wait_for_subscribers()
            yield under_test


def send(head: TestHead, name: str, steps: range) -> list[int]:
    """Send one set for each step, without camera infos; return the stamps."""
    stamps = []
    for step in steps:
        head.publish(head.messages(Exposure.of(capture(name), step % 4, PATTERNS[name])))
        stamps.append(head.stamp)
    return stamps


@pytest.mark.parametrize("name", list(PATTERNS))
@pytest.mark.parametrize("first", [0, 3])
def test_each_frame_from_the_fifth_on_gives_depth_with_the_middle_stamp(head: TestHead, name: str, first: int) -> None:
    head.stamp += 100 * NANOSECONDS
    before = len(head.received[DEPTH])
    stamps = send(head, name, range(first, first + 8))
    scene = capture(name)
    sensor = Reconstructor(scene.rig, PATTERNS[name], method="phase_shift")
    for index in range(8 - 4):
        depth_m = pixels(head.answer(DEPTH, stamps[index + MIDDLE]))
        frames = [(first + index + n) % 4 for n in range(5)]
        expected = sensor.reconstruct(scene.left[frames], scene.right[frames], frames[0])
        # The pattern is put together from the messages: its phases can differ in the last bit.
        np.testing.assert_allclose(depth_m, expected.depth_m, rtol=1e-5)
        found = score_depth(depth_m, scene)
        assert found.completeness >= 0.95
        assert found.median_error_mm <= MEDIAN_MM
    assert len(head.received[DEPTH]) == before + 4
    head.answer("acquisition_done", stamps[MIDDLE])


def test_a_lost_frame_costs_the_results_it_is_part_of_and_no_more(head: TestHead) -> None:
    head.stamp += 100 * NANOSECONDS
    before = len(head.received[DEPTH])
    early = send(head, "equal", range(6))
    # A burst of more than the subscription's depth would lose more than the one frame.
    head.answer(DEPTH, early[3])
    head.stamp += NANOSECONDS // 10
    late = send(head, "equal", range(7, 13))
    for stamp in (early[2], late[2], late[3]):
        head.answer(DEPTH, stamp)
    assert len(head.received[DEPTH]) == before + 4


def test_a_single_shot_programme_is_refused_with_the_reason(head: TestHead) -> None:
    refused = head.count("reconstruction", "refused: bad projector state")
    head.publish(head.messages(Exposure.of(analytic_capture("plane_1000"))))
    head.wait_for_count("reconstruction", "refused: bad projector state", refused + 1)
    assert "step" in head.facts["reconstruction: reconstruction"]["last refused: bad projector state"]
