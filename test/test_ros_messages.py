"""Conversions between arrays and messages, without a node."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from moire_sensor.camera_info import rectification_from_camera_info
from moire_sensor.errors import ImageError, SettingsError
from moire_sensor.paper_rig import FX_PX, PROJECTOR_SIZE, paper_rig
from moire_sensor.rig import StereoRig
from moire_sensor.ros.camera_messages import camera_infos
from moire_sensor.ros.cloud_messages import cloud_message, organised_cloud
from moire_sensor.ros.image_messages import grey_image, image_message
from moire_sensor.ros.shot_messages import background_image, depth_camera_info, depth_image, disparity_message

HEADER = Header(frame_id="head_left_optical_frame")
ROWS = np.arange(12, dtype=np.uint8).reshape(3, 4)


def message_of(rows: np.ndarray[Any, Any], encoding: str, **fields: Any) -> Image:
    message = Image(height=rows.shape[0], width=rows.shape[1], encoding=encoding)
    message.step = rows.strides[0]
    message.data = rows.tobytes()
    for name, value in fields.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_grey_image_returns_what_image_message_was_given(kind: type) -> None:
    values = (np.arange(48 * 64).reshape(48, 64) * 7 % np.iinfo(kind).max).astype(kind)
    message = image_message(HEADER, values, "mono8" if kind is np.uint8 else "mono16")
    assert message.step == 64 * values.itemsize
    assert message.header == HEADER
    back = grey_image("left", message)
    assert back.dtype == values.dtype
    np.testing.assert_array_equal(back, values)


def test_grey_image_honours_byte_order() -> None:
    values = np.array([[1, 256], [513, 65535]], dtype=np.uint16)
    for order, flag in (("<", 0), (">", 1)):
        sent = values.astype(values.dtype.newbyteorder(order))  # type: ignore[arg-type]
        back = grey_image("left", message_of(sent, "mono16", is_bigendian=flag))
        assert back.dtype == np.dtype(np.uint16)
        np.testing.assert_array_equal(back, values)


def test_grey_image_skips_row_padding() -> None:
    padded = np.full((3, 7), 255, dtype=np.uint8)
    padded[:, :4] = ROWS
    np.testing.assert_array_equal(grey_image("left", message_of(padded, "mono8", width=4)), ROWS)


@pytest.mark.parametrize(
    ("encoding", "fields", "says"),
    [
        ("rgb8", {}, "encoding 'rgb8'; allowed are mono8 and mono16"),
        ("", {}, "encoding ''"),
        ("mono8", {"width": 5}, "step 4; 5 pixels of mono8"),
        ("mono16", {}, "step 4; 4 pixels of mono16"),
        ("mono8", {"height": 4}, "12 bytes of data; step 4 times height 4 is 16"),
        ("mono8", {"data": bytes(11)}, "truncated"),
        ("mono8", {"data": bytes(13)}, "damaged"),
        ("mono8", {"height": 0, "data": b""}, "4x0 pixels"),
        ("mono8", {"width": 0}, "0x3 pixels"),
        ("mono8", {"width": 2**31, "step": 2**31}, "each side must be 1 to 16384"),
        ("mono16", {"width": 1, "step": 3, "height": 4}, "multiple of 2"),
    ],
)
def test_grey_image_refuses_and_names_the_camera(encoding: str, fields: dict[str, Any], says: str) -> None:
    with pytest.raises(ImageError, match=f"the right image .*{says}"):
        grey_image("right", message_of(ROWS, encoding, **fields))


def test_camera_infos_of_the_paper_rig_follow_the_contract_and_give_the_rig_back() -> None:
    rig = paper_rig()
    infos = camera_infos(rig, HEADER, PROJECTOR_SIZE)
    assert infos["right"].p[3] == pytest.approx(-FX_PX * 0.094, abs=1e-9)
    assert infos["projector"].p[3] == pytest.approx(-FX_PX * 0.053, abs=1e-9)
    assert infos["projector"].p[2] == pytest.approx(483.54041)
    assert infos["left"].p[3] == 0.0
    for name, info in infos.items():
        assert info.header.frame_id == f"head_{name}_optical_frame"
        assert (info.width, info.height) == (PROJECTOR_SIZE if name == "projector" else (640, 480))
        assert list(info.r) == np.eye(3).ravel().tolist()
    pair = rectification_from_camera_info(infos["left"], infos["right"], infos["projector"])
    assert pair.left_map is None
    assert pair.right_map is None
    for name in ("P_left", "P_right", "P_projector"):
        np.testing.assert_array_equal(getattr(pair.rig, name), getattr(rig, name))


def rotated_rig() -> StereoRig:
    """A projector turned by 170 degrees about its axis and 20 about the vertical, with a lens."""
    angle, yaw = np.deg2rad(170.0), np.deg2rad(20.0)
    roll = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    lens = np.array([[1800.0, 0, 640], [0, 1790, 400], [0, 0, 1]])
    projector = lens @ roll @ turn @ np.hstack([np.eye(3), [[-0.2], [0.03], [0.01]]])
    base = paper_rig()
    return StereoRig.from_projections(
        base.P_left, base.P_right, projector, (640, 480), projector_distortion=(0.1, -0.05, 0.001, 0.002, 0.0),
        projector_size=(1280, 800),
    )


def test_camera_infos_carry_a_rotated_projector_with_its_lens() -> None:
    rig = rotated_rig()
    infos = camera_infos(rig, HEADER, (1280, 800))
    back = rectification_from_camera_info(infos["left"], infos["right"], infos["projector"]).rig
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 0.5], [0.2, 0.2, 2.0], (200, 3))
    np.testing.assert_allclose(back.projector_pixels(points), rig.projector_pixels(points), atol=1e-9)


def test_depth_image_is_rep_118_in_both_encodings() -> None:
    depth_m = np.array([[1.0004, np.nan, 0.5], [65.535, 65.536, 1.9996]], dtype=np.float32)
    metres = depth_image(HEADER, depth_m)
    assert (metres.encoding, metres.step) == ("32FC1", 12)
    np.testing.assert_array_equal(np.frombuffer(metres.data, np.float32).reshape(2, 3), depth_m)
    millimetres = depth_image(HEADER, depth_m, "16UC1")
    assert (millimetres.encoding, millimetres.step) == ("16UC1", 6)
    assert np.frombuffer(millimetres.data, np.uint16).tolist() == [1000, 0, 500, 65535, 0, 2000]
    with pytest.raises(SettingsError, match="allowed are 32FC1 and 16UC1"):
        depth_image(HEADER, depth_m, "64FC1")


def test_background_image_is_clipped_and_rounded_mono8() -> None:
    message = background_image(HEADER, np.array([[-3.0, 99.6, 300.0, np.nan]], dtype=np.float32))
    assert message.encoding == "mono8"
    assert list(message.data) == [0, 100, 255, 0]


def test_depth_camera_info_has_the_frame_and_matrix_of_the_left_camera() -> None:
    info = depth_camera_info(HEADER, paper_rig())
    assert info.header == HEADER
    assert list(info.p) == paper_rig().P_left.ravel().tolist()


def test_disparity_gives_depth_as_stereo_msgs_says_also_with_shifted_centres() -> None:
    base = paper_rig()
    shifted = base.P_right.copy()
    shifted[0] += 40.0 * shifted[2]
    rig = StereoRig.from_projections(base.P_left, shifted, base.P_projector, (640, 480))
    depth_m = np.full((480, 640), 1.25, dtype=np.float32)
    depth_m[0, 0] = np.nan
    message = disparity_message(HEADER, rig, rig.disparity_px(depth_m).astype(np.float32), (0.5, 2.0))
    values = np.frombuffer(message.image.data, np.float32).reshape(480, 640)
    # Tolerance: one 32 bit rounding of a disparity of 94 px.
    np.testing.assert_allclose(message.f * message.t / values[1:], 1.25, rtol=1e-6)
    assert np.isnan(values[0, 0])
    assert message.f * message.t / message.max_disparity == pytest.approx(0.5, rel=1e-6)
    assert message.f * message.t / message.min_disparity == pytest.approx(2.0, rel=1e-6)


def test_disparity_window_holds_the_columns_that_the_right_camera_sees() -> None:
    rig = paper_rig()
    message = disparity_message(HEADER, rig, np.full((480, 640), 60.0, dtype=np.float32), (0.5, 2.0))
    window = message.valid_window
    far_px = float(rig.disparity_px(2.0))
    assert window.x_offset - 1 < far_px <= window.x_offset
    assert (window.x_offset + window.width, window.y_offset, window.height) == (640, 0, 480)


def fields_of(message: PointCloud2) -> np.ndarray[Any, Any]:
    """Read a cloud as a consumer does: by the offsets that the message names."""
    kind = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": ["<f4" if not message.is_bigendian else ">f4"] * len(message.fields),
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    return np.frombuffer(message.data, kind).reshape(message.height, message.width)


def test_organised_cloud_is_aligned_with_the_image_and_honest_about_nan() -> None:
    rig = paper_rig()
    depth_m = np.full((480, 640), 1.5, dtype=np.float32)
    grey = np.arange(480 * 640, dtype=np.float32).reshape(480, 640) % 256
    message, cloud = organised_cloud(HEADER, rig, depth_m, grey)
    assert (message.height, message.width, message.point_step, message.row_step) == (480, 640, 16, 10240)
    assert message.is_dense is True
    assert message.is_bigendian == (sys.byteorder == "big")
    points = fields_of(message)
    column, row = 400, 100
    assert points[row, column]["z"] == np.float32(1.5)
    assert points[row, column]["x"] == pytest.approx((column - rig.centre_px[0]) * 1.5 / rig.fx_px, rel=1e-6)
    assert points[row, column]["y"] == pytest.approx((row - rig.centre_px[1]) * 1.5 / rig.fy_px, rel=1e-6)
    np.testing.assert_array_equal(points["intensity"], grey)
    assert message == cloud_message(HEADER, cloud)
    depth_m[3, 5] = np.nan
    holey, _ = organised_cloud(HEADER, rig, depth_m, grey)
    assert holey.is_dense is False
    assert all(np.isnan(fields_of(holey)[3, 5][name]) for name in "xyz")


def test_an_empty_cloud_is_a_whole_message() -> None:
    message = cloud_message(HEADER, np.empty((1, 0, 4), dtype=np.float32))
    assert (message.height, message.width, len(message.data), message.is_dense) == (1, 0, 0, True)
