"""Ridges: where two faces meet across a row, each is measured by itself and carried to the line in which they meet.

Windows that straddle a ridge round it; where one face is dim and the other bright, the bright one decides, and the dim
one's first pixels stand a pixel off. A line fitted to the grey levels of one face alone knows nothing of the other.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import BARE, NAN_SAFE
from moire_sensor.depth_offer import LARGEST_MOVE_PX
from moire_sensor.depth_refine import Match
from moire_sensor.depth_runs import TASKS, list_edges, marks_for
from moire_sensor.depth_window import level_and_slope
from moire_sensor.phase_carrier import Float32

# A ridge shows as a break of so much between neighbours, or as a hole of at most so many pixels.
BREAK_PX, HOLE_PX = np.float32(0.8), 8
# Pixels beside it that are doubted, and those behind them whose disparities give the line to start from.
DOUBT_PX, LINE_PX = 4, 9
# Grey levels are matched from the second pixel of a face on, in so many rows above and below, so many times.
ROWS_PX, STEPS = 2, 3
# Faces differ in slope by more, are straight to so many pixels (root mean square), and meet so near to the break.
LEAST_BEND, MOST_ROUGH_PX, BESIDE_PX = np.float32(0.2), np.float32(0.3), np.float32(3.0)
# Pixels nearer to their face are left alone.
NEAR_PX = np.float32(0.5)
# Determinant of the normal equations without which there is nothing to measure by.
LEAST_POWER = np.float32(1.0)
NAN, ZERO = np.float32(np.nan), np.float32(0.0)


def sharpen(match: Match, greys: tuple[Float32, Float32], amplitude: Float32) -> None:
    """Give the pixels at ridges to the face they are on, in place.

    Parameters
    ----------
    match : disparities, NaN where unknown, which stays so. Pixels that move get the sigma of their line and, as
        mismatch, what its grey levels leave in fringe amplitudes; their signed mismatch is NaN.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    amplitude : fringe amplitude of the left image (H, W).
    """
    sharpen_rows(*greys, amplitude, *match.images())


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def sharpen_rows(left, right, amplitude, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Kernel of :func:`sharpen`."""
    height, width = disparity.shape
    reach = DOUBT_PX + LINE_PX
    for task in prange(TASKS):
        marks, edges = marks_for(width), np.empty(width + 1, dtype=np.int32)
        line = np.empty(width, dtype=np.float32)
        for y in range(np.int64(task), height, TASKS):
            line[:] = disparity[y]
            count = list_edges(line, BREAK_PX, marks, edges)
            for number in range(1, count):
                before, after = edges[number] - 1, edges[number]
                if np.isnan(line[before]):
                    continue
                after = edges[number + 1] if np.isnan(line[after]) else after
                if before + 1 >= reach and after - before <= HOLE_PX and after + reach <= width:
                    mend(left, right, amplitude, y, line, before, after, disparity, sigma, signed, mismatch)


@njit(**BARE)
def mend(left, right, amplitude, y, line, before, after, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Where the faces up to column ``before`` and from ``after`` on meet in a ridge, move the pixels beside it."""
    half, reach = LINE_PX // 2, DOUBT_PX + LINE_PX
    near, near_start, near_rough = straight(line, before - DOUBT_PX - half)
    far, far_start, far_rough = straight(line, after + DOUBT_PX + half)
    if not (near_rough <= MOST_ROUGH_PX and far_rough <= MOST_ROUGH_PX and abs(far_start - near_start) > LEAST_BEND):
        return
    near = matched(left, right, y, before - reach + 1, before, before - DOUBT_PX - half, near, near_start)
    far = matched(left, right, y, after + 1, after + reach, after + DOUBT_PX + half, far, far_start)
    meet = ((near[1] - near[2] * near[0]) - (far[1] - far[2] * far[0])) / (far[2] - near[2])
    if not np.float32(before) - BESIDE_PX <= meet <= np.float32(after) + BESIDE_PX:
        return
    for x in range(before - DOUBT_PX + 1, after + DOUBT_PX):
        middle, value, slope, left_over, spread = near if np.float32(x) < meet else far
        away = np.float32(x) - middle
        if abs(line[x] - value - slope * away) > NEAR_PX:
            disparity[y, x] = value + slope * away
            sigma[y, x] = np.sqrt(left_over * (spread[0] + away * (spread[1] + away * spread[2])))
            signed[y, x] = NAN
            mismatch[y, x] = np.sqrt(left_over) / max(amplitude[y, x], np.float32(1.0))


@njit(**BARE)
def straight(line, middle):  # type: ignore[no-untyped-def]
    """Value in the middle, slope and roughness of ``LINE_PX`` pixels; NaN where one is unknown."""
    mean, slope, squares = ZERO, ZERO, ZERO
    half = LINE_PX // 2
    for away in range(-half, half + 1):
        mean += line[middle + away]
        slope += np.float32(away) * line[middle + away]
        squares += np.float32(away * away)
    mean, slope = mean / np.float32(LINE_PX), slope / squares
    rough = ZERO
    for away in range(-half, half + 1):
        off = line[middle + away] - mean - slope * np.float32(away)
        rough += off * off
    return mean, slope, np.sqrt(rough / np.float32(LINE_PX))


@njit(**BARE)
def matched(left, right, y, first, end, middle, value, slope):  # type: ignore[no-untyped-def]
    """Line about column ``middle`` at which the grey levels of columns ``first`` to ``end`` - 1 match, from a start.

    Returns the middle column, value and slope, the variance left over for a pixel, and what a pixel ``n`` columns away
    takes of it for its own variance: terms of n^0, n^1 and n^2. NaN where nothing holds the line or it moves too far.
    """
    found, turn = value, slope
    left_over, spread = NAN, (NAN, NAN, NAN)
    for _ in range(STEPS):
        (one, along, square), (met, turned), (squares, seen) = normal_equations(
            left, right, y, first, end, middle, found, turn
        )
        power = one * square - along * along
        if not (power > LEAST_POWER and abs(found - value) <= LARGEST_MOVE_PX):
            return np.float32(middle), NAN, NAN, NAN, spread
        step, turn_step = (met * square - turned * along) / power, (turned * one - met * along) / power
        left_over = max(squares - step * met - turn_step * turned, ZERO) / max(seen - np.float32(2.0), np.float32(1.0))
        found, turn = found + step, turn + turn_step
        spread = square / power, np.float32(-2.0) * along / power, one / power
    return np.float32(middle), found, turn, left_over, spread


@njit(**BARE)
def normal_equations(left, right, y, first, end, middle, value, slope):  # type: ignore[no-untyped-def]
    """Sums over the face: of squared slopes times 1, n, n^2, of slopes times differences times 1, n, and the rest."""
    height, width = left.shape
    one, along, square, met, turned, squares, seen = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for row in range(max(y - ROWS_PX, 0), min(y + ROWS_PX + 1, height)):
        for x in range(first, end):
            away = np.float32(x - middle)
            column = np.float32(x) - value - slope * away
            if not (np.float32(1.0) <= column < np.float32(width - 2)):
                continue
            level, grade = level_and_slope(right, row, column)
            difference = level - left[row, x]
            one += grade * grade
            along += grade * grade * away
            square += grade * grade * away * away
            met += grade * difference
            turned += grade * difference * away
            squares += difference * difference
            seen += np.float32(1.0)
    return (one, along, square), (met, turned), (squares, seen)
