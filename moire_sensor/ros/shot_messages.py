"""The results of a shot as messages; all carry the header of the exposure, in the left optical frame."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from moire_sensor.errors import SettingsError
from moire_sensor.rig import StereoRig
from moire_sensor.ros.camera_messages import camera_info, camera_matrix
from moire_sensor.ros.image_messages import image_message

DEPTH_ENCODINGS = ("32FC1", "16UC1")
MAX_DEPTH_MM = 65535


def depth_image(header: Header, depth_m: npt.NDArray[np.float32], encoding: str = "32FC1") -> Image:
    """Return the depth image of REP 118: 32FC1 in metres, NaN unknown; or 16UC1 in millimetres, 0 unknown.

    Raises
    ------
    SettingsError
        Another encoding.
    """
    if encoding == "32FC1":
        return image_message(header, depth_m)
    if encoding != "16UC1":
        raise SettingsError(f"the depth encoding is {encoding!r}; allowed are {' and '.join(DEPTH_ENCODINGS)}")
    depth_mm = np.rint(depth_m * 1000.0)
    known = np.isfinite(depth_mm) & (depth_mm <= MAX_DEPTH_MM)
    return image_message(header, np.where(known, depth_mm, 0.0).astype(np.uint16))


def background_image(header: Header, background: npt.NDArray[np.float32]) -> Image:
    """Return the fringe-free left view, grey levels of 255, as mono8."""
    # OpenCV rounds as numpy does and keeps to 0..255; NaN, like a number beyond all integers, it makes 0.
    return image_message(header, cv2.add(background, 0.0, dtype=cv2.CV_8U), "mono8")


def depth_camera_info(header: Header, rig: StereoRig) -> CameraInfo:
    """Return the info that belongs to the depth image: the rectified left camera, no lens."""
    return camera_info(header, header.frame_id, rig.image_size, rig.P_left, camera_matrix(rig.P_left))


def disparity_message(
    header: Header, rig: StereoRig, disparity_px: npt.NDArray[np.float32], depth_range_m: tuple[float, float]
) -> DisparityImage:
    """Return the disparity for which depth = f T / d, NaN where unknown.

    ``disparity_px`` (H, W) is left minus right column. What principal points of different columns add to it is taken
    off, as stereo_msgs has no field for it.
    """
    far_px, near_px = (float(rig.disparity_px(depth)) - rig.disparity_at_infinity_px for depth in depth_range_m[::-1])
    parallax_px = np.asarray(disparity_px - rig.disparity_at_infinity_px, dtype=np.float32)
    message = DisparityImage(header=header, image=image_message(header, parallax_px))
    message.f, message.t = rig.fx_px, rig.baseline_m
    message.min_disparity, message.max_disparity = far_px, near_px
    # The results are not quantised: the step is that of the 32 bit number.
    message.delta_d = float(np.spacing(np.float32(near_px)))
    message.valid_window = valid_window(rig, far_px)
    return message


def valid_window(rig: StereoRig, far_disparity_px: float) -> RegionOfInterest:
    """Return the left pixels that the right camera can see at least at the far end of the range."""
    width, height = rig.image_size
    first = math.ceil(far_disparity_px + rig.disparity_at_infinity_px)
    last = width - 1 + min(0, math.floor(far_disparity_px + rig.disparity_at_infinity_px))
    first = min(max(first, 0), width)
    return RegionOfInterest(x_offset=first, y_offset=0, width=max(last + 1 - first, 0), height=height)
