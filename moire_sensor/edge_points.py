"""Depth of matched fringe edges (equations 9 and 10)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.edge_candidates import Candidates
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_match import EdgeMatch
from moire_sensor.rig import Array, StereoRig


class EdgePoints(NamedTuple):
    """Points at the matched fringe edges, ordered by row, then column; arrays of shape (N,).

    Attributes
    ----------
    row : int64, epipolar line.
    left_x_px, right_x_px : float64, columns of the edge, x_l and x_r of equation (9).
    side : int8, 1 up (dark to bright along the row), -1 down.
    fringe_order : int16, projector period that the edge belongs to.
    depth_m, depth_sigma_m : float64, z in the left optical frame and its predicted standard deviation, metres.
    mismatch_px : float64, distance of the left edge from the projected candidate.
    """

    row: npt.NDArray[np.int64]
    left_x_px: Array
    right_x_px: Array
    side: npt.NDArray[np.int8]
    fringe_order: npt.NDArray[np.int16]
    depth_m: Array
    depth_sigma_m: Array
    mismatch_px: Array

    @property
    def disparity_px(self) -> Array:
        """Equation (10), pixels (N,)."""
        return self.left_x_px - self.right_x_px


def measure(
    rig: StereoRig,
    left: EdgeRows,
    right: EdgeRows,
    candidates: Candidates,
    match: EdgeMatch,
    step_rad: float,
) -> EdgePoints:
    """Depth of the correspondences, equation (9)."""
    first = np.zeros(left.number.size + 1, dtype=np.int64)
    count_points(match.partner, left.number, first)
    first = np.cumsum(first)
    reals = np.empty((5, first[-1]))
    points = EdgePoints(
        np.empty(first[-1], dtype=np.int64), reals[0], reals[1], np.empty(first[-1], dtype=np.int8),
        np.empty(first[-1], dtype=np.int16), reals[2], reals[3], reals[4],
    )  # fmt: skip
    lens = rig.fx_px * rig.baseline_m, rig.disparity_at_infinity_px
    measure_rows(left, right, candidates, match, lens, step_rad / (2.0 * np.pi), first, points)
    return points


@njit(parallel=True, cache=True)
def count_points(partner, number, after):  # type: ignore[no-untyped-def]
    """Points of row y in ``after[y + 1]``."""
    for row in prange(number.size):
        y = np.int64(row)
        after[y + 1] = np.sum(partner[y, : number[y]] >= 0)


@njit(parallel=True, cache=True, error_model="numpy")
def measure_rows(left, right, candidates, match, lens, step_turns, first, points):  # type: ignore[no-untyped-def]
    """Fill ``points``, those of row y from ``first[y]``; ``lens`` is T f and the disparity of infinitely far points."""
    for row in prange(left.number.size):
        y = np.int64(row)
        at = first[y]
        for i in range(left.number[y]):
            if match.partner[y, i] >= 0:
                measure_edge(left, right, candidates, match, y, i, lens, step_turns, points, at)
                at += 1


@njit(error_model="numpy")
def measure_edge(left, right, candidates, match, y, i, lens, step_turns, points, at):  # type: ignore[no-untyped-def]
    """Fill point number ``at`` from left edge i of row y."""
    j, number = match.partner[y, i], match.candidate[y, i]
    left_x, right_x = np.float64(left.x_px[y, i]), np.float64(right.x_px[y, j])
    points.row[at], points.side[at] = y, left.side[y, i]
    points.left_x_px[at], points.right_x_px[at] = left_x, right_x
    points.fringe_order[at] = order_of(candidates.half_order[y, j] + 2 * number, step_turns)
    depth = depth_of(left_x - right_x, lens)
    points.depth_m[at] = depth
    points.depth_sigma_m[at] = sigma_of(depth, left.sigma_px[y, i], right.sigma_px[y, j], lens)
    points.mismatch_px[at] = abs(np.float64(candidates.left_x_px[y, number, j]) - left_x)


@njit(error_model="numpy", inline="always")
def depth_of(disparity, lens):  # type: ignore[no-untyped-def]
    """Equation (9): T f over the disparity, which infinitely far points have some of too."""
    parallax = disparity - lens[1]
    return lens[0] / parallax if parallax > 0.0 else np.nan


@njit(error_model="numpy", inline="always")
def sigma_of(depth, left_sigma, right_sigma, lens):  # type: ignore[no-untyped-def]
    """Standard deviation of a depth, from those of both edges' columns."""
    return depth * depth / lens[0] * np.sqrt(np.float64(left_sigma) ** 2 + np.float64(right_sigma) ** 2)


@njit(error_model="numpy", inline="always")
def order_of(half_order, step_turns):  # type: ignore[no-untyped-def]
    """Projector period of an edge: it lies in the middle of a half period of the exposure, the steps' phase off."""
    return np.int16(np.floor(0.5 * (half_order + 0.5) - step_turns + 0.5))
