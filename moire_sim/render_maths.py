"""Poses and camera matrices in the forms that the renderer takes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from moire_sim.device_view import DeviceView

Array = npt.NDArray[np.float64]
NEAR_M, FAR_M = 0.2, 10.0
TINY_CENTRE, EGL_CENTRE = (0.0, 1.0), (0.5, 0.5)


def quaternion(rotation: Array) -> list[float]:
    """Quaternion (x, y, z, w) of a rotation matrix: the eigenvector of the largest eigenvalue (Bar-Itzhack 2000)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    symmetric = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    vector: list[float] = np.linalg.eigh(symmetric)[1][:, -1].tolist()
    return vector


def clip_from_device(view: DeviceView, centre: tuple[float, float]) -> Array:
    """OpenGL projection (4, 4) of a device whose pixel centres are at integers.

    ``centre`` is where a renderer samples a pixel, columns and rows from its upper left corner: OpenGL in its middle;
    TinyRenderer at whole window coordinates counted from the lower left corner, and image row v is window row
    height - 1 - v: hence no half pixel along a row and a whole one down a column.
    """
    (fx, skew, cx), (_, fy, cy), _ = view.intrinsic.tolist()
    width, height = view.size
    return np.array(
        [
            [2.0 * fx / width, -2.0 * skew / width, 1.0 - 2.0 * (cx + centre[0]) / width, 0.0],
            [0.0, 2.0 * fy / height, 2.0 * (cy + centre[1]) / height - 1.0, 0.0],
            [0.0, 0.0, -(FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )


def column_major(matrix: Array) -> list[float]:
    """Return a matrix as the flat list that OpenGL takes."""
    values: list[float] = matrix.T.ravel().tolist()
    return values
