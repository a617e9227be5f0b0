"""Least squares of both phases for the pixels of one row, all or some, a part of the row at a time."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import TWO_PI
from moire_sensor.apart import LEAF
from moire_sensor.depth_refine_step import NAN, solve, speeds

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
