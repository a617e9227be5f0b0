"""The same-side test: which left edges confirm the candidates of a right edge (section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.edge_cost import ENDLESS, in_units, match_cost

# Two columns share an entry of the table of edges: between edges of one side lies an edge of the other, 2 px or more.
BIN_BITS = np.uint32(1)
ZERO = np.float32(0.0)


class Sides(NamedTuple):
    """Left edges of a row, up edges apart from down edges, one row a lane; E is the most edges of a row.

    Attributes
    ----------
    x_px, height : (lanes, 2, E) float32, as in ``EdgeRows``.
    edge : (lanes, 2, E) uint32, which left edge it is.
    before : (lanes, 2, B) uint32, edges before every second column.
    candidate, at : (lanes, K E) uint32, candidates near a left edge, and the first such in ``edge``.
    first : (lanes, E + 1) uint32, of each right edge, the first of its candidates in ``candidate``.
    """

    x_px: npt.NDArray[np.float32]
    height: npt.NDArray[np.float32]
    edge: npt.NDArray[np.uint32]
    before: npt.NDArray[np.uint32]
    candidate: npt.NDArray[np.uint32]
    at: npt.NDArray[np.uint32]
    first: npt.NDArray[np.uint32]


@njit(inline="always")
def side_index(side):  # type: ignore[no-untyped-def]
    """Where the edges of a side are kept: 1 up, 0 down."""
    return np.int64(side > 0)


@njit
def split_sides(left_x, left_side, left_height, x_px, height, edge, before):  # type: ignore[no-untyped-def]
    """Fill the arrays of :class:`Sides` from the edges of a row; behind the last of a side lies an endless column."""
    before[:] = 0
    up = down = 0
    for i in range(left_x.size):
        s = side_index(left_side[i])
        at = up if s == 1 else down
        x_px[s, at], height[s, at], edge[s, at] = left_x[i], left_height[i], i
        before[s, (np.int64(left_x[i]) >> BIN_BITS) + 1] += 1
        up += s
        down += 1 - s
    x_px[1, up] = x_px[0, down] = np.inf
    add_up(before[0])
    add_up(before[1])


@njit
def add_up(numbers):  # type: ignore[no-untyped-def]
    """Sums of all numbers up to each."""
    number = np.uint32(0)
    for b in range(numbers.size):
        number += numbers[b]
        numbers[b] = number


@njit
def find_near(columns, right_side, m, reach, x_px, before, candidate, at, first):  # type: ignore[no-untyped-def]
    """Keep the candidates (K, E) of a row that have a left edge of their side within reach: most have none.

    Each is written down and only those are counted: there is no branch that the processor could guess wrong. Indices
    are unsigned, since numba asks of the others whether they are negative.
    """
    count = np.uint64(0)
    for j in range(m):
        s = side_index(right_side[j])
        side_x, side_before = x_px[s], before[s]
        first[j] = count
        for number in range(columns.shape[0]):
            # A candidate that was discarded is NaN, and no column is less.
            least, most = columns[number, j] - reach, columns[number, j] + reach
            nearest = side_before[np.uint32(least if least > ZERO else ZERO) >> BIN_BITS]
            nearest += side_x[nearest] < least
            candidate[count], at[count] = number, nearest
            count += np.uint64(side_x[nearest] <= most)
    first[m] = count


@njit
def confirm(column, at, right_height, rules, x_px, height, edge, added):  # type: ignore[no-untyped-def]
    """Lower what a match of a right edge adds to J where a left edge confirms its candidate.

    ``x_px``, ``height`` and ``edge`` are those of its side, ``at`` the first near it; ``added`` (E,) is as for a path.
    """
    reach = np.float32(rules.same_side_px)
    while True:
        away = abs(column - x_px[at])
        higher, lower = max(height[at], right_height), min(height[at], right_height)
        counts = (away <= reach) & (higher <= rules.same_height * lower)
        i = edge[at]
        added[i] = min(added[i], in_units(match_cost(away, rules)) if counts else ENDLESS)
        at += np.uint64(1)
        if not x_px[at] <= column + reach:
            break
