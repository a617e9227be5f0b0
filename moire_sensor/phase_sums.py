"""Sums over the windows of a row: down the columns one row at a time, along the row by doubling."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import LEAF_FAST

# Grey levels are taken less this, so that their squares lose less in float32.
MIDDLE = np.float32(128.0)
ONE, ZERO = np.float32(1.0), np.float32(0.0)
TWO, THREE = np.float32(2.0), np.float32(3.0)
# Rows of memory that :func:`sum_windows` works in; the last is, and stays, zero.
SUM_ROOM = 5


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
def sum_windows(columns, size, room, sums):  # type: ignore[no-untyped-def]
    """Fill ``sums`` (6, n): sums over ``size`` columns from each on, and of I cos and I sin also k times the k-th.

    ``columns`` are (4, n + size - 1), ``room`` (SUM_ROOM, n + size - 1).
    """
    for k in range(2):
        sum_along(columns[k], size, room, sums[k])
    for k in range(2, 4):
        ramp_along(columns[k], size, room, sums[k], sums[k + 2])


@njit(**LEAF_FAST)
def sum_along(values, size, room, sums):  # type: ignore[no-untyped-def]
    """Fill ``sums`` (n,) with those of ``size`` values from each on, ``values`` being at least n + size - 1.

    A sum over 2 n is S[x] + S[x + n]; an odd size adds one value. Two doublings are one step where they can be. The two
    rows of ``room`` are as long as ``values``.
    """
    if size == 1:
        copy(values, sums)
    bits, steps = steps_to(size)
    source, have = values, 1
    for step in range(steps - 1, -1, -1):
        next_have, bits, more = next_size(size, have, bits)
        target = room[step % 2][: values.size + 1 - next_have] if step > 0 else sums
        extra = values[next_have - 1 :] if more > ZERO else values
        if next_have >= 4 * have:
            grow_four(source, source[have:], source[2 * have :], source[3 * have :], extra, more, target)
        else:
            grow(source, source[have:], extra, more, target)
        source, have = target, next_have


@njit(**LEAF_FAST)
def ramp_along(values, size, room, sums, ramps):  # type: ignore[no-untyped-def]
    """Fill ``sums`` as :func:`sum_along`, and ``ramps`` (n,) with the sums of k times the k-th value.

    Such a sum over 2 n is T[x] + T[x + n] + n S[x + n].
    """
    bits, steps = steps_to(size)
    source, ramp, have = values, room[4], 1
    for step in range(steps - 1, -1, -1):
        next_have, bits, more = next_size(size, have, bits)
        last = np.float32(next_have - 1)
        target, ramp_target = sums, ramps
        if step > 0:
            target = room[step % 2][: values.size + 1 - next_have]
            ramp_target = room[2 + step % 2][: values.size + 1 - next_have]
        extra = values[next_have - 1 :] if more > ZERO else values
        if next_have == 4:
            first_four(source, source[1:], source[2:], source[3:], target, ramp_target)
        elif next_have >= 4 * have:
            grow_ramp_four(
                source, source[have:], source[2 * have :], source[3 * have :], ramp, ramp[have:], ramp[2 * have :],
                ramp[3 * have :], np.float32(have), extra, more, last, target, ramp_target,
            )  # fmt: skip
        else:
            ahead = ramp[have:]
            grow_ramp(source, source[have:], ramp, ahead, np.float32(have), extra, more, last, target, ramp_target)
        source, ramp, have = target, ramp_target, next_have


@njit(**LEAF_FAST)
def next_size(size, have, bits):  # type: ignore[no-untyped-def]
    """Columns after the next step from ``have``, the doublings then left, and 1 where the step adds a single one."""
    # Four times as many where no column is added between two doublings.
    doublings = 2 if bits > 1 and not (size >> (bits - 1)) & 1 else 1
    bits -= doublings
    more = (size >> bits) & 1
    return (have << doublings) + more, bits, np.float32(more)


@njit(**LEAF_FAST)
def steps_to(size):  # type: ignore[no-untyped-def]
    """Number of doublings to ``size`` columns, and of steps that they take."""
    doublings = 0
    while size >> (doublings + 1):
        doublings += 1
    bits, have, steps = doublings, 1, 0
    while bits > 0:
        have, bits, _ = next_size(size, have, bits)
        steps += 1
    return doublings, steps


@njit(**LEAF_FAST)
def grow_four(first, second, third, fourth, extra, more, target):  # type: ignore[no-untyped-def]
    """Sums over four times the columns, and one more."""
    for x in range(target.size):
        target[x] = (first[x] + second[x]) + (third[x] + fourth[x]) + more * extra[x]


@njit(**LEAF_FAST)
def grow(source, ahead, extra, more, target):  # type: ignore[no-untyped-def]
    """Sums over twice the columns, and one more."""
    for x in range(target.size):
        target[x] = source[x] + ahead[x] + more * extra[x]


@njit(**LEAF_FAST)
def first_four(first, second, third, fourth, target, ramp_target):  # type: ignore[no-untyped-def]
    """Sums, and sums of k times the k-th, over four columns."""
    for x in range(target.size):
        target[x] = (first[x] + second[x]) + (third[x] + fourth[x])
        ramp_target[x] = second[x] + TWO * third[x] + THREE * fourth[x]


@njit(**LEAF_FAST)
def grow_ramp_four(  # type: ignore[no-untyped-def]
    first, second, third, fourth, ramp, ramp_2, ramp_3, ramp_4, columns, extra, more, last, target, ramp_target
):
    """Sums, and sums of k times the k-th, over four times the columns, and one more."""
    for x in range(target.size):
        single = more * extra[x]
        target[x] = (first[x] + second[x]) + (third[x] + fourth[x]) + single
        behind = columns * (second[x] + TWO * third[x] + THREE * fourth[x]) + last * single
        ramp_target[x] = (ramp[x] + ramp_2[x]) + (ramp_3[x] + ramp_4[x]) + behind


@njit(**LEAF_FAST)
def grow_ramp(source, ahead, ramp, ramp_ahead, columns, extra, more, last, target, ramp_target):  # type: ignore[no-untyped-def]
    """Sums, and sums of k times the k-th, over twice the columns, and one more."""
    for x in range(target.size):
        single = more * extra[x]
        target[x] = source[x] + ahead[x] + single
        ramp_target[x] = ramp[x] + ramp_ahead[x] + columns * ahead[x] + last * single


@njit(**LEAF_FAST)
def copy(values, target):  # type: ignore[no-untyped-def]
    """Fill the target with the first values; the compiler copies a slice several times slower."""
    for x in range(target.size):
        target[x] = values[x]


@njit(**LEAF_FAST)
def add_scaled(values, scale, target):  # type: ignore[no-untyped-def]
    """target += scale * values."""
    for x in range(values.size):
        target[x] += scale * values[x]
