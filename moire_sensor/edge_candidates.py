"""Candidate points of right fringe edges and their pictures in the left image (section 3.3, equations 11 and 12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.edge_find import EdgeRows
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.reference_ray import disparity_on_ray_px, phase_seen_rad
from moire_sensor.rig import Array, StereoRig

TURN = 2.0 * np.pi
# Surfaces at the very end of the depth range keep their edges, which noise moves to and fro.
RANGE_MARGIN_PX = 1.0


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidate points A, B, C, ... (figure 7) of each right edge, arrays of shape (H, E, K).

    Attributes
    ----------
    left_x_px : float32, column of the candidate in the left image; NaN where discarded.
    half_order : int32, absolute phase over pi, rounded down: -1 up edge of order 0, 0 its down edge, 1...
    """

    left_x_px: npt.NDArray[np.float32]
    half_order: npt.NDArray[np.int32]


def find_candidates(
    right: EdgeRows,
    projector: ProjectorMap,
    disparity_range_px: tuple[float, float],
    width_px: int,
    step_rad: float = 0.0,
    bright: float = 0.5,
) -> Candidates:
    """Intersect the ray of each right edge with the light of every projected fringe edge of its side.

    Parameters
    ----------
    disparity_range_px : disparities of the farthest and the nearest depth that can occur.
    width_px : width of the left image; candidates outside are discarded.
    step_rad : phase added to the pattern in this exposure.
    bright : share of a projected fringe between its up and its down edge, 0 to 1.
    """
    x = right.x_px.astype(np.float64)
    y = np.arange(x.shape[0], dtype=np.float64)[:, None]
    least, most = disparity_range_px[0] - RANGE_MARGIN_PX, disparity_range_px[1] + RANGE_MARGIN_PX
    ends = np.sort([phase_seen_rad(projector, "right", x, y, d) + step_rad for d in (least, most)], axis=0)
    edge_rad = edge_phase_rad(right.side, bright, fringes_run(projector, x, y, 0.5 * (least + most)))
    first = np.ceil((ends[0] - edge_rad) / TURN)
    spans = np.floor((ends[1] - edge_rad) / TURN) - first + 1.0
    number = max(1, int(np.nanmax(spans, initial=1.0)))
    order = first[..., None] + np.arange(number)
    phase_rad = edge_rad[..., None] + TURN * order
    disparity = disparity_on_ray_px(projector, "right", x[..., None], y[..., None], phase_rad - step_rad)
    left_x = x[..., None] + disparity
    inside = (disparity >= least) & (disparity <= most) & (left_x >= 0.0) & (left_x <= width_px - 1.0)
    half_order = np.floor(np.where(inside, phase_rad, 0.0) / np.pi).astype(np.int32)
    return Candidates(np.where(inside, left_x, np.nan).astype(np.float32), half_order)


def edge_phase_rad(side: npt.NDArray[np.int8], bright: float, direction: Array) -> Array:
    """Phase of the projected edge of order 0: before 0 where the light rises with the phase, behind where it falls."""
    return np.asarray(-np.pi * bright * side * direction)


def fringes_run(projector: ProjectorMap, x_px: Array, y_px: Array, disparity_px: float) -> Array:
    """1 where the right image's phase grows with the column, -1 where a turned projector lets it fall."""
    before, after = (phase_seen_rad(projector, "right", x_px + step, y_px, disparity_px) for step in (-0.5, 0.5))
    return np.sign(after - before)


def period_px(projector: ProjectorMap, rig: StereoRig, disparity_px: float) -> float:
    """Width of a fringe in the middle of the left image on a fronto-parallel surface at a disparity, 2 px or more."""
    x, y = 0.5 * rig.image_size[0], np.full(2, 0.5 * rig.image_size[1])
    ends = phase_seen_rad(projector, "left", np.array([x - 0.5, x + 0.5]), y, disparity_px)
    return float(np.clip(TURN / abs(ends[1] - ends[0]), 2.0, rig.image_size[0]))
