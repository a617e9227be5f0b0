"""From solved rows to their neighbours: the conclusion's speed-up, and the company that a match must have."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.edge_candidates import Candidates
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_match import SIDE, TIE_BREAK, EdgeMatch, X, confirmed_candidate, dissimilarity
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.rig import Array


def spread_rows(
    match: EdgeMatch, left: EdgeRows, right: EdgeRows, candidates: Candidates, rules: Array, settings: EdgeSettings
) -> EdgeMatch:
    """Follow the correspondences of every ``settings.rows``-th row up and down, a row at a time, to the rows between.

    An edge takes over the match of the next row's edge of the same side, at most ``follow_px`` away, if it is so in
    both images and the two edges confirm the same fringe. What lies wholly between two solved rows stays unknown.
    """
    if settings.rows == 1:
        return match
    partner, candidate = match.partner.copy(), match.candidate.copy()
    follow_rows(
        settings.rows, left.packed(), left.count, right.packed(), right.count, candidates.left_x_px,
        candidates.half_order, rules, settings.follow_px, partner, candidate,
    )  # fmt: skip
    return EdgeMatch(partner, candidate)


def in_company(match: EdgeMatch, candidates: Candidates, min_run: int) -> npt.NDArray[np.bool_]:
    """Correspondences (H, E) in runs of ``min_run`` or more, neighbours in both images and in the pattern."""
    keep = np.zeros(match.partner.shape, dtype=np.bool_)
    mark_runs(match.partner, match.candidate, candidates.half_order, min_run, keep)
    return keep


@njit(cache=True)
def nearest_edge(edge, row, count, within_px):  # type: ignore[no-untyped-def]
    """Number of the edge of a row that is nearest to ``edge`` and of its side, -1 when none is ``within_px``."""
    nearest = -1
    least = within_px
    for number in range(count):
        distance = abs(row[number, X] - edge[X])
        if row[number, SIDE] == edge[SIDE] and distance <= least:
            nearest, least = number, distance
    return nearest


@njit(cache=True)
def follow_row(  # type: ignore[no-untyped-def]
    y, source, lefts, left_count, rights, right_count, candidates, half_order, rules, follow_px, partner, candidate
):
    """Take over in row y the correspondences of row ``source``."""
    for number in range(left_count[source]):
        old = partner[source, number]
        if old < 0:
            continue
        i = nearest_edge(lefts[source, number], lefts[y], left_count[y], follow_px)
        j = nearest_edge(rights[source, old], rights[y], right_count[y], follow_px)
        if i < 0 or j < 0 or dissimilarity(lefts[y, i], rights[y, j], candidates[y, j], rules) > TIE_BREAK:
            continue
        confirmed = confirmed_candidate(lefts[y, i], rights[y, j], candidates[y, j], rules)[0]
        if half_order[y, j, confirmed] == half_order[source, old, candidate[source, number]]:
            partner[y, i] = j
            candidate[y, i] = confirmed


@njit(parallel=True, cache=True)
def follow_rows(  # type: ignore[no-untyped-def]
    rows, lefts, left_count, rights, right_count, candidates, half_order, rules, follow_px, partner, candidate
):
    """From each solved row upwards and downwards, half way to the next solved row."""
    height = lefts.shape[0]
    middle = rows // 2
    for block in prange((height - middle + rows - 1) // rows):
        solved = middle + block * rows
        below = height if solved + rows >= height else solved + rows - middle
        for y in range(solved - 1, solved - middle - 1, -1):
            follow_row(
                y, y + 1, lefts, left_count, rights, right_count, candidates, half_order, rules, follow_px,
                partner, candidate,
            )  # fmt: skip
        for y in range(solved + 1, below):
            follow_row(
                y, y - 1, lefts, left_count, rights, right_count, candidates, half_order, rules, follow_px,
                partner, candidate,
            )  # fmt: skip


@njit(parallel=True, cache=True)
def mark_runs(partner, candidate, half_order, min_run, keep):  # type: ignore[no-untyped-def]
    """Mark runs along each row that step by one edge in both images and by one fringe edge on the projector."""
    height, most = partner.shape
    for y in prange(height):
        start = 0
        for i in range(1, most + 1):
            joined = i < most and partner[y, i - 1] >= 0 and partner[y, i] == partner[y, i - 1] + 1
            if joined:
                here = half_order[y, partner[y, i], candidate[y, i]]
                before = half_order[y, partner[y, i - 1], candidate[y, i - 1]]
                joined = abs(here - before) == 1
            if not joined:
                if partner[y, start] >= 0 and i - start >= min_run:
                    keep[y, start:i] = True
                start = i
