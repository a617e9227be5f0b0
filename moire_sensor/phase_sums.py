"""Sums over the windows of a row: down the columns one row at a time, along the row by doubling."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import LEAF_FAST

# Grey levels are taken less this, so that their squares lose less in float32.
MIDDLE = np.float32(128.0)
ONE, ZERO = np.float32(1.0), np.float32(0.0)
TWO, THREE = np.float32(2.0), np.float32(3.0)


@njit(**LEAF_FAST)
def add_row(columns, values, cos, sin):  # type: ignore[no-untyped-def]
    """Add one image row to the sums of I, I^2, I cos, I sin down each column."""
    ones, squares, in_cos, in_sin = columns[0], columns[1], columns[2], columns[3]
    for x in range(values.size):
        value = values[x] - MIDDLE
        ones[x] += value
        squares[x] += value * value
    for x in range(values.size):
        in_cos[x] += (values[x] - MIDDLE) * cos[x]
        in_sin[x] += (values[x] - MIDDLE) * sin[x]


@njit(**LEAF_FAST)
def move_rows(columns, values, cos, sin, old, old_cos, old_sin):  # type: ignore[no-untyped-def]
    """Add one image row to the sums and take another away."""
    ones, squares, in_cos, in_sin = columns[0], columns[1], columns[2], columns[3]
    for x in range(values.size):
        value, gone = values[x] - MIDDLE, old[x] - MIDDLE
        ones[x] += value - gone
        squares[x] += value * value - gone * gone
    for x in range(values.size):
        value, gone = values[x] - MIDDLE, old[x] - MIDDLE
        in_cos[x] += value * cos[x] - gone * old_cos[x]
        in_sin[x] += value * sin[x] - gone * old_sin[x]


@njit(**LEAF_FAST)
def sum_windows(columns, size, sums):  # type: ignore[no-untyped-def]
    """Sums over ``size`` columns from each on: ``sums[0]`` of all four, ``sums[1, 2 W:]`` of t I cos and t I sin.

    The four rows lie behind each other, so a window that leaves its row holds what nobody reads. A sum over 2 n columns
    is S[x] + S[x + n], that of k times the k-th is T[x] + T[x + n] + n S[x + n]; an odd size adds one column. Two
    doublings are one step where they can be.
    """
    values = columns.reshape(columns.size)
    half = values.size // 2
    source, ramp = values, sums[3][:half]
    for x in range(half):
        ramp[x] = ZERO
    bits, steps = steps_to(size)
    have = 1
    for step in range(steps - 1, -1, -1):
        target, ramp_target = (sums[0], sums[1][half:]) if step % 2 == 0 else (sums[2], sums[1][:half])
        behind = source[half:]
        if by_four(size, bits):
            grow_ramp_four(
                behind[have:], behind[2 * have :], behind[3 * have :], ramp, ramp[have:], ramp[2 * have :],
                ramp[3 * have :], np.float32(have), ramp_target,
            )  # fmt: skip
            grow_four(source, source[have:], source[2 * have :], source[3 * have :], target)
            have, bits = 4 * have, bits - 2
        else:
            grow_ramp(behind, behind[have:], ramp, ramp[have:], np.float32(have), ramp_target)
            grow(source, source[have:], target)
            have, bits = 2 * have, bits - 1
        if (size >> bits) & 1:
            add_scaled(values[half + have :], np.float32(have), ramp_target)
            add_scaled(values[have:], ONE, target)
            have += 1
        source, ramp = target, ramp_target
    add_scaled(source[half:], -np.float32(size // 2), ramp)


@njit(inline="always")
def by_four(size, bits):  # type: ignore[no-untyped-def]
    """Whether the next step may take four times the columns: no column is added between its two doublings."""
    return bits > 1 and not (size >> (bits - 1)) & 1


@njit(**LEAF_FAST)
def steps_to(size):  # type: ignore[no-untyped-def]
    """Number of doublings to ``size`` columns, and of steps that they take."""
    doublings = 0
    while size >> (doublings + 1):
        doublings += 1
    bits, steps = doublings, 0
    while bits > 0:
        bits -= 2 if by_four(size, bits) else 1
        steps += 1
    return doublings, steps


@njit(**LEAF_FAST)
def grow_four(first, second, third, fourth, target):  # type: ignore[no-untyped-def]
    """Sums over four times the columns."""
    for x in range(fourth.size):
        target[x] = (first[x] + second[x]) + (third[x] + fourth[x])


@njit(**LEAF_FAST)
def grow_ramp_four(second, third, fourth, ramp, ramp_2, ramp_3, ramp_4, columns, target):  # type: ignore[no-untyped-def]
    """Sums of k times the k-th over four times the columns."""
    for x in range(fourth.size):
        behind = second[x] + TWO * third[x] + THREE * fourth[x]
        target[x] = (ramp[x] + ramp_2[x]) + (ramp_3[x] + ramp_4[x]) + columns * behind


@njit(**LEAF_FAST)
def grow(source, ahead, target):  # type: ignore[no-untyped-def]
    """Sums over twice the columns."""
    for x in range(ahead.size):
        target[x] = source[x] + ahead[x]


@njit(**LEAF_FAST)
def grow_ramp(source, ahead, ramp, ramp_ahead, columns, target):  # type: ignore[no-untyped-def]
    """Sums of k times the k-th over twice the columns."""
    for x in range(ahead.size):
        target[x] = ramp[x] + ramp_ahead[x] + columns * ahead[x]


@njit(**LEAF_FAST)
def add_scaled(values, scale, target):  # type: ignore[no-untyped-def]
    """target += scale * values."""
    for x in range(values.size):
        target[x] += scale * values[x]
