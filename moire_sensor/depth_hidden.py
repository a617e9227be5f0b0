"""Depth behind something nearer: what the right camera cannot see, the pair cannot have measured."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE
from moire_sensor.phase_carrier import Float32

# A pixel is hidden where the right image shows something nearer by so much in its column and so many on either side.
NEARER_PX, BESIDE_PX = np.float32(2.0), 5
NOTHING = np.float32(-1e9)


def drop_hidden(disparity_px: Float32) -> None:
    """Set in place to NaN the disparities (H, W) of pixels that lie deep behind a nearer surface on the right.

    Near the rim of what hides them pixels are left alone: there a pixel more or less decides who is seen.
    """
    drop_of_rows(disparity_px)


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def drop_of_rows(disparity):  # type: ignore[no-untyped-def]
    """Kernel of :func:`drop_hidden`."""
    height, width = disparity.shape
    for y in prange(height):
        line = disparity[y]
        nearest = np.full(width, NOTHING, dtype=np.float32)
        claim(line, nearest)
        # Of the columns from here to as far as twice beside, and so about the one in the middle.
        surely = np.full(width, NOTHING, dtype=np.float32)
        for x in range(width - 2 * BESIDE_PX):
            surely[x + BESIDE_PX] = nearest[x : x + 2 * BESIDE_PX + 1].min()
        for x in range(width):
            column = np.float32(x) - line[x] + np.float32(0.5)
            if not np.float32(0.0) <= column < np.float32(width):
                continue
            if surely[np.int64(column)] > line[x] + NEARER_PX:
                line[x] = np.float32(np.nan)


@njit(fastmath=NAN_SAFE, error_model="numpy")
def claim(line, nearest):  # type: ignore[no-untyped-def]
    """Fill the greatest disparity that each right column shows: a pixel is seen by the two it falls between."""
    for x in range(line.size):
        column = np.floor(np.float32(x) - line[x])
        if np.float32(-1.0) <= column < np.float32(line.size):
            first = np.int64(column)
            if first >= 0:
                nearest[first] = max(nearest[first], line[x])
            if first + 1 < line.size:
                nearest[first + 1] = max(nearest[first + 1], line[x])
