"""What a row of the right image shows, by the disparities of the left one: each claims the columns where it is seen."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import BARE


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
def claim_both(line, counts, claims):  # type: ignore[no-untyped-def]
    """Put into ``claims`` (W,), given full of less than any, the greatest disparity seen on either side of each.

    Pixels that do not count claim nothing; the others claim the two columns they fall between.
    """
    first = claims[0]
    for x in range(line.size):
        if counts[x]:
            column = int(np.floor(np.float32(x) - line[x]))
            if 0 <= column < line.size:
                claims[column] = max(claims[column], line[x])
            elif column == -1:
                first = max(first, line[x])
    for column in range(line.size - 1, 0, -1):
        claims[column] = max(claims[column], claims[column - 1])
    claims[0] = max(claims[0], first)
