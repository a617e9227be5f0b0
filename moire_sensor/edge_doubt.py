"""Matches that another fringe order explains as well: then nothing within the images tells which is right."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import EXACT, UNCOUNTED
from moire_sensor.edge_cost import NEAR, in_units, match_cost

# In place of the number of a right edge: there is a match, but two fringe orders fit.
DOUBTFUL = np.int32(-2)
# Shorter runs of edges fit another order by accident.
LEAST_RUN = 8
# No edge lies so far off.
NO_SHIFT = np.int32(1 << 30)


@njit(**UNCOUNTED)
def doubt_row(partner, right, left, cost, rules, shift):  # type: ignore[no-untyped-def]
    """Mark the runs of a row's matches, neighbours in both images, whose left edges confirm another run as closely.

    ``right``, ``left`` and ``cost`` are those of :class:`Near`; ``shift`` (E,) holds meanwhile how far in its row the
    other right edge, the last one if there are more, lies from the left one.
    """
    close = in_units(match_cost(np.float32(NEAR * rules.same_side_px), rules))
    if count_elsewhere(partner, right, left, cost, close) < rules.doubtful_share * LEAST_RUN:
        return
    shift[: partner.size] = NO_SHIFT
    for near in range(right.size):
        edge, other = np.int64(left[near]), np.int64(right[near])
        if cost[near] <= close and partner[edge] != other:
            shift[edge] = min(shift[edge], edge - other)
    start = 0
    for i in range(1, partner.size + 1):
        if i == partner.size or partner[i - 1] < 0 or partner[i] != partner[i - 1] + 1:
            if i - start >= LEAST_RUN and most_common(shift[start:i]) >= rules.doubtful_share * (i - start):
                partner[start:i] = DOUBTFUL
            start = i


@njit(**EXACT)
def count_elsewhere(partner, right, left, cost, close):  # type: ignore[no-untyped-def]
    """How many left edges confirm another match as closely."""
    number = np.int32(0)
    for near in range(right.size):
        number += np.int32((cost[near] <= close) & (partner[np.uint32(left[near])] != right[near]))
    return number


@njit(**UNCOUNTED)
def most_common(shift):  # type: ignore[no-untyped-def]
    """How often the shift occurs that more than half of the edges have; 0 if there is none."""
    value, votes = NO_SHIFT, 0
    for i in range(shift.size):
        value = shift[i] if votes == 0 else value
        votes += 1 if shift[i] == value else -1
    number = np.int64(0)
    for i in range(shift.size):
        number += np.int64(shift[i] == value)
    return number if value != NO_SHIFT else np.int64(0)
