"""Dynamic programme over the fringe edges of an epipolar line (section 3.4, constraints 1 to 3).

The right edges are taken one by one. A match of right edge j with left edge i follows the start, the match of j - 1
with i - 1, a match of j - 1 before a run of unmatched left edges, or a match of i - 1 before a run of unmatched right
ones: order (constraint 2) holds because i and j only grow, and no run in one image meets a run in the other (constraint
3). Before the first and after the last match both may run. Only matches in the depth range are looked at.

Some rows are solved side by side (edge_abreast), one in each place of a vector of the processor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import get_thread_id, njit, prange

from moire_sensor.apart import EXACT, ROW, UNCOUNTED
from moire_sensor.edge_abreast import fill, find_band, line_up
from moire_sensor.edge_confirm import find_near, split_sides
from moire_sensor.edge_cost import COST, EDGE_BITS, ENDLESS, MOST_EDGES, NO_MATCH, in_units, on_path
from moire_sensor.edge_doubt import doubt_row
from moire_sensor.edge_lanes import ABREAST, LANES, TOGETHER, block_rows, lane_blocks, vectors_of
from moire_sensor.edge_spread import follow_rows

NONE, ZERO = np.int32(-1), np.float32(0.0)


class Work(NamedTuple):
    """Tables of the programme, one a thread in the first dimension; E is the most edges of a row.

    Attributes
    ----------
    path : (threads, E, rows) int64, best path whose last match is that of i with the right edge at hand, or with the
        one before.
    skipped : (threads, E, rows) int64, best path whose last match is that of i - 1 with a right edge before the last.
    state : (threads, 4, rows) int64, of :func:`extend_paths`.
    table : (threads, E E + 1, rows) int32, of each match in the band what it adds to J, and once it is looked at the
        place of the match before it on its best path.
    least_px : (threads, E) float32, of :func:`settle_rows`.
    shift : (threads, E) int32, of :func:`doubt_row`.
    """

    path: npt.NDArray[np.int64]
    skipped: npt.NDArray[np.int64]
    state: npt.NDArray[np.int64]
    table: npt.NDArray[np.int32]
    least_px: npt.NDArray[np.float32]
    shift: npt.NDArray[np.int32]


@njit(parallel=True, cache=True, error_model="numpy")
def match_rows(left, right, candidates, rules, sides, near, lefts, rights, band, work, match):  # type: ignore[no-untyped-def]
    """Match all rows."""
    height = left.x_px.shape[0]
    for index in prange(LANES):
        first, last = lane_blocks(index, height, rules.rows)
        for block in range(first, last):
            begin, behind = block_rows(block, height, rules.rows)
            match_block(begin, behind, left, right, candidates, rules, sides, near, lefts, rights, band, work, match)


@njit(error_model="numpy")
def match_block(begin, behind, left, right, candidates, rules, sides, near, lefts, rights, band, work, match):  # type: ignore[no-untyped-def]
    """Match a block of rows: every ``rules.rows``-th is solved, the others follow their neighbours."""
    thread, rows = get_thread_id(), np.arange(begin + rules.rows // 2, behind, rules.rows)
    if rules.rows > 1:
        match.partner[begin:behind] = -1
    m = lay_out(left, right, rules, rows, lefts, rights, band, work, thread)
    confirm_rows(left, right, candidates.left_x_px, rules, rows, sides, near, band, work, thread)
    solve_rows(left.number, right.number, m, rules, rows, lefts, rights, band, work, thread)
    trace_back(work.state[thread, 3], band.cell[thread], work.table[thread], rows, match.partner)
    settle_rows(left.number, right.number, rules, rows, near, work, thread, match.partner, match.candidate)
    if rules.rows > 1:
        follow_rows(rows, begin, behind, left, right, candidates, rules, match)


@njit(**UNCOUNTED)
def lay_out(left, right, rules, rows, lefts, rights, band, work, thread):  # type: ignore[no-untyped-def]
    """Put some rows side by side, in a table in which all edges agree in their side alone; the most right edges."""
    lambda_oc, only_side = on_path(in_units(rules.lambda_oc)), in_units(rules.lambda_mat - rules.lambda_r)
    n = line_up(
        left.x_px, left.side, left.number, rows, lambda_oc,
        lefts.x_px[thread], lefts.behind[thread], lefts.least[thread], lefts.most[thread],
    )  # fmt: skip
    m = line_up(
        right.x_px, right.side, right.number, rows, lambda_oc,
        rights.x_px[thread], rights.behind[thread], rights.least[thread], rights.most[thread],
    )  # fmt: skip
    cells = find_band(
        n, m, lefts.least[thread], lefts.most[thread], rights.least[thread], rights.most[thread], rules,
        band.low[thread], band.high[thread], band.cell[thread],
    )  # fmt: skip
    fill(work.table[thread, :1], np.int32(0))
    fill(work.table[thread, 1:cells], only_side)
    fill(work.path[thread, :n], ENDLESS)
    fill(work.skipped[thread, : n + 1], ENDLESS)
    return m


@njit(**UNCOUNTED)
def confirm_rows(left, right, columns, rules, rows, sides, near, band, work, thread):  # type: ignore[no-untyped-def]
    """The same-side test: which left edges confirm candidates, and what their matches cost, which goes in the table."""
    # Taken out of the tuples once: numba counts references each time, which would cost more than all the rest.
    x_px, height, edge, seen = sides.x_px[thread], sides.height[thread], sides.edge[thread], sides.seen[thread]
    at, found, column, entries = near.at[thread], near.found[thread], near.column[thread], near.entries[thread]
    owners, numbers, lefts, aways_px = near.right[thread], near.number[thread], near.left[thread], near.away_px[thread]
    costs, low, high, cell = near.cost[thread], band.low[thread], band.high[thread], band.cell[thread]
    left_x, left_side, left_height, left_number = left.x_px, left.side, left.height, left.number
    right_side, right_height, right_number = right.side, right.height, right.number
    table, reach = work.table[thread], np.float32(rules.same_side_px)
    for r in range(rows.size):
        y = rows[r]
        none = split_sides(left_x[y, : left_number[y]], left_side[y], left_height[y], reach, x_px, height, edge, seen)
        entries[r] = find_near(
            columns[y], right_side[y], right_height[y], right_number[y], none, rules, x_px, height, edge, seen, at,
            found, column, owners[r], numbers[r], lefts[r], aways_px[r], costs[r],
        )  # fmt: skip
        add_costs(owners[r], lefts[r], costs[r], entries[r], low, high, cell, table, r)


@njit(**UNCOUNTED)
def add_costs(right, left, cost, entries, low, high, cell, table, r):  # type: ignore[no-untyped-def]
    """Enter the costs of a row's confirmed matches into its column of the table."""
    for entry in range(entries):
        j, i = right[entry], left[entry]
        if cost[entry] < NO_MATCH and low[j] <= i < high[j]:
            table[cell[j] + i, r] = min(table[cell[j] + i, r], cost[entry])


@njit(**UNCOUNTED)
def solve_rows(left_number, right_number, m, rules, rows, lefts, rights, band, work, thread):  # type: ignore[no-untyped-def]
    """Run the programme over rows side by side; ``state[3]`` is then the last match of the best path of each."""
    lambda_oc, state = on_path(in_units(rules.lambda_oc)), work.state[thread]
    state[3] = 0
    for r in range(rows.size):
        y = rows[r]
        state[3, r] = lambda_oc * (np.int64(left_number[y] > 0) + np.int64(right_number[y] > 0))
    take_steps(
        m, lambda_oc, np.float32(rules.farthest), np.float32(rules.nearest), band.low[thread], band.high[thread],
        band.cell[thread], lefts.x_px[thread], lefts.behind[thread], rights.x_px[thread], rights.behind[thread],
        work.path[thread], work.skipped[thread], state[0], state[1], state[2], state[3], work.table[thread],
    )  # fmt: skip


@njit(**ROW)
def take_steps(  # type: ignore[no-untyped-def]
    m, lambda_oc, farthest, nearest, low, high, cell, left_x, left_behind, right_x, right_behind, path, skipped, run,
    diagonal, ended, best, table,
):  # fmt: skip
    """Match the right edges one by one; ``best`` becomes the best whole path.

    Indices are unsigned, since numba asks of the others whether they are negative.
    """
    low_before = np.uint64(0)
    for j in range(np.uint64(m)):
        begin, end = np.uint64(low[j]), np.uint64(high[j])
        # Before the first left edge nothing is unmatched, and before the first right one neither.
        start = lambda_oc if j == 0 else 2 * lambda_oc
        for r in range(np.uint64(ABREAST)):
            skipped[np.uint64(0), r] = -lambda_oc if j == 0 else 0
        leave_behind(low_before, begin, path, run, diagonal, ended)
        extend_paths(
            j, begin, end, np.uint64(cell[j]), start, lambda_oc, farthest, nearest, left_x, left_behind, right_x, path,
            skipped, run, diagonal, ended, table,
        )  # fmt: skip
        for r in range(np.uint64(ABREAST)):
            skipped[end, r] = min(skipped[end, r], diagonal[r])
            best[r] = min(best[r], ended[r] + right_behind[j, r])
        low_before = begin


@njit(inline="always")
def leave_behind(low_before, low, path, run, diagonal, ended):  # type: ignore[no-untyped-def]
    """Best path before a run of left edges, the one by the last left edge that is now out of range; no end as yet."""
    for r in range(np.uint64(ABREAST)):
        run[r], diagonal[r], ended[r] = ENDLESS, ENDLESS, ENDLESS
    for i in range(low_before, low):
        for r in range(np.uint64(ABREAST)):
            run[r], diagonal[r] = min(run[r], diagonal[r]), path[i, r]


@njit(inline="always")
def extend_paths(  # type: ignore[no-untyped-def]
    j, low, high, cell, start, lambda_oc, farthest, nearest, left_x, left_behind, right_x, path, skipped, run, diagonal,
    ended, table,
):  # fmt: skip
    """Match right edge j with the left edges ``low`` to ``high``, each after the path before it that costs least.

    ``ended`` becomes the best path that so ends; ``start`` is J where the first match is behind the first left edge.
    """
    for i in range(low, high):
        place = np.int64((j << np.uint64(EDGE_BITS)) + i + np.uint64(1))
        for r in range(np.uint64(ABREAST)):
            before, last = path[i, r], skipped[i, r]
            left, right = left_x[i, r], right_x[j, r]
            disparity = abs(left) - abs(right)
            fits = (disparity >= farthest) & (disparity <= nearest) & ((left < ZERO) == (right < ZERO))
            past = min(min(min(last, run[r]) + lambda_oc, start), diagonal[r]) + on_path(table[cell + i, r])
            table[cell + i, r] = np.int32(past & ~COST)
            extended = (past & COST) | place if fits else ENDLESS
            path[i, r] = extended
            ended[r] = min(ended[r], extended + left_behind[i, r])
            skipped[i, r] = min(last, diagonal[r])
            run[r] = min(run[r], diagonal[r])
            diagonal[r] = before


@njit(**UNCOUNTED)
def trace_back(best, cell, table, rows, partner):  # type: ignore[no-untyped-def]
    """Walk from the last match of each row to the first and write them down; a step in all rows at a time."""
    for r in range(rows.size):
        partner[rows[r]] = -1
        best[r] &= ~COST
    walking = rows.size
    while walking > 0:
        walking = 0
        for r in range(rows.size):
            place = best[r]
            if place > 0:
                j, i = (place - 1) >> EDGE_BITS, (place - 1) & MOST_EDGES
                partner[rows[r], i] = j
                best[r] = table[cell[j] + i, r]
                walking += 1


@njit(**UNCOUNTED)
def settle_rows(numbers, right_numbers, rules, rows, near, work, thread, partner, candidate):  # type: ignore[no-untyped-def]
    """Keep the matches that are correspondences, with the nearest candidate, and mark the doubtful ones."""
    rights, lefts, number, entries = near.right[thread], near.left[thread], near.number[thread], near.entries[thread]
    costs, aways_px = near.cost[thread], near.away_px[thread]
    least_px, shift = work.least_px[thread], work.shift[thread]
    reach = np.float32(rules.same_side_px)
    for r in range(rows.size):
        y = rows[r]
        n, m, count = numbers[y], right_numbers[y], entries[r]
        keep_own(partner[y], number[r], lefts[r], costs[r], aways_px[r], vectors_of(n), reach, least_px, candidate[y])
        keep_others(
            partner[y], rights[r, m:count], lefts[r, m:], number[r, m:], costs[r, m:], aways_px[r, m:], least_px,
            candidate[y],
        )  # fmt: skip
        drop_unconfirmed(candidate[y], vectors_of(n), partner[y])
        doubt_row(partner[y, :n], rights[r, :count], lefts[r], costs[r], rules, shift)


@njit(**EXACT)
def keep_own(partner, number, left, cost, away_px, vectors, reach, least_px, candidate):  # type: ignore[no-untyped-def]
    """Note the candidate of each match of a row that the entry of its right edge confirms, and how near it is."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            i = np.uint64(TOGETHER * vector + lane)
            known = partner[i] >= 0
            j = np.uint32(partner[i] if known else 0)
            confirmed = known & (left[j] == np.int32(i)) & (cost[j] < NO_MATCH)
            candidate[i] = number[j] if confirmed else NONE
            least_px[i] = away_px[j] if confirmed else reach


@njit(**UNCOUNTED)
def keep_others(partner, right, left, number, cost, away_px, least_px, candidate):  # type: ignore[no-untyped-def]
    """The same for the further entries: of two candidates that confirm a match the nearer one counts."""
    for entry in range(np.uint64(right.size)):
        i, away = np.uint64(left[entry]), away_px[entry]
        if partner[i] == right[entry] and cost[entry] < NO_MATCH and away <= least_px[i]:
            candidate[i], least_px[i] = number[entry], away


@njit(**EXACT)
def drop_unconfirmed(candidate, vectors, partner):  # type: ignore[no-untyped-def]
    """Keep the matches of a row that a candidate confirms."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            i = np.uint64(TOGETHER * vector + lane)
            partner[i] = partner[i] if candidate[i] >= 0 else NONE
