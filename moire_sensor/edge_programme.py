"""Dynamic programme over the fringe edges of an epipolar line (section 3.4, constraints 1 to 3).

The right edges are taken one by one. A match of right edge j with left edge i follows the start, the match of j - 1
with i - 1, a match of j - 1 before a run of unmatched left edges, or a match of i - 1 before a run of unmatched right
ones: order (constraint 2) holds because i and j only grow, and no run in one image meets a run in the other (constraint
3). Before the first and after the last match both may run. Only matches in the depth range are looked at.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.edge_confirm import confirm, find_near, split_sides
from moire_sensor.edge_cost import COST, ENDLESS, alike, in_units
from moire_sensor.edge_doubt import doubt_row
from moire_sensor.edge_lanes import LANES, lane_rows

# A match of i and j has place j 2^12 + i + 1, the start place 0.
EDGE_BITS = 12
MOST_EDGES = (1 << EDGE_BITS) - 1


class Work(NamedTuple):
    """Tables of the programme, one a lane in the first dimension; E is the most edges of a row.

    Attributes
    ----------
    added : (lanes, E) int64, what a match of left edge i with the right edge at hand adds to J.
    path : (lanes, E) int64, best path whose last match is that of i with the right edge at hand, or the one before.
    skipped : (lanes, E + 1) int64, best path whose last match is that of i - 1 with a right edge before the last one.
    previous : (lanes, E, E) int32, of a match [j, i], the place of the match before it on its best path.
    shift : (lanes, E) int32, of :func:`doubt_row`.
    """

    added: npt.NDArray[np.int64]
    path: npt.NDArray[np.int64]
    skipped: npt.NDArray[np.int64]
    previous: npt.NDArray[np.int32]
    shift: npt.NDArray[np.int32]


@njit(parallel=True, cache=True)
def match_rows(left, right, candidates, rules, every_row, sides, near, work, partner, candidate):  # type: ignore[no-untyped-def]
    """Match every ``every_row``-th row."""
    for index in prange(LANES):
        lane = np.int64(index)
        first, behind = lane_rows(lane, left.x_px.shape[0])
        # The middle rows of blocks of ``every_row`` rows.
        offset = (every_row // 2 - first) % every_row
        for y in range(first + offset, behind, every_row):
            found = confirm_row(left, right, candidates[y], rules, y, sides, near, lane)
            end = solve_row(left, right, rules, y, near, work, lane)
            trace_back(end, left, right, candidates[y], rules, y, work.previous[lane], partner[y], candidate[y])
            doubt_row(
                partner[y, : left.number[y]], near.right[lane], near.left[lane, :found], near.cost[lane], rules,
                work.shift[lane],
            )  # fmt: skip


@njit
def confirm_row(left, right, columns, rules, y, sides, near, lane):  # type: ignore[no-untyped-def]
    """The same-side test of row y: which left edges confirm candidates, and what their matches cost; their number."""
    n, m, reach = left.number[y], right.number[y], np.float32(rules.same_side_px)
    x_px, height, edge, before = sides.x_px[lane], sides.height[lane], sides.edge[lane], sides.before[lane]
    column, owner, at = near.column[lane], near.right[lane], near.at[lane]
    split_sides(left.x_px[y, :n], left.side[y], left.height[y], x_px, height, edge, before)
    found = find_near(columns, right.side[y], m, reach, x_px, before, column, owner, at, near.first[lane])
    confirm(right.height[y], rules, x_px, height, edge, column[:found], owner, at, near.left[lane], near.cost[lane])
    return found


@njit
def solve_row(left, right, rules, y, near, work, lane):  # type: ignore[no-untyped-def]
    """Run the programme over row y; the place of the last match of the best path."""
    # Taken out of the tuples once: numba counts references each time, which would cost more than all the rest.
    n, m = left.number[y], right.number[y]
    left_x, left_side = left.x_px[y, :n], left.side[y]
    right_x, right_side = right.x_px[y, :m], right.side[y]
    added, path, skipped, previous = work.added[lane], work.path[lane], work.skipped[lane], work.previous[lane]
    first, confirmed, cost = near.first[lane], near.left[lane], near.cost[lane]
    lambda_oc, only_side = in_units(rules.lambda_oc), in_units(rules.lambda_mat - rules.lambda_r)
    path[:n], skipped[: n + 1] = ENDLESS, ENDLESS
    best = lambda_oc * (np.int64(n > 0) + np.int64(m > 0))
    low = high = 0
    for j in range(m):
        # Before the first left edge nothing is unmatched, and before the first right one neither.
        skipped[0] = -lambda_oc if j == 0 else 0
        start = lambda_oc if j == 0 else 2 * lambda_oc
        low_before = low
        low, high = band(left_x, right_x[j], rules, low, high)
        added[low:high] = only_side
        for number in range(first[j], first[j + 1]):
            i = confirmed[number]
            added[i] = min(added[i], cost[number])
        run, diagonal = leave_behind(path[low_before:low])
        whole = extend_paths(
            run, diagonal, start, lambda_oc, (j << EDGE_BITS) + low + 1, left_side[low:high], right_side[j],
            added[low:high], path[low:high], skipped[low : high + 1], previous[j, low:high],
        )  # fmt: skip
        whole = min(whole + lambda_oc, path[n - 1] if low < high == n else ENDLESS)
        best = min(best, whole + (lambda_oc if j < m - 1 else 0))
    return best & ~COST


@njit
def band(left_x, right_x, rules, low, high):  # type: ignore[no-untyped-def]
    """Left edges ``low`` to ``high`` are those in the depth range of a right edge (constraint 1)."""
    nearest, farthest = np.float32(rules.nearest), np.float32(rules.farthest)
    while high < left_x.size and left_x[high] - right_x <= nearest:
        high += 1
    while low < high and left_x[low] - right_x < farthest:
        low += 1
    return low, high


@njit
def leave_behind(path):  # type: ignore[no-untyped-def]
    """The best path before a run of left edges, and the one by the last left edge that is now out of range."""
    run, diagonal = ENDLESS, ENDLESS
    for i in range(path.size):
        run, diagonal = min(run, diagonal), path[i]
    return run, diagonal


@njit
def extend_paths(run, diagonal, start, lambda_oc, place, left_side, side, added, path, skipped, previous):  # type: ignore[no-untyped-def]
    """Match right edge j with the left edges ``low`` to ``high``, each after the path before it that costs least.

    Returns the best path that so ends; ``start`` is J where the first match is behind the first left edge.
    """
    best = ENDLESS
    for i in range(path.size):
        ended, extended = path[i], ENDLESS
        if left_side[i] == side:
            past = min(min(min(skipped[i], run) + lambda_oc, start), diagonal) + added[i]
            previous[i] = past & ~COST
            extended = (past & COST) | (place + i)
            best = min(best, extended)
        path[i] = extended
        skipped[i] = min(skipped[i], diagonal)
        run, diagonal = min(run, diagonal), ended
    skipped[path.size] = min(skipped[path.size], diagonal)
    return best


@njit
def trace_back(place, left, right, candidates, rules, y, previous, partner, candidate):  # type: ignore[no-untyped-def]
    """Walk from the last match of row y to the first and write down the correspondences."""
    left_x, left_side, left_height = left.x_px[y], left.side[y], left.height[y]
    right_side, right_height = right.side[y], right.height[y]
    while place > 0:
        j, i = (place - 1) >> EDGE_BITS, (place - 1) & MOST_EDGES
        if alike(left_side[i], left_height[i], right_side[j], right_height[j], rules):
            least = np.float32(rules.same_side_px)
            for number in range(candidates.shape[0]):
                distance = abs(candidates[number, j] - left_x[i])
                if distance <= least:
                    partner[i], candidate[i], least = j, number, distance
        place = np.int64(previous[j, i])
