"""Kernels of the edge finder: where a row of grey levels crosses the middle between its peaks and troughs.

What lies all over a row is fetched one by one. What is computed from it fills whole vectors, so that no loop has a
remainder: the last vector goes on behind the last extremum, and what it writes there means nothing.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import EXACT, UNCOUNTED
from moire_sensor.edge_lanes import TOGETHER, vectors_of

UP, DOWN = np.int8(1), np.int8(-1)
ZERO, HALF, ONE, TWO, EIGHT = (np.float32(number) for number in (0.0, 0.5, 1.0, 2.0, 8.0))
ENDLESS = np.float32(np.inf)
NOWHERE = np.int32(-1)
STEP, TWO_COLUMNS = np.uint64(1), np.uint64(2)
# Rows of the work memory of :func:`mark_edges`.
REALS, WHOLES = 6, 2


@njit(**UNCOUNTED)
def mark_edges(row, extrema, number, reals, wholes, edge_noise, x_px, side, height, sigma_px):  # type: ignore[no-untyped-def]
    """One edge between each two of the ``number`` extrema of a row, where the row crosses the middle level; their
    number.

    ``reals`` (6, N) float32 and ``wholes`` (2, N) int32 are memory, N one vector more than the edges have room for.
    Behind its last number ``extrema`` (N,) names any columns two or more off the ends of the row.
    """
    if number < 2:
        return np.int64(0)
    first, here, second, level, rise, crossed = reals[0], reals[1], reals[2], reals[3], reals[4], reals[5]
    column, open_ = wholes[0], wholes[1]
    pairs, vectors = number - 1, vectors_of(number)
    fetch_extrema(row, extrema, number, first, here, second)
    extremum_levels(first, here, second, vectors, level)
    fill_rises(extrema, extrema[2:], level, level[2:], number, rise)
    between(
        extrema, extrema[1:], level, level[1:], rise, rise[1:], rise[2:], rise[3:], vectors, crossed, height, column
    )
    fetch_pairs(row, column, pairs, first, second)
    guess_crossings(here, here[1:], crossed, first, second, vectors, column)
    fetch_pairs(row, column, pairs, first, second)
    mark_open(extrema, extrema[1:], here, here[1:], crossed, first, second, column, vectors, open_)
    lost = seek_open(row, extrema, here, crossed, open_, pairs, column, first, second)
    measure_crossings(here, here[1:], crossed, first, second, column, edge_noise, vectors, x_px, side, sigma_px)
    return pairs if lost == 0 else close_up(column, pairs, x_px, side, height, sigma_px)


@njit(**UNCOUNTED)
def fetch_extrema(row, extrema, number, before, here, after):  # type: ignore[no-untyped-def]
    """Levels of a row at each extremum and two pixels off."""
    for n in range(np.uint64(number)):
        x = np.uint64(extrema[n])
        before[n], here[n], after[n] = row[x - TWO_COLUMNS], row[x], row[x + TWO_COLUMNS]


@njit(**EXACT)
def extremum_levels(before, here, after, vectors, level):  # type: ignore[no-untyped-def]
    """Grey level at the top of the parabola through each extremum and the samples two pixels off."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            n = np.uint64(TOGETHER * vector + lane)
            tilt, bend = after[n] - before[n], after[n] - TWO * here[n] + before[n]
            top = here[n] - tilt * tilt / (EIGHT * bend)
            level[n] = here[n] if abs(bend) <= abs(tilt) else top


@njit(**UNCOUNTED)
def fill_rises(x, x_after, level, level_after, number, rise):  # type: ignore[no-untyped-def]
    """Change of level per column from each extremum to the next of its kind, behind two endless ones and before two."""
    change_per_column(x, x_after, level, level_after, vectors_of(number), rise[2:])
    rise[0], rise[1], rise[number], rise[number + 1] = ENDLESS, ENDLESS, ENDLESS, ENDLESS


@njit(**EXACT)
def change_per_column(x, x_after, level, level_after, vectors, rise):  # type: ignore[no-untyped-def]
    """Change of level per column between two columns."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            n = np.uint64(TOGETHER * vector + lane)
            rise[n] = (level_after[n] - level[n]) / np.float32(np.int32(x_after[n] - x[n]))


@njit(inline="always")
def drift(before, after):  # type: ignore[no-untyped-def]
    """Change per column at an extremum: along the flatter of the lines to its two likes; 0 where it has none."""
    flatter = before if abs(before) <= abs(after) else after
    return flatter if flatter < ENDLESS else ZERO


@njit(**EXACT)
def between(  # type: ignore[no-untyped-def]
    start, end, level, level_next, before, before_next, after, after_next, vectors, crossed, step, column
):
    """Middle of the levels that each extremum and the next have half way between them, half their difference, and the
    column half way. ``before`` and ``after`` are the rises towards an extremum and from it."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            n = np.uint64(TOGETHER * vector + lane)
            middle = HALF * np.float32(np.int32(start[n] + end[n]))
            first = level[n] + drift(before[n], after[n]) * (middle - np.float32(start[n]))
            second = level_next[n] + drift(before_next[n], after_next[n]) * (middle - np.float32(end[n]))
            crossed[n] = HALF * (first + second)
            step[n] = HALF * abs(second - first)
            column[n] = np.int32(start[n] + end[n]) >> 1


@njit(**UNCOUNTED)
def fetch_pairs(row, column, number, first, second):  # type: ignore[no-untyped-def]
    """Levels of a row in columns and the next ones."""
    for n in range(np.uint64(number)):
        x = np.uint64(column[n])
        first[n], second[n] = row[x], row[x + STEP]


@njit(inline="always")
def above(level, crossed, rises):  # type: ignore[no-untyped-def]
    """How far a level lies on the far side of the crossing."""
    return level - crossed if rises else crossed - level


@njit(**EXACT)
def guess_crossings(here, here_next, crossed, first, second, vectors, column):  # type: ignore[no-untyped-def]
    """Columns to seek each crossing from: half way between the extrema, as given, and one step on towards it."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            n = np.uint64(TOGETHER * vector + lane)
            rises = here_next[n] > here[n]
            ahead = np.int32(above(second[n], crossed[n], rises) <= ZERO)
            column[n] += np.int32(-1) if above(first[n], crossed[n], rises) > ZERO else ahead


@njit(**EXACT)
def mark_open(start, end, here, here_next, crossed, first, second, column, vectors, open_):  # type: ignore[no-untyped-def]
    """1 where a row does not cross its level behind the column guessed."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            n = np.uint64(TOGETHER * vector + lane)
            rises = here_next[n] > here[n]
            crosses = (above(first[n], crossed[n], rises) <= ZERO) & (above(second[n], crossed[n], rises) > ZERO)
            inside = (start[n] <= column[n]) & (column[n] < end[n])
            open_[n] = np.int32(0) if crosses & inside else np.int32(1)


@njit(**UNCOUNTED)
def seek_open(row, extrema, here, crossed, open_, pairs, column, first, second):  # type: ignore[no-untyped-def]
    """Seek the crossings that were not where they were guessed; how many there are not."""
    lost = np.int64(0)
    for n in range(np.uint64(pairs)):
        if open_[n] != 0:
            start, end = np.int64(extrema[n]), np.int64(extrema[n + STEP])
            x = seek(row, start, end, crossed[n], here[n + STEP] > here[n], np.int64(column[n]))
            if start <= x < end:
                column[n], first[n], second[n] = x, row[x], row[x + 1]
            else:
                column[n] = NOWHERE
                lost += 1
    return lost


@njit(inline="always")
def seek(row, start, end, crossed, rises, x):  # type: ignore[no-untyped-def]
    """Column behind which a row crosses a level on its way from start to end, sought from x."""
    while x >= start and above(row[x], crossed, rises) > ZERO:
        x -= 1
    while start <= x < end and above(row[x + 1], crossed, rises) <= ZERO:
        x += 1
    return x


@njit(**EXACT)
def measure_crossings(here, here_next, crossed, first, second, column, edge_noise, vectors, x_px, side, sigma_px):  # type: ignore[no-untyped-def]
    """Fill the edges of a row, between columns by a straight line."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            n = np.uint64(TOGETHER * vector + lane)
            slope = second[n] - first[n]
            x_px[n] = np.float32(column[n]) + (crossed[n] - first[n]) / slope
            side[n] = UP if here_next[n] > here[n] else DOWN
            sigma_px[n] = edge_noise / abs(slope)


@njit(**UNCOUNTED)
def close_up(column, pairs, x_px, side, height, sigma_px):  # type: ignore[no-untyped-def]
    """Leave out the edges that lie nowhere; how many are left."""
    number = np.uint64(0)
    for n in range(np.uint64(pairs)):
        x_px[number], side[number], height[number], sigma_px[number] = x_px[n], side[n], height[n], sigma_px[n]
        number += np.uint64(column[n] != NOWHERE)
    return np.int64(number)
