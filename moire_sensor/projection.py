"""Projection matrices and lenses: checked, taken apart, and applied."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.errors import RigError

Array = npt.NDArray[np.float64]
MIN_SIDE_PX = 16
# Larger images than any camera we know gives are taken for a damaged message or file.
MAX_SIDE_PX = 16384
LENS_SIZES = (0, 4, 5, 8, 12, 14)
# No number of a calibration in pixels and metres comes near; squares and products of larger ones overflow.
LARGEST = 1e12
# Share of the volume that the rows of a matrix of their lengths could span; a real device has 0.1 to 1.
SINGULAR = 1e-9
# A matrix scaled already is left alone, so that a rig told and read again is the same to the bit.
SAME_SCALE = 1e-12


def check_image_size(image_size: Sequence[int], name: str = "image_size") -> tuple[int, int]:
    """Return (width, height) in pixels, or raise RigError unless they are two whole numbers of 16 to 16384."""
    try:
        sides = tuple(float(side) for side in image_size)
    except (TypeError, ValueError):
        sides = ()
    if len(sides) != 2 or not all(side.is_integer() and MIN_SIDE_PX <= side <= MAX_SIDE_PX for side in sides):
        raise RigError(
            f"{name} is {image_size}; give (width, height), whole numbers of at least {MIN_SIDE_PX} pixels and at most "
            f"{MAX_SIDE_PX}"
        )
    return int(sides[0]), int(sides[1])


def numbers(name: str, values: Any, shape: tuple[int, ...]) -> Array:
    """Return finite float64 values of ``shape``, or raise RigError naming them."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise RigError(f"{name} is not an array of numbers; it must have shape {shape}") from None
    if array.shape != shape:
        raise RigError(f"{name} has shape {array.shape}; it must have shape {shape}")
    if not np.isfinite(array).all():
        raise RigError(f"{name} contains NaN or infinity; give finite numbers")
    if np.abs(array).max(initial=0.0) > LARGEST:
        raise RigError(f"{name} contains a number beyond {LARGEST:g}; give pixels and metres")
    return array


def as_projection(name: str, matrix: npt.ArrayLike) -> Array:
    """Return a projection as (3, 4) float64, scaled to a unit third row and a positive determinant.

    A projection matrix is known up to a factor. The one chosen here counts depth in metres, positive in front of any
    device that does not mirror.

    Raises
    ------
    RigError
        A matrix of another shape, not finite, or singular; the message names it.
    """
    values = numbers(name, matrix, (3, 4))
    lengths = np.linalg.norm(values[:, :3], axis=1)
    determinant = float(np.linalg.det(values[:, :3]))
    flat = lengths.min() <= SAME_SCALE * lengths.max()
    if flat or not abs(determinant) > SINGULAR * float(lengths.prod()):
        raise RigError(f"{name} is singular (all zero?); calibrate the device and give its (3, 4) projection")
    factor = float(np.sign(determinant) / lengths[2])
    return values if abs(factor - 1.0) < SAME_SCALE else values * factor


def split_projection(projection: Array) -> tuple[Array, Array, Array]:
    """Intrinsics K (3, 3) with K[2, 2] = 1, rotation device-from-world (3, 3) and position (3,) in the world."""
    matrix = projection[:, :3]
    position = -np.linalg.solve(matrix, projection[:, 3])
    if not np.tril(matrix, -1).any() and (np.diag(matrix) > 0.0).all():
        return np.asarray(matrix / matrix[2, 2]), np.eye(3), np.asarray(position)  # not turned: nothing is rounded
    q, r = np.linalg.qr(matrix[::-1].T)
    intrinsic, rotation = r.T[::-1, ::-1], q.T[::-1]
    signs = np.sign(np.diag(intrinsic))
    intrinsic, rotation = intrinsic * signs, rotation * signs[:, None]
    return np.asarray(intrinsic / intrinsic[2, 2]), np.asarray(rotation), np.asarray(position)


def device_pose(projection: Array) -> Array:
    """Pose world-from-device, (4, 4), of a projection matrix."""
    _, rotation, position = split_projection(projection)
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = position
    return pose


def check_lens(name: str, distortion: Sequence[float]) -> tuple[float, ...]:
    """Return lens coefficients in OpenCV order, empty when all are zero, or raise RigError naming the device."""
    values = tuple(numbers(f"the lens of the {name}", distortion, (len(distortion),)).tolist())
    if len(values) not in LENS_SIZES:
        raise RigError(
            f"the lens of the {name} has {len(values)} coefficients; allowed are {', '.join(map(str, LENS_SIZES))} in "
            "the order k1, k2, p1, p2, k3, ... of OpenCV"
        )
    return values if any(values) else ()


def check_intrinsic(name: str, intrinsic: npt.ArrayLike) -> Array:
    """Return an intrinsic matrix (3, 3) float64, or raise RigError naming the device."""
    values = numbers(f"the intrinsic matrix of the {name}", intrinsic, (3, 3))
    if not (values[0, 0] * values[1, 1] != 0.0 and values[1, 0] == 0.0 and values[2].tolist() == [0.0, 0.0, 1.0]):
        raise RigError(
            f"the intrinsic matrix of the {name} is {values.tolist()}; it must be [[fx, skew, cx], [0, fy, cy], "
            "[0, 0, 1]] with focal lengths that are not zero"
        )
    return values


def distort_pixels(pixels: Array, intrinsic: Array, distortion: Sequence[float]) -> Array:
    """Bend ideal pixels (..., 2) by a lens: ``K distort(K^-1 x)`` with OpenCV's coefficients."""
    homogeneous = np.concatenate([pixels.reshape(-1, 2), np.ones((pixels.size // 2, 1))], axis=1)
    normal = np.ascontiguousarray(homogeneous @ np.linalg.inv(intrinsic).T)
    lens = np.asarray(distortion, dtype=np.float64)
    bent = np.asarray(cv2.projectPoints(normal, np.zeros(3), np.zeros(3), np.eye(3), lens)[0], dtype=np.float64)
    device = bent.reshape(-1, 2) @ intrinsic[:2, :2].T + intrinsic[:2, 2]
    return np.asarray(device.reshape(pixels.shape))
