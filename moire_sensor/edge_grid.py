"""Matched fringe edges on the pixel grid of the left image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.edge_candidates import Candidates
from moire_sensor.edge_doubt import DOUBTFUL
from moire_sensor.edge_find import EdgeRows, Float32
from moire_sensor.edge_lanes import LANES, lane_rows
from moire_sensor.edge_light import fill_light
from moire_sensor.edge_match import EdgeMatch
from moire_sensor.edge_noise import Grey
from moire_sensor.edge_points import depth_of, order_of, sigma_of
from moire_sensor.edge_spread import drop_loners
from moire_sensor.rig import StereoRig
from moire_sensor.shot import UNKNOWN_ORDER, Shot, Status

OK, UNLIT, SATURATED = np.uint8(Status.OK), np.uint8(Status.UNLIT), np.uint8(Status.SATURATED)
OCCLUDED, AMBIGUOUS = np.uint8(Status.OCCLUDED), np.uint8(Status.AMBIGUOUS)
UNKNOWN, NO_ORDER, ZERO = np.float32(np.nan), np.int16(UNKNOWN_ORDER), np.float32(0.0)
HALF = np.float32(0.5)
# Mismatches are counted in shares of the largest.
BINS = 1024


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
    """

    period_px: float
    off_px: float
    scale: float
    saturated: float
    unlit_below: float


def on_left_grid(
    left: EdgeRows,
    right: EdgeRows,
    candidates: Candidates,
    match: EdgeMatch,
    image: Grey,
    limits: Limits,
    rig: StereoRig,
    step_rad: float,
    min_run: int,
) -> Shot:
    """Put the depth of each correspondence, equation (9), on the left pixel nearest to it.

    Those in runs of less than ``min_run`` are dropped, from ``match`` too.
    """
    grid = Grid.of(image)
    lens = rig.fx_px * rig.baseline_m, rig.disparity_at_infinity_px
    counts = np.zeros((LANES, BINS + 1), dtype=np.int64)
    fill_rows(left, right, candidates, match, min_run, image, limits, lens, step_rad / (2.0 * np.pi), grid, counts)
    typical_rad = 2.0 * np.pi / limits.period_px * limits.off_px * upper_quartile(counts)
    return Shot(*grid, typical_mismatch_rad=typical_rad)


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


@njit(parallel=True, cache=True, error_model="numpy")
def fill_rows(left, right, candidates, match, min_run, image, limits, lens, step_turns, grid, counts):  # type: ignore[no-untyped-def]
    """Fill the grid, and count mismatches, as shares of the largest, lane by lane."""
    for lane in prange(LANES):
        fill_lane(
            left, right, candidates, match, min_run, image, limits, lens, step_turns, grid, counts, np.int64(lane)
        )


@njit(error_model="numpy")
def fill_lane(left, right, candidates, match, min_run, image, limits, lens, step_turns, grid, counts, lane):  # type: ignore[no-untyped-def]
    """Fill the rows of a lane."""
    width, size = image.shape[1], 2 * np.int64(np.rint(0.5 * limits.period_px)) + 1
    work = np.empty((5, width + size - 1), dtype=np.float32)
    contrast = np.empty(width, dtype=np.float32)
    for y in range(*lane_rows(lane, image.shape[0])):
        fill_light(image[y], size, np.float32(limits.scale), work, grid.background[y], contrast)
        without_points(image[y], contrast, left.x_px[y, : left.number[y]], match.partner[y], limits, grid.status[y])
        forget(grid.depth_m[y], grid.depth_sigma_m[y], grid.disparity_px[y], grid.confidence[y], grid.fringe_order[y])
        drop_loners(match.partner[y], match.candidate[y], candidates.half_order[y], left.number[y], min_run)
        place_points(left, right, candidates, match, limits, lens, step_turns, grid, counts[lane], y)


@njit
def forget(depth, sigma, disparity, confidence, order):  # type: ignore[no-untyped-def]
    """A row without any point."""
    for x in range(depth.size):
        depth[x] = UNKNOWN
    for x in range(depth.size):
        sigma[x] = UNKNOWN
    for x in range(depth.size):
        disparity[x] = UNKNOWN
    for x in range(depth.size):
        confidence[x] = ZERO
    for x in range(depth.size):
        order[x] = NO_ORDER


@njit
def without_points(image, contrast, edges_px, partner, limits, status):  # type: ignore[no-untyped-def]
    """Status of a row as it would be without any match."""
    unlit_below = np.float32(limits.unlit_below)
    for x in range(status.size):
        status[x] = UNLIT if contrast[x] < unlit_below else AMBIGUOUS
    for edge in range(edges_px.size):
        status[np.int64(edges_px[edge] + 0.5)] = AMBIGUOUS if partner[edge] == DOUBTFUL else OCCLUDED
    for x in range(status.size):
        status[x] = SATURATED if image[x] >= limits.saturated else status[x]


@njit(error_model="numpy")
def place_points(left, right, candidates, match, limits, lens, step_turns, grid, counts, y):  # type: ignore[no-untyped-def]
    """Put the points of row y into the grid."""
    left_x, right_x, columns, half_order = (
        left.x_px[y],
        right.x_px[y],
        candidates.left_x_px[y],
        candidates.half_order[y],
    )
    depths, sigmas, disparities = grid.depth_m[y], grid.depth_sigma_m[y], grid.disparity_px[y]
    confidences, orders, statuses = grid.confidence[y], grid.fringe_order[y], grid.status[y]
    left_sigma, right_sigma, partner, candidate = (
        left.sigma_px[y],
        right.sigma_px[y],
        match.partner[y],
        match.candidate[y],
    )
    for i in range(left.number[y]):
        if partner[i] < 0:
            continue
        j, number, x = partner[i], candidate[i], np.int64(left_x[i] + HALF)
        disparity = np.float64(left_x[i]) - np.float64(right_x[j])
        depth = depth_of(disparity, lens)
        off = abs(np.float64(columns[number, j]) - np.float64(left_x[i])) / limits.off_px
        disparities[x], depths[x] = disparity, depth
        sigmas[x] = sigma_of(depth, left_sigma[i], right_sigma[j], lens)
        confidences[x] = max(1.0 - off, 0.0)
        orders[x], statuses[x] = order_of(half_order[j] + 2 * number, step_turns), OK
        counts[min(np.int64(off * BINS), BINS)] += 1
