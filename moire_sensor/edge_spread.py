"""From solved rows to their neighbours: the conclusion's speed-up, and the company that a match must have."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import EXACT
from moire_sensor.edge_cost import alike


@njit(inline="always")
def nearest_edge(x_px, side, columns, sides, count, first, within_px):  # type: ignore[no-untyped-def]
    """Number of the edge of a row that is nearest to column ``x_px`` and of a side, -1 when none is ``within_px``.

    Edges before ``first`` are too far left; the second result is the same for the next column.
    """
    while first < count and columns[first] < x_px - within_px:
        first += 1
    nearest, least, number = -1, within_px, first
    while number < count and columns[number] <= x_px + within_px:
        distance = abs(columns[number] - x_px)
        if sides[number] == side and distance <= least:
            nearest, least = number, distance
        number += 1
    return nearest, first


@njit
def follow_row(y, source, left, right, candidates, rules, match):  # type: ignore[no-untyped-def]
    """Take over in row y the correspondences of row ``source``."""
    left_x, left_side, left_height = left.x_px[y], left.side[y], left.height[y]
    right_x, right_side, right_height = right.x_px[y], right.side[y], right.height[y]
    old_left, old_right, sides = left.x_px[source], right.x_px[source], left.side[source]
    old_partner, old_candidate = match.partner[source], match.candidate[source]
    partner, candidate = match.partner[y], match.candidate[y]
    columns, half_order = candidates.left_x_px[y], candidates.half_order[y]
    old_half_order = candidates.half_order[source]
    count_l, count_r = left.number[y], right.number[y]
    first_l = first_r = 0
    for number in range(left.number[source]):
        old = old_partner[number]
        if old < 0:
            continue
        i, first_l = nearest_edge(old_left[number], sides[number], left_x, left_side, count_l, first_l, rules.follow_px)
        j, first_r = nearest_edge(old_right[old], sides[number], right_x, right_side, count_r, first_r, rules.follow_px)
        if i < 0 or j < 0 or not rules.farthest <= left_x[i] - right_x[j] <= rules.nearest:
            continue
        if alike(left_side[i], left_height[i], right_side[j], right_height[j], rules):
            fringe = old_half_order[old] + 2 * old_candidate[number]
            for confirmed in range(columns.shape[0]):
                near = abs(columns[confirmed, j] - left_x[i]) <= rules.same_side_px
                if near and half_order[j] + 2 * confirmed == fringe:
                    partner[i], candidate[i] = j, confirmed


@njit
def follow_rows(rows, begin, behind, left, right, candidates, rules, match):  # type: ignore[no-untyped-def]
    """From each solved row follow its correspondences up and down, half way to the next solved row.

    An edge takes over the match of the next row's edge of the same side, at most ``follow_px`` away, if it is so in
    both images and the two edges confirm the same fringe. What lies wholly between two solved rows stays unknown.
    """
    for number in range(rows.size):
        first = begin if number == 0 else rows[number] - rules.rows // 2
        last = behind if number == rows.size - 1 else rows[number + 1] - rules.rows // 2
        for y in range(rows[number] - 1, first - 1, -1):
            follow_row(y, y + 1, left, right, candidates, rules, match)
        for y in range(rows[number] + 1, last):
            follow_row(y, y - 1, left, right, candidates, rules, match)


@njit
def drop_loners(partner, candidate, half_order, min_run, joined, kept):  # type: ignore[no-untyped-def]
    """Drop the correspondences of a row outside runs of ``min_run`` or more, which step by one edge in both images and
    by one fringe edge on the projector. ``joined`` and ``kept`` are memory, (E,) int32 each."""
    if min_run == 1:
        return
    n = partner.size
    kept[:n] = 0
    if n >= min_run:
        mark_joined(partner[:-1], partner[1:], candidate, half_order, joined)
        for length in range(2, min_run):
            shorten(joined, n - length)
        for step in range(min_run):
            keep(joined[: n - min_run + 1], kept[step:])
    drop(kept, partner)


@njit(**EXACT)
def mark_joined(before, here, candidate, half_order, joined):  # type: ignore[no-untyped-def]
    """1 where the match of the next edge goes on that of an edge, else 0."""
    for i in range(here.size):
        step = half_order[max(here[i], 0)] - half_order[max(before[i], 0)] + 2 * (candidate[i + 1] - candidate[i])
        joined[i] = (before[i] >= 0) & (here[i] == before[i] + 1) & (abs(step) == 1)


@njit
def shorten(joined, size):  # type: ignore[no-untyped-def]
    """Keep a 1 only where the next one is 1 too."""
    for i in range(np.uint64(size)):
        joined[i] &= joined[i + np.uint64(1)]


@njit(**EXACT)
def keep(joined, kept):  # type: ignore[no-untyped-def]
    """Mark edges where the run does that starts so many before."""
    for i in range(joined.size):
        kept[i] |= joined[i]


@njit(**EXACT)
def drop(kept, partner):  # type: ignore[no-untyped-def]
    """Drop the matches that are not kept."""
    for i in range(partner.size):
        partner[i] = partner[i] if kept[i] != 0 else np.int32(-1)
