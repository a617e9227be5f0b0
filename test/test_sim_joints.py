"""Pan and tilt: the way through a trajectory's points, what is refused, and where the URDF puts the cameras."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from source_scan import ROOT
from trajectories import trajectory
from trajectory_msgs.msg import JointTrajectory

from moire_sim import VirtualHead
from moire_sim.errors import TrajectoryError
from moire_sim.head_motion import MAX_POINTS, HeadMotion
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT, JointLimit, JointMotion, Knot
from moire_sim.turns import NANOSECONDS

# The simulator's rotations are of single precision, 6e-8, in a chain of four joints.
KINEMATICS = 2.5e-7
NOW_NS = 1_700_000_000 * NANOSECONDS
LIMITS = {PAN_JOINT: JointLimit(-1.5, 1.5, 2.0), TILT_JOINT: JointLimit(-0.6, 0.9, 2.0)}


def still_head(pan_rad: float = 0.0, tilt_rad: float = 0.0) -> HeadMotion:
    return HeadMotion(LIMITS, {PAN_JOINT: pan_rad, TILT_JOINT: tilt_rad})


def pan_tilt(motion: HeadMotion, seconds: float) -> tuple[float, float]:
    states = motion.at(NOW_NS + round(seconds * NANOSECONDS))
    return states[PAN_JOINT][0], states[TILT_JOINT][0]


def test_without_velocities_the_way_is_straight_and_the_points_are_met_exactly() -> None:
    motion = still_head(0.1)
    motion.command(trajectory([1.0, 2.0], [[0.3, -0.2], [0.3, 0.1]]), NOW_NS)
    assert pan_tilt(motion, -1.0) == pan_tilt(motion, 0.0) == (0.1, 0.0)
    assert pan_tilt(motion, 0.5) == pytest.approx((0.2, -0.1))
    assert pan_tilt(motion, 1.0) == (0.3, -0.2)
    assert pan_tilt(motion, 1.5) == pytest.approx((0.3, -0.05))
    assert pan_tilt(motion, 2.0) == pan_tilt(motion, 99.0) == (0.3, 0.1)
    states = motion.at(NOW_NS + NANOSECONDS // 2)
    assert [states[name][1] for name in (PAN_JOINT, TILT_JOINT)] == pytest.approx([0.2, -0.2])
    assert motion.is_moving(NOW_NS + NANOSECONDS)
    assert not motion.is_moving(NOW_NS + 2 * NANOSECONDS)


def test_with_velocities_the_way_is_the_one_cubic_that_has_them() -> None:
    """Oracle: p(t) = t^2 (3 - 2 t) / 2 from rest to rest; and any cubic is met by its own values and slopes."""
    motion = still_head()
    motion.command(trajectory([1.0], [[0.5, 0.0]], [[0.0, 0.0]]), NOW_NS)
    for t in np.linspace(0.0, 1.0, 11):
        state = motion.at(NOW_NS + round(t * NANOSECONDS))[PAN_JOINT]
        assert state == pytest.approx((t * t * (3.0 - 2.0 * t) / 2.0, 3.0 * t * (1.0 - t)), abs=1e-8)
    cubic = np.polynomial.Polynomial([0.2, -0.3, 0.5, -0.11])
    knots = tuple(Knot(t, cubic(t), cubic.deriv()(t)) for t in (0.0, 0.4, 1.9))
    for t in np.linspace(0.0, 1.89, 50):
        assert JointMotion(knots).at(t) == pytest.approx((cubic(t), cubic.deriv()(t)), abs=1e-12)


def test_limits_hold_all_along_the_way() -> None:
    """Oracle: the same way sampled finely; random cubics judged against limits at and just beyond their extremes."""
    random = np.random.default_rng(5)
    for _ in range(50):
        p0, p1, v0, v1 = random.uniform(-1.0, 1.0, 4)
        duration_s = random.uniform(0.2, 3.0)
        motion = JointMotion((Knot(0.0, p0, v0), Knot(duration_s, p1, v1)))
        samples = np.array([motion.at(t) for t in np.linspace(0.0, duration_s, 2001)[:-1]])
        low, high = min(samples[:, 0].min(), p1), max(samples[:, 0].max(), p1)
        speed = max(np.abs(samples[:, 1]).max(), abs(v1))
        # Half a sample from an extreme a cubic of this size differs by its bend: (1e-3 s)^2 of at most 1e3 rad/s^2.
        room = 1e-3
        assert motion.complaint(JointLimit(low - room, high + room, speed + room)) == ""
        assert "must stay within" in motion.complaint(JointLimit(low + room, high + room, speed + room))
        assert "must stay within" in motion.complaint(JointLimit(low - room, high - room, speed + room))
        assert "give it more time" in motion.complaint(JointLimit(low - room, high + room, speed - room))


def test_a_new_trajectory_takes_over_where_the_joints_are_and_how_they_move() -> None:
    motion = still_head()
    motion.command(trajectory([2.0], [[0.8, 0.4]]), NOW_NS)
    motion.command(trajectory([1.0], [[0.4]], [[0.0]], names=[PAN_JOINT]), NOW_NS + NANOSECONDS)
    before, after = (motion.at(NOW_NS + NANOSECONDS + ns)[PAN_JOINT] for ns in (0, 1000))
    assert before == pytest.approx((0.4, 0.4))
    # Its bend is at most 6 rad/s^2 here.
    assert after == pytest.approx(before, abs=1e-5)
    # Tilt is not named: it stays where it was then.
    assert pan_tilt(motion, 3.0) == pytest.approx((0.4, 0.2))


def test_points_are_due_at_the_stamp_plus_their_time_and_late_ones_are_passed_over() -> None:
    motion = still_head()
    motion.command(trajectory([1.0, 3.0], [[0.3, 0.0], [0.5, 0.0]], stamp_ns=NOW_NS - 2 * NANOSECONDS), NOW_NS)
    assert pan_tilt(motion, 0.5)[0] == pytest.approx(0.25)
    assert pan_tilt(motion, 1.0)[0] == 0.5
    motion.command(trajectory([1.0], [[0.0, 0.0]], stamp_ns=NOW_NS + 2 * NANOSECONDS), NOW_NS + NANOSECONDS)
    assert pan_tilt(motion, 2.0)[0] == pytest.approx(0.25)
    assert pan_tilt(motion, 3.0)[0] == 0.0


BAD: dict[str, tuple[Callable[[], JointTrajectory], str]] = {
    "name": (lambda: trajectory([1.0], [[0.0]], names=["neck"]), "unknown joint 'neck'; the joints are head_pan_joint"),
    "no name": (lambda: trajectory([1.0], [[]], names=[]), "joint_names are none; name each"),
    "twice": (lambda: trajectory([1.0], [[0.0, 0.0]], names=[PAN_JOINT] * 2), "name each joint that moves once"),
    "empty": (lambda: trajectory([], []), f"has 0 points; it must have 1 to {MAX_POINTS}"),
    "too long": (lambda: trajectory(list(range(1, 1002)), [[0.0, 0.0]] * 1001), "has 1001 points"),
    "NaN": (lambda: trajectory([1.0], [[math.nan, 0.0]]), "point 0 gives head_pan_joint the position nan"),
    "infinite": (lambda: trajectory([1.0], [[0.0, 0.0]], [[0.0, math.inf]]), "head_tilt_joint .* the velocity inf"),
    "too few": (lambda: trajectory([1.0], [[0.0]]), "point 0 has 1 positions and 0 velocities for 2 joint"),
    "velocities": (lambda: trajectory([1.0], [[0.0, 0.0]], [[0.0]]), "has 2 positions and 1 velocities for 2"),
    "too far": (lambda: trajectory([1.0], [[0.0, 1.0]]), "head_tilt_joint goes to 1 rad; .* -0.6 to 0.9"),
    "overshoot": (
        lambda: trajectory([1.0, 2.0], [[1.4, 0.0], [1.4, 0.0]], [[1.0, 0.0], [0.0, 0.0]]),
        r"head_pan_joint goes to 1.548 rad; it must stay within -1.5 to 1.5",
    ),
    "too fast": (lambda: trajectory([0.1], [[0.5, 0.0]]), "moves at 3 rad/s; at most 2: give it more time"),
    "backward": (lambda: trajectory([1.0, 0.5], [[0.1, 0.0]] * 2), "point 1 is 0.5 s; it must be later than the 1 s"),
    "same time": (lambda: trajectory([1.0, 1.0], [[0.1, 0.0]] * 2), "point 1 is 1 s; it must be later"),
    "negative": (lambda: trajectory([-1.0], [[0.1, 0.0]]), "point 0 is -1 s; it must be 0 or more"),
    "at once": (lambda: trajectory([0.0], [[0.1, 0.0]]), "due 0 s ago; give a time_from_start above zero"),
    "past": (lambda: trajectory([1.0], [[0.1, 0.0]], stamp_ns=NOW_NS - 3 * NANOSECONDS), "due 2 s ago"),
    "no rest": (lambda: trajectory([1.0], [[0.1, 0.0]], [[0.1, 0.0]]), "ends at 0.1 rad/s; it must end at rest"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_trajectory_is_refused_in_one_line_and_changes_nothing(case: str) -> None:
    make, words = BAD[case]
    motion = still_head(0.2)
    motion.command(trajectory([2.0], [[0.4, 0.0]]), NOW_NS)
    before = [pan_tilt(motion, t) for t in (0.0, 1.0, 2.0)]
    with pytest.raises(TrajectoryError, match=words) as caught:
        motion.command(make(), NOW_NS)
    assert "\n" not in str(caught.value)
    assert [pan_tilt(motion, t) for t in (0.0, 1.0, 2.0)] == before


def test_exactly_the_limits_can_be_commanded() -> None:
    motion = still_head()
    motion.command(trajectory([0.75], [[1.5, -0.6]]), NOW_NS)
    assert pan_tilt(motion, 1.0) == (1.5, -0.6)


def turned(axis: str, angle: float) -> Any:
    """Rotation (4, 4) about the axes x, y or z."""
    c, s = math.cos(angle), math.sin(angle)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(4)
    matrix[[first, second], [first, second]] = c
    matrix[first, second], matrix[second, first] = -s, s
    return matrix


def numbers(text: str | None) -> list[float]:
    return [float(number) for number in (text or "0 0 0").split()]


def poses_of_the_urdf(angles_rad: dict[str, float]) -> dict[str, Any]:
    """Pose (4, 4) of each link in ``head_base_link``, from the URDF's text alone."""
    poses: dict[str, Any] = {"head_base_link": np.eye(4)}
    for joint in ET.parse(ROOT / "urdf" / "head.urdf").getroot().findall("joint"):
        parent, child, origin = (joint.find(tag) for tag in ("parent", "child", "origin"))
        assert parent is not None
        assert child is not None
        pose = np.eye(4)
        roll, pitch, yaw = numbers(origin.get("rpy") if origin is not None else None)
        pose[:3, 3] = numbers(origin.get("xyz") if origin is not None else None)
        pose = pose @ turned("z", yaw) @ turned("y", pitch) @ turned("x", roll)
        axis = joint.find("axis")
        if axis is not None:
            pose = pose @ turned("xyz"[numbers(axis.get("xyz")).index(1.0)], angles_rad[joint.get("name", "")])
        poses[child.get("link", "")] = poses[parent.get("link", "")] @ pose
    return poses


@pytest.mark.parametrize(("pan_rad", "tilt_rad"), [(0.0, 0.0), (0.4, 0.0), (0.0, 0.3), (-1.1, -0.55), (1.5, 0.8)])
def test_the_head_stands_where_the_urdf_says(pan_rad: float, tilt_rad: float) -> None:
    expected = poses_of_the_urdf({PAN_JOINT: pan_rad, TILT_JOINT: tilt_rad})
    with VirtualHead() as head:
        at_rest = np.linalg.inv(head.frames["head_left_optical_frame"]) @ head.frames["head_right_optical_frame"]
        head.set_head(pan_rad, tilt_rad)
        frames = head.frames
    assert set(frames) == set(expected)
    for name, pose in frames.items():
        np.testing.assert_allclose(pose, expected[name], atol=KINEMATICS, err_msg=name)
    left, right = (frames[f"head_{side}_optical_frame"] for side in ("left", "right"))
    # The rig itself does not bend.
    np.testing.assert_allclose(np.linalg.inv(left) @ right, at_rest, atol=KINEMATICS)
    # Positive pan looks to the left (y), positive tilt down.
    np.testing.assert_allclose(
        left[:3, 2],
        [math.cos(pan_rad) * math.cos(tilt_rad), math.sin(pan_rad) * math.cos(tilt_rad), -math.sin(tilt_rad)],
        atol=KINEMATICS,
    )


def test_limits_are_those_of_the_urdf() -> None:
    joints = ET.parse(ROOT / "urdf" / "head.urdf").getroot().findall("joint[@type='revolute']")
    limits = {joint.get("name"): joint.find("limit") for joint in joints}
    with VirtualHead() as head:
        known = head.joint_limits
    assert list(known) == list(limits) == [PAN_JOINT, TILT_JOINT]
    for name, limit in known.items():
        written = limits[name]
        assert written is not None
        expected = [float(written.get(key, "nan")) for key in ("lower", "upper", "velocity")]
        assert [limit.low_rad, limit.high_rad, limit.speed_rad_s] == expected
