"""Sums over windows of an image: down the columns one row at a time, along the row by doubling."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import FAST
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_sums import add_scaled, sum_along

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
