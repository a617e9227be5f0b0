"""What the left pixels see besides edges: background, and whether there are fringes at all.

In whole numbers, as the camera gives them: twice or four times as many pixels go through the processor at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.apart import ROW
from moire_sensor.edge_lanes import LANES
from moire_sensor.plain_image import Grey

# Up to so many pixels of 8 bit their sum fits 16 bit.
MOST_SHORT = 257
Sums = npt.NDArray[np.uint16] | npt.NDArray[np.uint32]


def window_px(period_px: float) -> int:
    """Odd number of columns next to a fringe period."""
    return 2 * round(0.5 * period_px) + 1


def room_for_light(dtype: npt.DTypeLike, width: int, size: int) -> tuple[Grey, Sums]:
    """Memory of :func:`fill_light` for windows of ``size`` columns: six rows a lane of grey levels, two of sums."""
    levels: npt.NDArray[Any] = np.empty((LANES, 6, width + size), dtype=dtype)
    wide = np.uint16 if levels.dtype == np.uint8 and size <= MOST_SHORT else np.uint32
    sums: npt.NDArray[Any] = np.empty((LANES, 2, width + size), dtype=wide)
    return levels, sums


@njit
def fill_light(image, size, scale, levels, sums, background):  # type: ignore[no-untyped-def]
    """Fill the mean of ``size`` pixels (odd) of a row around each, times ``scale``; return their greatest less least.

    Beyond its ends the row is mirrored. ``levels`` (6, N) and ``sums`` (2, N) are memory; the result lies in it.
    """
    padded = levels[5, : image.size + size - 1]
    mirror(image, size // 2, padded)
    have, at = sum_windows(padded, size, sums)
    scale_sums(sums[at], np.float32(1.0) / np.float32(have), scale, background)
    return find_contrast(padded, size, levels)


@njit(**ROW)
def mirror(image, half, padded):  # type: ignore[no-untyped-def]
    """A row, and ``half`` more pixels at either end."""
    for x in range(np.uint64(image.size)):
        padded[np.uint64(half) + x] = image[x]
    for x in range(half):
        padded[half - 1 - x] = image[1 + x]
        padded[half + image.size + x] = image[image.size - 2 - x]


@njit
def sum_windows(values, size, sums):  # type: ignore[no-untyped-def]
    """Sums of ``size`` values (3 or more) from each on, and in which row: S_2k[x] = S_k[x] + S_k[x + k], one more if
    odd."""
    bits = 0
    while size >> (bits + 2):
        bits += 1
    grow(values, values[1:], sums[0])
    have, at = 2, 0
    for bit in range(bits, -1, -1):
        if bit < bits:
            grow(sums[at], sums[at, have : values.size - have + 1], sums[1 - at])
            have, at = 2 * have, 1 - at
        if (size >> bit) & 1:
            add(values[have:], sums[at])
            have += 1
    return have, at


@njit(**ROW)
def grow(values, ahead, sums):  # type: ignore[no-untyped-def]
    """Sums of two rows."""
    for x in range(ahead.size):
        sums[x] = np.uint32(values[x]) + np.uint32(ahead[x])


@njit(**ROW)
def add(values, sums):  # type: ignore[no-untyped-def]
    """Add a row to sums."""
    for x in range(values.size):
        sums[x] = np.uint32(sums[x]) + np.uint32(values[x])


@njit
def scale_sums(sums, share, scale, background):  # type: ignore[no-untyped-def]
    """Grey levels from sums."""
    for x in range(background.size):
        background[x] = np.float32(sums[x]) * share * scale


@njit
def find_contrast(values, size, levels):  # type: ignore[no-untyped-def]
    """Greatest less least of the ``size`` values from each on: those of 2 k values from those of k."""
    high = low = values
    have, turn = 1, 0
    while have < size:
        step = min(have, size - have)
        higher, lower = levels[turn], levels[turn + 2]
        last = values.size - have + 1
        grow_extremes(high, high[step:last], low, low[step:last], higher, lower)
        high, low = higher, lower
        have += step
        turn = 1 - turn
    contrast = levels[4]
    for x in range(values.size - size + 1):
        contrast[x] = high[x] - low[x]
    return contrast


@njit(**ROW)
def grow_extremes(high, high_ahead, low, low_ahead, higher, lower):  # type: ignore[no-untyped-def]
    """The greater of each two greatest values, and the less of each two least, as far as there are two."""
    for x in range(high_ahead.size):
        higher[x] = high[x] if high[x] > high_ahead[x] else high_ahead[x]
    for x in range(low_ahead.size):
        lower[x] = low[x] if low[x] < low_ahead[x] else low_ahead[x]
