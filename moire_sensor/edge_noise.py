"""Noise of a camera, read from one image."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from moire_sensor.apart import EXACT
from moire_sensor.plain_image import Grey

# Every fourth column of some rows is enough: 19 000 differences of a 640x480 image tell a standard deviation to 0.6 %.
EVERY_COLUMN, MOST_ROWS = 4, 120
# That of rounding to whole grey levels.
LEAST_NOISE = 12.0**-0.5
CLIPPING_ROUNDS = 8
# Variance of a normal distribution over its variance within three standard deviations.
CLIPPED_SHARE = 1.0 / 0.9733
# Counted apart and added up, so that no two threads write to one count; the turns are those of :func:`count_row`.
LANES, TURNS = 8, 4


def camera_noise(image: Grey, scale: float = 1.0) -> float:
    """Standard deviation of the camera noise of an image (H, W), as of :func:`camera_noises`."""
    return camera_noises((image,), scale)[0]


def camera_noises(images: tuple[Grey, ...], scale: float = 1.0) -> list[float]:
    """Standard deviations of the camera noise of images (H, W) of one type: neighbouring rows differ by little else.

    Differences beyond three standard deviations, at surface borders, are left out again and again; a median of whole
    grey levels would be too coarse. ``scale`` turns grey levels of the images into those of 255.
    """
    levels = np.iinfo(images[0].dtype).max + 1
    turns = TURNS if levels == 256 else 1
    counts = np.zeros((len(images), LANES, turns, levels), dtype=np.int64)
    count_differences(images, counts)
    return [max(math.sqrt(0.5 * clipped_variance(own.reshape(-1, levels), scale)), LEAST_NOISE) for own in counts]


@njit(cache=True)
def clipped_variance(counts, scale):  # type: ignore[no-untyped-def]
    """Mean square of the differences counted in lanes, without those beyond three standard deviations."""
    size = counts.shape[1]
    number, squares = np.zeros(size, dtype=np.int64), np.empty(size, dtype=np.float64)
    for lane in range(counts.shape[0]):
        number += counts[lane]
    seen, sum_of_squares = 0, 0.0
    for level in range(size):
        here = number[level]
        seen += here
        sum_of_squares += here * (scale * level) ** 2
        number[level], squares[level] = seen, sum_of_squares
    variance = sum_of_squares / float(max(seen, 1))
    for _ in range(CLIPPING_ROUNDS):
        last = min(np.int64(3.0 * math.sqrt(variance) / scale), size - 1)
        variance = CLIPPED_SHARE * squares[last] / max(number[last], 1)
    return variance


@njit(parallel=True, cache=True)
def count_differences(images, counts):  # type: ignore[no-untyped-def]
    """Count the absolute differences of some pixels to the pixel below, lane by lane."""
    for index in prange(len(images) * LANES):
        lane, image = index % LANES, images[index // LANES]
        differences = np.empty(image.shape[1], dtype=np.uint16)
        every_row = max((image.shape[0] - 1) // MOST_ROWS, 1)
        for y in range(lane * every_row, image.shape[0] - 1, LANES * every_row):
            subtract(image[y], image[y + 1], differences)
            count_row(differences, counts[index // LANES, lane])


@njit(**EXACT)
def subtract(above, below, differences):  # type: ignore[no-untyped-def]
    """Absolute differences of two rows."""
    for x in range(differences.size):
        differences[x] = abs(np.int32(below[x]) - np.int32(above[x]))


@njit
def count_row(differences, counts):  # type: ignore[no-untyped-def]
    """Count the differences of two rows in turn in each of a lane's counts: next to each other most are the same, and
    the processor would have to wait for a count before it can add to it again."""
    for x in range(0, differences.size, EVERY_COLUMN):
        counts[np.uint64(x // EVERY_COLUMN) & np.uint64(counts.shape[0] - 1), np.uint64(differences[x])] += 1
