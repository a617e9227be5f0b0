"""Where the right camera would see the candidates of one order along a row (equations 11 and 12)."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import TURNS_PER_RAD, TWO_PI
from moire_sensor.apart import LEAF
from moire_sensor.order_weigh import PARTS
from moire_sensor.projector_map import PLAIN, disparity_of_phase

PARTS_PER_RAD = TURNS_PER_RAD * PARTS
# Where the table of seen phases holds what lies left of the image, and, behind its width, what is out of range.
OUTSIDE, OUT_OF_RANGE = np.int32(0), np.int32(2)


@njit(**LEAF)
def place(phase, map_, y, order, carrier, limits, column, nearest, parts):  # type: ignore[no-untyped-def]
    """Fill right columns of one order, the nearest pixels, and its phase above the right carrier there.

    ``nearest`` are indices into a table of the right pixels counted from 1, followed by one for columns beyond the
    image and one for disparities out of the limits; the phase is in 1/65536 of a turn, wrapped.
    """
    if map_.shape[0] > PLAIN:
        for x in range(phase.size):
            column[x] = x - disparity_of_phase(map_, x, y, phase[x] + TWO_PI * np.float32(order))
        aim(phase, carrier, limits, column, nearest, parts)
    elif map_[5] == 0.0 and map_[7] == 0.0:
        place_straight(phase, map_, y, order, carrier, limits, column, nearest, parts)
    else:
        place_by_quotient(phase, map_, y, order, column)
        aim(phase, carrier, limits, column, nearest, parts)


@njit(**LEAF)
def place_straight(phase, map_, y, order, carrier, limits, column, nearest, parts):  # type: ignore[no-untyped-def]
    """For a projector in the plane of the cameras, not turned: everything is linear along a row."""
    below = (map_[4] + map_[6] * y) / map_[3]
    px_per_rad = np.float32(below / map_[8])
    px_per_px = np.float32(1.0 + map_[1] / map_[3])
    start = np.float32((map_[0] + map_[2] * y) / map_[3] - below * (2.0 * np.pi * order - map_[9]) / map_[8])
    last = carrier.size - 1
    first = np.float32(carrier[0] * PARTS_PER_RAD)
    per_px = (np.float64(carrier[last]) - np.float64(carrier[0])) / np.float64(last)
    parts_per_px = np.float32(per_px * np.float64(PARTS_PER_RAD))
    least, most = limits[0], limits[1]
    for x in range(phase.size):
        at = start + px_per_px * np.float32(np.int32(x)) - px_per_rad * phase[x]
        column[x] = at
        nearest[x] = index_of(at, np.float32(np.int32(x)) - at, least, most, phase.size)
        parts[x] = wrapped_parts(phase[x] * PARTS_PER_RAD - first - parts_per_px * at)


@njit(**LEAF)
def place_by_quotient(phase, map_, y, order, column):  # type: ignore[no-untyped-def]
    """For any projector without lens: disparity_of_phase in float32."""
    start = np.float32((2.0 * np.pi * order - map_[9]) / map_[8])
    per_rad = np.float32(1.0 / map_[8])
    above, above_x = np.float32(map_[0] + map_[2] * y), np.float32(map_[1])
    below, below_x = np.float32(map_[4] + map_[6] * y), np.float32(map_[5])
    above_d, below_d = np.float32(map_[3]), np.float32(map_[7])
    for index in range(phase.size):
        x = np.float32(np.int32(index))
        device = start + per_rad * phase[index]
        disparity = (device * (below + below_x * x) - (above + above_x * x)) / (above_d - device * below_d)
        column[index] = x - disparity


@njit(**LEAF)
def aim(phase, carrier, limits, column, nearest, parts):  # type: ignore[no-untyped-def]
    """Fill the nearest pixels and the phase above the right carrier, linear between its pixels."""
    last = np.float32(carrier.size - 2)
    least, most = limits[0], limits[1]
    for x in range(phase.size):
        at = column[x] if column[x] > np.float32(0.0) else np.float32(0.0)
        left = np.uint32(at if at < last else last)
        step = carrier[left + 1] - carrier[left]
        above = phase[x] - carrier[left] - (column[x] - np.float32(left)) * step
        parts[x] = wrapped_parts(above * PARTS_PER_RAD)
    for x in range(phase.size):
        nearest[x] = index_of(column[x], np.float32(np.int32(x)) - column[x], least, most, phase.size)


@njit(inline="always")
def index_of(at, disparity, least, most, width):  # type: ignore[no-untyped-def]
    """Index of the nearest right pixel. An unknown column is out of range too: all orders of a pixel alike."""
    inside = (disparity >= least) & (disparity <= most)
    at = at if at > np.float32(-1.0) else np.float32(-1.0)
    at = at if at < np.float32(width) else np.float32(width)
    index = np.int32(at + np.float32(1.5))
    return index if inside else np.int32(np.int32(width) + OUT_OF_RANGE)


@njit(inline="always")
def wrapped_parts(value):  # type: ignore[no-untyped-def]
    """Whole parts of a turn, which wrap where the phase does; 0 for NaN."""
    return np.int16(np.int32(value if value == value else np.float32(0.0)))
