"""Kernels of the edge finder: where a row of grey levels crosses the middle between its peaks and troughs."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import EXACT

UP, DOWN = 1, -1
ZERO, HALF, ONE, TWO, EIGHT = (np.float32(number) for number in (0.0, 0.5, 1.0, 2.0, 8.0))
ENDLESS = np.float32(np.inf)


@njit(error_model="numpy")
def mark_edges(row, extrema, work, columns, edge_noise, x_px, side, height, sigma_px):  # type: ignore[no-untyped-def]
    """One edge between each two extrema of a row, where the row crosses the middle level; their number.

    ``work`` (4, E) float32 and ``columns`` (2, E) int32 hold numbers of the extrema meanwhile.
    """
    level, drift, crossed, step = work[0], work[1], work[2], work[3]
    column, which = columns[0], columns[1]
    fill_levels(row, extrema, level, work[2], drift)
    between(extrema, level, drift, crossed, step)
    guess_crossings(row, extrema, crossed, column)
    number = find_crossings(row, extrema, crossed, column, which)
    measure_crossings(row, extrema, column[:number], which, crossed, step, edge_noise, x_px, side, height, sigma_px)
    return number


@njit(error_model="numpy")
def fill_levels(row, extrema, level, rise, drift):  # type: ignore[no-untyped-def]
    """Level of each extremum, and its change per column: along the flatter of the lines to its two likes."""
    number = extrema.size
    extremum_levels(row, extrema, level)
    drift[:number] = ENDLESS
    if number > 2:
        rises(level[: number - 2], level[2:number], extrema[: number - 2], extrema[2:], rise)
        drift[: number - 2] = rise[: number - 2]
        flatten(rise[: number - 2], drift[2:number])
    for n in range(number):
        drift[n] = drift[n] if drift[n] < ENDLESS else ZERO


@njit(**EXACT)
def rises(level, level_after, x, x_after, rise):  # type: ignore[no-untyped-def]
    """Change per column from each extremum to the next of its kind."""
    for n in range(level.size):
        rise[n] = (level_after[n] - level[n]) / np.float32(x_after[n] - x[n])


@njit(**EXACT)
def flatten(before, drift):  # type: ignore[no-untyped-def]
    """Take the change from the extremum before where it is the smaller one."""
    for n in range(drift.size):
        drift[n] = before[n] if abs(before[n]) <= abs(drift[n]) else drift[n]


@njit(**EXACT)
def extremum_levels(row, extrema, level):  # type: ignore[no-untyped-def]
    """Grey level at the top of the parabola through each extremum and the samples two pixels off."""
    for n in range(extrema.size):
        before, here, after = row[extrema[n] - 2], row[extrema[n]], row[extrema[n] + 2]
        tilt, bend = after - before, after - TWO * here + before
        top = here - tilt * tilt / (EIGHT * bend)
        level[n] = here if abs(bend) <= abs(tilt) else top


@njit(**EXACT)
def between(extrema, level, drift, crossed, step):  # type: ignore[no-untyped-def]
    """Middle of the levels that each extremum and the next have half way between them, and half their difference."""
    for n in range(extrema.size - 1):
        start, end = extrema[n], extrema[n + 1]
        middle = HALF * np.float32(start + end)
        first = level[n] + drift[n] * (middle - np.float32(start))
        second = level[n + 1] + drift[n + 1] * (middle - np.float32(end))
        crossed[n] = HALF * (first + second)
        step[n] = HALF * abs(second - first)


@njit
def guess_crossings(row, extrema, crossed, column):  # type: ignore[no-untyped-def]
    """Columns to seek each crossing from: half way between the extrema, and one step on towards it."""
    for n in range(extrema.size - 1):
        start, end = extrema[n], extrema[n + 1]
        sign = ONE if row[end] > row[start] else -ONE
        x = (start + end) >> 1
        above, below_next = sign * (row[x] - crossed[n]) > ZERO, sign * (row[x + 1] - crossed[n]) <= ZERO
        column[n] = x - 1 if above else x + below_next


@njit
def find_crossings(row, extrema, crossed, column, which):  # type: ignore[no-untyped-def]
    """Columns behind which the row crosses its levels, and after which extremum; the number of those there are."""
    number = np.int64(0)
    for n in range(extrema.size - 1):
        start, end = extrema[n], extrema[n + 1]
        sign = ONE if row[end] > row[start] else -ONE
        x = column[n]
        while x >= start and sign * (row[x] - crossed[n]) > ZERO:
            x -= 1
        while start <= x < end and sign * (row[x + 1] - crossed[n]) <= ZERO:
            x += 1
        column[number], which[number] = x, n
        number += np.int64((start <= x) & (x < end))
    return number


@njit(error_model="numpy")
def measure_crossings(  # type: ignore[no-untyped-def]
    row, extrema, column, which, crossed, step, edge_noise, x_px, side, height, sigma_px
):
    """Fill the edges of a row, between columns by a straight line."""
    for number in range(column.size):
        x, n = column[number], which[number]
        slope = row[x + 1] - row[x]
        x_px[number] = np.float32(x) + (crossed[n] - row[x]) / slope
        side[number] = UP if row[extrema[n + 1]] > row[extrema[n]] else DOWN
        height[number] = step[n]
        sigma_px[number] = edge_noise / abs(slope)
