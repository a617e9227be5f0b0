"""Rejection of disparities that cannot be trusted: mismatch, double use of a right pixel, specks."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Float32

SAME_SURFACE_PX = 1.0
SPECKLE_STEPS_PER_PX = 8


def believed(match: Match, max_mismatch_rad: float, min_segment_px: int) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) whose disparity passes all checks."""
    disparity = match.disparity_px.copy()
    disparity[~(match.mismatch_rad <= mismatch_gate_rad(match.mismatch_rad, max_mismatch_rad))] = np.nan
    unique = np.empty(disparity.shape, dtype=np.bool_)
    keep_unique(disparity, match.mismatch_rad, unique)
    disparity[~unique] = np.nan
    return np.isfinite(without_specks(disparity, min_segment_px))


def mismatch_gate_rad(mismatch_rad: Float32, largest_rad: float) -> float:
    """Six robust standard deviations of this image's own mismatch, at most ``largest_rad``, at least a fifth of it."""
    known = mismatch_rad[np.isfinite(mismatch_rad)]
    typical = float(np.median(known[::7])) if known.size else 0.0
    return float(np.clip(6.0 * 1.4826 * typical, 0.2 * largest_rad, largest_rad))


@njit(parallel=True, cache=True)
def keep_unique(disparity, mismatch, unique):  # type: ignore[no-untyped-def]
    """Of the left pixels that claim one right pixel from different surfaces only the best match stays."""
    height, width = disparity.shape
    for y in prange(height):
        winner = np.full(width, -1, dtype=np.int64)
        for x in range(width):
            unique[y, x] = False
            if np.isnan(disparity[y, x]):
                continue
            column = int(np.floor(x - disparity[y, x] + 0.5))
            if 0 <= column < width:
                rival = winner[column]
                if rival < 0 or mismatch[y, x] < mismatch[y, rival]:
                    winner[column] = x
        for x in range(width):
            if np.isnan(disparity[y, x]):
                continue
            column = int(np.floor(x - disparity[y, x] + 0.5))
            if 0 <= column < width:
                rival = winner[column]
                unique[y, x] = abs(disparity[y, rival] - disparity[y, x]) <= SAME_SURFACE_PX


def without_specks(disparity_px: Float32, min_segment_px: int) -> Float32:
    """Drop connected surfaces of fewer than ``min_segment_px`` pixels."""
    lowest = np.nanmin(disparity_px) if np.isfinite(disparity_px).any() else 0.0
    steps = np.where(np.isfinite(disparity_px), (disparity_px - lowest) * SPECKLE_STEPS_PER_PX, -1000.0)
    coarse = np.clip(steps, -1000, 32000).astype(np.int16)
    cv2.filterSpeckles(coarse, -1000, min_segment_px, SPECKLE_STEPS_PER_PX)
    return np.where(coarse == -1000, np.float32(np.nan), disparity_px)
