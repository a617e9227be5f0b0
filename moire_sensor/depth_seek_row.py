"""What the right camera sees and nobody explains: lit pixels that no left pixel claims and nothing nearer could hide.

Where a narrow post is lost or taken for the wall behind it, its right pixels are left over so.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import BARE, LEAF_FAST
from moire_sensor.depth_narrow import STEP_PX
from moire_sensor.depth_seek_fit import HALF_PX, ZERO


@njit(**LEAF_FAST)
def fill_mean(image, first, end, mean):  # type: ignore[no-untyped-def]
    """Fill the mean of some rows."""
    part = np.float32(1.0) / np.float32(end - first)
    for x in range(mean.size):
        mean[x] = ZERO
    for y in range(first, end):
        for x in range(mean.size):
            mean[x] += part * image[y, x]


@njit(**BARE)
def fill_sure(disparity, least_px, sure):  # type: ignore[no-untyped-def]
    """Copy the runs of a row that have at least so many pixels, NaN elsewhere."""
    x = 0
    while x < sure.size:
        start = x
        sure[x] = disparity[x]
        x += 1
        while x < sure.size and abs(disparity[x] - disparity[x - 1]) < STEP_PX:
            sure[x] = disparity[x]
            x += 1
        if x - start < least_px:
            for at in range(start, x):
                sure[at] = np.float32(np.nan)


@njit(**BARE)
def fill_sides(values, before, after):  # type: ignore[no-untyped-def]
    """Fill the nearest known value left and right of each pixel of a row, NaN where none."""
    last = np.float32(np.nan)
    for x in range(values.size):
        before[x] = last
        last = last if np.isnan(values[x]) else values[x]
    last = np.float32(np.nan)
    for x in range(values.size - 1, -1, -1):
        after[x] = last
        last = last if np.isnan(values[x]) else values[x]


@njit(forceinline=True, **BARE)
def lower(a, b):  # type: ignore[no-untyped-def]
    """The lower of two values of which one or both may be NaN."""
    return b if np.isnan(a) or b < a else a


@njit(forceinline=True, **BARE)
def is_bright(row, x, reach, least):  # type: ignore[no-untyped-def]
    """Whether a pixel of a row within reach is brighter than ``least``."""
    found = False
    for at in range(max(x - reach, 0), min(x + reach + 1, row.size)):
        found |= row[at] > least
    return found


@njit(**BARE)
def fill_left_over(sure, claims, before, after, places):  # type: ignore[no-untyped-def]
    """Fill the right columns of a row that nobody explains; return how many.

    ``before`` and ``after`` are the claims at the sides. The surface behind is the farther of them; a pixel that would
    show it where the left view has something nearer is hidden there, one beyond the left image is of no use.
    """
    count, width = 0, sure.size
    for column in range(HALF_PX, width - HALF_PX - 1):
        if not np.isnan(claims[column]) or not (np.isnan(claims[column - 1]) or np.isnan(claims[column + 1])):
            continue
        far = lower(before[column], after[column])
        if not np.isnan(far):
            x = int(np.floor(np.float32(column) + far))
            if x + 1 >= width:
                continue
            if x >= 0 and (sure[x] > far + STEP_PX or sure[x + 1] > far + STEP_PX):
                continue
        places[count] = column
        count += 1
    return count
