"""The same-side test: which left edges confirm the candidates of a right edge (section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.edge_cost import ENDLESS, in_units, match_cost

# Four columns share an entry of the table of edges.
BIN_BITS = np.uint32(2)
ZERO = np.float32(0.0)


class Sides(NamedTuple):
    """Left edges of a row, down edges and then up edges, one row a lane; E is the most edges of a row.

    Attributes
    ----------
    x_px, height : (lanes, 2 E) float32, as in ``EdgeRows``; behind the last edge of a side lie endless columns.
    edge : (lanes, 2 E) uint32, which left edge it is.
    before : (lanes, 2, B) uint32, edges of each side before every fourth column.
    """

    x_px: npt.NDArray[np.float32]
    height: npt.NDArray[np.float32]
    edge: npt.NDArray[np.uint32]
    before: npt.NDArray[np.uint32]


class Near(NamedTuple):
    """Left edges within reach of a candidate of their side, in the order of the right edges, one row a lane.

    Attributes
    ----------
    column : (lanes, N) float32, where the candidate lies.
    right, at : (lanes, N) uint32, its right edge, and the left edge's place in ``Sides``.
    first : (lanes, E + 1) uint32, of each right edge, the first of its entries.
    left : (lanes, N) uint32, the left edge.
    cost : (lanes, N) int64, what their match adds to J, in units of a path.
    """

    column: npt.NDArray[np.float32]
    right: npt.NDArray[np.uint32]
    at: npt.NDArray[np.uint32]
    first: npt.NDArray[np.uint32]
    left: npt.NDArray[np.uint32]
    cost: npt.NDArray[np.int64]


@njit
def split_sides(left_x, left_side, left_height, x_px, height, edge, before):  # type: ignore[no-untyped-def]
    """Fill the arrays of :class:`Sides` from the edges of a row."""
    before[:] = 0
    down, up = 0, x_px.size // 2
    for i in range(left_x.size):
        is_up = int(left_side[i] > 0)
        at = up if is_up else down
        x_px[at], height[at], edge[at] = left_x[i], left_height[i], i
        before[is_up, (np.int64(left_x[i]) >> BIN_BITS) + 1] += 1
        up += is_up
        down += 1 - is_up
    x_px[down : down + 2], x_px[up : up + 2] = np.inf, np.inf
    add_up(before[0], 0)
    add_up(before[1], x_px.size // 2)


@njit
def add_up(numbers, first):  # type: ignore[no-untyped-def]
    """Sums of all numbers up to each, and of ``first``."""
    number = np.uint32(first)
    for b in range(numbers.size):
        number += numbers[b]
        numbers[b] = number


@njit
def find_near(columns, right_side, m, reach, x_px, before, column, right, at, first):  # type: ignore[no-untyped-def]
    """Note the candidates (K, E) of a row that may have a left edge of their side within reach; their number.

    Most have none. Each is written down and only those near an edge are counted: there is no branch that the processor
    could guess wrong. Indices are unsigned, since numba asks of the others whether they are negative.
    """
    count, most_near = np.uint64(0), np.uint64(at.size - 1)
    for j in range(m):
        side_before = before[np.int64(right_side[j] > 0)]
        first[j] = count
        for number in range(columns.shape[0]):
            # A candidate that was discarded is NaN, and no column is less.
            least, most = columns[number, j] - reach, columns[number, j] + reach
            nearest = side_before[np.uint32(least if least > ZERO else ZERO) >> BIN_BITS]
            nearest += x_px[nearest] < least
            column[count], right[count], at[count] = columns[number, j], j, nearest
            count = min(count + np.uint64(x_px[nearest] <= most), most_near)
            nearest += np.uint64(1)
            while x_px[nearest] <= most:
                column[count], right[count], at[count] = columns[number, j], j, nearest
                count = min(count + np.uint64(1), most_near)
                nearest += np.uint64(1)
    first[m] = count
    return count


@njit
def confirm(right_height, rules, x_px, height, edge, column, right, at, left, cost):  # type: ignore[no-untyped-def]
    """Fill the left edges near candidates, and the cost of a match: endless if too far or of another height."""
    reach = np.float32(rules.same_side_px)
    for near in range(column.size):
        here = at[near]
        left[near] = edge[here]
        away = abs(column[near] - x_px[here])
        higher, lower = max(height[here], right_height[right[near]]), min(height[here], right_height[right[near]])
        confirmed = (away <= reach) & (higher <= rules.same_height * lower)
        cost[near] = in_units(match_cost(away, rules)) if confirmed else ENDLESS
