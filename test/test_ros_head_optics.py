"""Real optics, other fringes and a moving base over DDS: the reconstruction follows by what the head says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_head import Listener, pixels, running, stamp_of
from ros_process import TIMEOUT_S, ros_node
from sensor_msgs.msg import CameraInfo, Image, JointState

from moire_sensor.pattern import FringePattern
from moire_sensor.ros.frame_ring import Frame, FrameRing
from moire_sensor.ros.projector_state import state_of_exposure
from moire_sim.fringe_programme import FringeProgramme
from moire_sim.optics import REAL

DISTANCE_M = 0.8
DEPTH, TRUTH, STATE, INFO, BASE = (
    "depth/image_rect", "ground_truth/depth", "projector/state", "left/camera_info", "base_pose",
)  # fmt: skip
# Coarse samples are quicker; everything else is the preset's.
HEAD = (f"scene:=flat_board:distance_m={DISTANCE_M}", "rate_hz:=5", "optics:=realistic", "supersampling:=1")


def period_of(message: JointState) -> float:
    """Fringe period of an exposure, projector columns."""
    return float(dict(zip(message.name, message.position, strict=True))["fringe_period_px"])


def set_fringes(listener: Listener, **values: Any) -> Any:
    """Set parameters of the head; returns the answer to the last."""
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    request = SetParameters.Request(parameters=parameters)
    return listener.call(SetParameters, "virtual_head/set_parameters", request).results[-1]


def depth_with_period(listener: Listener, period_px: float) -> np.ndarray:
    """Wait for a depth image of an exposure with a fringe period."""

    def found() -> list[Image]:
        stamps = {stamp_of(state) for state in listener.received[STATE] if period_of(state) == period_px}
        return [depth for depth in listener.received[DEPTH] if stamp_of(depth) in stamps]

    listener.wait(lambda: bool(found()), f"depth with a period of {period_px} columns")
    return pixels(found()[-1])


def test_depth_is_right_through_bent_lenses_and_follows_every_change_of_pitch() -> None:
    with ros_node("asker") as node, running("moire_demo", *HEAD):
        listener = Listener(node)
        for topic, kind in ((DEPTH, Image), (STATE, JointState), (INFO, CameraInfo)):
            listener.listen(topic, kind)
        listener.wait(lambda: bool(listener.received[STATE]), "the first exposure", 2.0 * TIMEOUT_S)
        first_px = period_of(listener.received[STATE][0])
        depths = [depth_with_period(listener, first_px)]
        assert set_fringes(listener, period_px=21.0).successful
        depths.append(depth_with_period(listener, 21.0))
        assert set_fringes(listener, second_period_px=18.0).successful
        depths.append(depth_with_period(listener, 18.0))
        listener.received[STATE].clear()
        listener.wait(lambda: len(listener.received[STATE]) >= 4, "four more exposures")
        alternating = [period_of(state) for state in listener.received[STATE]]
        refused = set_fringes(listener, period_px=1.0)
    assert not refused.successful
    assert "period_px" in refused.reason
    assert {tuple(alternating[:2]), tuple(alternating[1:3])} == {(21.0, 18.0), (18.0, 21.0)}
    info = listener.received[INFO][0]
    assert list(info.d) == pytest.approx([REAL.k1, REAL.k2, REAL.p1, REAL.p2, REAL.k3])
    for depth_m in depths:
        assert np.isfinite(depth_m).mean() > 0.7
        # What the lens bends is far more than this: 5 px in the corners, 40 mm.
        assert np.nanmedian(np.abs(depth_m - DISTANCE_M)) < 5e-4


def test_two_pitches_of_phase_steps_give_a_result_each() -> None:
    """Each pitch stays for the five exposures that a result of four steps needs; none of them mixes both."""
    patterns = [FringePattern(period_px).with_equal_steps(4) for period_px in (16.0, 21.0)]
    programme, ring = FringeProgramme(patterns), FrameRing[None]()
    results = []
    for index in range(20):
        pattern, step = programme.next()
        whole = ring.add(Frame(1 + index, state_of_exposure(pattern, step), None))
        if whole:
            results.append({frame.state.fringe_period_px for frame in whole})
    assert results == [{16.0}, {21.0}, {16.0}, {21.0}]
    programme.change(patterns[1:])
    shown = [(programme.upcoming, programme.next()) for _ in range(5)]
    assert shown == [((patterns[1], step), (patterns[1], step)) for step in (0, 1, 2, 3, 0)]


def test_the_truth_and_the_pose_of_a_driving_head_belong_to_the_exposure() -> None:
    with ros_node("rider") as node, running("virtual_head", "scene:=corridor_drive:speed_m_s=0.1", "rate_hz:=2"):
        listener = Listener(node)
        listener.listen(TRUTH, Image)
        listener.listen(BASE, PoseStamped)

        def both() -> list[tuple[float, float]]:
            ways_m = {stamp_of(one): one.pose.position.x for one in listener.received[BASE]}
            truths = {stamp_of(one): float(pixels(one)[80, 323]) for one in listener.received[TRUTH]}
            return [(ways_m[stamp], truths[stamp]) for stamp in ways_m if stamp in truths]

        listener.wait(lambda: len({way_m for way_m, _ in both()}) >= 3, "three places on the way")
    for way_m, ahead_m in both():
        # The end of the corridor lies 3.3 m ahead of the start; the depth buffer is good to 3e-5 m there.
        assert ahead_m == pytest.approx(3.3 - way_m, abs=1e-4)
