"""Pixels at which the two views look different, whatever window holds them: they show no one point.

A pixel is as different as the mean of the best of all windows that hold it: beside an edge, some lie on one surface.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE, ROW
from moire_sensor.phase_carrier import Float32
from moire_sensor.settings import Settings

# Columns on either side of the middle of a window.
HALF_COLUMNS = 2
COLUMNS = np.float32(2 * HALF_COLUMNS + 1)
# Half a window of rows above and below a band is summed twice.
BAND_ROWS = 60


def drop_foreign(disparity_px: Float32, apart: Float32, amplitude: Float32, half_rows: int, settings: Settings) -> None:
    """Set in place to NaN the disparities whose views differ by more than noise and the allowed misfit.

    Parameters
    ----------
    disparity_px : (H, W) float32.
    apart : difference of left and moved right image (H, W), grey levels, 0 where there is none.
    amplitude : fringe amplitude of the left image (H, W).
    half_rows : 0 for windows of 5 columns and one row, 1 for three rows.
    """
    limits = np.array([2.0 * settings.image_noise, settings.max_misfit], dtype=np.float32)
    clear_foreign(disparity_px, apart, amplitude, half_rows, limits)


@njit(parallel=True, cache=True, fastmath=NAN_SAFE, error_model="numpy")
def clear_foreign(disparity, apart, amplitude, half_rows, limits):  # type: ignore[no-untyped-def]
    """Kernel of :func:`drop_foreign`; ``limits`` are that of noise and the share of the amplitude."""
    height, width = disparity.shape
    for band in prange((height + BAND_ROWS - 1) // BAND_ROWS):
        first = np.int64(band) * BAND_ROWS
        least = np.empty((2 * half_rows + 1, width), dtype=np.float32)
        room = np.empty((2, width + 2 * HALF_COLUMNS), dtype=np.float32)
        for y in range(first - half_rows, min(first + BAND_ROWS, height) + half_rows):
            if 0 <= y < height:
                # Mirrored at the image's borders.
                above = min(abs(y - half_rows), height - 1)
                below = max(height - 1 - abs(height - 1 - y - half_rows), 0)
                least_along(apart[above], apart[y], apart[below], room[0], room[1], least[y % least.shape[0]])
            else:
                least[y % least.shape[0], :] = np.inf
            at = y - half_rows
            if at >= first:
                # The slots of the rows above, at and below.
                slots = (at - half_rows) % least.shape[0], at % least.shape[0], y % least.shape[0]
                clear_row(least[slots[0]], least[slots[1]], least[slots[2]], amplitude[at], limits, disparity[at])


@njit(**ROW)
def least_along(above, middle, below, column, means, least):  # type: ignore[no-untyped-def]
    """Fill ``least`` (W,) with the lowest mean of the windows on three rows that hold a column.

    Beyond its ends a row is mirrored, and no window has its middle there.
    """
    half, width = HALF_COLUMNS, least.size
    for x in range(width):
        column[x + half] = above[x] + middle[x] + below[x]
    for beyond in range(1, half + 1):
        column[half - beyond] = column[half + min(beyond, width - 1)]
        column[half + width - 1 + beyond] = column[half + max(width - 1 - beyond, 0)]
        means[half - beyond] = means[half + width - 1 + beyond] = np.float32(np.inf)
    add_five(column, column[1:], column[2:], column[3:], column[4:], means[half:])
    least_of_five(means, means[1:], means[2:], means[3:], means[4:], least)


@njit(**ROW)
def add_five(a, b, c, d, e, means):  # type: ignore[no-untyped-def]
    """Fill the means (n,) of columns of three pixels."""
    scale = np.float32(1.0) / (np.float32(3.0) * COLUMNS)
    for x in range(e.size):
        means[x] = (a[x] + b[x] + c[x] + d[x] + e[x]) * scale


@njit(**ROW)
def least_of_five(a, b, c, d, e, least):  # type: ignore[no-untyped-def]
    """Fill the least (n,) of five."""
    for x in range(least.size):
        left, right = min(a[x], b[x]), min(d[x], e[x])
        least[x] = min(min(left, right), c[x])


@njit(**ROW)
def clear_row(above, middle, below, amplitude, limits, disparity):  # type: ignore[no-untyped-def]
    """One row of :func:`clear_foreign`, from the lowest means of three rows."""
    noise, share = limits[0], limits[1]
    for x in range(disparity.size):
        apart = min(min(above[x], below[x]), middle[x])
        disparity[x] = np.float32(np.nan) if apart > noise + share * amplitude[x] else disparity[x]
