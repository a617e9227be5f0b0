"""Disparities averaged along their own surface, never across a depth jump."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import LEAF, ROW
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_sums import copy

# Two pixels, one on either side, whose mean lies further than this from the middle one are not on its plane.
OFF_PLANE_PX = np.float32(0.5)
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


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
    mean_along_rows(disparity_px, 1, half_width, rows)
    mean_along_columns(rows, half_height, both)
    return both


def along_every_second(disparity_px: Float32, half_width: int, half_height: int, rows: Float32, both: Float32) -> None:
    """Fill ``both`` with the same means for the rows 0, 2, 4.. of an image (H, W), from pairs in those rows only.

    Each disparity has been measured over a window of several rows, so that its neighbours tell little new.

    Parameters
    ----------
    rows, both : ((H + 1) // 2, W) float32, room for the means along the rows, and the result.
    """
    mean_along_rows(disparity_px, 2, half_width, rows)
    mean_along_columns(rows, (half_height + 1) // 2, both)


@njit(parallel=True, cache=True)
def mean_along_rows(disparity, step, reach, mean):  # type: ignore[no-untyped-def]
    """Fill ``mean`` (H / step, W) with means over pairs in every so many rows."""
    height, width = mean.shape
    for row in prange(height):
        y = np.int64(row) * step
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
        divide(total, count, mean[row])


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


@njit(**LEAF)
def smooth_row(both, disparity, y, mean):  # type: ignore[no-untyped-def]
    """Fill row y (W,) of means whose rows 0, 2, 4.. are ``both``; others lie between, where that is on one plane."""
    here, after = both[y // 2], both[min(y // 2 + 1, both.shape[0] - 1)]
    if y % 2 == 0:
        copy(here, mean)
    elif y // 2 + 1 < both.shape[0]:
        between(here, after, disparity[y], mean)
    else:
        copy(disparity[y], mean)


@njit(**LEAF)
def between(above, below, middle, mean):  # type: ignore[no-untyped-def]
    """Fill the means of two rows where they lie on the plane of the middle, elsewhere that."""
    for x in range(middle.size):
        pair = HALF * (above[x] + below[x])
        off = abs(pair - middle[x])
        # The middle has not been averaged along its row: where both others agree, it may lie further off.
        agree = (abs(above[x] - below[x]) < OFF_PLANE_PX) & (off < ONE)
        mean[x] = pair if agree | (off < OFF_PLANE_PX) else middle[x]
