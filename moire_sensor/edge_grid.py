"""Matched fringe edges on the pixel grid of the left image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.apart import ROW
from moire_sensor.edge_doubt import DOUBTFUL
from moire_sensor.edge_light import fill_light
from moire_sensor.edge_place import BINS
from moire_sensor.plain_image import Grey
from moire_sensor.shot import Status

UNLIT, SATURATED = np.uint8(Status.UNLIT), np.uint8(Status.SATURATED)
OCCLUDED, AMBIGUOUS = np.uint8(Status.OCCLUDED), np.uint8(Status.AMBIGUOUS)
HALF = np.float32(0.5)


Float32 = npt.NDArray[np.float32]


class Grid(NamedTuple):
    """Images (H, W) to be filled, those of :class:`Shot`."""

    depth_m: Float32
    depth_sigma_m: Float32
    disparity_px: Float32
    fringe_order: npt.NDArray[np.int16]
    confidence: Float32
    status: npt.NDArray[np.uint8]
    background: Float32

    @classmethod
    def of(cls, image: Grey) -> Grid:
        """Memory for the points of a left image."""
        depth, sigma, disparity, confidence, background = (np.empty(image.shape, dtype=np.float32) for _ in range(5))
        order, status = np.empty(image.shape, dtype=np.int16), np.empty(image.shape, dtype=np.uint8)
        return cls(depth, sigma, disparity, order, confidence, status, background)


class Limits(NamedTuple):
    """Where fringes, and trust in a point, end.

    Attributes
    ----------
    period_px : columns of a fringe.
    off_px : mismatch at which confidence has fallen to 0.
    scale : from grey levels of the image to those of 255.
    saturated : grey level of a saturated pixel.
    unlit_below : least difference of grey levels within a fringe.
    window_px : odd number of columns next to a fringe.
    min_run : shorter runs of matches are dropped.
    """

    period_px: float
    off_px: float
    scale: float
    saturated: float
    unlit_below: float
    window_px: int
    min_run: int


@njit(cache=True)
def upper_quartile(counts):  # type: ignore[no-untyped-def]
    """Upper quartile of values from 0 to 1, counted in lanes (LANES, BINS + 1); NaN of none."""
    rank, below = 0.75 * np.sum(counts), 0
    for n in range(counts.shape[1]):
        here = np.sum(counts[:, n])
        if here > 0 and below + here >= rank:
            return (n + (rank - below) / here) / BINS
        below += here
    return np.nan


@njit(error_model="numpy")
def light_rows(left, match, image, begin, behind, limits, levels, sums, grid):  # type: ignore[no-untyped-def]
    """Fill some rows as they would be without any match."""
    # Taken out of the tuples once: numba counts references each time.
    background, status, left_x, number, partner = grid.background, grid.status, left.x_px, left.number, match.partner
    scale, unlit_below = np.float32(limits.scale), np.int32(np.ceil(limits.unlit_below))
    saturated = np.int32(np.ceil(limits.saturated))
    for y in range(begin, behind):
        contrast = fill_light(image[y], limits.window_px, scale, levels, sums, background[y])
        mark_unlit(contrast, unlit_below, status[y])
        mark_edges(left_x[y, : number[y]], partner[y], status[y])
        mark_saturated(image[y], saturated, status[y])


@njit(**ROW)
def mark_unlit(contrast, unlit_below, status):  # type: ignore[no-untyped-def]
    """Status where there is no edge."""
    for x in range(status.size):
        status[x] = UNLIT if np.int32(contrast[x]) < unlit_below else AMBIGUOUS


@njit
def mark_edges(edges_px, partner, status):  # type: ignore[no-untyped-def]
    """Status of edges without a match."""
    for edge in range(edges_px.size):
        status[np.uint64(edges_px[edge] + HALF)] = AMBIGUOUS if partner[edge] == DOUBTFUL else OCCLUDED


@njit(**ROW)
def mark_saturated(image, saturated, status):  # type: ignore[no-untyped-def]
    """Status of saturated pixels."""
    for x in range(status.size):
        status[x] = SATURATED if np.int32(image[x]) >= saturated else status[x]
