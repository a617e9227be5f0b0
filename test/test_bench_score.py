"""The benchmark's path from known depth images to figures: right ones, wrong ones, missing ones, invented ones."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sim.analytic_scenes import AnalyticScene, scene_surfaces
from moire_sim.analytic_surfaces import Box, Relief
from moire_sim.capture import HeadCapture
from moire_sim.score import near_edges
from tools.bench.accuracy import Record, part_record, record, truth_of
from tools.bench.conditions import CONDITIONS, DEFAULT, ILLUMINATION
from tools.bench.figures import FIGURES, condition_rows, not_ahead, scene_rows, score_table
from tools.bench.makers import (
    PLATE_SIZE_M,
    STEP_M,
    distance_error_mm,
    planarity_mm,
    point_precision_mm,
    step_m,
    width_m,
)

PLATE_M = 1.0


@pytest.fixture(scope="module")
def truth() -> HeadCapture:
    """Plate of known size, a known step before a wall."""
    plate = Box((0.0, 0.0, PLATE_M + PLATE_SIZE_M[2] / 2.0), PLATE_SIZE_M)
    return truth_of(AnalyticScene.of((Relief(PLATE_M + STEP_M), plate)))


def off_by(truth: HeadCapture, disparity_px: float) -> np.ndarray:
    """Return the true depth, its disparity made larger."""
    return truth.rig.depth_m(truth.rig.disparity_px(truth.depth_m) + disparity_px).astype(np.float32)


def values(truth: HeadCapture, depth: np.ndarray) -> dict[str, float]:
    """Return the figures of a depth image as the tables get them."""
    (row,) = scene_rows([record("plate", DEFAULT, "known", depth.astype(np.float32), truth)])
    return dict(zip((name for name, *_ in FIGURES), row.values, strict=True))


def test_the_truth_is_perfect_where_it_can_be_seen(truth: HeadCapture) -> None:
    found = values(truth, np.where(truth.covisible, truth.depth_m, np.nan))
    shares = ("completeness", "completeness_away", "right_share")
    assert all(found[name] == (1.0 if name in shares else 0.0) for name in found)


def test_a_known_error_missing_pixels_and_ghosts_are_counted_as_such(truth: HeadCapture) -> None:
    depth = np.where(truth.covisible, off_by(truth, 0.5), np.nan)
    rows = np.arange(480)[:, None]
    depth = np.where((rows < 100) & truth.covisible, off_by(truth, 1.5), depth)
    depth = np.where((rows >= 200) & (rows < 300), np.nan, depth)
    depth = np.where((rows >= 400) & ~truth.covisible, off_by(truth, 5.0), depth)
    found = values(truth, depth)
    missing = truth.covisible[200:300].sum()
    assert found["completeness"] == pytest.approx(1.0 - missing / truth.covisible.sum())
    assert found["outlier_share"] == pytest.approx(truth.covisible[:100].sum() / (truth.covisible.sum() - missing))
    right = truth.covisible.sum() - missing - truth.covisible[:100].sum()
    assert found["right_share"] == pytest.approx(right / truth.covisible.sum())
    assert found["ghost_share"] == pytest.approx((~truth.covisible[400:]).sum() / truth.covisible.size)
    # Half a pixel at 1 m is B f / d^2 / 2 = 4.25 mm, scaled by the depth's square; 1 % for the error's curvature.
    scale = 1.0 / (truth.rig.fx_px * truth.rig.baseline_m)
    assert found["median_error_mm"] == pytest.approx(500.0 * scale, rel=0.01)


def test_wrong_only_beside_edges_is_told_apart(truth: HeadCapture) -> None:
    depth = np.where(truth.covisible, np.where(near_edges(truth), off_by(truth, 2.0), truth.depth_m), np.nan)
    found = values(truth, depth)
    assert found["outlier_share_away"] == 0.0
    assert found["outlier_share_near"] == 1.0


def test_poles_are_scored_alone_and_left_out_of_the_means() -> None:
    poles = truth_of(AnalyticScene.of(scene_surfaces("thin_poles")))
    depth = np.where(poles.covisible & (poles.depth_m > 1.3), poles.depth_m, np.nan).astype(np.float32)
    whole = record("thin_poles", DEFAULT, "known", depth, poles)
    alone = part_record("thin_poles", "known", depth, poles)
    assert whole.score.completeness > 0.5
    assert alone.score.completeness == 0.0
    assert [row.values[0] for row in scene_rows([whole, alone])] == [whole.score.completeness, 0.0]
    (mean,) = condition_rows([whole, alone])
    assert mean.values[0] == whole.score.completeness


def test_known_dimensions_come_back(truth: HeadCapture) -> None:
    depth = np.where(truth.covisible, truth.depth_m, np.nan).astype(np.float32)
    assert step_m(depth, truth) == pytest.approx(STEP_M, abs=1e-6)
    # The plate's borders fall between pixels: one pixel is 0.8 mm.
    assert width_m(truth.depth_m, truth) == pytest.approx(PLATE_SIZE_M[0], abs=1e-3)
    assert np.isnan(width_m(np.full_like(depth, np.nan), truth))
    moved = np.where(truth.depth_m < PLATE_M + STEP_M / 2.0, depth - 0.002, depth)
    assert step_m(moved, truth) == pytest.approx(STEP_M + 0.002, abs=1e-6)


def test_precision_and_planarity_of_known_noise() -> None:
    board = truth_of(AnalyticScene.of((Relief(1.0, 0.1, 0.05),)))
    generator = np.random.default_rng(0)
    depths = [(board.depth_m + generator.normal(0.0, 1e-3, board.depth_m.shape)).astype(np.float32) for _ in range(6)]
    # The 0.3 % worst left out take 2 % of a normal distribution's rms and 4 % of that of its variances.
    assert point_precision_mm(depths, board) == pytest.approx(1.0, rel=0.05)
    # The noise lies along the viewing rays, the distance along the normal: 0.6 % less.
    assert planarity_mm(depths[0], board) == pytest.approx(0.98, rel=0.02)
    exact = np.where(board.covisible, board.depth_m, np.nan).astype(np.float32)
    assert planarity_mm(exact, board) == pytest.approx(0.0, abs=1e-3)
    assert distance_error_mm(exact + np.float32(0.002), board) == pytest.approx(2.0, abs=1e-3)
    assert np.isnan(planarity_mm(np.full_like(exact, np.nan), board))


def test_means_over_scenes_and_the_list_of_defeats(truth: HeadCapture) -> None:
    seen = np.where(truth.covisible, truth.depth_m, np.nan)
    half = np.where(np.arange(480)[:, None] < 240, seen, np.nan)
    records: list[Record] = [
        record(scene, DEFAULT, method, depth.astype(np.float32), truth)
        for scene in ("one", "two")
        for method, depth in (("dense", half if scene == "one" else seen), ("phase_shift", seen), ("peer", seen))
    ]
    by_method = {row.method: row.values[0] for row in condition_rows(records)}
    own_share = truth.covisible[:240].sum() / truth.covisible.sum()
    assert by_method["dense"] == pytest.approx((own_share + 1.0) / 2.0)
    table = not_ahead("", "", "scene", scene_rows(records), ["peer"])
    figures = ("complete %", "complete away %", "right %")
    assert [row[:2] for row in table.rows] == [("one", figure) for figure in figures]
    assert table.rows[0][2].endswith(" *")
    assert table.rows[0][3:] == ("100.00", "100.00", "peer")
    text = score_table("title", "note", "scene", scene_rows(records)).as_markdown()
    assert text.count("\n| ") == 2 + len(records)


def test_no_condition_saturates_white() -> None:
    for condition in (*CONDITIONS, *ILLUMINATION):
        for light in condition.lights(4):
            assert light.ambient + light.offset + light.amplitude <= 240.0
