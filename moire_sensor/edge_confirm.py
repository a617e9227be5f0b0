"""The same-side test: which left edges confirm the candidates of a right edge (section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.apart import EXACT, ROW, UNCOUNTED
from moire_sensor.edge_cost import EDGE_BITS, MOST_EDGES, NO_MATCH, in_units, match_cost

# Widens the columns in which an edge is looked for: sums of float32 may round the wrong way.
SLACK_PX = np.float32(0.01)
ZERO, ENDLESS_PX = np.float32(0.0), np.float32(np.inf)
NOWHERE = np.int32(-1)


class Sides(NamedTuple):
    """Left edges of a row, down edges and then up edges, one row a thread; E is the most edges of a row.

    Attributes
    ----------
    x_px, height : (threads, 2 E) float32, as in ``EdgeRows``; behind the last edge of a side lies an endless column.
    edge : (threads, 2 E) int32, which left edge it is.
    seen : (threads, 2 C) int32, of each side and pixel, the place of the first edge that may be within reach; -1 where
        none is, and in the last place of a side.
    """

    x_px: npt.NDArray[np.float32]
    height: npt.NDArray[np.float32]
    edge: npt.NDArray[np.int32]
    seen: npt.NDArray[np.int32]


class Near(NamedTuple):
    """Left edges near a candidate of their side; for N of them in each of the rows abreast, one such block a thread.

    Attributes
    ----------
    spot : (threads, E) int32, for candidates of one number, the place in ``Sides`` of an edge that may be near.
    candidate, at : (threads, rows, N) int32, candidate k of right edge j as k 2^12 + j, and place in ``Sides``.
    right, number : (threads, rows, N) int32, the right edge, and which of its candidates.
    left : (threads, rows, N) int32, the left edge.
    away_px : (threads, rows, N) float32, how far it lies from the candidate.
    cost : (threads, rows, N) int32, what their match adds to J, in units of a path; ``NO_MATCH`` if they do not.
    found : (threads, rows) int64, entries of each row.
    """

    spot: npt.NDArray[np.int32]
    candidate: npt.NDArray[np.int32]
    at: npt.NDArray[np.int32]
    right: npt.NDArray[np.int32]
    number: npt.NDArray[np.int32]
    left: npt.NDArray[np.int32]
    away_px: npt.NDArray[np.float32]
    cost: npt.NDArray[np.int32]
    found: npt.NDArray[np.int64]


def pixels_in_reach(reach_px: float) -> int:
    """Pixels whose columns may lie within reach of an edge."""
    return int(2.0 * (reach_px + SLACK_PX)) + 2


@njit(**UNCOUNTED)
def split_sides(left_x, left_side, left_height, reach, x_px, height, edge, seen):  # type: ignore[no-untyped-def]
    """Fill the arrays of :class:`Sides` from the edges of a row."""
    half = x_px.size // 2
    down, up = np.uint64(0), np.uint64(half)
    for i in range(left_x.size):
        is_up = np.uint64(left_side[i] > 0)
        at = up if is_up else down
        x_px[at], height[at], edge[at] = left_x[i], left_height[i], i
        up += is_up
        down += np.uint64(1) - is_up
    x_px[down], x_px[up] = ENDLESS_PX, ENDLESS_PX
    seen[:] = NOWHERE
    pixels = np.int64(np.float32(2.0) * (reach + SLACK_PX)) + 2
    show(x_px[:down], 0, reach + SLACK_PX, pixels, seen[: seen.size // 2])
    show(x_px[half:up], half, reach + SLACK_PX, pixels, seen[seen.size // 2 :])


@njit(**ROW)
def show(x_px, first, reach, pixels, seen):  # type: ignore[no-untyped-def]
    """Note the edges of a side, the first of which has place ``first``, in all pixels that may be within reach.

    A pixel that two edges reach shows the one before.
    """
    for number in range(x_px.size, 0, -1):
        pixel = np.uint64(max(x_px[np.uint64(number - 1)] - reach, ZERO))
        for step in range(np.uint64(pixels)):
            seen[pixel + step] = first + number - 1


@njit(**UNCOUNTED)
def find_near(columns, right_side, m, reach, x_px, seen, spot, candidate, at):  # type: ignore[no-untyped-def]
    """Note the candidates (K, E) of a row that may have a left edge of their side within reach; their number.

    Most have none. Each is written down and only those near an edge are counted: there is no branch that the processor
    could guess wrong. Indices are unsigned, since numba asks of the others whether they are negative.
    """
    count = np.uint64(0)
    for k in range(columns.shape[0]):
        look_up(columns[k, :m], right_side[:m], seen, spot)
        for j in range(np.uint64(m)):
            candidate[count], at[count] = (k << EDGE_BITS) + np.int64(j), spot[j]
            count += np.uint64(spot[j] >= 0)
    for entry in range(count):
        # Two edges of a side within reach of one pixel are rare.
        k, j = candidate[entry] >> EDGE_BITS, candidate[entry] & MOST_EDGES
        another, most = np.uint64(at[entry] + 1), columns[k, j] + (reach + SLACK_PX)
        while x_px[another] <= most:
            candidate[count], at[count] = candidate[entry], another
            count, another = count + np.uint64(1), another + np.uint64(1)
    return np.int64(count)


@njit(**ROW)
def look_up(columns, side, seen, spot):  # type: ignore[no-untyped-def]
    """Place of the first edge of its side that may be near each candidate; those discarded are NaN and see nothing."""
    half = np.int32(seen.size // 2)
    last = np.float32(half - 1)
    for j in range(columns.size):
        column = columns[j] if (columns[j] >= ZERO) & (columns[j] < last) else last
        spot[j] = seen[np.uint32(np.int32(column) + (half if side[j] > 0 else np.int32(0)))]


@njit(**EXACT)
def confirm(  # type: ignore[no-untyped-def]
    columns, right_height, rules, x_px, height, edge, candidate, at, right, number, left, away_px, cost
):
    """Fill what the entries of a row are: both edges, their distance, and their cost."""
    reach = np.float32(rules.same_side_px)
    for entry in range(candidate.size):
        here, k, j = at[entry], candidate[entry] >> np.int32(EDGE_BITS), candidate[entry] & np.int32(MOST_EDGES)
        right[entry], number[entry] = j, k
        away = abs(columns[k, j] - x_px[here])
        higher, lower = max(height[here], right_height[j]), min(height[here], right_height[j])
        confirmed = (away <= reach) & (higher <= rules.same_height * lower)
        left[entry], away_px[entry] = edge[here], away
        cost[entry] = in_units(match_cost(away, rules)) if confirmed else NO_MATCH
