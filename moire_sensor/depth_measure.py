"""One round of measuring disparities by grey levels, and what is left over: a band of rows at a time.

A row is compared, enters the sums down the columns, gives the moves of the row in the middle of the window, and leaves
again, all within the cache; only results go to memory.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import FAST, LEAF, LEAF_FAST, ROW
from moire_sensor.phase_sums import ONE, ZERO, sum_along

# Rows of half a window above and below a band are compared twice: few bands, but enough for four threads.
BAND_ROWS = 120
# A step is far beyond so many pixels, or beyond that share of a fringe where fringes are wider than usual: what shading
# puts into a phase is so much wider there.
FAR_STEP_PX, USUAL_COLUMNS, LARGEST_STEP_PX = np.float32(0.2), np.float32(17.0), np.float32(0.7)
# Pixels that differ by more than this share of the fringe amplitude, noise apart, do not show one point.
FOREIGN_SHARE = np.float32(0.35)
# Standard deviation by mean magnitude, of a normal distribution.
SIGMA_OF_MEAN = np.float32(np.sqrt(np.pi / 2.0))
# Differences above this much of the typical variance are no noise: where pixels are interpolated across sharp steps of
# brightness, the rows of a window err alike. Fitted to square fringes and texture.
EXCESS, SAME_ROWS = np.float32(1.4), np.float32(20.0)
# What the disparities of the former round add, averaged along the surface: 1.23 to 1.42 on the analytic scenes.
ROUNDS_SIGMA = np.float32(1.3)


@njit(parallel=True, cache=True)
def measure(  # type: ignore[no-untyped-def]
    left, right, disparity, amplitude, first_row, row_step, columns, half_height, noise, enough, apart, power, found
):
    """Fill ``found`` (n, W) with the disparities that remove the differences of the windows at the given ones.

    Parameters
    ----------
    disparity, amplitude : (n, W), of every ``row_step``-th row of the images (H, W) from ``first_row`` on.
    columns, half_height : of the windows: columns, and such rows above and below.
    enough : least sum of squared slopes that moves a disparity.
    apart, power : (n, W), filled with the differences of the pixels, and with sums of squared slopes over the windows.

    Returns
    -------
    How many pixels with a disparity move far.
    """
    far = np.int64(0)
    for band in prange((disparity.shape[0] + BAND_ROWS - 1) // BAND_ROWS):
        far += measure_band(
            left, right, disparity, amplitude, first_row, row_step, columns, half_height, noise, enough,
            np.int64(band) * BAND_ROWS, apart, power, found,
        )  # fmt: skip
    return far


@njit(**ROW)
def measure_band(  # type: ignore[no-untyped-def]
    left, right, disparity, amplitude, first_row, row_step, columns, half_height, noise, enough, first, apart, power,
    found,
):  # fmt: skip
    """The rows of one band from ``first`` on."""
    height, width = disparity.shape
    last, start = min(first + BAND_ROWS, height), max(first - half_height, 0)
    rings = np.empty((2, 2 * half_height + 1, width), dtype=np.float32)
    powers, mets = rings[0], rings[1]
    down = np.zeros((2, width + 2 * columns), dtype=np.float32)
    room = np.empty((4, width + 2 * columns), dtype=np.float32)
    far, far_step = 0, FAR_STEP_PX * max(np.float32(columns) / USUAL_COLUMNS, ONE)
    for y in range(start, last + half_height):
        if y < height:
            slot = y % powers.shape[0]
            inside = first <= y < last
            row = first_row + row_step * y
            compare_row(
                left[row], right[row], disparity[y], amplitude[y], noise, powers[slot], mets[slot],
                apart[y] if inside else room[3, :width],
            )  # fmt: skip
            change(powers[slot], mets[slot], ONE, down[0][columns // 2 :], down[1][columns // 2 :])
        at, old = y - half_height, y - 2 * half_height
        if at >= first:
            sum_along(down[0], columns, room[:2], power[at])
            sum_along(down[1], columns, room[:2], room[2, :width])
            far += move_row(disparity[at], power[at], room[2, :width], enough, far_step, found[at])
        if old >= start:
            slot = old % powers.shape[0]
            change(powers[slot], mets[slot], -ONE, down[0][columns // 2 :], down[1][columns // 2 :])
    return far


@njit(**LEAF_FAST)
def change(powers, mets, sign, down_power, down_met):  # type: ignore[no-untyped-def]
    """Add a row to the sums down the columns, or take it away."""
    for x in range(powers.size):
        down_power[x] += sign * powers[x]
        down_met[x] += sign * mets[x]


@njit(**LEAF)
def compare_row(left, right, disparity, amplitude, noise, power, met, apart):  # type: ignore[no-untyped-def]
    """Fill slope times slope, slope times difference, and difference (each (W,)) of left and moved right row.

    The right row is read by cubic interpolation. One slope is the left row's, one the right's: the noise of an
    interpolated value has to do with that of its own slope, and the square of it would draw disparities to whole
    pixels. Pixels that the right row does not show have no slope and no difference, those too different to show one
    point no slope.
    """
    half, last = np.float32(0.5), left.size - 1
    power[0] = left[min(1, last)] - left[0]
    power[last] = left[last] - left[max(last - 1, 0)]
    for x in range(1, last):
        power[x] = left[x + 1] - left[x - 1]
    lowest, highest = np.float32(1.0), np.float32(last - 2)
    for x in range(left.size):
        seen = np.float32(np.int32(x)) - disparity[x]
        known = (lowest <= seen) & (seen <= highest)
        column = seen if known else lowest
        base = np.uint32(np.int32(column))
        t = column - np.float32(np.int32(base))
        p0, p1, p2, p3 = right[base - 1], right[base], right[base + 1], right[base + 2]
        c1 = half * (p2 - p0)
        c2 = p0 - np.float32(2.5) * p1 + np.float32(2.0) * p2 - half * p3
        c3 = half * (p3 - p0) + np.float32(1.5) * (p1 - p2)
        slope = c1 + t * (np.float32(2.0) * c2 + np.float32(3.0) * t * c3)
        difference = left[x] - (p1 + t * (c1 + t * (c2 + t * c3)))
        distance = abs(difference)
        same = known & (distance < FOREIGN_SHARE * amplitude[x] + np.float32(3.0) * noise)
        own = half * power[x]
        power[x] = own * slope if same else np.float32(0.0)
        met[x] = -own * difference if same else np.float32(0.0)
        apart[x] = distance if known else np.float32(0.0)


@njit(**LEAF)
def move_row(disparity, power, met, enough, far_step, moved):  # type: ignore[no-untyped-def]
    """Fill the disparities of a row that remove the differences of its windows; return how many of them move far."""
    far = np.int32(0)
    for x in range(disparity.size):
        step = met[x] / max(power[x], enough)
        step = min(max(step, -LARGEST_STEP_PX), LARGEST_STEP_PX)
        step = step if power[x] > enough else np.float32(0.0)
        moved[x] = disparity[x] + step
        far += np.int32((abs(step) > far_step) & (disparity[x] == disparity[x]))
    return far


@njit(parallel=True, cache=True, **FAST)
def fill_sigma(apart, power, columns, half_height, enough, typical, sigma):  # type: ignore[no-untyped-def]
    """Fill ``sigma`` (H, W), the predicted standard deviation of a disparity, pixels.

    From the mean difference over the window of those pixels that have one, and sums of squared slopes over the window.
    """
    for band in prange((apart.shape[0] + BAND_ROWS - 1) // BAND_ROWS):
        sigma_band(apart, power, columns, half_height, enough, typical, np.int64(band) * BAND_ROWS, sigma)


@njit(**FAST)
def sigma_band(apart, power, columns, half_height, enough, typical, first, sigma):  # type: ignore[no-untyped-def]
    """The rows of one band from ``first`` on."""
    height, width = apart.shape
    last, start = min(first + BAND_ROWS, height), max(first - half_height, 0)
    down = np.zeros((2, width + 2 * columns), dtype=np.float32)
    room = np.empty((4, width + 2 * columns), dtype=np.float32)
    for y in range(start, last + half_height):
        at, old = y - half_height, y - 2 * half_height
        if y < height:
            count(apart[y], ONE, down[0][columns // 2 :], down[1][columns // 2 :])
        if at >= first:
            sum_along(down[0], columns, room[:2], room[2, :width])
            sum_along(down[1], columns, room[:2], room[3, :width])
            sigma_row(room[2], room[3], power[at], enough, typical, sigma[at])
        if old >= start:
            count(apart[old], -ONE, down[0][columns // 2 :], down[1][columns // 2 :])


@njit(**LEAF_FAST)
def count(apart, sign, down, known):  # type: ignore[no-untyped-def]
    """Add differences, and how many there are, to the sums down the columns, or take them away."""
    for x in range(apart.size):
        down[x] += sign * apart[x]
        known[x] += sign if apart[x] > ZERO else ZERO


@njit(**LEAF_FAST)
def sigma_row(apart, known, power, enough, typical, sigma):  # type: ignore[no-untyped-def]
    """One row of :func:`fill_sigma` from sums over the windows."""
    for x in range(sigma.size):
        noise = SIGMA_OF_MEAN * apart[x] / max(known[x], ONE)
        excess = noise * noise - EXCESS * typical * typical
        variance = noise * noise + SAME_ROWS * (excess if excess > ZERO else ZERO)
        sigma[x] = ROUNDS_SIGMA * np.sqrt(variance / max(power[x], enough))
