"""Noise of a camera, read from one image."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit, prange

Grey = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
# Every fourth column is enough: 77 000 differences of a 640x480 image tell a standard deviation to 0.3 %.
EVERY_COLUMN = 4
QUANTISATION_NOISE = 12.0**-0.5
CLIPPING_ROUNDS = 8
# Variance of a normal distribution over its variance within three standard deviations.
CLIPPED_SHARE = 1.0 / 0.9733
# Counted apart and added up, so that no two threads write to one count.
LANES = 8


def camera_noise(image: Grey, scale: float = 1.0) -> float:
    """Standard deviation of the camera noise of an image (H, W): neighbouring rows differ by little else.

    Differences beyond three standard deviations, at surface borders, are left out again and again; a median of whole
    grey levels would be too coarse. ``scale`` turns grey levels of the image into those of 255.
    """
    counts = np.zeros((LANES, np.iinfo(image.dtype).max + 1), dtype=np.int64)
    count_differences(image, counts)
    number = counts.sum(axis=0)
    squares = np.square(scale * np.arange(number.size))
    inside = np.cumsum(number), np.cumsum(number * squares)
    last = number.size - 1
    variance = float(inside[1][last]) / max(int(inside[0][last]), 1)
    for _ in range(CLIPPING_ROUNDS):
        last = min(int(3.0 * math.sqrt(variance) / scale), number.size - 1)
        variance = CLIPPED_SHARE * float(inside[1][last]) / max(int(inside[0][last]), 1)
    return max(math.sqrt(0.5 * variance), QUANTISATION_NOISE)


@njit(parallel=True, cache=True)
def count_differences(image, counts):  # type: ignore[no-untyped-def]
    """Count the absolute differences of each pixel of every fourth column to the pixel below, lane by lane."""
    for lane in prange(counts.shape[0]):
        for y in range(lane, image.shape[0] - 1, counts.shape[0]):
            for x in range(0, image.shape[1], EVERY_COLUMN):
                counts[lane, abs(np.int64(image[y + 1, x]) - np.int64(image[y, x]))] += 1
