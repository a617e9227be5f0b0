"""What the left pixels see besides edges: background, and whether there are fringes at all."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.box_sums import sum_along


@njit
def fill_light(image, size, scale, work, background, contrast):  # type: ignore[no-untyped-def]
    """Fill the mean of ``size`` pixels (odd) of a row around each, times ``scale``, and their brightest less darkest.

    Beyond its ends the row is mirrored. ``work`` is memory, (5, W + size - 1) float32.
    """
    half, width = size // 2, image.size
    padded = work[4]
    padded[half : half + width] = image
    for x in range(half):
        padded[half - 1 - x] = padded[half + 1 + x]
        padded[half + width + x] = padded[half + width - 2 - x]
    sum_along(padded, size, work, background)
    multiply(background, np.float32(1.0) / np.float32(size), scale)
    find_contrast(padded, size, work, contrast)


@njit
def find_contrast(values, size, work, contrast):  # type: ignore[no-untyped-def]
    """Greatest less least of the ``size`` values from each on: those of 2 k values from those of k."""
    high = low = values
    have, turn = 1, 0
    while have < size:
        step = min(have, size - have)
        higher, lower = work[turn], work[turn + 2]
        grow_extremes(high, high[step:], low, low[step:], higher, lower)
        high, low = higher, lower
        have += step
        turn = 1 - turn
    subtract(high, low, contrast)


@njit
def grow_extremes(high, high_ahead, low, low_ahead, higher, lower):  # type: ignore[no-untyped-def]
    """The greater of each two greatest values, and the less of each two least."""
    for x in range(high_ahead.size):
        higher[x] = high[x] if high[x] > high_ahead[x] else high_ahead[x]
    for x in range(low_ahead.size):
        lower[x] = low[x] if low[x] < low_ahead[x] else low_ahead[x]


@njit
def multiply(values, share, scale):  # type: ignore[no-untyped-def]
    """Multiply in place."""
    for x in range(values.size):
        values[x] = values[x] * share * scale


@njit
def subtract(values, others, result):  # type: ignore[no-untyped-def]
    """Differences, as many as ``result`` holds."""
    for x in range(result.size):
        result[x] = values[x] - others[x]
