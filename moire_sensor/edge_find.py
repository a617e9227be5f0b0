"""Up and down fringe edges on every epipolar line, to a fraction of a pixel (section 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.edge_crossing import DOWN, HALF, UP
from moire_sensor.edge_lanes import LANES, whole_vectors
from moire_sensor.edge_noise import Grey, camera_noise
from moire_sensor.edge_scan import SMOOTHING, scan_rows
from moire_sensor.edge_settings import EdgeSettings

Float32 = npt.NDArray[np.float32]
# Noise of an edge over camera noise: the smoothed grey level at the edge, and the mean of the two extrema's.
EDGE_NOISE = float(np.sqrt(1.5 * np.sum(np.square(SMOOTHING))))
# The share is the same all over the image: some rows tell it well enough.
SHARE_ROWS = 4
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
    """

    x_px: Float32
    side: npt.NDArray[np.int8]
    height: Float32
    sigma_px: Float32
    number: npt.NDArray[np.int64]


def room_for_edges(shape: tuple[int, int]) -> EdgeRows:
    """Memory for the edges of an image (H, W): extrema are at least two pixels apart."""
    size = (shape[0], whole_vectors(shape[1] // 2 + 1))
    x_px, height, sigma_px = (np.empty(size, dtype=np.float32) for _ in range(3))
    return EdgeRows(x_px, np.empty(size, dtype=np.int8), height, sigma_px, np.zeros(shape[0], dtype=np.int64))


def find_edges(image: Grey, settings: EdgeSettings, scale: float = 1.0, room: EdgeRows | None = None) -> EdgeRows:
    """Find where the rows of an image (H, W) cross the middle between a peak and a trough.

    A peak and a trough next to each other differ by at least twice the smallest amplitude. The middle is that of the
    levels that peaks and troughs would have at the edge. They are continued from the neighbour whose level differs
    least, so that shading does not move an edge, and a depth jump spoils the half fringe that it cuts, not more.

    ``scale`` turns grey levels of the image into those of 255. The result lies in ``room`` if it is given.
    """
    edges = room_for_edges(image.shape) if room is None else room  # type: ignore[arg-type]
    noise = camera_noise(image, scale)
    amplitude = max(settings.min_amplitude, settings.min_amplitude_to_noise * noise)
    # Sixteen times the greatest grey level fits.
    sums = np.empty((LANES, image.shape[1]), dtype=np.int16 if image.dtype == np.uint8 else np.int32)
    scan_rows(image, sums, scale, 2.0 * amplitude, np.float32(EDGE_NOISE * noise), edges)
    return edges


def bright_share(images: Sequence[EdgeRows]) -> float:
    """Share of a fringe that is brighter than its middle, 0 to 1: where on the projected fringe the edges lie.

    Half for a linear projector; gamma makes the bright half narrower. The median over the fringes, up edge to down
    edge to the next up edge; 0.5 when there are none.
    """
    room = np.empty(sum(edges.x_px[::SHARE_ROWS].size for edges in images), dtype=np.float32)
    number = 0
    for edges in images:
        number += fill_shares(edges, SHARE_ROWS, room[number:])
    return float(median_share(room[:number])) if number else 0.5


@njit(cache=True)
def median_share(shares):  # type: ignore[no-untyped-def]
    """Median of numbers (N,) from 0 to 1: those of the bin that holds it are sorted, the others only counted."""
    counts = np.zeros(SHARE_BINS + 1, dtype=np.int64)
    for n in range(shares.size):
        counts[np.int64(shares[n] * SHARE_BINS)] += 1
    middles = (shares.size - 1) // 2, shares.size // 2
    below, first = np.int64(0), 0
    while below + counts[first] <= middles[0]:
        below += counts[first]
        first += 1
    last, reached = first, below + counts[first]
    while reached <= middles[1]:
        last += 1
        reached += counts[last]
    near = np.empty(reached - below, dtype=np.float32)
    number = 0
    for n in range(shares.size):
        if first <= np.int64(shares[n] * SHARE_BINS) <= last:
            near[number] = shares[n]
            number += 1
    near.sort()
    return HALF * (near[middles[0] - below] + near[middles[1] - below])


@njit(cache=True, error_model="numpy")
def fill_shares(edges, every_row, shares):  # type: ignore[no-untyped-def]
    """Bright share of each whole fringe of every ``every_row``-th row; their number."""
    number = np.int64(0)
    for y in range(0, edges.number.size, every_row):
        x, side = edges.x_px[y], edges.side[y]
        for i in range(2, edges.number[y]):
            up, down, again = x[i - 2], x[i - 1], x[i]
            shares[number] = (down - up) / (again - up)
            number += np.int64((side[i - 2] == UP) & (side[i - 1] == DOWN) & (side[i] == UP))
    return number
