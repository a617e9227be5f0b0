"""Points to one a voxel: the mean of what lies in each, where enough does."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
# A voxel of which fewer of the pixels that fall into it are trusted is left out: where the sensor doubts most of a
# surface, those few beside them that pass are as wrong (a door's reveal seen at a grazing angle, off by 0.1 m).
TRUSTED_SHARE = 1.0 / 3.0
# A grid of this size is counted directly, five times as fast as sorting the points; a larger one costs memory.
MAX_GRID_CELLS = 4_000_000
ZERO, MAX_CELL = np.float32(0.0), np.int32(2**31 - 1)


def voxel_means(points: Floats, share: Floats, trusted: Mask, voxel_m: float, min_fill: float) -> Floats:
    """Return (1, M, C): the mean of the trusted points in each voxel whose shares sum up to ``min_fill``.

    ``points`` is (N, C) float32, x y z in metres first; ``share`` (N,) what each point fills of its voxel, 0 for those
    that do not count, which alone may be NaN; of a voxel's points, TRUSTED_SHARE at least must be ``trusted`` (N,). The
    grid of ``voxel_m`` metres is fixed to the origin of the optical frame.
    """
    channels = points.shape[-1]
    points, share = np.ascontiguousarray(points), np.asarray(share, dtype=np.float32)
    if not (trusted & (share > 0.0)).any():
        return np.empty((1, 0, channels), dtype=np.float32)
    numbers, size = voxel_numbers(points, share, np.float32(voxel_m))
    every, count = np.zeros(size, dtype=np.int32), np.zeros(size, dtype=np.int32)
    sums = np.zeros((size, channels + 1))
    add_up(points, share, trusted, numbers, every, count, sums)
    kept = np.flatnonzero((count > 0) & (count >= TRUSTED_SHARE * every) & (sums[:, channels] >= min_fill))
    return np.asarray(sums[kept, :channels] / count[kept, None], dtype=np.float32)[None]


def voxel_numbers(points: Floats, share: Floats, voxel_m: np.float32) -> tuple[Whole, int]:
    """Return the number of each point's (N, C) voxel, counted from 0, and how many there may be; not all need occur.

    The numbers of points without a ``share`` mean nothing.
    """
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    find_box(points, share, voxel_m, low, high)
    sides = high - low + 1
    numbers = np.empty(len(points), dtype=np.int64)
    find_numbers(points, share, voxel_m, low, sides, numbers)
    size = math.prod(sides.tolist())
    if size <= MAX_GRID_CELLS:
        return numbers, size
    chosen = np.flatnonzero(share > 0.0)
    occurring, inverse = np.unique(numbers[chosen], return_inverse=True)
    numbers[chosen] = inverse.reshape(-1)
    return numbers, len(occurring)


@njit(error_model="numpy", cache=True)
def find_box(points, share, voxel_m, low, high):  # type: ignore[no-untyped-def]
    """Fill ``low`` and ``high`` (3,) with the first and last cell of points (N, C) along x, y and z."""
    for axis in range(3):
        least, most = MAX_CELL, -MAX_CELL
        for n in range(len(points)):
            cell = np.int32(np.floor((points[n, axis] if share[n] > ZERO else ZERO) / voxel_m))
            least = min(least, cell if share[n] > ZERO else MAX_CELL)
            most = max(most, cell if share[n] > ZERO else -MAX_CELL)
        low[axis], high[axis] = least, most


@njit(error_model="numpy", cache=True)
def find_numbers(points, share, voxel_m, low, sides, numbers):  # type: ignore[no-untyped-def]
    """Fill ``numbers`` (N,), depth by depth, row by row, of the box that starts at ``low`` and has ``sides`` cells."""
    for n in range(len(points)):
        counts = share[n] > ZERO
        x = np.int64(np.floor((points[n, 0] if counts else ZERO) / voxel_m)) - low[0]
        y = np.int64(np.floor((points[n, 1] if counts else ZERO) / voxel_m)) - low[1]
        z = np.int64(np.floor((points[n, 2] if counts else ZERO) / voxel_m)) - low[2]
        numbers[n] = (z * sides[1] + y) * sides[0] + x if counts else 0


@njit(cache=True)
def add_up(points, share, trusted, numbers, every, count, sums):  # type: ignore[no-untyped-def]
    """Add every point to ``every`` of its voxel, trusted ones to ``count`` and, their share last, to ``sums``."""
    channels = points.shape[1]
    for n in range(len(points)):
        if share[n] > ZERO:
            voxel = numbers[n]
            every[voxel] += 1
            if trusted[n]:
                count[voxel] += 1
                for channel in range(channels):
                    sums[voxel, channel] += points[n, channel]
                sums[voxel, channels] += share[n]
