"""Dynamic programme over the fringe edges of an epipolar line (section 3.4, constraints 1 to 3), eight lines at a time.

The right edges are taken one by one. A match of right edge j with left edge i follows the start, the match of j - 1
with i - 1, a match of j - 1 before a run of unmatched left edges, or a match of i - 1 before a run of unmatched right
ones: order (constraint 2) holds because i and j only grow, and no run in one image meets a run in the other (constraint
3). Before the first and after the last match both may run. Only matches in the depth range are looked at.

The tables hold neighbouring rows side by side in their last dimension, so that the processor does them in one step. A
path is one number, its cost J in the upper bits and its last match in the lower ones: the least is the cheapest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

Float32 = npt.NDArray[np.float32]
Int64 = npt.NDArray[np.int64]
# Rows side by side: one register of float32.
SIDE_BY_SIDE = 8
NOWHERE = np.float32(np.nan)
# A path: J in units of 2^-18 from bit 24 on, below it the last match, as i + j E + 1; 0 is the start.
PLACE_BITS, UNITS = 24, 2.0**18
COST = ~np.int64((1 << PLACE_BITS) - 1)
ENDLESS = np.int64(1 << 60)
# Columns that share an entry of the look-up table of edges.
BIN_PX = 8
# Paths of equal J are common beside occlusions; among them the one that meets its candidates best is taken.
TIE_BREAK = 1e-3
# Share of the largest distance from a candidate at which lambda_off has grown to its whole.
NEAR = 0.2


class Work(NamedTuple):
    """Tables of the programme, one a lane in the first dimension, one a row in the last; i counts left edges.

    Attributes
    ----------
    left_x, left_side : (lanes, E, 8), left edges; right_x, right_side : (lanes, E, 8), right ones. NaN behind the last.
    last_left, last_right : (lanes, 8), number of the last edge, -1 for none.
    unlike : (lanes, E, 8), what a match of i with the right edge at hand adds to J.
    path : (lanes, E + 1, E + 1, 8), best path whose last match is that of j - 1 and i - 1: its J, and the match before.
    skipped : (lanes, E + 1, 8), best path whose last match is that of i - 1 with a right edge before the last one.
    run : (lanes, 8), best path whose last match is that of the last right edge with a left one before i - 1.
    whole : (lanes, 8), best path so far, with what follows it.
    bins : (lanes, 8, B), left edges before every eighth column.
    """

    left_x: Float32
    left_side: Float32
    right_x: Float32
    right_side: Float32
    last_left: Int64
    last_right: Int64
    unlike: Int64
    path: Int64
    skipped: Int64
    run: Int64
    whole: Int64
    bins: Int64


@njit(inline="always")
def alike(left_side, left_height, right_side, right_height, rules):  # type: ignore[no-untyped-def]
    """Whether two edges are of the same side and about the same height."""
    higher, lower = max(left_height, right_height), min(left_height, right_height)
    return left_side == right_side and higher <= rules.same_height * lower


@njit
def fill_bins(x_px, k, count, bins):  # type: ignore[no-untyped-def]
    """Number of edges of row k before column b ``BIN_PX`` for every b."""
    number = 0
    for index in range(bins.shape[1]):
        while number < count and x_px[number, k] < index * BIN_PX:
            number += 1
        bins[k, index] = number


@njit(inline="always")
def edges_from(bins, k, column):  # type: ignore[no-untyped-def]
    """Number of the first edge of row k that may lie at a column, by the look-up table."""
    return bins[k, max(0, min(np.int64(column) // BIN_PX, bins.shape[1] - 1))]


@njit(parallel=True, cache=True)
def match_rows(left, right, candidates, rules, every_row, work, partner, candidate):  # type: ignore[no-untyped-def]
    """Match every ``every_row``-th row."""
    lanes = work.path.shape[0]
    first, height = every_row // 2, left.x_px.shape[0]
    rows = (height - first + every_row - 1) // every_row
    for index in prange(lanes):
        lane = np.int64(index)
        for block in range(lane, (rows + SIDE_BY_SIDE - 1) // SIDE_BY_SIDE, lanes):
            y = first + block * SIDE_BY_SIDE * every_row
            match_block(left, right, candidates, rules, y, every_row, work, lane, partner, candidate)


@njit
def in_units(cost):  # type: ignore[no-untyped-def]
    """A cost as it is added to a path."""
    return np.int64(np.rint(cost * UNITS)) << PLACE_BITS


@njit
def match_block(left, right, candidates, rules, first, every_row, work, lane, partner, candidate):  # type: ignore[no-untyped-def]
    """Match eight rows from ``first`` on, as far as there are so many."""
    last_left, last_right = work.last_left[lane], work.last_right[lane]
    n, m = last_edges(left.number, first, every_row, last_left), last_edges(right.number, first, every_row, last_right)
    lay_side_by_side(left, first, every_row, n, work.left_x[lane], work.left_side[lane])
    lay_side_by_side(right, first, every_row, m, work.right_x[lane], work.right_side[lane])
    for k in range(SIDE_BY_SIDE):
        images = np.int64(last_left[k] >= 0) + np.int64(last_right[k] >= 0)
        work.whole[lane, k] = in_units(rules.lambda_oc) * images
    fill_tables(left, right, candidates, rules, first, every_row, n, m, work, lane)
    for k in range(SIDE_BY_SIDE):
        end = work.whole[lane, k] & ~COST
        trace_back(left, right, first + k * every_row, k, candidates, rules, work.path[lane], end, partner, candidate)


@njit
def last_edges(number, first, every_row, last):  # type: ignore[no-untyped-def]
    """Number of the last edge of each of eight rows, -1 for none, into ``last``; the most edges of a row."""
    most = 0
    for k in range(SIDE_BY_SIDE):
        y = first + k * every_row
        last[k] = number[y] - 1 if y < number.size else -1
        most = max(most, last[k] + 1)
    return most


@njit
def fill_tables(left, right, candidates, rules, first, every_row, n, m, work, lane):  # type: ignore[no-untyped-def]
    """Run the programme over eight rows."""
    # Taken out of the tuples once: numba counts references each time, which would cost more than all the rest.
    left_x, left_side, left_height = left.x_px, left.side, left.height
    right_side, right_height = right.side, right.height
    columns, sides, last_left = work.left_x[lane], work.left_side[lane], work.last_left[lane]
    columns_r, sides_r, last_right = work.right_x[lane], work.right_side[lane], work.last_right[lane]
    bins, unlike = work.bins[lane], work.unlike[lane]
    path, skipped, run, whole = work.path[lane], work.skipped[lane], work.run[lane], work.whole[lane]
    for k in range(SIDE_BY_SIDE):
        fill_bins(columns, k, last_left[k] + 1, bins)
    skipped[: n + 1] = ENDLESS
    low = low_before = high = high_before = 0
    for j in range(m):
        low, high = band(columns, columns_r, j, n, rules.nearest, rules.farthest, low, high)
        fill_unlike(columns, sides, columns_r, sides_r, j, low, high, rules, unlike)
        for k in range(SIDE_BY_SIDE):
            if j <= last_right[k]:
                confirm(
                    left_x, left_side, left_height, right_side, right_height, first + k * every_row, j, candidates,
                    rules, bins, k, last_left[k] + 1, low, high, unlike,
                )  # fmt: skip
        forget_others(path[j], low, high, low_before, high_before)
        fill_paths(j, low, high, low_before, high_before, in_units(rules.lambda_oc), unlike, path, skipped, run)
        keep_skipped(j, low_before, high_before, path, skipped)
        end_paths(j, low, high, last_left, last_right, in_units(rules.lambda_oc), path, whole)
        low_before, high_before = low, high


@njit
def lay_side_by_side(edges, first, every_row, most, x_px, side):  # type: ignore[no-untyped-def]
    """Edges of eight rows, (most, 8): NaN behind the last of a row."""
    for k in range(SIDE_BY_SIDE):
        y = min(first + k * every_row, edges.x_px.shape[0] - 1)
        row_x, row_side = edges.x_px[y], edges.side[y]
        number = edges.number[y] if first + k * every_row < edges.x_px.shape[0] else 0
        for i in range(most):
            x_px[i, k] = row_x[i] if i < number else NOWHERE
            side[i, k] = row_side[i]


@njit
def band(left_x, right_x, j, n, nearest, farthest, low, high):  # type: ignore[no-untyped-def]
    """Left edges ``low`` to ``high`` are those in the depth range of the right edges, of all eight rows."""
    nearest, farthest = np.float32(nearest), np.float32(farthest)
    while high < n:
        inside = 0
        for k in range(SIDE_BY_SIDE):
            inside += left_x[high, k] - right_x[j, k] <= nearest
        if inside == 0:
            break
        high += 1
    while low < high:
        inside = 0
        for k in range(SIDE_BY_SIDE):
            inside += left_x[low, k] - right_x[j, k] >= farthest
        if inside > 0:
            break
        low += 1
    return low, high


@njit
def fill_unlike(left_x, left_side, right_x, right_side, j, low, high, rules, unlike):  # type: ignore[no-untyped-def]
    """Matches of which only the side agrees: lambda_mat - lambda_r; of none else (constraint 1, and the penalty)."""
    nearest, farthest = np.float32(rules.nearest), np.float32(rules.farthest)
    same_side = in_units(rules.lambda_mat - rules.lambda_r)
    for i in range(low, high):
        for k in range(SIDE_BY_SIDE):
            disparity = left_x[i, k] - right_x[j, k]
            allowed = (disparity >= farthest) & (disparity <= nearest) & (left_side[i, k] == right_side[j, k])
            unlike[i, k] = same_side if allowed else ENDLESS


@njit(inline="always")
def confirm(  # type: ignore[no-untyped-def]
    left_x, left_side, left_height, right_side, right_height, y, j, candidates, rules, bins, k, n, low, high, unlike
):
    """Lower what a match adds to J where left edges of row y confirm a candidate of right edge j."""
    reach = np.float32(rules.same_side_px)
    for number in range(candidates.shape[2]):
        column = candidates[y, j, number]
        i = edges_from(bins, k, column - reach) if np.isfinite(column) else n
        while i < n and left_x[y, i] <= column + reach:
            away = abs(column - left_x[y, i])
            same = alike(left_side[y, i], left_height[y, i], right_side[y, j], right_height[y, j], rules)
            if same and away <= reach and low <= i < high and unlike[i, k] < ENDLESS:
                off = away * np.float32(1.0 / rules.same_side_px)
                far = min(off * np.float32(1.0 / NEAR), np.float32(1.0))
                added = TIE_BREAK * off + rules.lambda_off * far * far - rules.lambda_r
                unlike[i, k] = min(unlike[i, k], in_units(added))
            i += 1


@njit
def fill_paths(j, low, high, low_before, high_before, lambda_oc, unlike, path, skipped, run):  # type: ignore[no-untyped-def]
    """Match right edge j with the left edges ``low`` to ``high``, each after the path before it that costs least."""
    stride, now = path.shape[1] - 1, j + 1
    for k in range(SIDE_BY_SIDE):
        run[k] = ENDLESS
    behind = low_before
    for i in range(low, high):
        while behind < min(i - 1, high_before):
            behind += 1
            place = np.int64(behind + (j - 1) * stride)
            for k in range(SIDE_BY_SIDE):
                run[k] = min(run[k], (path[j, behind, k] & COST) | place)
        # Before the first right edge there is no match, and no place.
        start, diagonal = lambda_oc * ((i > 0) + (j > 0)), np.int64(max(i + (j - 1) * stride, 0))
        for k in range(SIDE_BY_SIDE):
            past = min(min(skipped[i, k], run[k]) + lambda_oc, start)
            path[now, i + 1, k] = min(past, (path[j, i, k] & COST) | diagonal) + unlike[i, k]


@njit
def forget_others(path, low, high, low_before, high_before):  # type: ignore[no-untyped-def]
    """No path ends by a match of the edge before with a left edge outside its own depth range."""
    for i in range(low, high):
        if not low_before < i <= high_before:
            for k in range(SIDE_BY_SIDE):
                path[i, k] = ENDLESS


@njit
def keep_skipped(j, low_before, high_before, path, skipped):  # type: ignore[no-untyped-def]
    """Right edges behind the next may follow the matches of the edge before j over a run of unmatched ones."""
    stride = path.shape[1] - 1
    for i in range(low_before + 1, high_before + 1):
        place = np.int64(i + (j - 1) * stride)
        for k in range(SIDE_BY_SIDE):
            skipped[i, k] = min(skipped[i, k], (path[j, i, k] & COST) | place)


@njit
def end_paths(j, low, high, last_left, last_right, lambda_oc, path, whole):  # type: ignore[no-untyped-def]
    """Keep the best whole path; after the last match both images may run."""
    stride = path.shape[1] - 1
    for i in range(low, high):
        place = np.int64(i + j * stride + 1)
        for k in range(SIDE_BY_SIDE):
            rest = lambda_oc * (np.int64(i < last_left[k]) + np.int64(j < last_right[k]))
            whole[k] = min(whole[k], ((path[j + 1, i + 1, k] & COST) + rest) | place)


@njit
def trace_back(left, right, y, k, candidates, rules, path, end, partner, candidate):  # type: ignore[no-untyped-def]
    """Walk from the last match of row y to the first and write down the correspondences."""
    if end == 0:
        return
    left_x, left_side, left_height = left.x_px[y], left.side[y], left.height[y]
    right_side, right_height = right.side[y], right.height[y]
    stride = path.shape[1] - 1
    while end > 0:
        i, j = (end - 1) % stride, (end - 1) // stride
        least = np.float32(rules.same_side_px)
        if alike(left_side[i], left_height[i], right_side[j], right_height[j], rules):
            for number in range(candidates.shape[2]):
                distance = abs(candidates[y, j, number] - left_x[i])
                if distance <= least:
                    partner[y, i], candidate[y, i], least = j, number, distance
        end = path[j + 1, i + 1, k] & ~COST
