"""A camera or projector as a pinhole beside the left camera, and what its depth buffer says of points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from moire_sim.surface_kernels import fill_smooth_difference, fill_visible

Array = npt.NDArray[np.float64]
# A point this far behind the buffer's surface is hidden: above what curvature bends within one pixel (0.02 mm on a
# 20 mm pole at 1 m), below the thickness of anything that casts a shadow worth seeing.
SHADOW_BIAS_M = 0.002
# A tangent plane is followed to depths within this share of the point's own: a grazing one soon leaves the surface.
TANGENT_REACH = 0.1


@dataclass(frozen=True, eq=False)
class DeviceView:
    """A pinhole: ``intrinsic`` (3, 3) pixels, ``device_from_left`` (4, 4), ``size`` (width, height) pixels."""

    intrinsic: Array
    device_from_left: Array
    size: tuple[int, int]

    @classmethod
    def of(cls, projection: Array, size: tuple[int, int]) -> DeviceView:
        """Split a projection (3, 4) from the left optical frame."""
        intrinsic, rotation, centre, *_ = cv2.decomposeProjectionMatrix(projection)
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = -rotation @ (centre[:3] / centre[3]).ravel()
        return cls(np.asarray(intrinsic / intrinsic[2, 2], dtype=np.float64), pose, size)

    @property
    def centre_m(self) -> Array:
        """Centre of projection (3,) in the left optical frame."""
        rotation, shift = self.device_from_left[:3, :3], self.device_from_left[:3, 3]
        return np.asarray(-rotation.T @ shift)

    @cached_property
    def rays(self) -> Array:
        """Directions (H, W, 3) of the pixels in the device's own frame, z = 1."""
        width, height = self.size
        columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        pixels = np.stack([columns, rows, np.ones_like(columns)], axis=-1)
        return np.asarray(pixels @ np.linalg.inv(self.intrinsic).T)

    def points(self, depth_m: Array) -> Array:
        """Points (H, W, 3) of a depth buffer (H, W), in the left optical frame."""
        return self.to_left(self.rays * depth_m[..., None])

    def to_left(self, points_m: Array) -> Array:
        """Move points (..., 3) from the device's frame to the left optical frame."""
        rotation, shift = self.device_from_left[:3, :3], self.device_from_left[:3, 3]
        return np.asarray((points_m - shift) @ rotation)

    def to_device(self, points_m: Array) -> Array:
        """Move points (..., 3) from the left optical frame to the device's frame."""
        rotation, shift = self.device_from_left[:3, :3], self.device_from_left[:3, 3]
        return np.asarray(points_m @ rotation.T + shift)


def visible_share(view: DeviceView, depth_m: Array, points_m: Array, planes: Array) -> npt.NDArray[np.float32]:
    """Share (...) 0 to 1 of each surface point that a device sees, by its depth buffer (H, W).

    The four buffer pixels around a point are compared with the point's tangent plane ``q . X = 1`` (``planes``,
    (..., 3), left optical frame), carried to those pixels, and weighed bilinearly. So a slanted surface does not shade
    itself, however steep, and a shadow's edge lies between pixels. Points outside the image, not finite, or facing
    away are not seen.
    """
    faces = dot(planes, points_m - view.centre_m) > 0.0
    own, inverse_z = view.to_device(points_m), inverse_depth_in_pixels(view, planes)
    seen = np.empty(faces.size, dtype=np.float32)
    fill_visible(
        own.reshape(-1, 3), inverse_z.reshape(-1, 3), faces.ravel(), view.intrinsic, depth_m,
        SHADOW_BIAS_M, TANGENT_REACH, seen,
    )  # fmt: skip
    return seen.reshape(faces.shape)


def dot(one: Array, two: Array) -> Array:
    """Scalar products (...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", one, two))


def inverse_depth_in_pixels(view: DeviceView, planes: Array) -> Array:
    """Coefficients (..., 3) of 1 / z = a column + b row + c, in the device's image, of planes ``q . X = 1``."""
    rotation, shift = view.device_from_left[:3, :3], view.device_from_left[:3, 3]
    turned = planes @ rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((turned @ np.linalg.inv(view.intrinsic)) / (1.0 + turned @ shift)[..., None])


def tangent_planes(view: DeviceView, depth_m: Array) -> Array:
    """Tangent planes ``q . X = 1`` (H, W, 3), left optical frame, of the surfaces in a depth buffer (H, W).

    1 / z of a plane is linear in the pixel, so differences of 1 / z give the plane exactly. At edges the smoother side
    is taken; q points away from the device.
    """
    inverse_z = 1.0 / np.nan_to_num(depth_m, nan=1e3)
    by_column = smooth_difference(inverse_z, axis=1)
    by_row = smooth_difference(inverse_z, axis=0)
    width, height = view.size
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    in_pixels = np.stack([by_column, by_row, inverse_z - by_column * columns - by_row * rows], axis=-1)
    own = in_pixels @ view.intrinsic
    rotation, shift = view.device_from_left[:3, :3], view.device_from_left[:3, 3]
    # q . (R X + t) = 1 is (R^T q) . X = 1 - q . t.
    return np.asarray((own @ rotation) / (1.0 - own @ shift)[..., None])


def smooth_difference(values: Array, axis: int) -> Array:
    """Difference per pixel (H, W): central on smooth parts, on the smoother side beside an edge (ENO)."""
    along = np.ascontiguousarray(np.moveaxis(values, axis, -1))
    difference = np.empty_like(along)
    fill_smooth_difference(along, difference)
    return np.asarray(np.moveaxis(difference, -1, axis))
