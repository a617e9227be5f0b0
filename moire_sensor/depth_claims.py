"""What a row of the right image shows, by the disparities of the left one: each claims the columns where it is seen."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import BARE, ROW


@njit(**BARE)
def claim_nearest(line, claims):  # type: ignore[no-untyped-def]
    """Put into ``claims`` (W,), given full of NaN or of less than any, the greatest disparity seen nearest to each."""
    for x in range(line.size):
        if np.isnan(line[x]):
            continue
        column = int(np.floor(np.float32(x) - line[x] + np.float32(0.5)))
        if 0 <= column < claims.size and not claims[column] > line[x]:
            claims[column] = line[x]


@njit(**BARE)
def claim_both(line, counts, none, columns, seen, claims):  # type: ignore[no-untyped-def]
    """Fill ``claims`` (W,) with the greatest disparity seen on either side of each column, or with ``none``.

    Pixels that do not count claim nothing; the others claim the two columns they fall between. ``columns`` int32 and
    ``seen`` float32 are memory for W + 2 values.
    """
    fill_places(line, counts, columns)
    seen[:] = none
    # Of the pixels that fall between the same columns, the last has the greatest disparity.
    for x in range(line.size):
        seen[np.uint32(columns[x])] = line[x]
    greater_of(seen, seen[1:], claims)


@njit(**ROW)
def fill_places(line, counts, places):  # type: ignore[no-untyped-def]
    """Fill the right column before which each pixel falls, plus one; W + 1 where it falls outside or does not count."""
    width = np.float32(line.size)
    for x in range(line.size):
        column = np.floor(np.float32(np.int32(x)) - line[x])
        inside = (counts[x] != 0) & (column >= np.float32(-1.0)) & (column < width)
        places[x] = np.int32((column if inside else width) + np.float32(1.0))


@njit(**ROW)
def greater_of(before, after, greater):  # type: ignore[no-untyped-def]
    """Fill the greater (n,) of two."""
    for x in range(greater.size):
        greater[x] = max(before[x], after[x])
