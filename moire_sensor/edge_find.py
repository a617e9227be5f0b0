"""Up and down fringe edges on every epipolar line, to a fraction of a pixel (section 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.edge_crossing import HALF
from moire_sensor.edge_lanes import LANES, whole_vectors
from moire_sensor.edge_noise import camera_noises
from moire_sensor.edge_scan import SHARE_ROWS, SMOOTHING, scan_rows
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.plain_image import Grey

Float32 = npt.NDArray[np.float32]
# Noise of an edge over camera noise: the smoothed grey level at the edge, and the mean of the two extrema's.
EDGE_NOISE = float(np.sqrt(1.5 * np.sum(np.square(SMOOTHING))))
SHARE_BINS = 1024


class EdgeRows(NamedTuple):
    """Fringe edges of one image, row by row from left to right; what lies behind a row's number has no meaning.

    Attributes
    ----------
    x_px : (H, E) float32, column of the edge.
    side : (H, E) int8, 1 up (dark to bright along the row), -1 down.
    height : (H, E) float32, half the step between trough and peak, grey levels of 255.
    sigma_px : (H, E) float32, predicted standard deviation of ``x_px``.
    number : (H,) int64, edges in each row.
    shares : (S, E) float32, bright share of the whole fringes of some rows, see :func:`bright_share`.
    whole_fringes : (S,) int64, whole fringes in each of these.
    """

    x_px: Float32
    side: npt.NDArray[np.int8]
    height: Float32
    sigma_px: Float32
    number: npt.NDArray[np.int64]
    shares: Float32
    whole_fringes: npt.NDArray[np.int64]


def room_for_edges(shape: tuple[int, int]) -> EdgeRows:
    """Memory for the edges of an image (H, W): extrema are at least two pixels apart, and vectors whole."""
    height, most = shape[0], whole_vectors(shape[1] // 2 + 1)
    x_px, heights, sigma_px = (np.empty((height, most), dtype=np.float32) for _ in range(3))
    side, number = np.empty((height, most), dtype=np.int8), np.zeros(height, dtype=np.int64)
    share_rows = -(-height // SHARE_ROWS)
    shares, whole_fringes = np.empty((share_rows, most), dtype=np.float32), np.zeros(share_rows, dtype=np.int64)
    return EdgeRows(x_px, side, heights, sigma_px, number, shares, whole_fringes)


def find_edges(
    images: tuple[Grey, Grey],
    settings: EdgeSettings,
    scale: float = 1.0,
    rooms: tuple[EdgeRows, EdgeRows] | None = None,
) -> tuple[EdgeRows, EdgeRows]:
    """Find where the rows of two images (H, W) of one size and type cross the middle between a peak and a trough.

    A peak and a trough next to each other differ by at least twice the smallest amplitude. The middle is that of the
    levels that peaks and troughs would have at the edge. They are continued from the neighbour whose level differs
    least, so that shading does not move an edge, and a depth jump spoils the half fringe that it cuts, not more.

    ``scale`` turns grey levels of the images into those of 255. The result lies in ``rooms`` if they are given.
    """
    shape, wide = images[0].shape, np.int16 if images[0].dtype == np.uint8 else np.int32
    edges = rooms or (room_for_edges(shape), room_for_edges(shape))  # type: ignore[arg-type]
    noises = np.array(camera_noises(images, scale))
    amplitudes = np.maximum(settings.min_amplitude, settings.min_amplitude_to_noise * noises)
    # Sixteen times the greatest grey level fits.
    sums = np.empty((2, LANES, shape[1]), dtype=wide)
    scan_rows(*images, sums, scale, 2.0 * amplitudes, (EDGE_NOISE * noises).astype(np.float32), *edges)
    return edges


def bright_share(images: Sequence[EdgeRows]) -> float:
    """Share of a fringe that is brighter than its middle, 0 to 1: where on the projected fringe the edges lie.

    Half for a linear projector; gamma makes the bright half narrower. The median over the fringes, up edge to down
    edge to the next up edge; 0.5 when there are none.
    """
    return float(median_share(tuple((edges.shares, edges.whole_fringes) for edges in images)))


@njit(cache=True)
def median_share(images):  # type: ignore[no-untyped-def]
    """Median of the first numbers, 0 to 1, of the rows of images, pairs of (S, E) and how many they are (S,).

    Those of the bins that hold it are sorted, the others only counted. 0.5 of none.
    """
    counts = np.zeros(SHARE_BINS + 1, dtype=np.int64)
    for rows, number in images:
        for row in range(number.size):
            for n in range(number[row]):
                counts[bin_of(rows[row, n])] += 1
    size = np.sum(counts)
    if size == 0:
        return HALF
    first, below = bin_of_rank(counts, (size - 1) // 2)
    last, before_last = bin_of_rank(counts, size // 2)
    near = np.empty(before_last + counts[last] - below, dtype=np.float32)
    found = 0
    for rows, number in images:
        for row in range(number.size):
            for n in range(number[row]):
                if first <= bin_of(rows[row, n]) <= last:
                    near[found] = rows[row, n]
                    found += 1
    near.sort()
    return HALF * (near[(size - 1) // 2 - below] + near[size // 2 - below])


@njit(inline="always")
def bin_of(share):  # type: ignore[no-untyped-def]
    """Bin of a number from 0 to 1."""
    return np.uint64(share * np.float32(SHARE_BINS))


@njit
def bin_of_rank(counts, rank):  # type: ignore[no-untyped-def]
    """Bin that holds the number of a rank, and how many numbers lie below it."""
    below, at = np.int64(0), np.uint64(0)
    while below + counts[at] <= rank:
        below += counts[at]
        at += np.uint64(1)
    return at, below
