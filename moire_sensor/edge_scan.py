"""Kernels of the edge finder: a row of grey levels to its up and down fringe edges, in one go.

Loops over whole rows have no branches, so that the processor takes many pixels at once; those with branches run over
the few columns that the others have found.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import EXACT, UNCOUNTED
from moire_sensor.edge_crossing import DOWN, REALS, UP, WHOLES, mark_edges
from moire_sensor.edge_lanes import LANES, TOGETHER, lane_rows

SMOOTHING = (1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0)
# Sums under the smoothing before they are divided.
WEIGHT = 16.0
# Smoothing and the parabola of an extremum each reach two pixels to either side.
BORDER_PX = 4
# The bright share of the fringes is the same all over the image: some rows tell it well enough.
SHARE_ROWS = 4


@njit(parallel=True, cache=True, error_model="numpy")
def scan_rows(left, right, sums, scale, contrasts, edge_noises, left_edges, right_edges):  # type: ignore[no-untyped-def]
    """Fill the edges (EdgeRows) of both images (H, W), whose grey levels times ``scale`` are those of 255.

    ``sums`` (2, LANES, W) is memory for whole numbers of 16 times the greatest grey level.
    """
    for index in prange(2 * LANES):
        lane = index % LANES
        if index < LANES:
            scan_lane(left, lane, sums[0, lane], scale, contrasts[0], edge_noises[0], left_edges)
        else:
            scan_lane(right, lane, sums[1, lane], scale, contrasts[1], edge_noises[1], right_edges)


@njit(error_model="numpy")
def scan_lane(image, lane, sums, scale, contrast, edge_noise, edges):  # type: ignore[no-untyped-def]
    """Fill the rows of a lane."""
    x_px, side, height, sigma_px, edge_number = edges.x_px, edges.side, edges.height, edges.sigma_px, edges.number
    shares, whole_fringes = edges.shares, edges.whole_fringes
    width, most = image.shape[1], x_px.shape[1] + TOGETHER
    smooth, turning = np.empty(width, dtype=np.float32), np.empty(width, dtype=np.uint8)
    turns, extrema = np.empty(width + 1, dtype=np.int32), np.full(most, BORDER_PX, dtype=np.int32)
    reals, wholes = np.zeros((REALS, most), dtype=np.float32), np.zeros((WHOLES, most), dtype=np.int32)
    apart = np.int64(np.ceil(contrast * WEIGHT / scale))
    for y in range(*lane_rows(lane, image.shape[0])):
        sum_taps(image[y], sums)
        scale_sums(sums, np.float32(scale / WEIGHT), smooth)
        turns_found = mark_turns(sums, turning, turns)
        found = mark_extrema(sums, turns[:turns_found], apart, extrema)
        number = mark_edges(smooth, extrema, found, reals, wholes, edge_noise, x_px[y], side[y], height[y], sigma_px[y])
        edge_number[y] = number
        if y % SHARE_ROWS == 0:
            at = y // SHARE_ROWS
            whole_fringes[at] = fill_shares(x_px[y, :number], side[y], shares[at])


@njit(**UNCOUNTED)
def fill_shares(x, side, shares):  # type: ignore[no-untyped-def]
    """Bright share of each whole fringe of a row, up edge to down edge to the next up edge; their number."""
    number = np.int64(0)
    for i in range(2, x.size):
        up, down, again = x[i - 2], x[i - 1], x[i]
        shares[number] = (down - up) / (again - up)
        number += np.int64((side[i - 2] == UP) & (side[i - 1] == DOWN) & (side[i] == UP))
    return number


@njit
def sum_taps(image, sums):  # type: ignore[no-untyped-def]
    """A row under 16 times a binomial of five; the border pixels are repeated."""
    # Slices, since indices that might be negative keep the loop from being vectorised.
    add_taps(image[:-4], image[1:-3], image[2:-2], image[3:-1], image[4:], sums[2:-2])
    last = image.size - 1
    for x in (0, 1, last - 1, last):
        outer = np.int64(image[max(x - 2, 0)]) + np.int64(image[min(x + 2, last)])
        inner = np.int64(image[max(x - 1, 0)]) + np.int64(image[min(x + 1, last)])
        sums[x] = outer + 4 * inner + 6 * np.int64(image[x])


@njit(**EXACT)
def add_taps(first, second, third, fourth, fifth, sums):  # type: ignore[no-untyped-def]
    """16 times the weighted sum of five neighbours."""
    for x in range(sums.size):
        outer, inner = np.int32(first[x]) + np.int32(fifth[x]), np.int32(second[x]) + np.int32(fourth[x])
        sums[x] = outer + 4 * inner + 6 * np.int32(third[x])


@njit(**EXACT)
def scale_sums(sums, unit, smooth):  # type: ignore[no-untyped-def]
    """Grey levels from sums."""
    for x in range(smooth.size):
        smooth[x] = unit * np.float32(np.int32(sums[x]))


@njit
def mark_turns(row, turning, turns):  # type: ignore[no-untyped-def]
    """Columns at which a row ends to rise or to fall, its first and its last; their number."""
    last = row.size - 1
    find_turns(row[:-2], row[1:-1], row[2:], turning)
    turns[0] = 0
    number = 1
    # Each column is written down and only turns are counted: there is no branch that the processor could guess wrong.
    for x in range(last - 1):
        turns[number] = x + 1
        number += turning[x]
    turns[number] = last
    return number + 1


@njit(**EXACT)
def find_turns(before, here, after, turning):  # type: ignore[no-untyped-def]
    """1 where three neighbours rise and then do not, or fall and then do not; else 0."""
    for x in range(here.size):
        peak = (here[x] > before[x]) & (after[x] <= here[x])
        trough = (here[x] < before[x]) & (after[x] >= here[x])
        turning[x] = peak | trough


@njit
def mark_extrema(row, turns, contrast, extrema):  # type: ignore[no-untyped-def]
    """Peaks and troughs of a row in turn, each ``contrast`` off what is before and behind it; their number.

    ``turns`` holds all columns that can be one, and both ends of the row. Of the first extremum nobody knows what came
    before it: it is left out. Troughs are peaks of the negative row.
    """
    first, sign = first_swing(row, turns, contrast)
    number = np.int64(0)
    if first < turns.size:
        top, level = turns[first], sign * row[turns[first]]
        for at in range(first + 1, turns.size):
            x = turns[at]
            here = sign * row[x]
            if here > level:
                top, level = x, here
            elif here <= level - contrast:
                extrema[number] = top
                number += np.int64((top >= BORDER_PX) & (top < row.size - BORDER_PX))
                top, level, sign = x, -here, -sign
    return number


@njit
def first_swing(row, turns, contrast):  # type: ignore[no-untyped-def]
    """Turn at which a row first lies ``contrast`` off what it reached before; 1 where above it, -1 below."""
    top = bottom = row[0]
    for at in range(1, turns.size):
        level = row[turns[at]]
        top, bottom = max(top, level), min(bottom, level)
        if level <= top - contrast:
            return at, -1
        if level >= bottom + contrast:
            return at, 1
    return turns.size, 1
