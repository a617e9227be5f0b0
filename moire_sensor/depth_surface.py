"""Disparities averaged along their own surface, never across a depth jump."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE
from moire_sensor.phase_carrier import Float32

# Two pixels, one on either side, whose mean lies further than this from the middle one are not on its plane.
OFF_PLANE_PX = np.float32(0.5)
TWICE_OFF_PLANE_PX = np.float32(2.0) * OFF_PLANE_PX


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
def add_pair(before, after, middle, total, count):  # type: ignore[no-untyped-def]
    """Add how far twice the middle lies from the pairs on its plane to ``total``, and their number to ``count``."""
    for x in range(middle.size):
        off = before[x] + after[x] - (middle[x] + middle[x])
        on_plane = abs(off) < TWICE_OFF_PLANE_PX
        total[x] += off if on_plane else np.float32(0.0)
        count[x] += np.float32(1.0) if on_plane else np.float32(0.0)


@njit(inline="always", fastmath=NAN_SAFE)
def add_pairs(before, after, farther_before, farther_after, middle, total, count):  # type: ignore[no-untyped-def]
    """The same for two pairs at once, which saves memory traffic."""
    for x in range(middle.size):
        twice = middle[x] + middle[x]
        off, farther = before[x] + after[x] - twice, farther_before[x] + farther_after[x] - twice
        on_plane, too = abs(off) < TWICE_OFF_PLANE_PX, abs(farther) < TWICE_OFF_PLANE_PX
        total[x] += (off if on_plane else np.float32(0.0)) + (farther if too else np.float32(0.0))
        count[x] += (np.float32(1.0) if on_plane else np.float32(0.0)) + (np.float32(1.0) if too else np.float32(0.0))


@njit(inline="always", fastmath=NAN_SAFE)
def fill_mean(middle, total, count, mean):  # type: ignore[no-untyped-def]
    """Fill the mean of the middle and of the pairs, each counted as one value."""
    for x in range(middle.size):
        mean[x] = middle[x] + np.float32(0.5) * total[x] / count[x]


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def mean_along_rows(disparity, reach, mean):  # type: ignore[no-untyped-def]
    """Fill ``mean`` (H, W) with means over pairs in the row."""
    height, width = disparity.shape
    for y in prange(height):
        row = disparity[y]
        total, count = np.zeros(width, dtype=np.float32), np.ones(width, dtype=np.float32)
        for away in range(1, min(reach, (width - 1) // 2) + 1):
            inner = slice(away, width - away)
            add_pair(row[: width - 2 * away], row[2 * away :], row[inner], total[inner], count[inner])
        fill_mean(row, total, count, mean[y])


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def mean_along_columns(disparity, reach, mean):  # type: ignore[no-untyped-def]
    """Fill ``mean`` (H, W) with means over pairs in the column."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        middle = disparity[y]
        total, count = np.zeros(width, dtype=np.float32), np.ones(width, dtype=np.float32)
        farthest = min(reach, y, height - 1 - y)
        for away in range(1, farthest, 2):
            add_pairs(
                disparity[y - away], disparity[y + away], disparity[y - away - 1], disparity[y + away + 1],
                middle, total, count,
            )  # fmt: skip
        if farthest % 2 == 1:
            add_pair(disparity[y - farthest], disparity[y + farthest], middle, total, count)
        fill_mean(middle, total, count, mean[y])
