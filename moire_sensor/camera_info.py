"""Camera infos (ROS messages or their YAML files) to a rig and its rectification."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt
import yaml

from moire_sensor.errors import RigError
from moire_sensor.rectify import Map, RectifiedPair
from moire_sensor.rig import Array, StereoRig

LENS_MODELS = ("plumb_bob", "rational_polynomial", "")


class CameraInfoMessage(Protocol):
    """The fields of ``sensor_msgs/CameraInfo`` that are used."""

    width: int
    height: int
    distortion_model: str
    d: Any
    k: Any
    r: Any
    p: Any


CameraInfoSource = CameraInfoMessage | str | Path


@dataclass(frozen=True, eq=False)
class Calibration:
    """One device: image size, K (3, 3), D, R (3, 3) and P (3, 4), as sensor_msgs/CameraInfo defines them."""

    name: str
    size: tuple[int, int]
    K: Array
    D: Array
    R: Array
    P: Array

    @property
    def is_rectified(self) -> bool:
        """True when the images need no rectification: no lens, no rotation, K equal to P."""
        return not self.D.any() and np.allclose(self.R, np.eye(3)) and np.allclose(self.K, self.P[:, :3])

    def raw_map(self) -> Map | None:
        """Raw pixel (H, W, 2) float32 of every rectified pixel, None when they are the same."""
        if self.is_rectified:
            return None
        maps = cv2.initUndistortRectifyMap(self.K, self.D, self.R, self.P[:, :3], self.size, cv2.CV_32FC2)
        return np.asarray(maps[0], dtype=np.float32)


def rig_from_camera_info(left: CameraInfoSource, right: CameraInfoSource, projector: CameraInfoSource) -> StereoRig:
    """Return the rectified rig of three camera infos; see :meth:`StereoRig.from_camera_info`."""
    return rectification_from_camera_info(left, right, projector).rig


def rectification_from_camera_info(
    left: CameraInfoSource, right: CameraInfoSource, projector: CameraInfoSource
) -> RectifiedPair:
    """Return rig and rectification maps of three camera infos (messages or YAML files).

    D, R and P of the cameras describe raw and rectified images; the projector's P maps the rectified left optical
    frame to its undistorted device pixels, K and D hold its lens.

    Raises
    ------
    RigError
        A missing or malformed info, an uncalibrated one (all zero), sizes that differ, or a pair not rectified by P.
    """
    cameras = [
        read_calibration(name, source)
        for name, source in (("left", left), ("right", right), ("projector", projector))
    ]
    if cameras[0].size != cameras[1].size:
        raise RigError(
            f"the left camera info is for {cameras[0].size} and the right for {cameras[1].size}; both must agree"
        )
    if not cameras[1].P[0, 3] < 0.0:
        raise RigError(
            f"the right camera info has P[3] = {cameras[1].P[0, 3]}; it must be -fx * baseline_m, a negative number: "
            "calibrate as a stereo pair"
        )
    rig = StereoRig.from_projections(
        *(camera.P for camera in cameras), cameras[0].size, cameras[2].D.tolist(), cameras[2].K
    )
    return RectifiedPair(rig, cameras[0].raw_map(), cameras[1].raw_map(), cameras[0].size)


def read_calibration(name: str, source: CameraInfoSource) -> Calibration:
    """Read one camera info; raises RigError naming the device and the field."""
    fields = fields_of_file(name, Path(source)) if isinstance(source, (str, Path)) else fields_of_message(source)
    model = fields.pop("distortion_model")
    if model not in LENS_MODELS:
        raise RigError(f"the {name} camera info has lens model {model!r}; allowed are plumb_bob, rational_polynomial")
    size = fields.pop("size")
    if min(size) < 1:
        raise RigError(f"the {name} camera info is for an image of {size} pixels; set width and height")
    arrays = {key: numbers(name, key, value) for key, value in fields.items()}
    if not arrays["K"].any() or not arrays["P"].any():
        raise RigError(f"the {name} camera info is all zero, an uncalibrated device; calibrate it and load the result")
    rotation = shaped(name, "R", arrays["R"], (3, 3)) if arrays["R"].any() else np.eye(3)
    return Calibration(
        name, size, shaped(name, "K", arrays["K"], (3, 3)), arrays["D"], rotation, shaped(name, "P", arrays["P"], (3, 4))
    )


def fields_of_message(message: CameraInfoMessage) -> dict[str, Any]:
    """Fields of a ``sensor_msgs/CameraInfo``."""
    return {
        "size": (int(message.width), int(message.height)),
        "distortion_model": message.distortion_model,
        "K": message.k, "D": message.d, "R": message.r, "P": message.p,
    }  # fmt: skip


def fields_of_file(name: str, path: Path) -> dict[str, Any]:
    """Fields of a camera info YAML as ``camera_calibration`` writes it."""
    try:
        content = yaml.safe_load(path.read_text())
        return {
            "size": (int(content["image_width"]), int(content["image_height"])),
            "distortion_model": content.get("distortion_model", "plumb_bob"),
            "K": content["camera_matrix"]["data"],
            "D": content.get("distortion_coefficients", {}).get("data", []),
            "R": content.get("rectification_matrix", {}).get("data", []),
            "P": content["projection_matrix"]["data"],
        }
    except (OSError, yaml.YAMLError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise RigError(f"cannot read the {name} camera info {path}: {error!r}; give a camera_calibration YAML") from error


def numbers(name: str, key: str, values: Any) -> Array:
    """Return finite float64 values (n,), or raise RigError."""
    try:
        array = np.asarray(values, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise RigError(f"{key} of the {name} camera info is not a list of numbers: {error}") from error
    if not np.isfinite(array).all():
        raise RigError(f"{key} of the {name} camera info contains NaN or infinity; calibrate the device again")
    return array


def shaped(name: str, key: str, values: npt.NDArray[np.float64], shape: tuple[int, int]) -> Array:
    """Return values in ``shape``, or raise RigError."""
    if values.size != shape[0] * shape[1]:
        raise RigError(f"{key} of the {name} camera info has {values.size} numbers; it needs {shape[0] * shape[1]}")
    return values.reshape(shape)
