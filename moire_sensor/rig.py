"""Geometry of a rectified stereo pair with a projector anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import RigError
from moire_sensor.projection import (
    Array,
    as_projection,
    check_image_size,
    check_intrinsic,
    check_lens,
    device_pose,
    distort_pixels,
    split_projection,
)

if TYPE_CHECKING:
    from moire_sensor.camera_info import CameraInfoSource

__all__ = ["Array", "StereoRig"]

# Half the sub-pixel floor of a fringe edge: rows or columns that disagree by more than this bias the phase match.
RECTIFIED_TOLERANCE_PX = 0.05
MIN_BASELINE_MM = 1e-3


@dataclass(frozen=True, eq=False)
class StereoRig:
    """A rectified pair and a projector, in the left optical frame (z forward, x right, y down, metres).

    Build it with :meth:`from_projections` or :meth:`from_camera_info`; the constructor assumes checked input.

    Attributes
    ----------
    P_left, P_right, P_projector : (3, 4) float64, left optical frame in metres to pixels.
    image_size : (width, height) of both camera images.
    projector_distortion : lens coefficients of the projector in OpenCV order, empty for none.
    projector_matrix : (3, 3) float64, intrinsic matrix K that the lens coefficients refer to.
    projector_size : (columns, rows) of the projector's device, None where nobody told.
    """

    P_left: Array
    P_right: Array
    P_projector: Array
    image_size: tuple[int, int]
    projector_distortion: tuple[float, ...] = ()
    projector_matrix: Array = field(default_factory=lambda: np.eye(3))
    projector_size: tuple[int, int] | None = None

    @classmethod
    def from_projections(
        cls,
        P_left: npt.ArrayLike,
        P_right: npt.ArrayLike,
        P_projector: npt.ArrayLike,
        image_size: tuple[int, int],
        projector_distortion: Sequence[float] = (),
        projector_matrix: npt.ArrayLike | None = None,
        projector_size: tuple[int, int] | None = None,
    ) -> StereoRig:
        """Build a rig from three (3, 4) projection matrices given in any one metric frame.

        The lens of the projector, if any, is ``device = K distort(K^-1 P X)`` with ``projector_matrix`` as K (left
        out: the intrinsics in ``P_projector``); it needs ``projector_size``, (columns, rows) of the device.

        Raises
        ------
        RigError
            A matrix of another shape, not finite or singular, a pair that is not rectified (the message tells by how
            many pixels), a right camera that is not to the right of the left one, or an unusable lens.
        """
        size = check_image_size(image_size)
        left, right = as_projection("P_left", P_left), as_projection("P_right", P_right)
        world_from_left = device_pose(left)
        left = np.hstack([split_projection(left)[0], np.zeros((3, 1))])
        right = right @ world_from_left
        check_rectified(left, right, size)
        projector = facing_forward(as_projection("P_projector", P_projector) @ world_from_left)
        matrix = split_projection(projector)[0] if projector_matrix is None else projector_matrix
        lens = check_lens("projector", projector_distortion)
        device = None if projector_size is None else check_image_size(projector_size, "projector_size")
        if lens and device is None:
            raise RigError("a projector lens came without projector_size; give (columns, rows) of the device")
        return cls(left, right, projector, size, lens, check_intrinsic("projector", matrix), device)

    @classmethod
    def from_camera_info(
        cls, left: CameraInfoSource, right: CameraInfoSource, projector: CameraInfoSource
    ) -> StereoRig:
        """Build the rectified rig that three ``sensor_msgs/CameraInfo`` messages, or their YAML files, describe.

        Raises
        ------
        RigError
            An info that is missing, malformed or uncalibrated, or a pair whose P matrices are not rectified.
        """
        from moire_sensor.camera_info import rig_from_camera_info

        return rig_from_camera_info(left, right, projector)

    @cached_property
    def fx_px(self) -> float:
        """Focal length along rows, pixels."""
        return float(self.P_left[0, 0])

    @cached_property
    def fy_px(self) -> float:
        """Focal length along columns, pixels."""
        return float(self.P_left[1, 1])

    @cached_property
    def centre_px(self) -> tuple[float, float]:
        """Principal point of the left image (column, row), pixels."""
        return float(self.P_left[0, 2]), float(self.P_left[1, 2])

    @cached_property
    def baseline_m(self) -> float:
        """Distance from the left to the right camera, metres, positive (T of equation 9)."""
        return float(-self.P_right[0, 3] / self.P_right[0, 0])

    @cached_property
    def disparity_at_infinity_px(self) -> float:
        """Left minus right column of a point at infinity: the principal points may differ, pixels."""
        return float(self.P_left[0, 2] - self.P_right[0, 2])

    def disparity_px(self, depth_m: npt.ArrayLike) -> Array:
        """Left minus right column of points at ``depth_m`` (any shape), equations (9), (10); NaN if not positive."""
        depth = np.asarray(depth_m, dtype=np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            parallax = np.where(depth > 0.0, self.fx_px * self.baseline_m / depth, np.nan)
        return parallax + self.disparity_at_infinity_px

    def depth_m(self, disparity_px: npt.ArrayLike) -> Array:
        """Depth of disparities (any shape), equation (9); NaN where no point in front of the pair has them."""
        parallax = np.asarray(disparity_px, dtype=np.float64) - self.disparity_at_infinity_px
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(parallax > 0.0, self.fx_px * self.baseline_m / parallax, np.nan)

    def rays(self) -> Array:
        """Directions of the left pixels scaled to z = 1, shape (H, W, 3)."""
        width, height = self.image_size
        columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        y = (rows - self.P_left[1, 2]) / self.P_left[1, 1]
        x = (columns - self.P_left[0, 2] - self.P_left[0, 1] * y) / self.P_left[0, 0]
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def points(
        self, depth_m: npt.NDArray[np.floating[Any]], out: npt.NDArray[np.float32] | None = None
    ) -> npt.NDArray[np.float32]:
        """Points of a depth image (H, W) in the left optical frame, (H, W, 3) float32 metres, NaN where unknown.

        They are written into ``out``, (H, W, 3) float32, where it is given.

        Raises
        ------
        RigError
            A depth image of another size.
        """
        width, height = self.image_size
        if depth_m.shape != (height, width):
            raise RigError(f"the depth image has shape {depth_m.shape}; this rig needs {(height, width)}")
        depth = np.asarray(depth_m, dtype=np.float32)
        points = np.empty((height, width, 3), dtype=np.float32) if out is None else out
        # Axis by axis: numpy's loop over three numbers would take five times as long.
        for axis, along in enumerate(self._rays32):
            np.multiply(along, depth, out=points[..., axis])
        return points

    @cached_property
    def _rays32(self) -> tuple[npt.NDArray[np.float32], ...]:
        """Each axis of :meth:`rays`, (H, W)."""
        return tuple(np.ascontiguousarray(axis, dtype=np.float32) for axis in np.moveaxis(self.rays(), -1, 0))

    def projector_pixels(self, points_m: npt.ArrayLike) -> Array:
        """Projector device pixels (column, row), shape (..., 2), of points (..., 3) in the left optical frame.

        The lens is honoured. NaN for points that do not lie in front of the projector.
        """
        points = np.asarray(points_m, dtype=np.float64)
        device = points @ self.P_projector[:, :3].T + self.P_projector[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = np.where(device[..., 2:] > 0.0, device[..., :2] / device[..., 2:], np.nan)
        if not self.projector_distortion:
            return pixels
        return distort_pixels(pixels, self.projector_matrix, self.projector_distortion)


def facing_forward(P_projector: Array) -> Array:
    """Sign of a projection in the left optical frame by which points ahead of the left camera lie in front."""
    return -P_projector if P_projector[2, 2] + P_projector[2, 3] < 0.0 else P_projector


def check_rectified(P_left: Array, P_right: Array, image_size: tuple[int, int]) -> None:
    """Raise RigError unless rows agree and disparity depends on depth alone, over the whole image."""
    width, height = image_size
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=np.float64)
    rays = np.concatenate([corners, np.ones((4, 1))], axis=1) @ np.linalg.inv(P_left[:, :3]).T
    points = np.multiply.outer(np.array([0.3, 1.0, 1e6]), rays)
    seen = points @ P_right[:, :3].T + P_right[:, 3]
    if not (seen[..., 2] > 0.0).all():
        raise RigError("the right camera does not look where the left one looks: not a rectified pair, check P_right")
    parallax = corners - seen[..., :2] / seen[..., 2:]
    row_error_px = float(np.abs(parallax[..., 1]).max())
    column_error_px = float(np.ptp(parallax[..., 0], axis=1).max())
    if max(row_error_px, column_error_px) > RECTIFIED_TOLERANCE_PX:
        raise RigError(
            f"the cameras are not a rectified pair: rows disagree by up to {row_error_px:.2f} px and disparity at one "
            f"depth varies by {column_error_px:.2f} px; at most {RECTIFIED_TOLERANCE_PX} px is allowed; "
            "use rectify_pair(...)"
        )
    baseline_mm = float(parallax[1, :, 0].mean() - parallax[2, :, 0].mean()) / P_left[0, 0] * 1e3
    if not baseline_mm > MIN_BASELINE_MM:
        raise RigError(
            f"the right camera lies {baseline_mm:.1f} mm to the right of the left camera; that must be positive: swap "
            "left and right, or check the sign of P[3]"
        )
