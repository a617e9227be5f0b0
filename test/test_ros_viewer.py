"""The live view: what it makes of messages, what it says when none come, and the page in a real browser."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import rclpy
from browser import browser_tab, find_chromium
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from ros_head import running, time_of
from ros_process import TIMEOUT_S, ros_node, spin_until
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor.errors import ImageError, SettingsError
from moire_sensor.ros.cloud_messages import cloud_message
from moire_sensor.ros.image_messages import image_message
from moire_sensor.ros.viewer_inputs import STREAMS, ViewerInputs, rate
from moire_sensor.ros.viewer_node import ViewerNode, check_scale, facts_text
from moire_sensor.ros.viewer_page import ViewerPage, resolve_host, url_host
from moire_sensor.ros.viewer_pictures import (
    COLOURS,
    STRIPES,
    Scale,
    depth_of,
    depth_scale,
    grey_picture,
    known_share,
    points_of,
    scale_picture,
)

HEADER = Header(frame_id="head_left_optical_frame")
NAN = np.float32(np.nan)
# Pixels of either end of the colour map in the pane of the cloud; the cloud covers some ten thousand.
LEAST_PX = 2000


def test_known_depth_is_coloured_by_its_scale_and_unknown_depth_is_striped() -> None:
    depth_m = np.linspace(0.5, 1.5, 40 * 60, dtype=np.float32).reshape(40, 60)
    depth_m[:, :20] = NAN
    picture = scale_picture(depth_m, Scale(0.5, 1.5))
    assert picture.shape == (40, 60, 3)
    unknown = {tuple(colour) for colour in picture[:, :20].reshape(-1, 3).tolist()}
    assert unknown == {tuple(colour) for colour in STRIPES.tolist()}
    assert not unknown & {tuple(colour) for colour in COLOURS.tolist()}
    assert (picture[-1, -1] == COLOURS[255]).all()
    assert (picture[20, 30] == COLOURS[int((depth_m[20, 30] - 0.5) * 255)]).all()
    assert known_share(depth_m) == pytest.approx(2 / 3)


def test_the_colours_grow_brighter_all_the_way() -> None:
    """So they can be told apart without seeing hues."""
    luminance = COLOURS @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luminance) > -0.5).all()
    assert luminance[-1] - luminance[0] > 150


def test_the_automatic_scale_holds_the_known_depths_and_survives_none() -> None:
    depth_m = np.full((10, 10), 1.23, dtype=np.float32)
    depth_m[0] = NAN
    scale = depth_scale(depth_m, 0.0, 0.0)
    assert (scale.low, scale.high) == pytest.approx((1.2, 1.3))
    assert depth_scale(depth_m, 0.5, 2.0) == Scale(0.5, 2.0)
    nothing = np.full((4, 4), NAN)
    assert depth_scale(nothing, 0.0, 0.0).high > 0.0
    assert {tuple(one) for one in scale_picture(nothing, Scale(0.0, 1.0)).reshape(-1, 3).tolist()} <= {
        tuple(one) for one in STRIPES.tolist()
    }


def test_depth_in_millimetres_is_the_same_and_zero_is_unknown() -> None:
    message = image_message(HEADER, np.array([[0, 1500]], dtype=np.uint16))
    np.testing.assert_array_equal(depth_of(message), np.array([[NAN, 1.5]], dtype=np.float32))
    with pytest.raises(ImageError, match="the depth image has encoding 'mono8'; allowed are 32FC1 and 16UC1"):
        depth_of(image_message(HEADER, np.zeros((2, 2), dtype=np.uint8), "mono8"))


def test_a_camera_picture_shows_the_bits_that_are_used_and_no_more_columns_than_needed() -> None:
    image = np.tile(np.linspace(0, 4095, 1500).astype(np.uint16), (6, 1))
    picture = grey_picture("left", image_message(HEADER, image, "mono16"))
    assert picture.shape == (2, 500, 3)
    assert (picture[0, 0, 0], picture[0, -1, 0]) == (0, pytest.approx(255, abs=1))


def test_points_are_thinned_evenly_and_only_known_ones_are_left() -> None:
    cloud = np.zeros((40, 60, 4), dtype=np.float32)
    cloud[..., 0], cloud[..., 1] = np.meshgrid(np.arange(60), np.arange(40))
    cloud[..., 2], cloud[..., 3] = 1.0, 200.0
    cloud[:, :30, :3] = NAN
    points = points_of(cloud_message(HEADER, cloud), 600)
    assert points.points_m.shape == (20 * 15, 3)
    assert points.points_m[:, 0].min() == 30.0
    assert (points.brightness == 200.0).all()
    row = points_of(cloud_message(HEADER, cloud[:1, 30:]), 10)
    assert row.points_m[:, 0].tolist() == list(range(30, 60, 3))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"fields": []}, "needs fields x, y and z"),
        ({"point_step": 8}, "within point_step"),
        ({"height": 5}, "exactly row_step"),
        ({"height": 0, "data": []}, "no points"),
    ],
)
def test_a_damaged_cloud_is_refused(change: dict[str, Any], says: str) -> None:
    message = cloud_message(HEADER, np.zeros((4, 4, 4), dtype=np.float32))
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(ImageError, match=says):
        points_of(message, 100)


def test_rates_are_those_of_the_last_seconds() -> None:
    assert rate(deque([0.0, 0.1, 10.0, 10.5, 11.0]), 11.2) == pytest.approx(2.0)
    assert rate(deque([0.0, 0.1]), 11.2) == 0.0


def test_loopback_is_told_from_other_addresses() -> None:
    assert resolve_host("127.0.0.1") == ("127.0.0.1", True)
    assert resolve_host("0.0.0.0") == ("0.0.0.0", False)
    assert [url_host(one) for one in ("127.0.0.1", "::1", "0.0.0.0")] == ["127.0.0.1", "[::1]", socket.gethostname()]


def test_the_newest_message_wins_and_a_silent_topic_is_named_with_its_reason() -> None:
    """Over DDS: one topic comes, one does not match, the others have no publisher."""
    with ros_node("camera") as camera:
        mismatch = "qos_overrides./head/right/image_raw.subscription.reliability"
        viewer = rclpy.create_node(
            "viewer", namespace="head", parameter_overrides=[Parameter(mismatch, value="reliable")]
        )
        best_effort = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        left = camera.create_publisher(Image, "left/image_raw", 5)
        camera.create_publisher(Image, "right/image_raw", best_effort)
        inputs = ViewerInputs(viewer)
        assert mismatch in inputs.qos_parameters()
        assert not viewer.count_subscribers("left/image_raw")
        inputs.open()
        sent = 0

        def came() -> bool:
            nonlocal sent
            sent += 1
            header = Header(stamp=time_of(sent))
            left.publish(image_message(header, np.full((2, 2), sent % 256, dtype=np.uint8), "mono8"))
            return inputs.states(TIMEOUT_S)["left"].rate_hz > 0.0

        spin_until(viewer, came, "images")
        assert inputs.newest("left").header.stamp.nanosec <= sent
        assert inputs.newest("left") is None
        spin_until(viewer, lambda: bool(viewer.count_publishers("right/image_raw")), "the other camera")
        states = inputs.states(silent_after_s=0.0)
        inputs.close()
        assert not inputs.is_open
        viewer.destroy_node()
    assert "quality of service does not match" in states["right"].trouble
    assert "reliable" in states["right"].trouble.lower()
    assert states["depth"].trouble == "nobody publishes it; is the reconstruction running?"
    assert states["left"].trouble.startswith("silent for 0 s")
    # Its stamps are of another clock.
    assert np.isnan(states["left"].latency_s)
    text = facts_text(states, 0.5)
    assert "**/head/right/image_raw**: quality of service" in text
    assert all(f"| {name} |" in text for name in STREAMS)


def test_what_hinders_the_page_is_said_and_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(SettingsError, match=f"at 127.0.0.1 port {port}: Address already in use; choose another"):
            ViewerPage("127.0.0.1", port, "")
    with pytest.raises(SettingsError, match="parameter host is 'no host', which is no address"):
        resolve_host("no host")
    with pytest.raises(SettingsError, match="near_m is 2 and far_m 1; the nearest must be the smaller"):
        check_scale(2.0, 1.0)
    wrong = Parameter("qos_overrides./head/left/image.subscription.depth", value=3)
    with ros_node("asker"), pytest.raises(SettingsError, match=r"unknown parameter qos_overrides\./head/left/image"):
        ViewerNode(parameter_overrides=[wrong])


def test_a_missing_library_is_one_line() -> None:
    code = "import sys; sys.modules['viser'] = None; from moire_sensor.ros.viewer_node import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "--ros-args", "-p", "port:=0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1), done.stderr
    assert done.stderr.startswith("error: the viewer needs the library viser")
    assert "install it: pip install" in done.stderr


def page_address(process: subprocess.Popen[str]) -> str:
    """The address that the viewer says."""
    assert process.stdout is not None
    line = next(line for line in process.stdout if "ready: open" in line)
    return line.partition("ready: open ")[2].split()[0]


def cloud_pixels(picture: npt.NDArray[np.uint8]) -> tuple[int, int]:
    """Bluish and yellowish pixels, either end of the colour map, in the pane between the columns of pictures."""
    pane = picture[160:, 320:-320].astype(int)
    difference = pane[..., 0] - pane[..., 2]
    return int((difference > 40).sum()), int((difference < -40).sum())


def test_a_browser_shows_the_cloud_and_nothing_is_subscribed_without_one(tmp_path: Path) -> None:
    """Head and reconstruction in one process, the viewer in another; nothing comes from anywhere but the viewer."""
    chromium = find_chromium()
    if chromium is None:
        pytest.skip("no Chromium on this machine: the page is not tested (apt-get install chromium)")
    demo = running("moire_demo", "scene:=cylinder_and_box", "rate_hz:=2.0")
    page = running("moire_viewer", "port:=0", "silent_after_s:=60.0", "max_points:=40000")
    with ros_node("asker") as node, demo, page as viewer:
        with browser_tab(chromium, tmp_path / "profile", (1000, 700)) as tab:
            address = page_address(viewer)
            spin_until(node, lambda: node.count_publishers("points") > 0, "the reconstruction")
            assert not node.count_subscribers("points")
            tab.open(address)
            tab.wait(lambda: "depth is known in" in tab.text(), "the table")
            tab.wait(lambda: min(cloud_pixels(tab.picture())) > LEAST_PX, "a cloud of near and far points")
            text, requested = tab.text(), tab.requested
            spin_until(node, lambda: node.count_subscribers("points") == 1, "the viewer's subscription")
        spin_until(node, lambda: not node.count_subscribers("points"), "the end of the subscription")
    assert address.startswith("http://127.0.0.1:")
    assert "stripes: unknown" in text
    assert address + "/" in requested
    assert all(one.startswith((address, f"blob:{address}", "data:")) for one in requested), requested
