"""Virtual head and reconstruction as two processes: depth over DDS against the truth."""

from __future__ import annotations

import signal
from typing import Any

import numpy as np
import pytest
from ros_head import Listener, pixels, running, stamp_of
from ros_process import ros_node
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.ros.projector_state import projector_state
from moire_sensor.ros.qos import latched_qos
from moire_sim import VirtualHead, score_depth

DEPTH, TRUTH = "depth/image_rect", "ground_truth/depth"
EXPOSURES = 6
SEED = 3
# What the project promises: completeness, share off by more than 1 px, and of a single shot median error at 1 m.
LEAST_COMPLETE, MOST_OFF = 0.95, 0.02
# Four steps, one pixel: 0.33 mm on a white wall at 1 m (noise floor of the rig); a slanted one returns less light.
MEDIAN_MM = {"dense": 0.3, "phase_shift": 0.45}


@pytest.mark.parametrize(
    ("scene", "method", "steps", "sets", "rate_hz", "number"),
    [
        ("flat_board:distance_m=0.9", "dense", 1, 1, 10, signal.SIGINT),
        ("flat_board:distance_m=0.9", "dense", 1, 2, 100, signal.SIGINT),
        ("free_form", "phase_shift", 4, 1, 10, signal.SIGTERM),
    ],
)
def test_every_exposure_becomes_depth_that_is_right(
    scene: str, method: str, steps: int, sets: int, rate_hz: int, number: signal.Signals
) -> None:
    results = EXPOSURES if steps == 1 else EXPOSURES - 4
    sensor = running("reconstruction", f"method:={method}", "reliable_input:=true", "queue_depth:=50",
                     f"parallel_sets:={sets}", number=number)  # fmt: skip
    head = running("virtual_head", f"scene:={scene}", f"phase_steps:={steps}", f"seed:={SEED}", f"rate_hz:={rate_hz}",
                   f"frames:={EXPOSURES}", "wait_for_subscribers:=2", number=number)  # fmt: skip
    with ros_node("listener") as node, sensor:
        listener = Listener(node)
        # The head waits for what is listened to last, and so knows of the truth's listener, too.
        for topic in (DEPTH, TRUTH, "left/image_raw", "right/image_raw"):
            listener.listen(topic, Image)
        listener.listen("projector/state", JointState)
        listener.wait(lambda: node.count_publishers(DEPTH) > 0, "the reconstruction")
        with head:
            listener.wait(lambda: len(listener.received[DEPTH]) >= results, f"{results} depth images")
            depths, truths = listener.received[DEPTH], listener.received[TRUTH]
            listener.answer(TRUTH, stamp_of(depths[-1]))
    check_depths(scene, method, steps, [pixels(message) for message in depths])
    check_truth(scene, truths)


def check_depths(scene: str, method: str, steps: int, depths: list[Any]) -> None:
    """The noise is the seed's: each depth image is the library's for the same exposures, and near the truth."""
    pattern = paper_pattern(steps)
    sensor = Reconstructor(VirtualHead(scene).rig, pattern, method=method)
    with VirtualHead(scene, SEED) as head:
        truth = head.capture(pattern, 0)
        for first, depth_m in enumerate(depths):
            count = sensor.frames_needed
            pairs = [head.expose(pattern, n, n) for n in range(first, first + count)]
            left, right = (np.stack(images) if count > 1 else images[0] for images in zip(*pairs, strict=True))
            expected = sensor.reconstruct(left, right, first % steps)
            np.testing.assert_allclose(depth_m, expected.depth_m, rtol=1e-5)
            found = score_depth(depth_m, truth)
            assert found.completeness >= LEAST_COMPLETE
            assert found.outlier_share <= MOST_OFF
            assert found.median_error_mm <= MEDIAN_MM[method]


def check_truth(scene: str, truths: list[Any]) -> None:
    with VirtualHead(scene) as head:
        for message in truths:
            assert message.header.frame_id == "head_left_optical_frame"
            np.testing.assert_array_equal(pixels(message), head.depth_m)


def test_one_stamp_per_exposure_on_all_topics_and_services_work() -> None:
    """rate_hz 0: exposures come from the service alone, five for a four-step programme."""
    head = running("virtual_head", "rate_hz:=0", "phase_steps:=4", "pan_rad:=0.1", "tilt_rad:=-0.05")
    topics: dict[str, Any] = {"left/image_raw": Image, "right/image_raw": Image}
    topics |= {"projector/state": JointState, "joint_states": JointState}
    topics |= {f"{device}/camera_info": CameraInfo for device in ("left", "right", "projector")}
    with ros_node("listener") as node, head:
        listener = Listener(node)
        received = listener.received
        for topic, kind in topics.items():
            listener.listen(topic, kind)
        robot: list[Any] = []
        node.create_subscription(String, "robot_description", robot.append, latched_qos())
        listener.wait_for_publishers()
        assert listener.call(Trigger, "capture", Trigger.Request()).message == "5 exposure(s) published"
        listener.wait(lambda: all(len(kept) >= 5 for kept in received.values()), "five of everything")
        assert listener.call(SetBool, "projector/enable", SetBool.Request(data=False)).success
        listener.call(Trigger, "capture", Trigger.Request())
        listener.wait(lambda: all(len(kept) >= 10 for kept in received.values()), "ten of everything")
        listener.wait(lambda: bool(robot), "the robot description")
    assert robot[0].data.count("head_left_optical_frame") > 0
    stamps = {topic: [stamp_of(message) for message in kept] for topic, kept in received.items()}
    assert all(kept == stamps["left/image_raw"] for kept in stamps.values())
    assert stamps["left/image_raw"] == sorted(set(stamps["left/image_raw"]))
    states = [projector_state(message) for message in received["projector/state"]]
    assert [state.step_index for state in states] == [0, 1, 2, 3, 0, 1, 2, 3, 0, 1]
    assert [state.laser_on for state in states] == [True] * 5 + [False] * 5
    joints = received["joint_states"][0]
    assert dict(zip(joints.name, joints.position, strict=True)) == {"head_pan_joint": 0.1, "head_tilt_joint": -0.05}
    lit, dark = (np.ptp(pixels(received["left/image_raw"][n]).astype(float)) for n in (0, 5))
    assert lit > 2 * dark

