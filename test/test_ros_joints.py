"""Pan and tilt over DDS: the head goes where a trajectory sends it, and everything of an exposure is of one pose."""

from __future__ import annotations

from typing import Any

import numpy as np
from ros_head import NANOSECONDS, Listener, pixels, running, stamp_of
from ros_process import ros_node
from sensor_msgs.msg import Image, JointState
from trajectories import trajectory
from trajectory_msgs.msg import JointTrajectory

from moire_sim import VirtualHead
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT

SCENE = "flat_board:distance_m=0.9"
DEPTH, TRUTH, LEFT, JOINTS = "depth/image_rect", "ground_truth/depth", "left/image_raw", "joint_states"
PAN_RAD, TILT_RAD = 0.22, -0.1
# What the project promises of a single shot (see test_ros_head_to_depth.py).
LEAST_COMPLETE, MEDIAN_MM = 0.95, 0.3
SENSOR = ("reliable_input:=true", "queue_depth:=50")
HEAD = (f"scene:={SCENE}", "rate_hz:=5", "wait_for_subscribers:=1")


def pose_of(message: JointState) -> tuple[float, float]:
    """Pan and tilt in rad."""
    positions = dict(zip(message.name, message.position, strict=True))
    return positions[PAN_JOINT], positions[TILT_JOINT]


def listening(node: Any, *topics: str) -> Listener:
    listener = Listener(node)
    for topic in topics:
        listener.listen(topic, JointState if topic == JOINTS else Image)
    return listener


def connected(listener: Listener) -> Any:
    """Publisher of trajectories that the head hears."""
    publisher = listener.node.create_publisher(JointTrajectory, "joint_trajectory", 10)
    listener.wait(lambda: publisher.get_subscription_count() > 0, "the head to listen to trajectories")
    return publisher


def test_a_pan_is_reached_and_depth_agrees_with_the_truth_of_its_stamp() -> None:
    with ros_node("mover") as node, running("reconstruction", *SENSOR):
        listener = listening(node, DEPTH, TRUTH, JOINTS)
        listener.wait(lambda: node.count_publishers(DEPTH) > 0, "the reconstruction")
        states = listener.received[JOINTS]
        with running("virtual_head", *HEAD):
            publisher = connected(listener)
            # The truth is not waited for by the head, so the first ones may go before it is connected.
            listener.wait(lambda: bool(listener.received[TRUTH]), "the truth at rest")
            publisher.publish(trajectory([1.0], [[PAN_RAD, TILT_RAD]], [[0.0, 0.0]]))
            listener.wait(lambda: pose_of(states[-1]) == (PAN_RAD, TILT_RAD), "the pose that was commanded")
            reached = next(stamp_of(one) for one in states if pose_of(one) == (PAN_RAD, TILT_RAD))
            listener.wait(lambda: stamp_of(listener.received[DEPTH][-1]) >= reached, "depth after the move")
            listener.answer(TRUTH, stamp_of(listener.received[DEPTH][-1]))
    assert pose_of(states[0]) == (0.0, 0.0)
    check_every_exposure(listener)


def check_every_exposure(listener: Listener) -> None:
    """Each truth is that of the pose with its stamp, and each depth image agrees with it, moving or not."""
    poses = {stamp_of(message): pose_of(message) for message in listener.received[JOINTS]}
    truths = {stamp_of(message): pixels(message) for message in listener.received[TRUTH]}
    depths = {stamp: pixels(message) for message in listener.received[DEPTH] if (stamp := stamp_of(message)) in truths}
    assert {poses[stamp] for stamp in depths} >= {(0.0, 0.0), (PAN_RAD, TILT_RAD)}
    with VirtualHead(SCENE) as head:
        for stamp, depth_m in depths.items():
            head.set_head(*poses[stamp])
            np.testing.assert_array_equal(truths[stamp], head.depth_m)
            error_mm = 1e3 * np.abs(depth_m - truths[stamp])[head.covisible]
            assert np.mean(np.isfinite(error_mm)) >= LEAST_COMPLETE
            assert np.nanmedian(error_mm) <= MEDIAN_MM


def test_exposures_on_the_way_lie_on_the_line_in_time() -> None:
    """The pose at a stamp is where the straight way has got to by then, whatever the rendering took."""
    duration_s = 2.0
    with ros_node("mover") as node, running("virtual_head", *HEAD[:2]):
        listener = listening(node, JOINTS)
        publisher = connected(listener)
        states = listener.received[JOINTS]
        listener.wait(lambda: bool(states), "the head at rest")
        start_ns = stamp_of(states[-1]) + NANOSECONDS
        publisher.publish(trajectory([duration_s], [[0.4, 0.2]], stamp_ns=start_ns))
        end_ns = start_ns + round(duration_s * NANOSECONDS)
        listener.wait(lambda: stamp_of(states[-1]) >= end_ns, "the end of the way")
    on_the_way = [one for one in states if 0.0 < pose_of(one)[0] < 0.4]
    assert on_the_way
    for message in on_the_way:
        pan_rad, tilt_rad = pose_of(message)
        left_s = (end_ns - stamp_of(message)) / NANOSECONDS
        # Straight to the due point at a constant speed, from when the message came.
        speed = message.velocity[0]
        np.testing.assert_allclose((0.4 - pan_rad, tilt_rad), (speed * left_s, pan_rad / 2.0), atol=1e-8)
    assert pose_of(states[-1]) == (0.4, 0.2)
    assert list(states[-1].velocity) == [0.0, 0.0]


def test_a_refused_trajectory_is_counted_and_the_head_stays() -> None:
    bad = {
        "unknown joint 'neck'": trajectory([1.0], [[0.1, 0.0]], names=["neck", TILT_JOINT]),
        "0 points": trajectory([], []),
        "position nan": trajectory([1.0], [[float("nan"), 0.0]]),
        "must stay within -0.6 to 0.9": trajectory([5.0], [[0.0, 2.0]]),
        "later than the 2 s": trajectory([2.0, 1.0], [[0.1, 0.0]] * 2),
    }
    with ros_node("mover") as node, running("virtual_head", *HEAD[:2]) as process:
        listener = listening(node, JOINTS)
        publisher = connected(listener)
        facts = listener.facts
        for number, (words, message) in enumerate(bad.items(), start=1):
            publisher.publish(message)
            listener.wait(
                lambda seen=number: facts.get("virtual_head: joints", {}).get("refused") == str(seen),  # type: ignore[misc]
                f"refusal {number} in the diagnostics",
            )
            assert words in facts["virtual_head: joints"]["last refusal"]
            assert facts["virtual_head: joints"]["message"] == "a trajectory was refused in the last period"
        publisher.publish(trajectory([0.5], [[0.1]], names=[PAN_JOINT]))
        states = listener.received[JOINTS]
        listener.wait(lambda: pose_of(states[-1]) == (0.1, 0.0), "the good one")
        listener.wait(lambda: facts["virtual_head: joints"]["message"] == "at rest", "the good one in the diagnostics")
        assert facts["virtual_head: joints"]["accepted"] == "1"
        process.terminate()
        output, _ = process.communicate()
    assert output.count("trajectory refused: ") == len(bad)
