"""Depth of matched fringe edges (equations 9 and 10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.edge_candidates import Candidates
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_match import EdgeMatch
from moire_sensor.rig import Array, StereoRig


@dataclass(frozen=True, eq=False)
class EdgePoints:
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
    keep: npt.NDArray[np.bool_],
    step_rad: float,
) -> EdgePoints:
    """Depth of the kept correspondences, equation (9)."""
    row, i = np.nonzero(keep)
    j, k = match.partner[row, i], match.candidate[row, i]
    left_x, right_x = left.x_px[row, i].astype(np.float64), right.x_px[row, j].astype(np.float64)
    depth = rig.depth_m(left_x - right_x)
    sigma_px = np.hypot(left.sigma_px[row, i], right.sigma_px[row, j])
    turns = 0.5 * (candidates.half_order[row, j, k] + 0.5) - step_rad / (2.0 * np.pi)
    return EdgePoints(
        row=row,
        left_x_px=left_x,
        right_x_px=right_x,
        side=left.side[row, i],
        fringe_order=np.floor(turns + 0.5).astype(np.int16),
        depth_m=depth,
        depth_sigma_m=np.asarray(depth**2 / (rig.fx_px * rig.baseline_m) * sigma_px),
        mismatch_px=np.abs(candidates.left_x_px[row, j, k] - left_x),
    )
