"""Rejection of disparities that use a right pixel twice."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import ROW
from moire_sensor.depth_specks import SAME_SURFACE_PX
from moire_sensor.phase_carrier import Float32
from moire_sensor.right_view import REACH_PX, difference

MISMATCH_WEIGHT = np.float32(0.5)


def drop_rivals(
    disparity_px: Float32,
    mismatch_rad: Float32,
    amplitude: Float32,
    images: tuple[Float32, Float32],
    rows: npt.NDArray[np.int64],
) -> None:
    """Set in place to NaN the disparities whose right pixel a better match of another surface claims.

    Disparities, mismatches and amplitudes (n, W) are those of some ``rows`` (n,) of the images (H, W).
    """
    keep_unique(disparity_px, mismatch_rad, amplitude, *images, rows)


@njit(parallel=True, cache=True)
def keep_unique(disparity, mismatch, amplitude, left, right, rows):  # type: ignore[no-untyped-def]
    """Of the left pixels that claim one right pixel from different surfaces only the one that looks like it stays."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        column = np.empty(width, dtype=np.int32)
        # The last place is for what the right image does not show, and holds NaN.
        claim, winner = np.full(width + 1, np.nan, dtype=np.float32), np.empty(width + 1, dtype=np.int32)
        fill_columns(disparity[y], column)
        for x in range(width):
            at = column[x]
            if at == width:
                continue
            here, held = disparity[y, x], claim[at]
            if held != held or (abs(held - here) > SAME_SURFACE_PX and beats(
                disparity[y], mismatch[y], amplitude[y], left, right, rows[y], x, winner[at]
            )):  # fmt: skip
                claim[at], winner[at] = here, x
        keep_claims(column, claim, disparity[y])


@njit(**ROW)
def fill_columns(disparity, column):  # type: ignore[no-untyped-def]
    """Fill the right columns that the pixels of a row claim, W where there is none."""
    width = np.float32(column.size)
    for x in range(column.size):
        at = np.floor(np.float32(np.int32(x)) - disparity[x] + np.float32(0.5))
        column[x] = np.int32(at if (at >= np.float32(0.0)) & (at < width) else width)


@njit(**ROW)
def keep_claims(column, claim, disparity):  # type: ignore[no-untyped-def]
    """Set to NaN the disparities of pixels that do not lie on the surface that their right column shows."""
    for x in range(column.size):
        kept = abs(claim[np.uint32(column[x])] - disparity[x]) <= SAME_SURFACE_PX
        disparity[x] = disparity[x] if kept else np.float32(np.nan)


@njit(inline="always", fastmath=False)
def beats(disparity, mismatch, amplitude, left, right, y, x, rival):  # type: ignore[no-untyped-def]
    """Whether left pixel x fits the right pixel better than its rival of another surface."""
    here = differs(disparity, mismatch, amplitude, left, right, y, x)
    return here < differs(disparity, mismatch, amplitude, left, right, y, rival)


@njit(inline="always", fastmath=False)
def differs(disparity, mismatch, amplitude, left, right, y, x):  # type: ignore[no-untyped-def]
    """How badly a match fits: grey levels over three rows, in fringe amplitudes, and the mismatch of the phases."""
    total = np.float32(0.0)
    first, last = max(y - 1, 0), min(y + 1, left.shape[0] - 1)
    for yy in range(first, last + 1):
        total += difference(left, right, yy, x, x - disparity[x], REACH_PX)
    grey = total / np.float32(last - first + 1) / max(amplitude[x], np.float32(1.0))
    return grey + MISMATCH_WEIGHT * mismatch[x]
