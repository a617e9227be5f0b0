"""Least squares of both phases for the pixels of one row, all or some: every step is a loop without a branch.

Disparities and phases of the projector are counted from the carrier's, where float32 tells them best. At D pixels from
the middle disparity a pixel shows the carrier's phase and S D / (1 + G D), as equation (11) is a ratio of two
straight lines; S and G follow from the matrices. A lens is looked up in its tables.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import TWO_PI, wrap
from moire_sensor.apart import LEAF
from moire_sensor.projector_map import PLAIN, disparity_of_phase, phase_of_disparity

# Right phases that differ more between neighbours lie on either side of an edge.
EDGE_RAD = np.float32(0.5)
NAN, ZERO, HALF, ONE = np.float32(np.nan), np.float32(0.0), np.float32(0.5), np.float32(1.0)
LEAST_VARIANCE = np.float32(1e-10)
# Pixels that are solved together, and rows of memory for them.
PART, ROWS = 320, 11
# Of eight labels looked at as one word, the bits that tell that there is none.
SIGNS = np.uint64(0x8080808080808080)


@njit(**LEAF)
def refine_row(  # type: ignore[no-untyped-def]
    label, first, y, left, left_sigma, left_rad, right, right_sigma, right_rad, map_, middle, errors, fresh, room, rows,
    disparity, sigma, signed, mismatch,
):  # fmt: skip
    """Fill the last four (W,) at the pixels with a label, if ``fresh`` all.

    ``room`` is (3, W) float32, ``rows`` (ROWS, PART): pixels are taken a few at a time, and stay in the nearest cache.
    """
    width, offset = label.size, np.float32(first)
    listed, seen, speed = room[0].view(np.int32), room[1], room[2]
    count = width if fresh else list_labelled(label, listed)
    if count == 0:
        return
    speeds(right, right_rad, seen, speed)
    misaligned = errors[1] * (right_rad[1] - right_rad[0])
    for start in range(0, count, PART):
        size = min(PART, count - start)
        column, phase, noise, carrier = rows[0, :size], rows[1, :size], rows[2, :size], rows[3, :size]
        found, apart, spread = rows[4, :size], rows[5, :size], rows[6, :size]
        part = slice(start, start + size)
        if fresh:
            take_all(
                label[part], offset, left[part], left_sigma[part], left_rad[part], start, column, phase, noise, carrier
            )
        else:
            take_listed(label, offset, left, left_sigma, left_rad, listed[part], column, phase, noise, carrier)
        solve(
            map_, y, middle, seen, speed, right_sigma, misaligned, errors[0], column, phase, noise, carrier,
            rows[7, :size], rows[8, :size], rows[9, :size], rows[10, :size], found, apart, spread,
        )  # fmt: skip
        if fresh:
            give_all(
                found, apart, spread, middle, errors[2], disparity[part], sigma[part], signed[part], mismatch[part]
            )
        else:
            give_listed(listed[part], found, apart, spread, middle, errors[2], disparity, sigma, signed, mismatch)


@njit(**LEAF)
def solve(  # type: ignore[no-untyped-def]
    map_, y, middle, seen, speed, far_sigma, misaligned, common, column, phase, noise, carrier, slope, steep, bent,
    expected, found, apart, spread,
):  # fmt: skip
    """Least squares of a few pixels: fill where they are found, how far apart the phases lie, and variances."""
    a2, g2 = misaligned * misaligned, common * common
    lens = map_.shape[0] > PLAIN
    if lens:
        place_lens(map_, y, middle, column, carrier, phase, found, slope)
    else:
        lines(map_, y, middle, column, steep, bent)
        place(phase, steep, bent, found, slope)
    meet(seen, speed, far_sigma, column, middle, phase, carrier, noise, phase, slope, a2, g2, found, apart, spread)
    if lens:
        expect_lens(map_, y, middle, column, carrier, found, expected, slope)
    else:
        expect(found, steep, bent, expected, slope)
    meet(seen, speed, far_sigma, column, middle, phase, carrier, noise, expected, slope, a2, g2, found, steep, spread)


@njit(**LEAF)
def take_all(label, first, offset, sigma, carrier_rad, start, column, phase, noise, carrier):  # type: ignore[no-untyped-def]
    """Fill columns, phases from the carrier on, their noise and the carrier; phases NaN where there is no label."""
    for n in range(label.size):
        column[n], noise[n], carrier[n] = np.float32(np.int32(start + n)), sigma[n], carrier_rad[n]
        order = first + np.float32(label[n])
        phase[n] = offset[n] + TWO_PI * order if label[n] >= 0 else NAN


@njit(**LEAF)
def list_labelled(label, listed):  # type: ignore[no-untyped-def]
    """List the columns that have a label; return how many there are."""
    count, whole = 0, label.size // 8 * 8
    eights = label[:whole].view(np.uint64)
    for eight in range(eights.size):
        if eights[eight] & SIGNS != SIGNS:  # most have none, looked at together
            for x in range(8 * eight, 8 * eight + 8):
                listed[count] = x
                count += label[x] >= 0
    for x in range(whole, label.size):
        listed[count] = x
        count += label[x] >= 0
    return count


@njit(**LEAF)
def take_listed(label, first, offset, sigma, carrier_rad, listed, column, phase, noise, carrier):  # type: ignore[no-untyped-def]
    """The same as :func:`take_all` for the listed columns."""
    for n in range(listed.size):
        x = np.uint32(listed[n])
        column[n], noise[n], carrier[n] = np.float32(listed[n]), sigma[x], carrier_rad[x]
        phase[n] = offset[x] + TWO_PI * (first + np.float32(label[x]))


@njit(**LEAF)
def give_all(found, apart, spread, middle, most, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Fill the results of neighbours, no disparity where the phases lie further apart than ``most``."""
    for n in range(disparity.size):
        close = abs(apart[n]) <= most
        disparity[n] = middle + found[n] if close else NAN
        sigma[n] = np.sqrt(spread[n]) if close else NAN
        signed[n] = apart[n]
        mismatch[n] = abs(apart[n])


@njit(**LEAF)
def give_listed(listed, found, apart, spread, middle, most, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Fill the results of the listed columns, as :func:`give_all`."""
    for n in range(listed.size):
        x = np.uint32(listed[n])
        close = abs(apart[n]) <= most
        disparity[x] = middle + found[n] if close else NAN
        sigma[x] = np.sqrt(spread[n]) if close else NAN
        signed[x] = apart[n]
        mismatch[x] = abs(apart[n])


@njit(**LEAF)
def speeds(offset, carrier_rad, seen, speed):  # type: ignore[no-untyped-def]
    """Fill the right phases, and how much each lies before that of the next pixel: the carrier's alone at an edge."""
    for x in range(offset.size):
        seen[x] = carrier_rad[x] + offset[x]
    speed[speed.size - 1] = NAN
    for x in range(offset.size - 1):
        turn = wrap(offset[x + 1] - offset[x])
        speed[x] = carrier_rad[x + 1] - carrier_rad[x] + (turn if abs(turn) <= EDGE_RAD else ZERO)


@njit(**LEAF)
def lines(map_, y, middle, column, steep, bent):  # type: ignore[no-untyped-def]
    """Fill S and G of the pixels."""
    above, below = (
        np.float32(map_[0] + map_[2] * y + map_[3] * middle),
        np.float32(map_[4] + map_[6] * y + map_[7] * middle),
    )
    above_x, below_x, above_d, below_d = (
        np.float32(map_[1]),
        np.float32(map_[5]),
        np.float32(map_[3]),
        np.float32(map_[7]),
    )
    rad_per_column = np.float32(map_[8])
    for n in range(column.size):
        down = ONE / (below + below_x * column[n])
        device = (above + above_x * column[n]) * down
        steep[n] = rad_per_column * (above_d - device * below_d) * down
        bent[n] = below_d * down


@njit(**LEAF)
def place(phase, steep, bent, found, slope):  # type: ignore[no-untyped-def]
    """Fill where the pixels' own phases lie on the projector's, and the derivative of its phase there."""
    for n in range(phase.size):
        found[n] = phase[n] / (steep[n] - bent[n] * phase[n])
        down = ONE / (ONE + bent[n] * found[n])
        slope[n] = steep[n] * down * down


@njit(**LEAF)
def expect(found, steep, bent, expected, slope):  # type: ignore[no-untyped-def]
    """Fill the projector's phase from the carrier's on, and its derivative."""
    for n in range(found.size):
        down = ONE / (ONE + bent[n] * found[n])
        expected[n] = steep[n] * found[n] * down
        slope[n] = steep[n] * down * down


@njit(**LEAF)
def place_lens(map_, y, middle, column, carrier, phase, found, slope):  # type: ignore[no-untyped-def]
    """The same as :func:`place` through a lens."""
    for n in range(column.size):
        exact = disparity_of_phase(map_, column[n], y, carrier[n] + phase[n])
        found[n] = np.float32(exact - middle)
        slope[n] = np.float32(phase_of_disparity(map_, column[n], y, exact)[1])


@njit(**LEAF)
def expect_lens(map_, y, middle, column, carrier, found, expected, slope):  # type: ignore[no-untyped-def]
    """The same as :func:`expect` through a lens."""
    for n in range(column.size):
        exact, along = phase_of_disparity(map_, column[n], y, middle + found[n])
        expected[n], slope[n] = np.float32(exact - carrier[n]), np.float32(along)


@njit(**LEAF)
def meet(  # type: ignore[no-untyped-def]
    seen, speed, sigma, column, middle, phase, carrier, noise, expected, slope, a2, g2, found, apart, spread
):
    """Move the disparities by one step of the least squares, and fill their variances by noise.

    ``apart`` takes by how much the phase expected there lies before the right one, folded; NaN where the right image
    does not reach. Of the right row that side of an edge counts which is nearer. The inverse covariance, but for its
    determinant, is [[w1, -g^2], [-g^2, w2]].
    """
    last = np.float32(seen.size - 1)
    for n in range(found.size):
        at = column[n] - middle - found[n]
        inside = at if at > ZERO else ZERO
        inside = inside if inside < last else last
        nearest = np.uint32(np.int32(inside + HALF))
        before = np.uint32(np.int32(inside if inside < last - ONE else last - ONE))
        along, far_noise = speed[before], sigma[nearest]
        reached = seen[nearest] + (at - np.float32(np.int32(nearest))) * along
        ahead = wrap(carrier[n] + expected[n] - reached)
        apart[n] = ahead if (at >= -HALF) & (at <= last + HALF) else NAN
        v1 = noise[n] * noise[n] + LEAST_VARIANCE
        v2 = far_noise * far_noise + LEAST_VARIANCE
        slope1, slope2 = slope[n], slope[n] + along
        gain1 = (v2 + a2 + g2) * slope1 - g2 * slope2
        gain2 = (v1 + g2) * slope2 - g2 * slope1
        norm = ONE / (gain1 * slope1 + gain2 * slope2)
        found[n] += (gain1 * (phase[n] - expected[n]) - gain2 * ahead) * norm
        spread[n] = (gain1 * gain1 * v1 + gain2 * gain2 * v2) * (norm * norm)
