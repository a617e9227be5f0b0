"""What narrow things found along single rows make of the image: holes closed, things that stand alone widened, and what
goes on from row to row written.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import BARE, NAN_SAFE
from moire_sensor.depth_narrow import STEP_PX
from moire_sensor.depth_seek_chain import SAME_PX
from moire_sensor.depth_seek_fit import HALF, ZERO
from moire_sensor.depth_seek_row import lower

# One row in so many is looked at, as the mean of so many.
ROWS_PX, MEAN_PX = 8, 7
# Of the two rows looked at above and the two below so many must show the same.
LOOK_ROWS, LEAST_ROWS = 2, 2
# A thing that stands alone is wider than the middles of the pieces that fit it, by so much on either side; it is not
# alone where its surface is known so near.
OUTWARD_PX, ALONE_PX = 3, 16
# How well a disparity found so is known.
SIGMA_PX, MISMATCH_RAD = np.float32(0.15), np.float32(0.2)


@njit(**BARE)
def close_holes(line):  # type: ignore[no-untyped-def]
    """Fill single unknown pixels of a row between those of one surface."""
    for x in range(1, line.size - 1):
        if np.isnan(line[x]) and abs(line[x + 1] - line[x - 1]) < SAME_PX:
            line[x] = HALF * (line[x - 1] + line[x + 1])


@njit(**BARE)
def reach_out(line, rows, before):  # type: ignore[no-untyped-def]
    """Widen what stands alone before the wall by ``OUTWARD_PX`` on either side; ``before`` (W,) is memory."""
    sure, wall_before, wall_after = rows[2], rows[3], rows[4]
    width = line.size
    for x in range(width):
        before[x] = line[x]
    for x in range(width):
        if not np.isnan(line[x]):
            continue
        value = np.float32(np.nan)
        for away in range(1, OUTWARD_PX + 1):
            for at in (x - away, x + away):
                if np.isnan(value) and 0 <= at < width:
                    value = before[at]
        alone = lower(wall_before[x], wall_after[x]) < value - STEP_PX
        for at in range(max(x - ALONE_PX, 0), min(x + ALONE_PX + 1, width) if alone else 0):
            alone &= not abs(sure[at] - value) < STEP_PX
        if alone:
            line[x] = value


@njit(**BARE)
def goes_on(found, number, x):  # type: ignore[no-untyped-def]
    """Whether enough of the rows looked at nearby show the same at a column or beside it."""
    rows = 0
    for other in range(max(number - LOOK_ROWS, 0), min(number + LOOK_ROWS + 1, found.shape[0])):
        same = False
        for at in range(max(x - 1, 0), min(x + 2, found.shape[1])):
            same |= abs(found[other, at] - found[number, x]) < SAME_PX
        rows += same and other != number
    return rows >= LEAST_ROWS


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def write(found, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Write what two neighbouring rows looked at have in common into the rows between, and beyond the outermost."""
    height, last = disparity.shape[0], found.shape[0] - 2
    for number in prange(found.shape[0] - 1):
        above, below = found[number], found[number + 1]
        first = np.int64(number) * ROWS_PX + MEAN_PX // 2
        begin, end = (0 if number == 0 else first), (height if number == last else first + ROWS_PX)
        for x in range(above.size):
            step = below[x] - above[x]
            if not abs(step) < SAME_PX or not goes_on(found, number, x) or not goes_on(found, number + 1, x):
                continue
            for y in range(begin, end):
                part = min(max(np.float32(y - first) / np.float32(ROWS_PX), ZERO), np.float32(1.0))
                value = above[x] + part * step
                if not abs(disparity[y, x] - value) < SAME_PX:
                    disparity[y, x], sigma[y, x] = value, SIGMA_PX
                    signed[y, x], mismatch[y, x] = np.float32(np.nan), MISMATCH_RAD
