"""A camera or projector as a pinhole beside the left camera, and what its depth buffer says of points."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sim.surface_kernels import fill_lambert, fill_padded, fill_planes, fill_points, fill_visible

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

    def points(self, depth_m: Array) -> Array:
        """Points (H, W, 3) of a depth buffer (H, W), in the left optical frame."""
        points = np.empty((*depth_m.shape, 3))
        fill_points(depth_m, np.linalg.inv(self.intrinsic), *self.rotation_and_shift, points)
        return points

    @property
    def rotation_and_shift(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and shift (3,) from the left optical frame, each contiguous."""
        return self.device_from_left[:3, :3].copy(), self.device_from_left[:3, 3].copy()

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
    seen = np.empty(planes.shape[:-1], dtype=np.float32)
    fill_visible(
        points_m.reshape(-1, 3), planes.reshape(-1, 3), (view.intrinsic, *view.rotation_and_shift), depth_m,
        SHADOW_BIAS_M, TANGENT_REACH, seen.ravel(),
    )  # fmt: skip
    return seen


def dot(one: Array, two: Array) -> Array:
    """Scalar products (...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", one, two))


def tangent_planes(view: DeviceView, depth_m: Array) -> Array:
    """Tangent planes ``q . X = 1`` (H, W, 3), left optical frame, of the surfaces in a depth buffer (H, W).

    1 / z of a plane is linear in the pixel, so differences of 1 / z give the plane exactly. At edges the smoother side
    is taken; q points away from the device.
    """
    height, width = depth_m.shape
    padded, planes = np.empty((height + 4, width + 4)), np.empty((height, width, 3))
    fill_padded(depth_m, padded)
    fill_planes(padded, view.intrinsic, *view.rotation_and_shift, planes)
    return planes


def lambert_cosine(planes: Array, points_m: Array, light_m: Array) -> npt.NDArray[np.float32]:
    """Cosine (H, W) between the normals of planes ``q . X = 1`` and the way to the light; 0 where nothing is seen."""
    lambert = np.empty(planes.shape[:-1], dtype=np.float32)
    fill_lambert(points_m.reshape(-1, 3), planes.reshape(-1, 3), light_m, lambert.ravel())
    return lambert
