"""The same-side test: which left edges confirm the candidates of a right edge (section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.apart import EXACT, ROW, UNCOUNTED
from moire_sensor.edge_cost import NO_MATCH, in_units, match_cost
from moire_sensor.edge_lanes import TOGETHER, vectors_of

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

    Entry j is right edge j and the last of its candidates that has one; further ones follow behind those of all edges.

    Attributes
    ----------
    at, found : (threads, E) int32, of each right edge the place in ``Sides`` of a left edge that may be near one of its
        candidates, and how many of these have such; then 1 in ``found`` if there may be more entries than one.
    column : (threads, E) float32, that candidate.
    right, number : (threads, rows, N) int32, the right edge, and which of its candidates.
    left : (threads, rows, N) int32, the left edge.
    away_px : (threads, rows, N) float32, how far it lies from the candidate.
    cost : (threads, rows, N) int32, what their match adds to J, in units of a path; ``NO_MATCH`` if they do not.
    entries : (threads, rows) int64, entries of each row.
    """

    at: npt.NDArray[np.int32]
    found: npt.NDArray[np.int32]
    column: npt.NDArray[np.float32]
    right: npt.NDArray[np.int32]
    number: npt.NDArray[np.int32]
    left: npt.NDArray[np.int32]
    away_px: npt.NDArray[np.float32]
    cost: npt.NDArray[np.int32]
    entries: npt.NDArray[np.int64]


def pixels_in_reach(reach_px: float) -> int:
    """Pixels whose columns may lie within reach of an edge."""
    return int(2.0 * (reach_px + SLACK_PX)) + 2


@njit(**UNCOUNTED)
def split_sides(left_x, left_side, left_height, reach, x_px, height, edge, seen):  # type: ignore[no-untyped-def]
    """Fill the arrays of :class:`Sides` from the edges of a row; the place of none, endlessly far."""
    half = x_px.size // 2
    down, up = np.uint64(0), np.uint64(half)
    for i in range(left_x.size):
        is_up = np.uint64(left_side[i] > 0)
        at = up if is_up else down
        x_px[at], height[at], edge[at] = left_x[i], left_height[i], i
        up += is_up
        down += np.uint64(1) - is_up
    x_px[down], x_px[up], edge[down] = ENDLESS_PX, ENDLESS_PX, 0
    seen[:] = NOWHERE
    pixels = np.int64(np.float32(2.0) * (reach + SLACK_PX)) + 2
    show(x_px[:down], 0, reach + SLACK_PX, pixels, seen[: seen.size // 2])
    show(x_px[half:up], half, reach + SLACK_PX, pixels, seen[seen.size // 2 :])
    return np.int32(down)


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
def find_near(  # type: ignore[no-untyped-def]
    columns, side, right_height, m, none, rules, x_px, height, edge, seen, at, found, column, right, number, left,
    away_px, cost,
):  # fmt: skip
    """Fill what the entries of a row are: both edges, their distance, and their cost; the number of entries.

    Of nearly all right edges one candidate (K, E) has a left edge near it: what they are is computed for all at once.
    ``none`` is a place without an edge.
    """
    vectors, half = vectors_of(m), np.int32(seen.size // 2)
    clear(vectors, none, at, found, column, number)
    for k in range(columns.shape[0]):
        look_up(columns[k], side, seen, half, np.int32(k), vectors, at, found, column, number)
    confirm(column, right_height, rules, x_px, x_px[1:], height, edge, at, vectors, right, left, away_px, cost, found)
    count = np.int64(m)
    for j in range(np.uint64(m)):
        if found[j] != 0:
            count = add_others(
                columns, side[j], right_height[j], j, at[j], rules, x_px, height, edge, seen, count, right, number,
                left, away_px, cost,
            )  # fmt: skip
    return count


@njit(**EXACT)
def clear(vectors, none, at, found, column, number):  # type: ignore[no-untyped-def]
    """Nothing is near any candidate as yet."""
    for j in range(TOGETHER * vectors):
        at[j], found[j], column[j], number[j] = none, 0, ZERO, 0


@njit(**EXACT)
def look_up(columns, side, seen, half, k, vectors, at, found, column, number):  # type: ignore[no-untyped-def]
    """Note candidates ``k`` with an edge of their side that may be near; those discarded are NaN and see nothing."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            j = np.uint64(TOGETHER * vector + lane)
            spot = seen[pixel_of(columns[j], side[j], half)]
            near = spot >= 0
            found[j] += np.int32(near)
            at[j] = spot if near else at[j]
            column[j] = columns[j] if near else column[j]
            number[j] = k if near else number[j]


@njit(inline="always")
def pixel_of(column, side, half):  # type: ignore[no-untyped-def]
    """Place in ``seen`` of a candidate; the last one of its side, where nothing is, outside the image."""
    last = np.float32(half - 1)
    inside = column if (column >= ZERO) & (column < last) else last
    return np.uint32(np.int32(inside) + (half if side > 0 else np.int32(0)))


@njit(**EXACT)
def confirm(  # type: ignore[no-untyped-def]
    column, right_height, rules, x_px, x_behind, height, edge, at, vectors, right, left, away_px, cost, found
):
    """Fill the first entries, one for each right edge; ``found`` is then 1 where there may be more."""
    reach = np.float32(rules.same_side_px)
    for vector in range(vectors):
        for lane in range(TOGETHER):
            j = np.uint64(TOGETHER * vector + lane)
            here = np.uint32(at[j])
            away = abs(column[j] - x_px[here])
            right[j], left[j], away_px[j] = j, edge[here], away
            cost[j] = cost_of(away, height[here], right_height[j], reach, rules)
            more = (found[j] > 1) | (x_behind[here] <= column[j] + (reach + SLACK_PX))
            found[j] = np.int32(1) if more else np.int32(0)


@njit(inline="always")
def cost_of(away, left_height, right_height, reach, rules):  # type: ignore[no-untyped-def]
    """What a match adds to J whose left edge is of the candidate's side, in units; ``NO_MATCH`` if it is too far."""
    higher, lower = max(left_height, right_height), min(left_height, right_height)
    confirmed = (away <= reach) & (higher <= rules.same_height * lower)
    return in_units(match_cost(away, rules)) if confirmed else NO_MATCH


@njit(**UNCOUNTED)
def add_others(  # type: ignore[no-untyped-def]
    columns, side, right_height, j, first, rules, x_px, height, edge, seen, count, right, number, left, away_px, cost
):
    """Add the entries of right edge j but its own one, by the left edge in place ``first``; the number of all."""
    reach, half = np.float32(rules.same_side_px), np.int32(seen.size // 2)
    for k in range(columns.shape[0]):
        column = columns[k, j]
        here = seen[pixel_of(column, side, half)]
        near = here >= 0
        while near:
            if here != first or k != number[j]:
                away = abs(column - x_px[here])
                right[count], number[count], left[count], away_px[count] = j, k, edge[here], away
                cost[count] = cost_of(away, height[here], right_height, reach, rules)
                count += 1
            here += 1
            near = x_px[here] <= column + (reach + SLACK_PX)
    return count
