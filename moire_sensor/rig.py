"""Geometry of a rectified stereo pair with a projector anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.errors import RigError

if TYPE_CHECKING:
    from moire_sensor.camera_info import CameraInfoSource

Array = npt.NDArray[np.float64]
# Half the sub-pixel floor of a fringe edge: rows or columns that disagree by more than this bias the phase match.
RECTIFIED_TOLERANCE_PX = 0.05


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
    """

    P_left: Array
    P_right: Array
    P_projector: Array
    image_size: tuple[int, int]
    projector_distortion: tuple[float, ...] = ()
    projector_matrix: Array = field(default_factory=lambda: np.eye(3))

    @classmethod
    def from_projections(
        cls,
        P_left: npt.ArrayLike,
        P_right: npt.ArrayLike,
        P_projector: npt.ArrayLike,
        image_size: tuple[int, int],
        projector_distortion: Sequence[float] = (),
        projector_matrix: npt.ArrayLike | None = None,
    ) -> StereoRig:
        """Build a rig from three (3, 4) projection matrices given in any one metric frame.

        The lens of the projector, if any, is ``device = K distort(K^-1 P X)`` with ``projector_matrix`` as K; left
        out, K is taken from ``P_projector``.

        Raises
        ------
        RigError
            A matrix of another shape or not finite, a pair that is not rectified (the message tells by how many
            pixels rows or columns disagree), or a right camera that is not to the right of the left one.
        """
        width, height = check_image_size(image_size)
        matrices = [as_projection(*named) for named in (("P_left", P_left), ("P_right", P_right),
                                                        ("P_projector", P_projector))]
        world_from_left = left_pose(matrices[0])
        in_left = [scaled(matrix @ world_from_left) for matrix in matrices]
        check_rectified(in_left[0], in_left[1], width, height)
        intrinsic = intrinsic_matrix(in_left[2]) if projector_matrix is None else np.asarray(projector_matrix, float)
        lens = tuple(float(value) for value in projector_distortion)
        return cls(*in_left, (width, height), lens if any(lens) else (), intrinsic)

    @classmethod
    def from_camera_info(cls, left: CameraInfoSource, right: CameraInfoSource, projector: CameraInfoSource) -> StereoRig:
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
        """Left column minus right column of points at ``depth_m`` (any shape), equations (9) and (10)."""
        depth = np.asarray(depth_m, dtype=np.float64)
        return np.asarray(self.fx_px * self.baseline_m / depth + self.disparity_at_infinity_px)

    def depth_m(self, disparity_px: npt.ArrayLike) -> Array:
        """Depth of disparities (any shape), equation (9); NaN where the disparity is not positive."""
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

    def points(self, depth_m: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Points of a depth image (H, W) in the left optical frame, (H, W, 3) float32 metres, NaN where unknown.

        Raises
        ------
        RigError
            A depth image of another size.
        """
        width, height = self.image_size
        if depth_m.shape != (height, width):
            raise RigError(f"the depth image has shape {depth_m.shape}; this rig needs {(height, width)}")
        return (self.rays() * depth_m[..., None]).astype(np.float32)

    def projector_pixels(self, points_m: npt.ArrayLike) -> Array:
        """Projector device pixels (column, row), shape (..., 2), of points (..., 3) in the left optical frame."""
        points = np.asarray(points_m, dtype=np.float64)
        device = points @ self.P_projector[:, :3].T + self.P_projector[:, 3]
        pixels = device[..., :2] / device[..., 2:]
        if not self.projector_distortion:
            return np.asarray(pixels)
        return distort_pixels(pixels, self.projector_matrix, self.projector_distortion)


def check_image_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return (width, height) as whole numbers, or raise RigError."""
    width, height = (int(side) for side in image_size)
    if width < 16 or height < 16:
        raise RigError(f"image_size is {image_size}; give (width, height), both at least 16 pixels")
    return width, height


def as_projection(name: str, matrix: npt.ArrayLike) -> Array:
    """Return a finite (3, 4) float64 matrix with a non-degenerate camera, or raise RigError naming it."""
    values = np.asarray(matrix, dtype=np.float64)
    if values.shape != (3, 4):
        raise RigError(f"{name} has shape {values.shape}; a projection matrix has shape (3, 4)")
    if not np.isfinite(values).all():
        raise RigError(f"{name} contains NaN or infinity; give finite numbers, metres to pixels")
    if abs(np.linalg.det(values[:, :3])) < 1e-12:
        raise RigError(f"{name} is singular (all zero?); calibrate the device and give its (3, 4) projection")
    return values


def left_pose(P_left: Array) -> Array:
    """Pose world-from-left, (4, 4), of a projection matrix."""
    _, rotation, centre, *_ = cv2.decomposeProjectionMatrix(P_left)
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = (centre[:3] / centre[3]).ravel()
    return pose


def scaled(projection: Array) -> Array:
    """Scale a projection so that its third row is a unit direction, positive in front of the device."""
    norm = np.linalg.norm(projection[2, :3])
    sign = np.sign(np.linalg.det(projection[:, :3]))
    return np.asarray(projection * (sign / norm))


def intrinsic_matrix(projection: Array) -> Array:
    """Intrinsic matrix K (3, 3) of a projection, scaled to K[2, 2] = 1."""
    intrinsic = np.asarray(cv2.decomposeProjectionMatrix(projection)[0], dtype=np.float64)
    return intrinsic / intrinsic[2, 2]


def distort_pixels(pixels: Array, intrinsic: Array, distortion: Sequence[float]) -> Array:
    """Bend ideal pixels (..., 2) by a lens: ``K distort(K^-1 x)`` with OpenCV's coefficients."""
    flat = np.concatenate([pixels.reshape(-1, 2), np.ones((pixels.size // 2, 1))], axis=1)
    normal = flat @ np.linalg.inv(intrinsic).T
    lens = np.asarray(distortion, dtype=np.float64)
    bent = cv2.projectPoints(normal[:, None, :], np.zeros(3), np.zeros(3), np.eye(3), lens)[0].reshape(-1, 2)
    device = bent @ intrinsic[:2, :2].T + intrinsic[:2, 2]
    return np.asarray(device, dtype=np.float64).reshape(pixels.shape)


def check_rectified(P_left: Array, P_right: Array, width: int, height: int) -> None:
    """Raise RigError unless rows agree and disparity depends on depth alone, over the whole image."""
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=np.float64)
    rays = np.concatenate([corners, np.ones((4, 1))], axis=1) @ np.linalg.inv(P_left[:, :3]).T
    parallax: list[Array] = []
    row_error_px = 0.0
    for depth_m in (0.3, 1.0, 1e6):
        points = np.concatenate([rays * depth_m, np.ones((4, 1))], axis=1)
        seen = points @ P_right.T
        pixels = seen[:, :2] / seen[:, 2:]
        row_error_px = max(row_error_px, float(np.abs(pixels[:, 1] - corners[:, 1]).max()))
        parallax.append(corners[:, 0] - pixels[:, 0])
    column_error_px = max(float(np.ptp(values)) for values in parallax)
    if max(row_error_px, column_error_px) > RECTIFIED_TOLERANCE_PX:
        raise RigError(
            f"the cameras are not a rectified pair: rows disagree by up to {row_error_px:.2f} px and disparity at one "
            f"depth varies by {column_error_px:.2f} px; at most {RECTIFIED_TOLERANCE_PX} px is allowed; "
            "use rectify_pair(...)"
        )
    if parallax[1].mean() <= parallax[2].mean():
        raise RigError(
            f"the right camera lies {-(parallax[1].mean() - parallax[2].mean()) / P_left[0, 0] * 1e3:.1f} mm to the "
            "left of the left camera; it must lie to the right: swap left and right, or check the sign of P[3]"
        )
