"""Scores of every method on every scene, all by the same code: moire_sim.score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.pattern import Waveform
from moire_sim.analytic_scenes import AnalyticScene, scene_surfaces
from moire_sim.capture import Grey, HeadCapture
from moire_sim.random_dots import Projected
from moire_sim.score import Score, disparity_error_px, score_depth
from tools.bench.conditions import DEFAULT, Condition
from tools.bench.methods import Depth, Method, Solver

DEPTH_RANGE_M = (0.5, 2.0)
# What stands nearer than this in its scene is scored alone, too: the thin poles before their wall.
PARTS_NEARER_M = {"thin_poles": 1.3}


@dataclass(frozen=True, eq=False)
class Record:
    """Score of one method on one scene, or on a part of one, which is listed but left out of the means.

    ``error_px`` (H, W) is kept for whole scenes under the default condition only.
    """

    scene: str
    condition: str
    method: str
    score: Score
    error_px: npt.NDArray[np.float32] | None = None
    part_of_scene: bool = False


def truth_of(scene: AnalyticScene) -> HeadCapture:
    """Return the truth of a scene, which no pattern changes; its images are empty."""
    blank = np.zeros(scene.depth_m.shape, dtype=np.uint8)
    return HeadCapture(blank, blank, scene.depth_m, scene.covisible, scene.lit, scene.rig, paper_pattern())


def photograph(
    scene: AnalyticScene, pattern: Projected, condition: Condition, projector_on: bool = True, seed: int = 0
) -> tuple[Grey, Grey]:
    """Left and right pictures of a scene under a pattern, or under ambient light alone."""
    lights = condition.lights(pattern.step_count, projector_on)
    return scene.images(pattern, lights, condition.noise, seed)


def depth_of(method: Method, scene: AnalyticScene, condition: Condition, seed: int = 0) -> Depth:
    """Photograph a scene for a method and let it measure."""
    left, right = photograph(scene, method.pattern(condition), condition, method.projector_on, seed)
    return solver_of(method, condition.waveform)(left, right)


@lru_cache(maxsize=64)
def solver_of(method: Method, waveform: Waveform) -> Solver:
    """Set a method up for the paper's rig, once a process."""
    return method.solver(paper_rig(), Condition("", waveform=waveform), DEPTH_RANGE_M)


def record(scene_name: str, condition: Condition, method_name: str, depth_m: Depth, truth: HeadCapture) -> Record:
    """Score one depth image."""
    error = disparity_error_px(depth_m, truth).astype(np.float32) if condition == DEFAULT else None
    return Record(scene_name, condition.name, method_name, score_depth(depth_m, truth), error)


def scene_records(scene_name: str, conditions: Sequence[Condition], methods: Sequence[Method]) -> list[Record]:
    """Score all methods on a scene under conditions that share one texture."""
    (texture,) = {condition.texture for condition in conditions}
    scene = AnalyticScene.of(scene_surfaces(scene_name), texture)
    truth = truth_of(scene)
    records = []
    for condition in conditions:
        for method in methods:
            if condition.changes_fringes_only and not method.ours:
                continue
            depth_m = depth_of(method, scene, condition)
            records.append(record(scene_name, condition, method.name, depth_m, truth))
            if scene_name in PARTS_NEARER_M and condition == DEFAULT:
                records.append(part_record(scene_name, method.name, depth_m, truth))
    return records


def part_record(scene_name: str, method_name: str, depth_m: Depth, truth: HeadCapture) -> Record:
    """Score the near part of a scene alone, default condition."""
    near = nearer_than(truth, PARTS_NEARER_M[scene_name])
    name = f"{scene_name}, poles alone"
    return Record(name, DEFAULT.name, method_name, score_depth(depth_m, near), part_of_scene=True)


def nearer_than(truth: HeadCapture, limit_m: float) -> HeadCapture:
    """Return a truth of which only what stands nearer is scored."""
    return replace(truth, covisible=truth.covisible & (truth.depth_m < limit_m))
