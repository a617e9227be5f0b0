"""``sensor_msgs/CameraInfo`` of a rectified rig."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from moire_sensor.rig import StereoRig

Matrix = npt.NDArray[np.float64]
FRAMES = {
    "left": "head_left_optical_frame",
    "right": "head_right_optical_frame",
    "projector": "head_projector_optical_frame",
}
# Number of coefficients of the lens models that sensor_msgs names.
LENS_MODELS = {5: "plumb_bob", 8: "rational_polynomial"}


def camera_infos(
    rig: StereoRig,
    header: Header,
    projector_size: tuple[int, int],
    frame_prefix: str = "",
    lens: tuple[float, ...] = (),
) -> dict[str, CameraInfo]:
    """Return the infos of a rectified rig, keyed ``left``, ``right`` and ``projector``, with the header's stamp.

    R is the identity, K the left part of P, and D the ``lens`` of both cameras; without one they need no rectification.
    The right P[3] is -fx times the baseline; the projector's P is the whole map from the left optical frame to its
    device pixels.

    ``projector_size`` : (width, height) of the projector's device in pixels. ``frame_prefix`` stands before the frames'
    names, as robot_state_publisher's parameter of this name.
    """
    left, right = (
        camera_info(header, frame_prefix + FRAMES[side], rig.image_size, P, camera_matrix(P), lens)
        for side, P in (("left", rig.P_left), ("right", rig.P_right))
    )
    projector = camera_info(
        header, frame_prefix + FRAMES["projector"], projector_size,
        rig.P_projector, rig.projector_matrix, rig.projector_distortion,
    )  # fmt: skip
    return {"left": left, "right": right, "projector": projector}


def camera_matrix(P: Matrix) -> Matrix:
    """Return K (3, 3) of a rectified camera: the left part of P, what rounding left below its diagonal taken off."""
    K = np.triu(P[:, :3])
    K[2, 2] = 1.0
    return np.asarray(K)


def camera_info(
    header: Header,
    frame: str,
    size: tuple[int, int],
    P: Matrix,
    K: Matrix,
    distortion: tuple[float, ...] = (),
) -> CameraInfo:
    """Return the info of one device with R the identity; ``frame`` replaces the header's frame."""
    lens_size = min(count for count in LENS_MODELS if count >= len(distortion))
    lens = [float(value) for value in distortion] + [0.0] * (lens_size - len(distortion))
    message = CameraInfo(header=Header(stamp=header.stamp, frame_id=frame))
    message.width, message.height = size
    message.distortion_model = LENS_MODELS[lens_size]
    message.d = lens
    message.k = np.ravel(K).tolist()
    message.r = np.eye(3).ravel().tolist()
    message.p = np.ravel(P).tolist()
    return message


def info_of_rectified(info: CameraInfo) -> CameraInfo:
    """Return the info of a camera whose images are rectified already, as image_proc makes them: P alone counts."""
    message = CameraInfo(header=info.header, width=info.width, height=info.height)
    message.distortion_model, message.d = info.distortion_model, []
    message.k = np.reshape(info.p, (3, 4))[:, :3].ravel().tolist()
    message.r = np.eye(3).ravel().tolist()
    message.p = info.p
    message.binning_x, message.binning_y, message.roi = info.binning_x, info.binning_y, info.roi
    return message
