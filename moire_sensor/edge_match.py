"""Dynamic programme over the fringe edges of an epipolar line (section 3.4, constraints 1 to 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.edge_candidates import RANGE_MARGIN_PX, Candidates
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.rig import Array

# Rows are dealt out to lanes with a work table each: a fixed number, so that the result never depends on the machine.
LANES = 8
START, MATCH, LEFT_RUN, RIGHT_RUN = 0, 1, 2, 3
X, SIDE, HEIGHT = 0, 1, 2
NEAREST, FARTHEST, SAME_SIDE, SAME_HEIGHT, LAMBDA_OC, LAMBDA_R, LAMBDA_MAT, PENALTY = range(8)
# Paths of equal J are common beside occlusions; among them the one that meets its candidates best is taken.
TIE_BREAK = 1e-3


@dataclass(frozen=True, eq=False)
class EdgeMatch:
    """Correspondence of each left edge, (H, E) int32.

    Attributes
    ----------
    partner : number of the right edge in its row, -1 where there is none.
    candidate : which candidate of that right edge the left edge confirms.
    """

    partner: npt.NDArray[np.int32]
    candidate: npt.NDArray[np.int32]


def matching_rules(disparity_range_px: tuple[float, float], period_px: float, settings: EdgeSettings) -> Array:
    """Limits and costs of a match where fringes are ``period_px`` wide, (8,) float64, for the compiled kernels."""
    least, most = disparity_range_px[0] - RANGE_MARGIN_PX, disparity_range_px[1] + RANGE_MARGIN_PX
    costs = (settings.lambda_oc, settings.lambda_r, settings.lambda_mat, settings.penalty)
    return np.array([most, least, settings.same_side_periods * period_px, settings.same_height, *costs])


def match_edges(
    left: EdgeRows, right: EdgeRows, candidates: Candidates, rules: Array, every_row: int = 1
) -> EdgeMatch:
    """Choose, on every ``every_row``-th row, the matches of least cost J.

    ``J = N_oc lambda_oc - N_m lambda_r + sum d(x_i, y_i)`` with one occlusion for each run of unmatched edges. Only
    matches with d = 0 are correspondences; one of which just the side agrees bridges the ordering, without depth.
    """
    lefts, rights = left.packed(), right.packed()
    partner = np.full(lefts.shape[:2], -1, dtype=np.int32)
    candidate = np.full(lefts.shape[:2], -1, dtype=np.int32)
    solved = np.arange(every_row // 2, lefts.shape[0], every_row)
    table = (LANES, lefts.shape[1] + 1, rights.shape[1] + 1, 4)
    best, origin = np.zeros(table), np.zeros(table, dtype=np.int8)
    solve_rows(
        solved, lefts, left.count, rights, right.count, candidates.left_x_px, rules, best, origin, partner, candidate
    )
    return EdgeMatch(partner, candidate)


@njit(cache=True)
def confirmed_candidate(left, right, candidates, rules):  # type: ignore[no-untyped-def]
    """Number of the candidate that left edge (x, side, height) confirms, -1 for none, and how far off it is, 0 to 1."""
    chosen = -1
    least = rules[SAME_SIDE]
    alike = left[HEIGHT] <= rules[SAME_HEIGHT] * right[HEIGHT] and right[HEIGHT] <= rules[SAME_HEIGHT] * left[HEIGHT]
    if alike and left[SIDE] == right[SIDE]:
        for number in range(candidates.size):
            distance = abs(candidates[number] - left[X])
            if distance <= least:
                chosen, least = number, distance
    return chosen, least / rules[SAME_SIDE]


@njit(cache=True)
def dissimilarity(left, right, candidates, rules):  # type: ignore[no-untyped-def]
    """d(x_i, y_i) of two edges: 0 if corresponding, lambda_mat if only the side agrees, else the penalty."""
    disparity = left[X] - right[X]
    # Constraint 1, with the depth range in place of "not negative".
    if left[SIDE] != right[SIDE] or disparity < rules[FARTHEST] or disparity > rules[NEAREST]:
        return rules[PENALTY]
    number, off = confirmed_candidate(left, right, candidates, rules)
    return TIE_BREAK * off if number >= 0 else rules[LAMBDA_MAT]


@njit(cache=True)
def fill_table(left, right, candidates, rules, best, origin):  # type: ignore[no-untyped-def]
    """Least cost of the first i left and j right edges, by how the path ends, and the state it came from.

    Order (constraint 2) holds because i and j only grow. A run of unmatched edges in one image is entered from a match
    and left by a match, never by a run in the other image (constraint 3). Before the first match both may run.
    """
    lambda_oc = rules[LAMBDA_OC]
    for i in range(len(left) + 1):
        for j in range(len(right) + 1):
            best[i, j, :] = np.inf
            best[i, j, START] = lambda_oc * ((i > 0) + (j > 0))
            if i > 0:
                enter, stay = best[i - 1, j, MATCH] + lambda_oc, best[i - 1, j, LEFT_RUN]
                best[i, j, LEFT_RUN] = min(enter, stay)
                origin[i, j, LEFT_RUN] = MATCH if enter <= stay else LEFT_RUN
            if j > 0:
                enter, stay = best[i, j - 1, MATCH] + lambda_oc, best[i, j - 1, RIGHT_RUN]
                best[i, j, RIGHT_RUN] = min(enter, stay)
                origin[i, j, RIGHT_RUN] = MATCH if enter <= stay else RIGHT_RUN
            if i > 0 and j > 0:
                state = MATCH
                for other in (LEFT_RUN, RIGHT_RUN, START):
                    if best[i - 1, j - 1, other] < best[i - 1, j - 1, state]:
                        state = other
                unlike = dissimilarity(left[i - 1], right[j - 1], candidates[j - 1], rules)
                best[i, j, MATCH] = best[i - 1, j - 1, state] + unlike - rules[LAMBDA_R]
                origin[i, j, MATCH] = state


@njit(cache=True)
def last_match(best, left_count, right_count, lambda_oc):  # type: ignore[no-untyped-def]
    """End (i, j) of the best path, (0, 0) when no match pays; after the last match both images may run."""
    chosen = (0, 0)
    least = lambda_oc * ((left_count > 0) + (right_count > 0))
    for i in range(1, left_count + 1):
        for j in range(1, right_count + 1):
            cost = best[i, j, MATCH] + lambda_oc * ((i < left_count) + (j < right_count))
            if cost < least:
                chosen, least = (i, j), cost
    return chosen


@njit(cache=True)
def trace_back(left, right, candidates, rules, origin, end, partner, candidate):  # type: ignore[no-untyped-def]
    """Walk from the last match to the first and write down the correspondences."""
    i, j = end
    state = MATCH if i > 0 else START
    while state != START:
        previous = origin[i, j, state]
        if state != RIGHT_RUN:
            i -= 1
        if state != LEFT_RUN:
            j -= 1
        if state == MATCH and dissimilarity(left[i], right[j], candidates[j], rules) <= TIE_BREAK:
            partner[i] = j
            candidate[i] = confirmed_candidate(left[i], right[j], candidates[j], rules)[0]
        state = previous


@njit(parallel=True, cache=True)
def solve_rows(solved, lefts, left_count, rights, right_count, candidates, rules, best, origin, partner, candidate):  # type: ignore[no-untyped-def]
    """Match the rows ``solved``; ``best`` and ``origin`` are work tables (lanes, E + 1, E + 1, states)."""
    for lane in prange(LANES):
        for number in range(lane, solved.size, LANES):
            y = solved[number]
            left, right = lefts[y, : left_count[y]], rights[y, : right_count[y]]
            fill_table(left, right, candidates[y], rules, best[lane], origin[lane])
            end = last_match(best[lane], len(left), len(right), rules[LAMBDA_OC])
            trace_back(left, right, candidates[y], rules, origin[lane], end, partner[y], candidate[y])
