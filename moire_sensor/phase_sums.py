"""Sums over the windows of a row: down the columns one row at a time, along the row by doubling."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import ROW_FAST

# Grey levels are taken less this, so that their squares lose less in float32.
MIDDLE = np.float32(128.0)
ONE, ZERO = np.float32(1.0), np.float32(0.0)


@njit(**ROW_FAST)
def add_row(columns, values, cos, sin, sign):  # type: ignore[no-untyped-def]
    """Add one image row to the sums of I, I^2, I cos, I sin down each column."""
    ones, squares, in_cos, in_sin = columns[0], columns[1], columns[2], columns[3]
    for x in range(values.size):
        value = values[x] - MIDDLE
        ones[x] += sign * value
        squares[x] += sign * value * value
    for x in range(values.size):
        in_cos[x] += sign * (values[x] - MIDDLE) * cos[x]
    for x in range(values.size):
        in_sin[x] += sign * (values[x] - MIDDLE) * sin[x]


@njit(**ROW_FAST)
def sum_windows(columns, size, sums):  # type: ignore[no-untyped-def]
    """Sums over ``size`` columns from each on: ``sums[0]`` of all four, ``sums[1, 2 W:]`` of t I cos and t I sin.

    The four rows lie behind each other, so a window that leaves its row holds what nobody reads. A sum over 2 n columns
    is S[x] + S[x + n], that of k times the k-th is T[x] + T[x + n] + n S[x + n]; an odd size adds one column.
    """
    values = columns.reshape(columns.size)
    source, target = values, values
    half = values.size // 2
    ramp, ramp_target = sums[3][:half], sums[3][:half]
    ramp[:] = ZERO
    bits = 0
    while size >> (bits + 1):
        bits += 1
    have = 1
    for bit in range(bits - 1, -1, -1):
        target, ramp_target = (sums[0], sums[1][half:]) if bit % 2 == 0 else (sums[2], sums[1][:half])
        grow_ramp(source[half:], source[half + have :], ramp, ramp[have:], np.float32(have), ramp_target)
        grow(source, source[have:], target)
        have *= 2
        if (size >> bit) & 1:
            add_scaled(values[half + have :], np.float32(have), ramp_target)
            add_scaled(values[have:], ONE, target)
            have += 1
        source, ramp = target, ramp_target
    add_scaled(source[half:], -np.float32(size // 2), ramp)


@njit(**ROW_FAST)
def grow(source, ahead, target):  # type: ignore[no-untyped-def]
    """Sums over twice the columns."""
    for x in range(ahead.size):
        target[x] = source[x] + ahead[x]


@njit(**ROW_FAST)
def grow_ramp(source, ahead, ramp, ramp_ahead, columns, target):  # type: ignore[no-untyped-def]
    """Sums of k times the k-th over twice the columns."""
    for x in range(ahead.size):
        target[x] = ramp[x] + ramp_ahead[x] + columns * ahead[x]


@njit(**ROW_FAST)
def add_scaled(values, scale, target):  # type: ignore[no-untyped-def]
    """target += scale * values."""
    for x in range(values.size):
        target[x] += scale * values[x]
