"""Figures 11 and 12: what each method makes of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from moire_sensor import Reconstructor, Shot
from moire_sensor.paper_rig import REFERENCE_DEPTH_M, paper_pattern
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig
from moire_sensor.settings import Settings
from moire_sim import VirtualHead
from moire_sim.capture import HeadCapture
from moire_sim.score import OUTLIER_PX, Score, disparity_error_px, score
from tools.figures.stage import TURN, Array

DEPTH_RANGE_M = (0.5, 2.0)
STEPS = 4
# A depth counts as whole orders off if its phase is within this of a whole number of periods from the true one.
WHOLE_PERIODS = 0.1


@dataclass(frozen=True)
class Way:
    """A method as it is tried."""

    label: str
    method: str
    reference_depth_m: float = REFERENCE_DEPTH_M

    @property
    def steps(self) -> int:
        """Exposures that it needs."""
        return STEPS if self.method == "phase_shift" else 1


WAYS = (
    Way("reference_plane", "reference_plane"),
    Way("fringe_edges", "fringe_edges"),
    Way("dense", "dense"),
    Way("phase_shift", "phase_shift"),
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one method made of the scene.

    Attributes
    ----------
    error_mm : (H, W) depth minus truth, millimetres, NaN where either is unknown or the pixel is not co-visible.
    whole_orders : of the depths that are off by more than 1 px, the share that is off by whole fringe orders.
    """

    way: Way
    shot: Shot
    score: Score
    error_mm: Array
    whole_orders: float


@dataclass(frozen=True, eq=False)
class SurfaceResult:
    """A scene and all outcomes; ``capture`` is the single shot."""

    scene: str
    capture: HeadCapture
    outcomes: tuple[Outcome, ...]

    def outcome(self, label: str) -> Outcome:
        """Return the outcome of the way with a label."""
        return next(one for one in self.outcomes if one.way.label == label)


def measure(scene: str, rig: StereoRig | None = None, ways: Sequence[Way] = WAYS, seed: int = 0) -> SurfaceResult:
    """Photograph a scene of the virtual head and reconstruct it by every way."""
    with VirtualHead(scene, seed=seed, rig=rig) as head:
        captures = {steps: head.capture(paper_pattern(steps), 0) for steps in sorted({way.steps for way in ways} | {1})}
    outcomes = tuple(outcome_of(way, captures[way.steps]) for way in ways)
    return SurfaceResult(scene, captures[1], outcomes)


def outcome_of(way: Way, capture: HeadCapture) -> Outcome:
    """Reconstruct and compare with the truth."""
    settings = replace(Settings(), reference_depth_m=way.reference_depth_m)
    sensor = Reconstructor(capture.rig, capture.pattern, DEPTH_RANGE_M, way.method, settings=settings)
    left, right = capture.left, capture.right
    if way.steps > 1:
        frames = np.arange(sensor.frames_needed) % way.steps
        left, right = left[frames], right[frames]
    shot = sensor.reconstruct(left, right)
    error_mm = np.where(capture.covisible, (shot.depth_m.astype(np.float64) - capture.depth_m) * 1e3, np.nan)
    return Outcome(way, shot, score(shot, capture), error_mm, whole_orders(shot, capture))


def whole_orders(shot: Shot, capture: HeadCapture) -> float:
    """Share of the wrong depths whose phase is whole periods from the true one; NaN when none is wrong."""
    off = np.abs(disparity_error_px(shot.depth_m, capture)) > OUTLIER_PX
    off &= capture.covisible
    if not off.any():
        return float("nan")
    projector = ProjectorMap.build(capture.rig, capture.pattern)
    rows, columns = (index.astype(np.float64) for index in np.nonzero(off))
    found, true = (
        projector.phase_rad_at(columns, rows, capture.rig.disparity_px(depth[off]))
        for depth in (shot.depth_m, capture.depth_m)
    )
    turns = (found - true) / TURN
    whole = (np.abs(turns - np.round(turns)) < WHOLE_PERIODS) & (np.round(turns) != 0.0)
    return float(whole.mean())
