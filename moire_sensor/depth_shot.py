"""From disparities to what a shot says of every pixel: depth, its sigma, confidence and status."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE
from moire_sensor.phase_carrier import Float32
from moire_sensor.rig import StereoRig
from moire_sensor.shot import Status

# Depths so much nearer or farther than the range are kept.
RANGE_MARGIN = 0.02


def scale_of(rig: StereoRig) -> Float32:
    """Focal length times baseline, pixel metres, and the disparity at infinity, pixels."""
    return np.array([rig.fx_px * rig.baseline_m, rig.disparity_at_infinity_px], dtype=np.float32)


def drop_out_of_range(disparity_px: Float32, rig: StereoRig, depth_range_m: tuple[float, float]) -> None:
    """Set in place to NaN the disparities (H, W) of depths outside the range."""
    nearest, farthest = depth_range_m
    limits = np.array([nearest * (1.0 - RANGE_MARGIN), farthest * (1.0 + RANGE_MARGIN)], dtype=np.float32)
    clear_beyond(disparity_px, scale_of(rig), limits)


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def clear_beyond(disparity, scale, limits):  # type: ignore[no-untyped-def]
    """Kernel of :func:`drop_out_of_range`."""
    height, width = disparity.shape
    at_one, far, nearest, farthest = scale[0], scale[1], limits[0], limits[1]
    for y in prange(height):
        for x in range(width):
            depth = at_one / (disparity[y, x] - far)
            disparity[y, x] = disparity[y, x] if nearest <= depth <= farthest else np.float32(np.nan)


def results(
    images: tuple[Float32, Float32, Float32],
    seen: npt.NDArray[np.uint8],
    rig: StereoRig,
    least_confidence: float,
    lost: Status,
) -> tuple[Float32, Float32, Float32, npt.NDArray[np.uint8]]:
    """Depth, its sigma, disparity and status of every pixel, (H, W); doubtful ones lose their confidence in place.

    Parameters
    ----------
    images : disparities, NaN where unknown, their sigma, and their confidence.
    seen : status of the left phase.
    least_confidence : pixels of less are unknown, for being ambiguous.
    lost : status of pixels with a phase but without a disparity.
    """
    shape = seen.shape
    depth, sigma, disparity = (np.empty(shape, dtype=np.float32) for _ in range(3))
    status = np.empty(shape, dtype=np.uint8)
    codes = np.array([Status.OK, Status.AMBIGUOUS, lost], dtype=np.uint8)
    fill_results(*images, seen, scale_of(rig), np.float32(least_confidence), codes, depth, sigma, disparity, status)
    return depth, sigma, disparity, status


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def fill_results(  # type: ignore[no-untyped-def]
    known, known_sigma, confidence, seen, scale, least, codes, depth, sigma, disparity, status
):
    """Kernel of :func:`results`; ``codes`` are those of good, doubtful and lost pixels."""
    height, width = known.shape
    at_one, far, nan = scale[0], scale[1], np.float32(np.nan)
    good, doubtful, lost = codes[0], codes[1], codes[2]
    for y in prange(height):
        for x in range(width):
            value = known[y, x]
            sure = confidence[y, x] >= least
            keep = sure & (value == value)
            distance = at_one / (value - far)
            depth[y, x] = distance if keep else nan
            sigma[y, x] = distance * distance / at_one * known_sigma[y, x] if keep else nan
            disparity[y, x] = value if keep else nan
        for x in range(width):
            code = lost if seen[y, x] == good else seen[y, x]
            code = doubtful if known[y, x] == known[y, x] else code
            status[y, x] = good if disparity[y, x] == disparity[y, x] else code
            confidence[y, x] = confidence[y, x] if disparity[y, x] == disparity[y, x] else np.float32(0.0)
