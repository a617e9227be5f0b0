"""Scenes that nobody chose: posts of 20 mm at random places before a wall, which is where fringes are weakest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from moire_sim.analytic_scenes import AnalyticScene
from moire_sim.analytic_surfaces import Cylinder, Relief
from moire_sim.score import score_depth
from tools.bench.accuracy import Record, depth_of, nearer_than, truth_of
from tools.bench.conditions import DEFAULT
from tools.bench.methods import Method

SEEDS = range(12)
POSTS, RADIUS_M = 3, 0.010
WALLS_M = (1.3, 1.5, 1.9)
ACROSS_M = (-0.20, 0.25)
# Nearest and farthest post, the latter as distance before the wall.
NEAREST_M, BEFORE_WALL_M = 0.6, 0.15
PLACES = ("whole scenes", "posts alone")


def scene_of(seed: int) -> tuple[AnalyticScene, float]:
    """Three posts before a wall, drawn from ``default_rng(seed)``, and the distance of the wall."""
    rng = np.random.default_rng(seed)
    wall_m = float(rng.choice(WALLS_M))
    farthest_m = wall_m - BEFORE_WALL_M
    posts = tuple(
        Cylinder(float(rng.uniform(*ACROSS_M)), float(rng.uniform(NEAREST_M, farthest_m)), RADIUS_M, -1.0, 1.0)
        for _ in range(POSTS)
    )
    return AnalyticScene.of((Relief(wall_m), *posts)), wall_m


def post_records(seed: int, methods: Sequence[Method]) -> list[Record]:
    """Score all methods on one scene, whole and where posts are; the records' conditions are ``PLACES``."""
    scene, wall_m = scene_of(seed)
    whole = truth_of(scene)
    posts = nearer_than(whole, wall_m - 0.5 * BEFORE_WALL_M)
    records = []
    for method in methods:
        depth_m = depth_of(method, scene, DEFAULT, seed)
        for place, truth in zip(PLACES, (whole, posts), strict=True):
            if truth.covisible.any():
                records.append(Record(f"posts {seed}", place, method.name, score_depth(depth_m, truth)))
    return records
