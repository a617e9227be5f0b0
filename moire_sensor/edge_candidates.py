"""Candidate points of right fringe edges and their pictures in the left image (section 3.3, equations 11 and 12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import EXACT, UNCOUNTED
from moire_sensor.edge_find import EdgeRows, Float32
from moire_sensor.edge_lanes import LANES, TOGETHER, lane_rows, vectors_of
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.reference_ray import phase_seen_rad

TURN = 2.0 * np.pi
# Surfaces at the very end of the depth range keep their edges, which noise moves to and fro.
RANGE_MARGIN_PX = 1.0


class Candidates(NamedTuple):
    """Candidate points A, B, C, ... (figure 7) of each right edge.

    Attributes
    ----------
    left_x_px : (H, K, E) float32, column of the candidate in the left image; NaN where discarded.
    half_order : (H, E) int32, absolute phase of the first candidate over pi, rounded down: -1 up edge of order 0, 0 its
        down edge, 1... It grows by two from each candidate to the next.
    """

    left_x_px: Float32
    half_order: npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class CandidateRays:
    """What the rays of right pixels meet between the farthest and the nearest depth.

    Attributes
    ----------
    projector : the numbers of the packed ``ProjectorMap``.
    ends : least and most disparity, and the last column of the left image.
    number : candidates that a right edge can have.
    direction : 1 where the right image's phase grows with the column, -1 where a turned projector lets it fall.
    """

    projector: tuple[float, ...]
    ends: tuple[float, float, float]
    number: int
    direction: float

    @classmethod
    def build(
        cls, projector: ProjectorMap, disparity_range_px: tuple[float, float], image_size: tuple[int, int]
    ) -> CandidateRays:
        """Rays of a rig whose images are (width, height); the range is that of the depths that can occur."""
        width, height = image_size
        least, most = disparity_range_px[0] - RANGE_MARGIN_PX, disparity_range_px[1] + RANGE_MARGIN_PX
        x, y = np.meshgrid([0.0, 0.5 * width, width - 1.0], [0.0, 0.5 * height, height - 1.0])
        far, near = (phase_seen_rad(projector, "right", x, y, disparity) for disparity in (least, most))
        middle = 0.5 * (least + most)
        before, after = (phase_seen_rad(projector, "right", x + step, y, middle)[1, 1] for step in (-0.5, 0.5))
        number = int(np.nanmax(np.abs(near - far)) / TURN) + 1
        packed = tuple(float(number) for number in projector.packed())
        return cls(packed, (least, most, width - 1.0), number, float(np.sign(after - before)))

    def up_rad(self, bright: float) -> float:
        """Phase of the up edge of order 0, for the bright share of a projected fringe."""
        return -np.pi * bright * self.direction

    def room(self, edges: EdgeRows) -> Candidates:
        """Memory for the candidates of all edges."""
        height, most = edges.x_px.shape
        shape = (height, self.number, most)
        return Candidates(np.empty(shape, dtype=np.float32), np.empty((height, most), dtype=np.int32))


def find_candidates(
    right: EdgeRows, rays: CandidateRays, step_rad: float = 0.0, bright: float = 0.5, room: Candidates | None = None
) -> Candidates:
    """Intersect the ray of each right edge with the light of every projected fringe edge of its side.

    A projected edge of order 0 lies before phase 0 where the light rises with the phase, behind it where it falls.

    Parameters
    ----------
    step_rad : phase added to the pattern in this exposure.
    bright : share of a projected fringe between its up and its down edge, 0 to 1.
    room : memory for the result; what lies behind the number of a row's edges is left as it is.
    """
    candidates = rays.room(right) if room is None else room
    intersect_rays(right, rays.projector, rays.ends, rays.up_rad(bright), step_rad, candidates)
    return candidates


@njit(parallel=True, cache=True, error_model="numpy")
def intersect_rays(right, projector, ends, up_rad, step_rad, candidates):  # type: ignore[no-untyped-def]
    """Fill ``candidates`` for all right edges; ``up_rad`` is the phase of the up edge of order 0."""
    for index in prange(LANES):
        begin, behind = lane_rows(index, right.x_px.shape[0])
        intersect_rows(right, begin, behind, projector, ends, up_rad, step_rad, candidates)


@njit(error_model="numpy")
def intersect_rows(right, begin, behind, projector, ends, up_rad, step_rad, candidates):  # type: ignore[no-untyped-def]
    """Fill the candidates of some rows."""
    # Taken out of the tuples once: numba counts references each time.
    x_px, sides, number, left_x, half_order = (
        right.x_px, right.side, right.number, candidates.left_x_px, candidates.half_order
    )  # fmt: skip
    first_rad = np.empty(x_px.shape[1], dtype=np.float64)
    for y in range(begin, behind):
        intersect_row(
            x_px[y], sides[y], vectors_of(number[y]), y, projector, ends, up_rad, step_rad, first_rad, left_x[y],
            half_order[y],
        )  # fmt: skip


@njit(**UNCOUNTED)
def intersect_row(x_px, side, vectors, y, projector, ends, up_rad, step_rad, first_rad, left_x, half_order):  # type: ignore[no-untyped-def]
    """Fill the candidates of row y, those of one number after the other."""
    first_phases(x_px, side, vectors, y, projector, ends, up_rad, step_rad, first_rad, half_order)
    for k in range(left_x.shape[0]):
        intersect_edges(x_px, vectors, y, first_rad, TURN * k, projector, ends, left_x[k])


@njit(**EXACT)
def first_phases(x_px, side, vectors, y, projector, ends, up_rad, step_rad, first_rad, half_order):  # type: ignore[no-untyped-def]
    """Least phase of a projected edge that the ray of each edge of row y meets between the ends of its range."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            edge = np.uint64(TOGETHER * vector + lane)
            x, edge_rad = np.float64(x_px[edge]), side[edge] * up_rad
            far, near = phase_on_ray(projector, x, y, ends[0]), phase_on_ray(projector, x, y, ends[1])
            order = np.ceil((min(far, near) + step_rad - edge_rad) * (1.0 / TURN))
            first_rad[edge] = edge_rad + TURN * order - step_rad
            half_order[edge] = np.int32(2.0 * order) - np.int32(edge_rad < 0.0)


@njit(**EXACT)
def intersect_edges(x_px, vectors, y, first_rad, more_rad, projector, ends, left_x):  # type: ignore[no-untyped-def]
    """Candidates of one number of row y: on the ray, the phase is the first one and whole turns."""
    least, most, last = ends
    for vector in range(vectors):
        for lane in range(TOGETHER):
            edge = np.uint64(TOGETHER * vector + lane)
            x = np.float64(x_px[edge])
            disparity = disparity_on_ray(projector, x, y, first_rad[edge] + more_rad)
            column = x + disparity
            inside = (least <= disparity) & (disparity <= most) & (column >= 0.0) & (column <= last)
            left_x[edge] = column if inside else np.nan


@njit(error_model="numpy", inline="always")
def phase_on_ray(projector, x, y, disparity):  # type: ignore[no-untyped-def]
    """Absolute phase that right pixel (x, y) sees of a point at a disparity: ``phase_seen_rad``."""
    left_x = x + disparity
    above = projector[0] + projector[1] * left_x + projector[2] * y + projector[3] * disparity
    below = projector[4] + projector[5] * left_x + projector[6] * y + projector[7] * disparity
    return projector[8] * above / below + projector[9]


@njit(error_model="numpy", inline="always")
def disparity_on_ray(projector, x, y, phase):  # type: ignore[no-untyped-def]
    """Disparity at which right pixel (x, y) sees an absolute phase, equation (11): ``disparity_on_ray_px``."""
    column = (phase - projector[9]) * (1.0 / projector[8])
    per_disparity = column * (projector[7] + projector[5]) - (projector[3] + projector[1])
    above = projector[0] + projector[1] * x + projector[2] * y
    return (above - column * (projector[4] + projector[5] * x + projector[6] * y)) / per_disparity


def period_px(projector: ProjectorMap, width_px: int, height_px: int, disparity_px: float) -> float:
    """Width of a fringe in the middle of the left image on a fronto-parallel surface at a disparity, 2 px or more."""
    x, y = 0.5 * width_px, np.full(2, 0.5 * height_px)
    ends = phase_seen_rad(projector, "left", np.array([x - 0.5, x + 0.5]), y, disparity_px)
    return float(np.clip(TURN / abs(ends[1] - ends[0]), 2.0, width_px))
