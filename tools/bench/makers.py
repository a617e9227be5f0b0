"""What makers of 3-D cameras publish: point precision, planarity, trueness of known dimensions, by distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sim.analytic_scenes import AnalyticScene
from moire_sim.analytic_surfaces import Box, Relief
from moire_sim.capture import HeadCapture
from moire_sim.score import near_edges
from tools.bench.accuracy import depth_of, truth_of
from tools.bench.conditions import DEFAULT
from tools.bench.methods import Depth, Method

DISTANCES_M = (0.6, 1.0, 1.5)
REPEATS = 6
# A board a little askew, so that its disparity runs over several pixels and their fractions.
BOARD_SLOPE_X, BOARD_SLOPE_Y = 0.10, 0.05
# Share of the points that the best plane is judged by: the rest may be outliers.
KEPT_SHARE = 0.997
PLANE_ROUNDS = 5
STEP_M, PLATE_SIZE_M = 0.050, (0.100, 0.080, 0.005)
# The plate also stands a little nearer, so that its disparity has several fractions of a pixel.
PLATE_SHIFTS_M = (0.0, -0.007, -0.016)
MIN_POINTS = 50


@dataclass(frozen=True)
class MakerRecord:
    """Figures of one method at one distance, millimetres; NaN where it found too few points.

    Attributes
    ----------
    precision_mm : standard deviation of a board's points over repeated exposures, rms of the best 99.7 %.
    planarity_mm : rms distance of the best 99.7 % of a board's points from the best plane.
    distance_error_mm : median depth of a board's points minus the true one, which a wrong fringe order spoils.
    step_error_mm : rms error of the 50 mm between a plate and the wall behind.
    width_error_mm : mean error of the plate's width of 100 mm, from its outermost pixels.
    """

    method: str
    distance_m: float
    precision_mm: float
    planarity_mm: float
    distance_error_mm: float
    step_error_mm: float
    width_error_mm: float


def maker_records(distance_m: float, methods: Sequence[Method]) -> list[MakerRecord]:
    """Measure all methods on a board and on plates at one distance."""
    board = AnalyticScene.of((Relief(distance_m, BOARD_SLOPE_X, BOARD_SLOPE_Y),))
    plates = [
        AnalyticScene.of((Relief(front_m + STEP_M), Box((0.0, 0.0, front_m + PLATE_SIZE_M[2] / 2.0), PLATE_SIZE_M)))
        for front_m in (distance_m + shift for shift in PLATE_SHIFTS_M)
    ]
    return [one_record(method, distance_m, board, plates) for method in methods]


def one_record(method: Method, distance_m: float, board: AnalyticScene, plates: list[AnalyticScene]) -> MakerRecord:
    """Measure one method."""
    truth = truth_of(board)
    depths = [depth_of(method, board, DEFAULT, seed) for seed in range(REPEATS)]
    plate_truths = [truth_of(plate) for plate in plates]
    plate_depths = [depth_of(method, plate, DEFAULT) for plate in plates]
    pairs = list(zip(plate_depths, plate_truths, strict=True))
    steps = np.array([step_m(depth, truth) for depth, truth in pairs])
    widths = np.array([width_m(depth, truth) for depth, truth in pairs])
    return MakerRecord(
        method.name,
        distance_m,
        point_precision_mm(depths, truth),
        planarity_mm(depths[0], truth),
        distance_error_mm(depths[0], truth),
        1e3 * float(np.sqrt(np.mean((steps - STEP_M) ** 2))),
        1e3 * float(np.mean(widths - PLATE_SIZE_M[0])),
    )


def point_precision_mm(depths_m: Sequence[Depth], truth: HeadCapture) -> float:
    """Standard deviation in time, rms over the steadiest 99.7 % of the co-visible pixels that are known each time."""
    stack = np.stack(depths_m).astype(np.float64)
    known = truth.covisible & np.isfinite(stack).all(axis=0)
    if known.sum() < MIN_POINTS:
        return float("nan")
    variance = stack[:, known].var(axis=0, ddof=1)
    return 1e3 * float(np.sqrt(np.mean(variance[variance <= np.quantile(variance, KEPT_SHARE)])))


def planarity_mm(depth_m: Depth, truth: HeadCapture) -> float:
    """Root mean square distance of the best 99.7 % of the co-visible points from their best plane."""
    points = truth.rig.points(depth_m)[truth.covisible & np.isfinite(depth_m)].astype(np.float64)
    if len(points) < MIN_POINTS:
        return float("nan")
    kept = points
    for _ in range(PLANE_ROUNDS):
        centre = kept.mean(axis=0)
        normal = np.linalg.eigh(np.cov((kept - centre).T))[1][:, 0]
        distance = np.abs((points - centre) @ normal)
        near = distance <= np.quantile(distance, KEPT_SHARE)
        kept = points[near]
    return 1e3 * float(np.sqrt(np.mean(distance[near] ** 2)))


def distance_error_mm(depth_m: Depth, truth: HeadCapture) -> float:
    """Median of depth minus true depth over the co-visible pixels."""
    error_m = (depth_m - truth.depth_m)[truth.covisible & np.isfinite(depth_m)]
    return 1e3 * float(np.median(error_m)) if len(error_m) >= MIN_POINTS else float("nan")


def step_m(depth_m: Depth, truth: HeadCapture) -> float:
    """Distance between plate and wall: the difference of their median depths, away from edges."""
    sure = truth.covisible & np.isfinite(depth_m) & ~near_edges(truth)
    plate = on_plate(truth)
    if min((sure & plate).sum(), (sure & ~plate).sum()) < MIN_POINTS:
        return float("nan")
    return float(np.median(depth_m[sure & ~plate]) - np.median(depth_m[sure & plate]))


def width_m(depth_m: Depth, truth: HeadCapture) -> float:
    """Width of the plate: from its first to its last pixel in a row, the median over the rows it covers in truth.

    NaN for sparse methods, with depth at fewer than half of the plate's pixels.
    """
    plate = on_plate(truth)
    front_m = float(truth.depth_m[plate].mean())
    found = np.abs(depth_m - front_m) < STEP_M / 2.0
    rows = np.flatnonzero(plate.any(axis=1))[3:-3]
    if found[plate].mean() < 0.5:
        return float("nan")
    extents = [np.ptp(np.flatnonzero(row)) + 1 for row in found[rows] if row.any()]
    return float(np.median(extents)) * front_m / truth.rig.fx_px


def on_plate(truth: HeadCapture) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) that show the front of the plate."""
    return np.asarray(truth.depth_m < np.nanmin(truth.depth_m) + 0.2 * STEP_M)
