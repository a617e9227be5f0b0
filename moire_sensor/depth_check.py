"""Rejection of disparities that cannot be trusted: mismatch, double use of a right pixel, specks."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.depth_refine import Match
from moire_sensor.order_cost import REACH_PX, difference
from moire_sensor.phase_carrier import Float32

SAME_SURFACE_PX = 1.0
MISMATCH_WEIGHT = np.float32(0.5)
SPECKLE_STEPS_PER_PX = 8


def drop_misfits(match: Match, max_mismatch_rad: float) -> None:
    """Set in place to NaN the disparities whose phases disagree too much."""
    match.disparity_px[~(match.mismatch_rad <= max_mismatch_rad)] = np.nan


def is_unique(
    disparity_px: Float32, mismatch_rad: Float32, amplitude: Float32, images: tuple[Float32, Float32]
) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) with a disparity whose right pixel no better match of another surface claims."""
    unique = np.empty(disparity_px.shape, dtype=np.bool_)
    keep_unique(disparity_px, mismatch_rad, amplitude, *images, unique)
    return unique


@njit(parallel=True, cache=True)
def keep_unique(disparity, mismatch, amplitude, left, right, unique):  # type: ignore[no-untyped-def]
    """Of the left pixels that claim one right pixel from different surfaces only the one that looks like it stays."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        winner = np.full(width, -1, dtype=np.int64)
        for x in range(width):
            unique[y, x] = False
            if np.isnan(disparity[y, x]):
                continue
            column = int(np.floor(x - disparity[y, x] + 0.5))
            if 0 <= column < width:
                rival = winner[column]
                if rival < 0:
                    winner[column] = x
                    continue
                here = differs(disparity, mismatch, amplitude, left, right, y, x)
                if here < differs(disparity, mismatch, amplitude, left, right, y, rival):
                    winner[column] = x
        for x in range(width):
            if np.isnan(disparity[y, x]):
                continue
            column = int(np.floor(x - disparity[y, x] + 0.5))
            if 0 <= column < width:
                unique[y, x] = abs(disparity[y, winner[column]] - disparity[y, x]) <= SAME_SURFACE_PX


@njit(inline="always", fastmath=False)
def differs(disparity, mismatch, amplitude, left, right, y, x):  # type: ignore[no-untyped-def]
    """How badly a match fits: grey levels over three rows, in fringe amplitudes, and the mismatch of the phases."""
    total = np.float32(0.0)
    first, last = max(y - 1, 0), min(y + 1, disparity.shape[0] - 1)
    for yy in range(first, last + 1):
        total += difference(left, right, yy, x, x - disparity[y, x], REACH_PX)
    grey = total / np.float32(last - first + 1) / max(amplitude[y, x], np.float32(1.0))
    return grey + MISMATCH_WEIGHT * mismatch[y, x]


def without_specks(disparity_px: Float32, min_segment_px: int) -> Float32:
    """Drop connected surfaces of fewer than ``min_segment_px`` pixels."""
    lowest = np.nanmin(disparity_px) if np.isfinite(disparity_px).any() else 0.0
    steps = np.where(np.isfinite(disparity_px), (disparity_px - lowest) * SPECKLE_STEPS_PER_PX, -1000.0)
    coarse = np.clip(steps, -1000, 32000).astype(np.int16)
    cv2.filterSpeckles(coarse, -1000, min_segment_px, SPECKLE_STEPS_PER_PX)
    return np.where(coarse == -1000, np.float32(np.nan), disparity_px)
