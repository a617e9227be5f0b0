"""Least squares of both phases for the pixels of one row, all or some: every step is a loop without a branch."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import TWO_PI, wrap
from moire_sensor.apart import ROW
from moire_sensor.projector_map import PLAIN, disparity_of_phase, phase_of_disparity

STEPS = 2
# Right phases that differ more between neighbours lie on either side of an edge.
EDGE_RAD = np.float32(0.5)
NAN, ZERO, HALF, ONE = np.float32(np.nan), np.float32(0.0), np.float32(0.5), np.float32(1.0)
LEAST_VARIANCE = np.float32(1e-10)
# Rows of memory that :func:`refine_row` needs.
LISTS = 12


@njit(**ROW)
def refine_row(  # type: ignore[no-untyped-def]
    label, first, y, left, left_sigma, left_rad, right, right_sigma, right_rad, map_, errors, fresh, room,
    disparity, sigma, signed, mismatch,
):  # fmt: skip
    """Fill the last four (W,) at the pixels with a label, if ``fresh`` all; ``room`` is (LISTS, W) float32."""
    count, offset = label.size, np.float32(first)
    if fresh:
        take_all(label, offset, left, left_sigma, left_rad, room[0], room[1], room[2])
    else:
        count = take_labelled(label, offset, left, left_sigma, left_rad, room[0], room[1], room[2])
    column, phase, noise, found = room[0, :count], room[1, :count], room[2, :count], room[3, :count]
    seen, along, far_noise, apart = room[4, :count], room[5, :count], room[6, :count], room[7, :count]
    expected, slope, spread, speed = room[8, :count], room[9, :count], room[10, :count], room[11]
    speeds(right, right_rad, speed)
    misaligned = errors[1] * (right_rad[1] - right_rad[0])
    place(map_, y, column, phase, found)
    look(right, speed, right_rad, right_sigma, column, found, seen, along, far_noise)
    mismatches(phase, seen, column, found, np.float32(right.size), apart)
    for number in range(STEPS):
        if number > 0:
            look(right, speed, right_rad, right_sigma, column, found, seen, along, far_noise)
        expect(map_, y, column, found, expected, slope)
        step(phase, expected, seen, slope, along, noise, far_noise, misaligned, errors[0], found, spread)
    if fresh:
        give_all(found, spread, apart, errors[2], disparity, sigma, signed, mismatch)
    else:
        give_listed(column, found, spread, apart, errors[2], disparity, sigma, signed, mismatch)


@njit(**ROW)
def take_all(label, first, offset, sigma, carrier_rad, column, phase, noise):  # type: ignore[no-untyped-def]
    """Fill columns, absolute phases and their noise of a row, phases NaN where there is no label."""
    for x in range(label.size):
        column[x], noise[x] = np.float32(np.int32(x)), sigma[x]
        order = first + np.float32(label[x])
        phase[x] = carrier_rad[x] + offset[x] + TWO_PI * order if label[x] >= 0 else NAN


@njit(**ROW)
def take_labelled(label, first, offset, sigma, carrier_rad, column, phase, noise):  # type: ignore[no-untyped-def]
    """List columns, absolute phases and their noise of the pixels that have a label; return how many there are."""
    count = 0
    for x in range(label.size):
        column[count], noise[count] = np.float32(x), sigma[x]
        phase[count] = carrier_rad[x] + offset[x] + TWO_PI * (first + np.float32(label[x]))
        count += label[x] >= 0
    return count


@njit(**ROW)
def give_all(found, spread, apart, most, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Fill the results of a row, no disparity where the phases lie further apart than ``most``."""
    for x in range(found.size):
        close = abs(apart[x]) <= most
        disparity[x] = found[x] if close else NAN
        sigma[x] = spread[x] if close else NAN
        signed[x] = apart[x]
        mismatch[x] = abs(apart[x])


@njit(**ROW)
def give_listed(column, found, spread, apart, most, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Fill the results of the listed columns, as :func:`give_all`."""
    for n in range(column.size):
        x = np.uint32(column[n])
        close = abs(apart[n]) <= most
        disparity[x] = found[n] if close else NAN
        sigma[x] = spread[n] if close else NAN
        signed[x] = apart[n]
        mismatch[x] = abs(apart[n])


@njit(**ROW)
def speeds(offset, carrier_rad, speed):  # type: ignore[no-untyped-def]
    """Fill the phase per pixel from each right pixel to the next, the carrier's alone across an edge."""
    speed[speed.size - 1] = NAN
    for x in range(offset.size - 1):
        turn = wrap(offset[x + 1] - offset[x])
        speed[x] = carrier_rad[x + 1] - carrier_rad[x] + (turn if abs(turn) <= EDGE_RAD else ZERO)


@njit(**ROW)
def place(map_, y, column, phase, found):  # type: ignore[no-untyped-def]
    """Fill the disparities at which the pixels' own phases lie on the projector's."""
    if map_.shape[0] > PLAIN:
        for n in range(column.size):
            found[n] = np.float32(disparity_of_phase(map_, column[n], y, phase[n]))
        return
    above, below = map_[0] + map_[2] * y, map_[4] + map_[6] * y
    for n in range(column.size):
        device = (phase[n] - map_[9]) / map_[8]
        over = device * (below + map_[5] * column[n]) - (above + map_[1] * column[n])
        found[n] = np.float32(over / (map_[3] - device * map_[7]))


@njit(**ROW)
def look(offset, speed, carrier_rad, sigma, column, found, seen, along, noise):  # type: ignore[no-untyped-def]
    """Fill phase, phase per pixel and noise that the right row shows: on the side of an edge that is nearer."""
    last = np.float32(offset.size - 1)
    for n in range(column.size):
        at = column[n] - found[n]
        inside = at if at > ZERO else ZERO
        inside = inside if inside < last else last
        nearest = np.uint32(np.int32(inside + HALF))
        before = np.uint32(np.int32(inside if inside < last - ONE else last - ONE))
        along[n] = speed[before]
        seen[n] = carrier_rad[nearest] + offset[nearest] + (at - np.float32(np.int32(nearest))) * along[n]
        noise[n] = sigma[nearest]


@njit(**ROW)
def mismatches(phase, seen, column, found, width, apart):  # type: ignore[no-untyped-def]
    """Fill left less right phase, folded; NaN where the right image does not reach."""
    for n in range(apart.size):
        at = column[n] - found[n]
        inside = (at >= -HALF) & (at <= width - HALF)
        apart[n] = wrap(phase[n] - seen[n]) if inside else NAN


@njit(**ROW)
def expect(map_, y, column, found, expected, slope):  # type: ignore[no-untyped-def]
    """Fill the projector's phase at the disparities, and its derivative with them."""
    if map_.shape[0] > PLAIN:
        for n in range(column.size):
            exact, steep = phase_of_disparity(map_, column[n], y, found[n])
            expected[n], slope[n] = np.float32(exact), np.float32(steep)
        return
    above, below = map_[0] + map_[2] * y, map_[4] + map_[6] * y
    for n in range(column.size):
        down = ONE / (below + map_[5] * column[n] + map_[7] * found[n])
        device = (above + map_[1] * column[n] + map_[3] * found[n]) * down
        expected[n] = np.float32(map_[8] * device + map_[9])
        slope[n] = np.float32(map_[8] * (map_[3] - device * map_[7]) * down)


@njit(**ROW)
def step(phase, expected, seen, slope, along, noise, far_noise, misaligned, common, found, spread):  # type: ignore[no-untyped-def]
    """Move the disparities by one step of the least squares, and fill their standard deviations by noise.

    The inverse covariance, but for its determinant, is [[w1, -g^2], [-g^2, w2]].
    """
    g2, a2 = common * common, misaligned * misaligned
    for n in range(found.size):
        v1 = noise[n] * noise[n] + LEAST_VARIANCE
        v2 = far_noise[n] * far_noise[n] + LEAST_VARIANCE
        slope1, slope2 = slope[n], slope[n] + along[n]
        gain1 = (v2 + a2 + g2) * slope1 - g2 * slope2
        gain2 = (v1 + g2) * slope2 - g2 * slope1
        norm = ONE / (gain1 * slope1 + gain2 * slope2)
        found[n] += (gain1 * (phase[n] - expected[n]) + gain2 * wrap(seen[n] - expected[n])) * norm
        spread[n] = np.sqrt(gain1 * gain1 * v1 + gain2 * gain2 * v2) * abs(norm)
