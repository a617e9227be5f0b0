"""Disparities averaged along their own surface, never across a depth jump."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import ROW
from moire_sensor.phase_carrier import Float32

# Two pixels, one on either side, whose mean lies further than this from the middle one are not on its plane.
OFF_PLANE_PX = np.float32(0.5)
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


def along_surface(
    disparity_px: Float32, half_width: int, half_height: int, room: tuple[Float32, Float32] | None = None
) -> Float32:
    """Mean of every disparity with the pairs of pixels left and right, then above and below, that lie on its plane.

    A pair on either side of the pixel leaves a sloped plane as it is, and one that reaches across a jump is told by
    its mean. Averaging removes noise and the stripes one period wide that shading puts into a phase.

    Parameters
    ----------
    disparity_px : (H, W) float32, NaN where unknown; such pixels stay unknown and count nowhere.
    half_width, half_height : the farthest pair, pixels.
    room : two arrays (H, W) to work in, the second of which becomes the result.
    """
    rows, both = room or (np.empty_like(disparity_px), np.empty_like(disparity_px))
    mean_along_rows(disparity_px, half_width, rows)
    mean_along_columns(rows, half_height, both)
    return both


@njit(parallel=True, cache=True)
def mean_along_rows(disparity, reach, mean):  # type: ignore[no-untyped-def]
    """Fill ``mean`` (H, W) with means over pairs in the row."""
    height, width = disparity.shape
    for y in prange(height):
        # What lies beyond the row is unknown, and so on no plane.
        line = np.full(width + 2 * reach, np.nan, dtype=np.float32)
        line[reach : reach + width] = disparity[y]
        nothing = np.full(width, np.nan, dtype=np.float32)
        total, count = disparity[y].copy(), np.ones(width, dtype=np.float32)
        for away in range(1, reach + 1, 2):
            more = away < reach
            add_pairs(
                line[reach - away :], line[reach + away :], line[reach - away - 1 :] if more else nothing,
                line[reach + away + 1 :] if more else nothing, disparity[y], total, count,
            )  # fmt: skip
        divide(total, count, mean[y])


@njit(parallel=True, cache=True)
def mean_along_columns(disparity, reach, mean):  # type: ignore[no-untyped-def]
    """Fill ``mean`` (H, W) with means over pairs in the column."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        nothing = np.full(width, np.nan, dtype=np.float32)
        total, count = disparity[y].copy(), np.ones(width, dtype=np.float32)
        last = min(reach, y, height - 1 - y)
        for away in range(1, last + 1, 2):
            more = away < last
            add_pairs(
                disparity[y - away], disparity[y + away], disparity[y - away - 1] if more else nothing,
                disparity[y + away + 1] if more else nothing, disparity[y], total, count,
            )  # fmt: skip
        divide(total, count, mean[y])


@njit(**ROW)
def add_pairs(before, after, farther_before, farther_after, middle, total, count):  # type: ignore[no-untyped-def]
    """Add to ``total`` and ``count`` (n,) the means of the two pairs where they lie on the plane of the middle."""
    for x in range(middle.size):
        near = HALF * (before[x] + after[x])
        far = HALF * (farther_before[x] + farther_after[x])
        near_on, far_on = abs(near - middle[x]) < OFF_PLANE_PX, abs(far - middle[x]) < OFF_PLANE_PX
        total[x] += (near if near_on else ZERO) + (far if far_on else ZERO)
        count[x] += (ONE if near_on else ZERO) + (ONE if far_on else ZERO)


@njit(**ROW)
def divide(total, count, mean):  # type: ignore[no-untyped-def]
    """Fill the means (n,)."""
    for x in range(mean.size):
        mean[x] = total[x] / count[x]
