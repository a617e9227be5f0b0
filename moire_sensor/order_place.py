"""Where the right camera would see the candidates of one order along a row (equations 11 and 12)."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import TURNS_PER_RAD, TWO_PI
from moire_sensor.apart import ROW
from moire_sensor.projector_map import PLAIN, disparity_of_phase


@njit(**ROW)
def place(phase, map_, y, order, carrier, column, turns):  # type: ignore[no-untyped-def]
    """Fill right columns of one order, and its phase above the right carrier there, in turns."""
    if map_.shape[0] > PLAIN:
        for x in range(phase.size):
            column[x] = x - disparity_of_phase(map_, x, y, phase[x] + TWO_PI * np.float32(order))
        subtract_carrier(phase, carrier, column, turns)
    elif map_[5] == 0.0 and map_[7] == 0.0:
        place_straight(phase, map_, y, order, carrier, column, turns)
    else:
        place_by_quotient(phase, map_, y, order, column)
        subtract_carrier(phase, carrier, column, turns)


@njit(**ROW)
def place_straight(phase, map_, y, order, carrier, column, turns):  # type: ignore[no-untyped-def]
    """For a projector in the plane of the cameras, not turned: everything is linear along a row."""
    below = (map_[4] + map_[6] * y) / map_[3]
    px_per_rad = np.float32(below / map_[8])
    px_per_px = np.float32(1.0 + map_[1] / map_[3])
    start = np.float32((map_[0] + map_[2] * y) / map_[3] - below * (2.0 * np.pi * order - map_[9]) / map_[8])
    last = carrier.size - 1
    first_turn = np.float32(carrier[0] * TURNS_PER_RAD)
    turns_per_px = np.float32((np.float64(carrier[last]) - np.float64(carrier[0])) / (2.0 * np.pi * last))
    for x in range(phase.size):
        at = start + px_per_px * np.float32(np.int32(x)) - px_per_rad * phase[x]
        column[x] = at
        turns[x] = phase[x] * TURNS_PER_RAD - first_turn - turns_per_px * at


@njit(**ROW)
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


@njit(**ROW)
def subtract_carrier(phase, carrier, column, turns):  # type: ignore[no-untyped-def]
    """Fill the phase above the right carrier, linear between its pixels."""
    last = np.float32(carrier.size - 2)
    for x in range(phase.size):
        at = column[x] if column[x] > np.float32(0.0) else np.float32(0.0)
        left = np.uint32(at if at < last else last)
        step = carrier[left + 1] - carrier[left]
        turns[x] = (phase[x] - carrier[left] - (column[x] - np.float32(left)) * step) * TURNS_PER_RAD
