"""Disparities averaged along their own surface, never across a depth jump."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import ROW
from moire_sensor.phase_carrier import Float32

# Two pixels, one on either side, whose mean lies further than this from the middle one are not on its plane.
OFF_PLANE_PX = np.float32(0.5)
# Pairs that are added together.
TOGETHER = 4
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
        margin = reach + TOGETHER
        line = np.full(width + 2 * margin, np.nan, dtype=np.float32)
        line[margin : margin + width] = disparity[y]
        nothing = np.full(width, np.nan, dtype=np.float32)
        total, count = disparity[y].copy(), np.ones(width, dtype=np.float32)
        for away in range(1, reach + 1, TOGETHER):
            left, right = margin - away, margin + away
            second, third, fourth = away + 1 <= reach, away + 2 <= reach, away + 3 <= reach
            add_pairs(
                line[left:], line[right:],
                line[left - 1 :] if second else nothing, line[right + 1 :] if second else nothing,
                line[left - 2 :] if third else nothing, line[right + 2 :] if third else nothing,
                line[left - 3 :] if fourth else nothing, line[right + 3 :] if fourth else nothing,
                disparity[y], total, count,
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
        for away in range(1, last + 1, TOGETHER):
            above, below = y - away, y + away
            second, third, fourth = away + 1 <= last, away + 2 <= last, away + 3 <= last
            add_pairs(
                disparity[above], disparity[below],
                disparity[above - 1] if second else nothing, disparity[below + 1] if second else nothing,
                disparity[above - 2] if third else nothing, disparity[below + 2] if third else nothing,
                disparity[above - 3] if fourth else nothing, disparity[below + 3] if fourth else nothing,
                disparity[y], total, count,
            )  # fmt: skip
        divide(total, count, mean[y])


@njit(**ROW)
def add_pairs(  # type: ignore[no-untyped-def]
    before, after, before_2, after_2, before_3, after_3, before_4, after_4, middle, total, count
):
    """Add to ``total`` and ``count`` (n,) the means of ``TOGETHER`` pairs where they lie on the plane of the middle."""
    for x in range(middle.size):
        here = middle[x]
        pair, pair_2 = HALF * (before[x] + after[x]), HALF * (before_2[x] + after_2[x])
        pair_3, pair_4 = HALF * (before_3[x] + after_3[x]), HALF * (before_4[x] + after_4[x])
        on, on_2 = abs(pair - here) < OFF_PLANE_PX, abs(pair_2 - here) < OFF_PLANE_PX
        on_3, on_4 = abs(pair_3 - here) < OFF_PLANE_PX, abs(pair_4 - here) < OFF_PLANE_PX
        total[x] += (pair if on else ZERO) + (pair_2 if on_2 else ZERO)
        total[x] += (pair_3 if on_3 else ZERO) + (pair_4 if on_4 else ZERO)
        count[x] += (ONE if on else ZERO) + (ONE if on_2 else ZERO) + (ONE if on_3 else ZERO) + (ONE if on_4 else ZERO)


@njit(**ROW)
def divide(total, count, mean):  # type: ignore[no-untyped-def]
    """Fill the means (n,)."""
    for x in range(mean.size):
        mean[x] = total[x] / count[x]
