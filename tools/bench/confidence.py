"""Whether confidence and predicted error can be believed: on the scenes, under every condition, and on random posts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from moire_sensor import Shot
from moire_sensor.depth_grey import MEDIAN_SIGMAS
from moire_sensor.paper_rig import paper_rig
from moire_sim.analytic_scenes import AnalyticScene, analytic_scene_names, scene_surfaces
from moire_sim.capture import HeadCapture
from moire_sim.score import OUTLIER_PX, disparity_error_px, near_edges
from tools.bench.accuracy import DEPTH_RANGE_M, photograph, truth_of
from tools.bench.conditions import CONDITIONS, DEFAULT, Condition
from tools.bench.methods import FringeMethod
from tools.bench.posts import SEEDS, scene_of
from tools.bench.tasks import Task

SURE = 0.9
METHODS = (FringeMethod("dense"), FringeMethod("phase_shift"))
POSTS = "posts at random places"


@dataclass(frozen=True)
class TrustRecord:
    """How far one method can be believed in one place.

    Attributes
    ----------
    off_of_sure : of all pixels with a confidence above 0.9, wherever they lie, the share off by more than 1 px.
    sure_of_right : of the pixels within 1 px, the share with a confidence above 0.9.
    error_by_sigma : median over scenes of the typical error by the predicted one, away from edges.
    """

    place: str
    method: str
    off_of_sure: float
    sure_of_right: float
    error_by_sigma: float


def trust_tasks() -> list[Task[TrustRecord]]:
    """One task a place and method."""
    places: list[tuple[str, Condition, Callable[[], list[AnalyticScene]]]] = [
        (condition.name, condition, partial(scenes_under, condition)) for condition in CONDITIONS
    ]
    places.append((POSTS, DEFAULT, post_scenes))
    return [(trust_records, (*place, method)) for place in places for method in METHODS]


def scenes_under(condition: Condition) -> list[AnalyticScene]:
    """All scenes with the texture of a condition."""
    return [AnalyticScene.of(scene_surfaces(name), condition.texture) for name in analytic_scene_names()]


def post_scenes() -> list[AnalyticScene]:
    """The scenes of posts at random places."""
    return [scene_of(seed)[0] for seed in SEEDS]


def trust_records(
    place: str, condition: Condition, scenes: Callable[[], Sequence[AnalyticScene]], method: FringeMethod
) -> list[TrustRecord]:
    """Measure one method on all scenes of a place."""
    sensor = method.sensor(paper_rig(), condition, DEPTH_RANGE_M)
    counts, ratios = np.zeros(4, dtype=np.int64), []
    for scene in scenes():
        shot = sensor.reconstruct(*photograph(scene, method.pattern(condition), condition))
        truth = truth_of(scene)
        counts += trust_counts(shot, truth)
        ratios.append(error_by_sigma(shot, truth))
    sure, off, right, sure_right = (float(count) for count in counts)
    return [TrustRecord(place, method.name, off / sure, sure_right / right, float(np.median(ratios)))]


def trust_counts(shot: Shot, truth: HeadCapture) -> tuple[int, int, int, int]:
    """Confident pixels, those of them that are off, right pixels, those of them that are confident."""
    right = np.abs(disparity_error_px(shot.depth_m, truth)) <= OUTLIER_PX
    sure = shot.confidence > SURE
    return int(sure.sum()), int((sure & ~right).sum()), int(right.sum()), int((sure & right).sum())


def error_by_sigma(shot: Shot, truth: HeadCapture) -> float:
    """Typical depth error by the predicted standard deviation, away from edges; 1 where the prediction is right."""
    away = truth.covisible & np.isfinite(shot.depth_m) & ~near_edges(truth)
    errors = np.abs(shot.depth_m - truth.depth_m)[away] / shot.depth_sigma_m[away]
    return float(np.median(errors)) / MEDIAN_SIGMAS
