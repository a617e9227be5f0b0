"""Row offset and fringe period measured on exact scenes whose offset and period are known."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from moire_sensor import FringePattern, Reconstructor
from moire_sensor.paper_rig import PERIOD_PX
from moire_sensor.ros.thresholds import Thresholds
from moire_sensor.view_alignment import Alignment, measure_alignment
from moire_sim.analytic_scenes import analytic_capture

RANGE_M = (0.5, 2.0)


@cache
def capture(scene: str, texture: float = 0.0, amplitude: float = 70.0) -> Any:
    return analytic_capture(scene, texture=texture, amplitude=amplitude)


def measured(scene: Any, rows: float = 0.0, pattern: FringePattern | None = None) -> Alignment:
    """The right image moved down by ``rows``, the period as ``pattern`` tells."""
    pattern = pattern or scene.pattern
    move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, rows]])
    right = cv2.warpAffine(
        scene.right, move, scene.right.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    depth_m = Reconstructor(scene.rig, pattern, RANGE_M).reconstruct(scene.left, right).depth_m
    return measure_alignment(scene.rig, pattern, scene.left, right, depth_m, RANGE_M)


@pytest.mark.parametrize("scene", ["plane_1000", "cylinder_and_box", "tilt_0.5"])
@pytest.mark.parametrize("rows", [0.0, 0.5, -1.5, 3.0])
def test_a_row_offset_is_found_on_texture_to_a_fiftieth_of_a_row(scene: str, rows: float) -> None:
    """Also where rows apart cost the depth at just those edges that tell rows; a twenty-fifth of what is warned of."""
    assert measured(capture(scene, 0.5), rows).row_offset_px == pytest.approx(rows, abs=0.02)


@pytest.mark.parametrize("rows", [0.0, 2.0])
def test_a_white_wall_does_not_show_rows_and_nothing_is_claimed(rows: float) -> None:
    assert math.isnan(measured(capture("plane_1000"), rows).row_offset_px)


@pytest.mark.parametrize("scene", ["plane_600", "tilt_0.5", "slope_1.2", "waves", "cylinder_and_box", "stairs"])
def test_a_right_period_is_right_on_every_slope(scene: str) -> None:
    """Half a percent, what edges of shade leave, is an eighth of what is warned of."""
    assert abs(measured(capture(scene)).period_error) < 0.005


@pytest.mark.parametrize("scene", ["plane_1000", "tilt_0.5", "waves", "cylinder_and_box"])
def test_checked_texture_moves_the_period_by_less_than_half_of_what_is_warned_of(scene: str) -> None:
    assert abs(measured(capture(scene, 0.5)).period_error) < 0.5 * Thresholds.warn_period_error


@pytest.mark.parametrize("error", [-0.1, -0.03, 0.03, 0.1])
def test_a_wrong_period_is_found_though_no_depth_is_left(error: float) -> None:
    told = FringePattern(PERIOD_PX / (1.0 + error))
    assert measured(capture("plane_1000"), pattern=told).period_error == pytest.approx(error, abs=0.002)
    # The slope of the scene changes its period by 2.6 % (physics), and no depth is there to tell.
    assert measured(capture("tilt_0.5"), pattern=told).period_error == pytest.approx(error, abs=0.03)


def test_a_picture_without_fringes_has_no_period() -> None:
    scene = capture("plane_1000")
    noise = np.random.default_rng(0).integers(90, 110, scene.left.shape, dtype=np.uint8)
    unknown_m = np.full(scene.left.shape, np.nan, dtype=np.float32)
    found = measure_alignment(scene.rig, scene.pattern, noise, noise, unknown_m, RANGE_M)
    assert math.isnan(found.period_error)
    assert math.isnan(found.row_offset_px)
