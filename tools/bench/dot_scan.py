"""A fair chance for random dots: the dot size and the window with which each matcher does best in this rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from moire_sim.analytic_scenes import AnalyticScene, scene_surfaces
from moire_sim.capture import HeadCapture
from moire_sim.score import disparity_error_px, score_depth, share
from tools.bench.accuracy import depth_of, truth_of
from tools.bench.block_matching import KINDS, Kind
from tools.bench.conditions import DEFAULT
from tools.bench.methods import Depth, DotMethod

SCAN_SCENES = ("cylinder_and_box", "tilt_0.5")
DOTS_PX = (1.0, 1.5, 2.0, 4.0)
WINDOWS_PX: dict[Kind, tuple[int, ...]] = {
    "StereoBM": (9, 15, 21),
    "SGBM 3-way": (3, 5, 7, 9),
    "SGBM HH": (3, 5, 7, 9),
}
TOLERANCES_PX = (1.0, 0.5, 0.25)


@dataclass(frozen=True)
class Trial:
    """One setting and its merit, 0 to 1."""

    method: DotMethod
    merit: float


def merit(depth_m: Depth, truth: HeadCapture) -> float:
    """Mean share of the co-visible pixels right within 1, 1/2 and 1/4 px, less the share of ghosts.

    One figure for completeness, outliers, precision and invention alike.
    """
    off_px = np.abs(disparity_error_px(depth_m, truth))
    right = [share(off_px <= tolerance, truth.covisible) for tolerance in TOLERANCES_PX]
    return float(np.mean(right)) - score_depth(depth_m, truth).ghost_share


def trials_of_dots(scene_name: str, dot_px: float, kinds: Sequence[Kind]) -> list[Trial]:
    """Try all windows of some matchers on dots of one size."""
    scene = AnalyticScene.of(scene_surfaces(scene_name))
    truth = truth_of(scene)
    methods = [DotMethod(kind, window, dot_px) for kind in kinds for window in WINDOWS_PX[kind]]
    return [Trial(method, merit(depth_of(method, scene, DEFAULT), truth)) for method in methods]


def mean_trials(trials: Sequence[Trial]) -> list[Trial]:
    """Return one trial a setting, the mean over the scenes."""
    settings = list(dict.fromkeys(trial.method for trial in trials))
    return [Trial(one, float(np.mean([t.merit for t in trials if t.method == one]))) for one in settings]


def best_settings(trials: Sequence[Trial]) -> tuple[DotMethod, ...]:
    """Return the best setting of each matcher."""
    means = mean_trials(trials)
    chosen = []
    for kind in KINDS:
        own = [trial for trial in means if trial.method.kind == kind]
        if own:
            chosen.append(max(own, key=lambda trial: trial.merit).method)
    return tuple(chosen)
