"""Disparities averaged along their own surface, never across a depth jump."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE
from moire_sensor.phase_carrier import Float32

# Two pixels, one on either side, whose mean lies further than this from the middle one are not on its plane.
OFF_PLANE_PX = np.float32(0.5)


def along_surface(disparity_px: Float32, half_width: int, half_height: int) -> Float32:
    """Mean of every disparity with the pairs of pixels left and right, then above and below, that lie on its plane.

    A pair on either side of the pixel leaves a sloped plane as it is, and one that reaches across a jump is told by
    its mean. Averaging removes noise and the stripes one period wide that shading puts into a phase.

    Parameters
    ----------
    disparity_px : (H, W) float32, NaN where unknown; such pixels stay unknown and count nowhere.
    half_width, half_height : the farthest pair, pixels.
    """
    rows, both = np.empty_like(disparity_px), np.empty_like(disparity_px)
    mean_along_rows(disparity_px, half_width, rows)
    mean_along_columns(rows, half_height, both)
    return both


@njit(inline="always", fastmath=NAN_SAFE)
def add_pairs(before, after, middle, total, count):  # type: ignore[no-untyped-def]
    """Add to ``total`` and ``count`` (n,) the means of the pairs that lie on the plane of the middle."""
    for x in range(middle.size):
        pair = np.float32(0.5) * (before[x] + after[x])
        on_plane = abs(pair - middle[x]) < OFF_PLANE_PX
        total[x] += pair if on_plane else np.float32(0.0)
        count[x] += np.float32(1.0) if on_plane else np.float32(0.0)


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def mean_along_rows(disparity, reach, mean):  # type: ignore[no-untyped-def]
    """Fill ``mean`` (H, W) with means over pairs in the row."""
    height, width = disparity.shape
    for y in prange(height):
        row = disparity[y]
        total, count = row.copy(), np.ones(width, dtype=np.float32)
        for away in range(1, min(reach, (width - 1) // 2) + 1):
            inner = slice(away, width - away)
            add_pairs(row[: width - 2 * away], row[2 * away :], row[inner], total[inner], count[inner])
        mean[y] = total / count


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def mean_along_columns(disparity, reach, mean):  # type: ignore[no-untyped-def]
    """Fill ``mean`` (H, W) with means over pairs in the column."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        total, count = disparity[y].copy(), np.ones(width, dtype=np.float32)
        for away in range(1, min(reach, y, height - 1 - y) + 1):
            add_pairs(disparity[y - away], disparity[y + away], disparity[y], total, count)
        mean[y] = total / count
