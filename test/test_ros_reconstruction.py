"""The reconstruction node as a process, fed over DDS with analytic captures: values, not just arrival."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from ros_head import Exposure, TestHead, pixels, running, stamp_of, time_of
from ros_process import ros_node
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from moire_sensor import FringePattern, Reconstructor, Shot
from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_pattern
from moire_sensor.ros.camera_messages import camera_infos
from moire_sensor.ros.projector_state import DEPTH_RANGE
from moire_sensor.ros.qos import latched_qos
from moire_sim.analytic_scenes import analytic_capture
from moire_sim.score import score_depth

DEPTH = "depth/image_rect"
RESULTS: dict[str, Any] = {
    DEPTH: Image,
    "depth/camera_info": CameraInfo,
    "depth/sigma": Image,
    "confidence/image": Image,
    "status/image": Image,
    "fringe_order/image": Image,
    "background/image_rect": Image,
    "points": PointCloud2,
    "points_nav": PointCloud2,
    "disparity": DisparityImage,
    "acquisition_done": Header,
}
# What the project promises of a single shot: completeness, share off by more than 1 px, median error at 1 m.
LEAST_COMPLETE, MOST_OFF, MEDIAN_MM = 0.95, 0.02, 0.3


@cache
def capture(scene: str = "plane_1000") -> Any:
    return analytic_capture(scene)


@cache
def shot_of(scene: str = "plane_1000") -> Shot:
    """What the library gives for the same images."""
    one = capture(scene)
    return Reconstructor(one.rig, one.pattern).reconstruct(one.left, one.right)


@pytest.fixture(scope="module")
def head() -> Iterator[TestHead]:
    process = running("reconstruction", "reliable_input:=true", "queue_depth:=50", "diagnostics_period_s:=0.1")
    with process, ros_node("test_head") as node:
        under_test = TestHead(node)
        for topic, kind in RESULTS.items():
            under_test.listen(topic, kind)
        under_test.wait_for_subscribers()
        yield under_test


def test_depth_is_the_library_s_bit_for_bit_and_near_the_truth(head: TestHead) -> None:
    scene = capture("cylinder_and_box")
    depth_m = pixels(head.answer(DEPTH, head.send(Exposure.of(scene))))
    np.testing.assert_array_equal(depth_m, shot_of("cylinder_and_box").depth_m)
    found = score_depth(depth_m, scene)
    assert found.completeness >= LEAST_COMPLETE
    assert found.outlier_share <= MOST_OFF
    assert found.median_error_mm <= MEDIAN_MM


def test_every_topic_carries_stamp_frame_and_the_library_s_values(head: TestHead) -> None:
    stamp = head.send(Exposure.of(capture()))
    answers = {topic: head.answer(topic, stamp) for topic in RESULTS}
    shot, rig = shot_of(), capture().rig
    for topic, message in answers.items():
        header = message if topic == "acquisition_done" else message.header
        assert header == Header(stamp=time_of(stamp), frame_id="head_left_optical_frame"), topic
    for topic, values in (
        (DEPTH, shot.depth_m),
        ("depth/sigma", shot.depth_sigma_m),
        ("confidence/image", shot.confidence),
        ("status/image", shot.status),
        ("fringe_order/image", shot.fringe_order),
        ("background/image_rect", np.rint(shot.background.clip(0, 255)).astype(np.uint8)),
    ):
        got = pixels(answers[topic])
        assert got.dtype == values.dtype, topic
        np.testing.assert_array_equal(got, values, err_msg=topic)
    assert list(answers["depth/camera_info"].p) == rig.P_left.ravel().tolist()
    check_cloud(answers["points"], rig.points(shot.depth_m), shot.background)
    disparity = answers["disparity"]
    depth_m = disparity.f * disparity.t / pixels(disparity.image)
    # Tolerance: 32 bit rounding of disparity and of f T.
    np.testing.assert_allclose(depth_m, shot.depth_m, rtol=1e-6)


def check_cloud(message: PointCloud2, points_m: Any, intensity: Any) -> None:
    cloud = np.frombuffer(message.data, np.float32).reshape(message.height, message.width, 4)
    np.testing.assert_array_equal(cloud[..., :3], points_m)
    np.testing.assert_array_equal(cloud[..., 3], intensity)
    assert message.is_dense == bool(np.isfinite(cloud).all())


def test_points_nav_is_dense_and_lies_on_the_surface(head: TestHead) -> None:
    message = head.answer("points_nav", head.send(Exposure.of(capture())))
    cloud = np.frombuffer(message.data, np.float32).reshape(-1, 4)
    assert message.is_dense is True
    assert message.height == 1
    # The plane fills 0.51 x 0.38 m of the view at 1 m: some 480 voxels of 20 mm in one or two layers.
    assert 300 < len(cloud) < 1200
    assert np.abs(cloud[:, 2] - 1.0).max() < 0.02


@pytest.mark.parametrize("topic", ["left/image_raw", "right/image_raw", "projector/state"])
def test_a_missing_message_drops_its_set_alone_and_is_counted(head: TestHead, topic: str) -> None:
    name = {"left/image_raw": "left", "right/image_raw": "right", "projector/state": "state"}[topic]
    dropped = head.count("input", f"dropped: missing {name}")
    done = len(head.received[DEPTH])
    first = head.send(Exposure.of(capture()))
    lost = head.send(Exposure.of(capture()), without=topic)
    stamps = [first, *(head.send(Exposure.of(capture())) for _ in range(3))]
    for stamp in stamps:
        head.answer(DEPTH, stamp)
    head.wait_for_count("input", f"dropped: missing {name}", dropped + 1)
    assert len(head.received[DEPTH]) == done + 4
    assert all(message.header.stamp != time_of(lost) for message in head.received[DEPTH])


def bad_sets() -> dict[str, tuple[str, Any]]:
    good = Exposure.of(capture())
    small = good.left[:240, :320].copy()
    return {
        "laser off": ("laser off", good.with_state(laser_on=False)),
        "period of nothing": ("bad projector state", good.with_state(fringe_period_px=0.5)),
        "nan phase": ("bad projector state", good.with_state(fringe_phase_rad=float("nan"))),
        "step beyond count": ("bad projector state", good.with_state(step_index=7)),
        "small left image": ("bad image", replace(good, left=small)),
        "small images": ("bad image", replace(good, left=small, right=small)),
    }


@pytest.mark.parametrize("kind", ["laser off", "period of nothing", "nan phase", "step beyond count",
                                  "small left image", "small images"])  # fmt: skip
def test_a_bad_set_is_refused_with_its_reason_and_the_node_goes_on(head: TestHead, kind: str) -> None:
    reason, exposure = bad_sets()[kind]
    refused = head.count("reconstruction", f"refused: {reason}")
    bad = head.send(exposure)
    head.answer(DEPTH, head.send(Exposure.of(capture())))
    head.wait_for_count("reconstruction", f"refused: {reason}", refused + 1)
    assert all(message.header.stamp != time_of(bad) for message in head.received[DEPTH])


@pytest.mark.parametrize(
    ("fields", "says"),
    [({"encoding": "bgr8"}, "mono8 and mono16"), ({"step": 1}, "step 1"), ({"height": 999}, "truncated")],
)
def test_a_damaged_image_message_is_refused_by_name(head: TestHead, fields: dict[str, Any], says: str) -> None:
    refused = head.count("reconstruction", "refused: bad image")
    messages = head.messages(Exposure.of(capture()))
    for name, value in fields.items():
        setattr(messages["right/image_raw"], name, value)
    head.publish(messages)
    head.wait_for_count("reconstruction", "refused: bad image", refused + 1)
    text = head.facts["reconstruction: reconstruction"]["last refused: bad image"]
    assert "the right image" in text
    assert says in text
    head.answer(DEPTH, head.send(Exposure.of(capture())))


def test_a_new_pattern_takes_effect_without_a_restart(head: TestHead) -> None:
    other = analytic_capture("plane_1000", FringePattern(24.0, 1.0))
    depth_m = pixels(head.answer(DEPTH, head.send(Exposure.of(other))))
    assert score_depth(depth_m, other).completeness >= LEAST_COMPLETE
    assert score_depth(depth_m, other).median_error_mm <= MEDIAN_MM
    expected = Reconstructor(other.rig, other.pattern).reconstruct(other.left, other.right)
    np.testing.assert_array_equal(depth_m, expected.depth_m)


def test_single_frames_of_a_stepped_programme_give_dense_depth_at_every_step(head: TestHead) -> None:
    stepped = analytic_capture("plane_1000", paper_pattern(4))
    for step in range(4):
        depth_m = pixels(head.answer(DEPTH, head.send(Exposure.of(stepped, step))))
        assert score_depth(depth_m, stepped).completeness >= LEAST_COMPLETE
        assert score_depth(depth_m, stepped).median_error_mm <= MEDIAN_MM


def test_the_head_may_tell_the_depth_range(head: TestHead) -> None:
    """At 1 m with 0.2 to 0.6 m allowed nothing can be found; the range is used, and shown."""
    told = Exposure.of(capture()).with_state(depth_range_m=(0.2, 0.6))
    depth_m = pixels(head.answer(DEPTH, head.send(told)))
    assert not np.nanmax(depth_m, initial=0.0) > 0.62
    head.wait(lambda: head.facts["reconstruction: reconstruction"].get("max depth m") == "0.6", DEPTH_RANGE[1])
    depth_m = pixels(head.answer(DEPTH, head.send(Exposure.of(capture()))))
    np.testing.assert_array_equal(depth_m, shot_of().depth_m)


def test_raw_images_are_rectified_from_the_camera_infos(head: TestHead) -> None:
    """The left camera's images come shifted by 3 columns and 2 rows; K says so and P does not."""
    scene = capture()
    shifted = replace(Exposure.of(scene), left=np.roll(scene.left, (2, 3), axis=(0, 1)))
    infos = camera_infos(scene.rig, Header(), PROJECTOR_SIZE)
    k = list(infos["left"].k)
    k[2], k[5] = k[2] + 3.0, k[5] + 2.0
    infos["left"].k = k
    messages = head.messages(shifted)
    head.send_infos(infos)
    head.publish(messages)
    depth_m = pixels(head.answer(DEPTH, head.stamp))
    inside = np.s_[20:440, 120:600]
    # Whole pixels, so the remap is exact; the rows that left the image change what the whole image decides for a
    # few pixels by less than the noise. One pixel of shift too much would be 8.5 mm everywhere.
    difference_m = np.abs(depth_m - shot_of().depth_m)[inside]
    assert np.mean(difference_m < 1e-6) > 0.999
    assert np.nanmax(difference_m) < 1e-3


def test_a_loop_gives_the_same_bits_again(head: TestHead) -> None:
    scene = capture()
    begin = head.stamp
    for _ in range(2):
        head.stamp = begin
        before = len(head.received[DEPTH])
        stamps = [head.send(Exposure.of(scene)) for _ in range(10)]
        head.wait(lambda least=before + 10: len(head.received[DEPTH]) >= least, "ten depths")  # type: ignore[misc]
        assert [stamp_of(message) for message in head.received[DEPTH][before:]] == stamps
    last = head.received[DEPTH][-20:]
    for early, late in zip(last[:10], last[10:], strict=True):
        np.testing.assert_array_equal(pixels(early), pixels(late))


def set_parameter(head: TestHead, name: str, value: Any) -> Any:
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return head.call(SetParameters, "reconstruction/set_parameters", request).results[0]


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("method", "magic", "allowed are dense, phase_shift"),
        ("min_depth_m", 3.0, "the nearest must be the smaller"),
        ("min_depth_m", -1.0, "range"),
        ("reliable_input", False, "read-only"),
    ],
)
def test_a_bad_value_is_rejected_at_run_time_with_the_reason(head: TestHead, name: str, value: Any, says: str) -> None:
    result = set_parameter(head, name, value)
    assert not result.successful
    assert says in result.reason
    np.testing.assert_array_equal(
        pixels(head.answer(DEPTH, head.send(Exposure.of(capture())))), shot_of().depth_m
    )


def test_a_good_value_takes_effect_at_run_time(head: TestHead) -> None:
    assert set_parameter(head, "depth_encoding", "16UC1").successful
    message = head.answer(DEPTH, head.send(Exposure.of(capture())))
    assert message.encoding == "16UC1"
    expected = np.nan_to_num(np.rint(shot_of().depth_m * 1000.0)).astype(np.uint16)
    np.testing.assert_array_equal(pixels(message), expected)
    assert set_parameter(head, "depth_encoding", "32FC1").successful


def test_a_publisher_of_incompatible_quality_is_named_while_it_is_there(head: TestHead) -> None:
    publisher = head.node.create_publisher(Image, "left/image_raw", qos_profile_sensor_data)

    def named() -> bool:
        return head.facts["reconstruction: input"].get("incompatible left/image_raw") == "reliability"

    head.wait(named, "the policy in the diagnostics")
    head.node.destroy_publisher(publisher)
    head.wait(lambda: not named(), "its end")
    head.answer(DEPTH, head.send(Exposure.of(capture())))


def test_a_subscriber_of_incompatible_quality_is_named_in_the_log(head: TestHead) -> None:
    said: list[str] = []
    log = head.node.create_subscription(Log, "/rosout", lambda entry: said.append(entry.msg), latched_qos())
    deaf = head.node.create_subscription(Image, "depth/sigma", lambda _: None, latched_qos())
    head.wait(lambda: any("/head/depth/sigma" in text and "gets nothing" in text for text in said), "the warning")
    head.node.destroy_subscription(deaf)
    head.node.destroy_subscription(log)
    head.answer("depth/sigma", head.send(Exposure.of(capture())))


def test_sets_are_accounted_for(head: TestHead) -> None:
    """Runs near the end of this file: everything matched was reconstructed or refused, nothing superseded."""
    head.answer(DEPTH, head.send(Exposure.of(capture())))
    facts = head.facts["reconstruction: reconstruction"]

    def settled() -> bool:
        facts.update(head.facts["reconstruction: reconstruction"])
        refused = sum(int(number) for name, number in facts.items() if name.startswith("refused: "))
        # A report may be older than the last depth.
        reconstructed = int(facts["reconstructed"])
        return int(facts["matched"]) == reconstructed + refused and reconstructed >= len(head.received[DEPTH])

    head.wait(settled, "matched = reconstructed + refused")
    assert facts["superseded"] == "0"
    assert int(facts["reconstructed"]) == len(head.received[DEPTH])


def test_nothing_is_computed_while_nobody_listens(head: TestHead) -> None:
    before = head.count("reconstruction", "unwatched")
    done = head.count("reconstruction", "reconstructed")
    for subscription in [one for one in head.node.subscriptions if one.topic_name != "/diagnostics"]:
        head.node.destroy_subscription(subscription)
    head.wait(lambda: not head.node.count_subscribers(DEPTH), "the last listener to leave")

    def unwatched() -> bool:
        head.send(Exposure.of(capture()))
        return head.count("reconstruction", "unwatched") > before

    head.wait(unwatched, "a set that nobody wanted")
    settled = head.count("reconstruction", "reconstructed")
    number = head.count("reconstruction", "unwatched")
    head.wait(lambda: unwatched() and head.count("reconstruction", "unwatched") > number, "another one")
    assert head.count("reconstruction", "reconstructed") == settled >= done
