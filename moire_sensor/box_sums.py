"""Sums over windows of an image: down the columns one row at a time, along the row by doubling."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import FAST, LEAF_FAST
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_sums import add_scaled, by_four, grow, grow_four, steps_to

BAND_ROWS = 60
ONE = np.float32(1.0)


def box_sum(values: Float32, window: tuple[int, int]) -> Float32:
    """Sum over the window (columns, rows; odd) centred on each pixel (H, W), as if the image went on with zeros."""
    sums = np.empty_like(values)
    fill_sums(values, window[0], window[1] // 2, sums)
    return sums


@njit(parallel=True, cache=True, **FAST)
def fill_sums(values, columns, half_height, sums):  # type: ignore[no-untyped-def]
    """Fill ``sums`` (H, W), a band of rows at a time."""
    height, width = values.shape
    half = columns // 2
    for band in prange((height + BAND_ROWS - 1) // BAND_ROWS):
        first = np.int64(band) * BAND_ROWS
        down = np.zeros(width + 2 * columns, dtype=np.float32)
        work = np.empty((2, width + 2 * columns), dtype=np.float32)
        inner = down[half : half + width]
        for y in range(max(first - half_height, 0), min(first + half_height, height)):
            add_scaled(values[y], ONE, inner)
        for y in range(first, min(first + BAND_ROWS, height)):
            if y + half_height < height:
                add_scaled(values[y + half_height], ONE, inner)
            sum_along(down, columns, work, sums[y])
            if y - half_height >= 0:
                add_scaled(values[y - half_height], -ONE, inner)


@njit(**LEAF_FAST)
def sum_along(values, size, work, sums):  # type: ignore[no-untyped-def]
    """Fill ``sums`` (n,) with those of ``size`` values from each on, by doubling as for phases."""
    if size == 1:
        copy(values, sums)
    bits, steps = steps_to(size)
    source = values
    have = 1
    for step in range(steps - 1, -1, -1):
        target = work[step % 2] if step > 0 else sums
        count = target.size
        if by_four(size, bits):
            ahead = source[3 * have : 3 * have + count]
            grow_four(source, source[have:], source[2 * have :], ahead, target)
            have, bits = 4 * have, bits - 2
        else:
            grow(source, source[have : have + count], target)
            have, bits = 2 * have, bits - 1
        if (size >> bits) & 1:
            add_scaled(values[have : have + count], ONE, target)
            have += 1
        source = target


@njit(**LEAF_FAST)
def copy(values, target):  # type: ignore[no-untyped-def]
    """Fill the target with the first values."""
    for x in range(target.size):
        target[x] = values[x]
