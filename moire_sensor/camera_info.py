"""Camera infos (ROS messages or their YAML files) to a rig and its rectification."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import yaml

from moire_sensor.errors import RigError, quoted
from moire_sensor.projection import Array, check_image_size, check_intrinsic, check_lens, numbers
from moire_sensor.rectify import Map, RectifiedPair
from moire_sensor.rig import StereoRig

# Numbers of coefficients that the lens models of sensor_msgs go with; "" is an info without a lens.
LENS_MODELS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (0, 8, 12, 14), "": (0,)}
COUNTS = {"K": 9, "R": 9, "P": 12}
# Printed with five digits, a rotation is still orthonormal to this.
ROTATION_TOLERANCE = 1e-4
# Rounding left in P[:, 3] of a left camera at the origin, pixels times metres.
ORIGIN_TOLERANCE = 1e-6
# K and P that agree to this many pixels need no resampling.
SAME_PX = 1e-3


class CameraInfoMessage(Protocol):
    """The fields of ``sensor_msgs/CameraInfo`` that must be there; binning and region of interest are looked at too."""

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
    D: tuple[float, ...]
    R: Array
    P: Array

    @property
    def is_rectified(self) -> bool:
        """True when the images need no rectification: no lens, no rotation, K equal to P."""
        same = np.abs(self.K - self.P[:, :3]).max() < SAME_PX
        return bool(not self.D and np.allclose(self.R, np.eye(3), rtol=0.0, atol=1e-9) and same)

    def raw_map(self) -> Map | None:
        """Raw pixel (H, W, 2) float32 of every rectified pixel, None when they are the same."""
        if self.is_rectified:
            return None
        lens = np.asarray(self.D, dtype=np.float64)
        maps = cv2.initUndistortRectifyMap(self.K, lens, self.R, self.P[:, :3], self.size, cv2.CV_32FC2)
        return np.asarray(maps[0], dtype=np.float32)


def rig_from_camera_info(left: CameraInfoSource, right: CameraInfoSource, projector: CameraInfoSource) -> StereoRig:
    """Return the rectified rig of three camera infos; see :meth:`StereoRig.from_camera_info`."""
    return rig_of(*read_calibrations(left, right, projector))


def rectification_from_camera_info(
    left: CameraInfoSource, right: CameraInfoSource, projector: CameraInfoSource
) -> RectifiedPair:
    """Return rig and rectification maps of three camera infos (messages or YAML files).

    D, R and P of the cameras describe raw and rectified images; the projector's P maps the rectified left optical
    frame to its undistorted device pixels, K and D hold its lens.

    Raises
    ------
    RigError
        A missing or malformed info, an uncalibrated one (all zero), sizes that differ, binning or a region of
        interest, or a pair not rectified by P.
    """
    cameras = read_calibrations(left, right, projector)
    return RectifiedPair(rig_of(*cameras), cameras[0].raw_map(), cameras[1].raw_map(), cameras[0].size)


def read_calibrations(
    left: CameraInfoSource, right: CameraInfoSource, projector: CameraInfoSource
) -> tuple[Calibration, Calibration, Calibration]:
    """Read the three infos of a rig; raises RigError naming the device and the field."""
    return read_calibration("left", left), read_calibration("right", right), read_calibration("projector", projector)


def rig_of(left: Calibration, right: Calibration, projector: Calibration) -> StereoRig:
    """Return the rectified rig of three calibrations, or raise RigError."""
    if left.size != right.size:
        raise RigError(f"the left camera info is for {left.size} and the right for {right.size}; both must agree")
    if np.abs(left.P[:, 3]).max() > ORIGIN_TOLERANCE:
        raise RigError(
            f"the left camera info has P[:, 3] = {left.P[:, 3].tolist()}; the left camera is the origin, set it to zero"
        )
    if not right.P[0, 3] < 0.0:
        raise RigError(
            f"the right camera info has P[3] = {right.P[0, 3]}; it must be -fx * baseline_m, a negative number: "
            "calibrate as a stereo pair"
        )
    return StereoRig.from_projections(
        left.P, right.P, projector.P, left.size, projector.D, projector.K, projector.size
    )


def read_calibration(name: str, source: CameraInfoSource) -> Calibration:
    """Read one camera info; raises RigError naming the device and the field."""
    fields = fields_of_file(name, Path(source)) if isinstance(source, (str, Path)) else fields_of_message(name, source)
    size = check_image_size(fields["size"], f"the image size of the {name} camera info")
    arrays = {key: numbers(f"{key} of the {name} camera info", flat(fields[key]), (n,)) for key, n in COUNTS.items()}
    if not arrays["K"].any() or not arrays["P"].any():
        raise RigError(f"the {name} camera info is all zero, an uncalibrated device; calibrate it and load the result")
    intrinsic = check_intrinsic(f"{name} camera info", arrays["K"].reshape(3, 3))
    lens = lens_of(name, fields["distortion_model"], flat(fields["D"]))
    rotation = np.eye(3) if name == "projector" else check_rotation(name, arrays["R"].reshape(3, 3))
    return Calibration(name, size, intrinsic, lens, rotation, arrays["P"].reshape(3, 4))


def lens_of(name: str, model: Any, coefficients: list[Any]) -> tuple[float, ...]:
    """Return the lens coefficients, empty when all are zero, or raise RigError."""
    if model not in LENS_MODELS:
        allowed = ", ".join(filter(None, LENS_MODELS))
        raise RigError(f"the {name} camera info has lens model {quoted(str(model))}; allowed are {allowed}")
    lens = check_lens(f"{name} camera info", coefficients)
    if lens and len(lens) not in LENS_MODELS[model]:
        raise RigError(
            f"the {name} camera info has {len(lens)} lens coefficients; model {model!r} takes "
            f"{' or '.join(map(str, LENS_MODELS[model]))}"
        )
    return lens


def check_rotation(name: str, rotation: Array) -> Array:
    """Return R of a camera, or raise RigError unless it is a rotation."""
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0.0:
        raise RigError(
            f"R of the {name} camera info is no rotation (R R^T is off the identity by {error:.2g}); load what the "
            "stereo calibration gave, or the identity for images that are rectified already"
        )
    return rotation


def fields_of_message(name: str, message: CameraInfoMessage) -> dict[str, Any]:
    """Fields of a ``sensor_msgs/CameraInfo``."""
    try:
        fields = {
            "size": (message.width, message.height), "distortion_model": message.distortion_model,
            "K": message.k, "D": message.d, "R": message.r, "P": message.p,
        }  # fmt: skip
    except AttributeError as error:
        raise RigError(f"the {name} camera info is no sensor_msgs/CameraInfo: {error}") from None
    check_whole_image(name, message)
    return fields


def check_whole_image(name: str, message: Any) -> None:
    """Raise RigError for binning or a region of interest: K and P describe the whole image at full resolution."""
    binning = (getattr(message, "binning_x", 0), getattr(message, "binning_y", 0))
    roi = getattr(message, "roi", None)
    cut = tuple(getattr(roi, side, 0) for side in ("x_offset", "y_offset", "width", "height"))
    if max(binning) > 1 or cut not in ((0, 0, 0, 0), (0, 0, message.width, message.height)):
        raise RigError(
            f"the {name} camera info tells of binning {binning} and a region of interest {cut}; only the whole image "
            "at full resolution is supported: set the camera to it, or calibrate at the size it gives"
        )


def fields_of_file(name: str, path: Path) -> dict[str, Any]:
    """Fields of a camera info YAML as ``camera_calibration`` writes it."""
    try:
        content = yaml.safe_load(path.read_text())
        return {
            "size": (content["image_width"], content["image_height"]),
            "distortion_model": content.get("distortion_model", "plumb_bob"),
            "K": content["camera_matrix"]["data"],
            "D": content.get("distortion_coefficients", {}).get("data", []),
            "R": content.get("rectification_matrix", {}).get("data", np.eye(3).ravel()),
            "P": content["projection_matrix"]["data"],
        }
    except KeyError as error:
        reason = f"{error} is missing"
    except (OSError, yaml.YAMLError, TypeError, AttributeError, ValueError) as error:
        reason = " ".join(str(error).split())
    raise RigError(f"cannot read the {name} camera info {path}: {reason}; give a YAML of camera_calibration")


def flat(values: Any) -> list[Any]:
    """Values of a row-major list or array as one list; anything else is left to the check that names it."""
    try:
        return list(np.asarray(values).ravel())
    except ValueError:
        return [values]
