"""Up and down fringe edges on every epipolar line, to a fraction of a pixel (section 3.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.edge_settings import EdgeSettings

Float32 = npt.NDArray[np.float32]
UP, DOWN = 1, -1
# Noise of an edge over camera noise: the smoothed grey level at the edge, and the mean of the two extrema's.
SMOOTHING = (1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0)
EDGE_NOISE = float(np.sqrt(1.5 * np.sum(np.square(SMOOTHING))))
# Smoothing and the parabola of an extremum each reach two pixels to either side.
BORDER_PX = 4
QUANTISATION_NOISE = 12.0**-0.5
CLIPPING_ROUNDS = 8
# Variance of a normal distribution over its variance within three standard deviations.
CLIPPED_SHARE = 1.0 / 0.9733


@dataclass(frozen=True, eq=False)
class EdgeRows:
    """Fringe edges of one image, row by row from left to right; the tail of a row is padding.

    Attributes
    ----------
    x_px : (H, E) float32, column of the edge; NaN in the padding.
    side : (H, E) int8, 1 up (dark to bright along the row), -1 down, 0 in the padding.
    height : (H, E) float32, half the step between trough and peak, grey levels of 255.
    sigma_px : (H, E) float32, predicted standard deviation of ``x_px``.
    count : (H,) int64, edges in each row.
    """

    x_px: Float32
    side: npt.NDArray[np.int8]
    height: Float32
    sigma_px: Float32
    count: npt.NDArray[np.int64]

    def packed(self) -> Float32:
        """Column, side and height of each edge, (H, E, 3), for the compiled kernels."""
        return np.stack([self.x_px, self.side.astype(np.float32), self.height], axis=-1)


def find_edges(image: Float32, settings: EdgeSettings) -> EdgeRows:
    """Find where the rows of an image (H, W), grey levels of 255, cross the middle between a peak and a trough.

    A peak and a trough next to each other differ by at least twice the smallest amplitude. The middle is that of the
    levels that peaks and troughs would have at the edge. They are continued from the neighbour whose level differs
    least, so that shading does not move an edge, and a depth jump spoils the half fringe that it cuts, not more.
    """
    noise = camera_noise(image)
    amplitude = max(settings.min_amplitude, settings.min_amplitude_to_noise * noise)
    height, width = image.shape
    smooth = smoothed_rows(image)
    extremum_x = np.zeros((height, width // 2 + 2), dtype=np.int64)
    extremum_count = np.zeros(height, dtype=np.int64)
    mark_extrema(smooth, np.float32(2.0 * amplitude), extremum_x, extremum_count)
    most = max(1, int(extremum_count.max()))
    x_px = np.full((height, most), np.nan, dtype=np.float32)
    slope, step = np.ones((2, *x_px.shape), dtype=np.float32)
    side = np.zeros(x_px.shape, dtype=np.int8)
    count = np.zeros(height, dtype=np.int64)
    mark_edges(smooth, extremum_x, extremum_count, x_px, slope, step, side, count)
    return EdgeRows(x_px, side, step, (EDGE_NOISE * noise / slope).astype(np.float32), count)


def bright_share(images: Sequence[EdgeRows]) -> float:
    """Share of a fringe that is brighter than its middle, 0 to 1: where on the projected fringe the edges lie.

    Half for a linear projector; gamma makes the bright half narrower. The median over all fringes, up edge to down
    edge to the next up edge; 0.5 when there are none.
    """
    shares = []
    for edges in images:
        width = np.diff(edges.x_px, axis=1)
        bright = (edges.side[:, :-2] == UP) & (edges.side[:, 1:-1] == DOWN) & (edges.side[:, 2:] == UP)
        shares.append((width[:, :-1][bright]) / (width[:, :-1] + width[:, 1:])[bright])
    together = np.concatenate(shares)
    return float(np.median(together)) if together.size else 0.5


def camera_noise(image: Float32) -> float:
    """Standard deviation of the camera noise of an image (H, W): neighbouring rows differ by little else.

    Differences beyond three standard deviations, at surface borders, are left out again and again; a median of whole
    grey levels would be too coarse.
    """
    squares = np.square(np.diff(image[:, ::4], axis=0).ravel())
    variance = float(squares.mean()) if squares.size else 0.0
    for _ in range(CLIPPING_ROUNDS):
        variance = CLIPPED_SHARE * float(squares[squares <= 9.0 * variance].mean()) if variance > 0.0 else 0.0
    return max(math.sqrt(0.5 * variance), QUANTISATION_NOISE)


def smoothed_rows(image: Float32) -> Float32:
    """Rows of an image (H, W) under a binomial of five; the border pixels are repeated."""
    padded = np.pad(image, ((0, 0), (2, 2)), mode="edge")
    width = image.shape[1]
    taps = [np.float32(weight) * padded[:, tap : tap + width] for tap, weight in enumerate(SMOOTHING)]
    return np.asarray(sum(taps[1:], taps[0]), dtype=np.float32)


@njit(parallel=True, cache=True)
def mark_extrema(smooth, contrast, extremum_x, count):  # type: ignore[no-untyped-def]
    """Peaks and troughs of each row in turn, each ``contrast`` off what is before and behind it."""
    height, width = smooth.shape
    for y in prange(height):
        row = smooth[y]
        number = 0
        top = bottom = 0
        seeking = 0
        for x in range(1, width):
            if row[x] > row[top]:
                top = x
            if row[x] < row[bottom]:
                bottom = x
            found, first = -1, seeking == 0
            if seeking >= 0 and row[x] <= row[top] - contrast:
                found, seeking, bottom = top, -1, x
            elif seeking <= 0 and row[x] >= row[bottom] + contrast:
                found, seeking, top = bottom, 1, x
            if not first and BORDER_PX <= found < width - BORDER_PX:
                extremum_x[y, number] = found
                number += 1
        count[y] = number


@njit(cache=True)
def extremum_level(row, x):  # type: ignore[no-untyped-def]
    """Grey level at the top of the parabola through an extremum and the samples two pixels off."""
    tilt = row[x + 2] - row[x - 2]
    bend = row[x + 2] - np.float32(2.0) * row[x] + row[x - 2]
    if abs(bend) <= abs(tilt):
        return row[x]
    return row[x] - tilt * tilt / (np.float32(8.0) * bend)


@njit(cache=True)
def level_at(row, extrema, number, at_x):  # type: ignore[no-untyped-def]
    """Level that extremum ``number`` has at column ``at_x``, along the flatter of the lines to its two likes."""
    x = extrema[number]
    level = extremum_level(row, x)
    change = np.float32(np.inf)
    for like in (number - 2, number + 2):
        if 0 <= like < extrema.size:
            towards = (extremum_level(row, extrema[like]) - level) / np.float32(extrema[like] - x)
            change = towards if abs(towards) < abs(change) else change
    return level + change * np.float32(at_x - x) if np.isfinite(change) else level


@njit(parallel=True, cache=True)
def mark_edges(smooth, extremum_x, extremum_count, x_px, slope, height, side, count):  # type: ignore[no-untyped-def]
    """One edge between each two extrema of a row, where the smooth row crosses the middle level."""
    for y in prange(smooth.shape[0]):
        row = smooth[y]
        extrema = extremum_x[y, : extremum_count[y]]
        number = 0
        for after in range(1, extrema.size):
            start, end = extrema[after - 1], extrema[after]
            middle = 0.5 * (start + end)
            first, second = level_at(row, extrema, after - 1, middle), level_at(row, extrema, after, middle)
            level = np.float32(0.5) * (first + second)
            sign = UP if row[end] > row[start] else DOWN
            for x in range(start, end):
                low, high = sign * (row[x] - level), sign * (row[x + 1] - level)
                if low <= 0.0 < high:
                    x_px[y, number] = x - low / (high - low)
                    slope[y, number] = high - low
                    height[y, number] = np.float32(0.5) * abs(second - first)
                    side[y, number] = sign
                    number += 1
                    break
        count[y] = number
