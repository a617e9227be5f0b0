"""The paper's method from images to depth, on scenes with exact truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numba
import numpy as np
import pytest
from edge_rigs import rig_with_projector

from moire_sensor.edge_depth import EdgeShot, fringe_edges
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.errors import ImageError, SettingsError
from moire_sensor.paper_rig import PROJECTOR_SIZE, PROJECTOR_X_M, paper_pattern, paper_rig
from moire_sensor.rig import StereoRig
from moire_sensor.shot import UNKNOWN_ORDER, Status
from moire_sim.analytic_scenes import AnalyticScene, analytic_capture, analytic_scene_names
from moire_sim.analytic_surfaces import Relief
from moire_sim.capture import HeadCapture
from moire_sim.fringe_image import Light
from tools.figures.stage import rig_of_rows

RANGE_M = (0.5, 2.0)
Triple = tuple[float, float, float]
SCENES = analytic_scene_names()
# The coverage run switches the compiler off: one scene with a few rows solved is then enough.
whole_scene = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="a whole scene takes a minute uncompiled")


@cache
def captured(name: str) -> HeadCapture:
    return analytic_capture(name)


@cache
def measured(name: str, rows: int = 1) -> EdgeShot:
    return of(captured(name), EdgeSettings(rows=rows))


def of(capture: HeadCapture, settings: EdgeSettings | None = None) -> EdgeShot:
    return fringe_edges(capture.left, capture.right, capture.rig, capture.pattern, RANGE_M, settings)


def truth_at(result: EdgeShot, capture: HeadCapture) -> tuple[np.ndarray, np.ndarray]:
    """Disparity error of each point, pixels, and whether the pixel nearest to it is co-visible."""
    points = result.points
    column = np.floor(points.left_x_px + 0.5).astype(int)
    true_px = capture.rig.disparity_px(capture.depth_m[points.row, column])
    return points.disparity_px - true_px, capture.covisible[points.row, column]


def check_aim(result: EdgeShot, capture: HeadCapture, *, wrong_order: float) -> None:
    """Issue 3: >= 99 % of the points within 1 px, a fringe order wrong in <= 0.1 % of them, poles apart."""
    error_px, covisible = truth_at(result, capture)
    assert np.mean(np.abs(error_px[covisible]) <= 1.0) >= 0.99
    # One order is 38 px of disparity seen from the right camera and 29.6 px from the left one: half of the less.
    assert np.mean(np.abs(error_px[covisible]) > 14.8) <= wrong_order
    # What is not co-visible has no depth to be had: at most 1 in 1000 points may lie there and be wrong.
    assert np.mean(~covisible & ~(np.abs(error_px) <= 1.0)) <= 1e-3


@whole_scene
@pytest.mark.parametrize("name", SCENES)
def test_points_are_right(name: str) -> None:
    capture, result = captured(name), measured(name)
    check_aim(result, capture, wrong_order=0.01 if name == "thin_poles" else 0.001)
    # Two edges a period on co-visible pixels; the ordering constraint and cut fringes cost some beside depth jumps.
    possible = capture.covisible.sum() / (capture.pattern.period_px / 2.0)
    assert truth_at(result, capture)[1].sum() >= (0.75 if name == "thin_poles" else 0.9) * possible


@whole_scene
@pytest.mark.parametrize("name", [name for name in SCENES if name.startswith(("plane", "tilt", "small"))])
def test_predicted_sigma_matches_the_error(name: str) -> None:
    result = measured(name)
    error_px, covisible = truth_at(result, captured(name))
    sigma_px = result.points.depth_sigma_m / result.points.depth_m**2 * (paper_rig().fx_px * paper_rig().baseline_m)
    normal = covisible & (np.abs(error_px) < 1.0)
    # Issue 3: within 20 %. The truth at the nearest pixel is off by up to half a pixel of slope: 0.03 px at 0.5.
    assert 1.4826 * np.median(np.abs(error_px / sigma_px)[normal]) == pytest.approx(1.0, abs=0.2)


@whole_scene
@pytest.mark.parametrize("name", SCENES)
def test_fringe_orders_are_those_of_the_pattern(name: str) -> None:
    capture, points = captured(name), measured(name).points
    error_px, _ = truth_at(measured(name), capture)
    x, z = points.left_x_px, points.depth_m
    pixels = np.stack([x, points.row, np.ones_like(x)])
    rays = np.linalg.solve(capture.rig.P_left[:, :3], pixels)
    column = capture.rig.projector_pixels((rays * z).T)[:, 0]
    # An edge lies a quarter of a period inside its order; 1.2 px of mismatch are far less.
    assert np.array_equal(points.fringe_order, capture.pattern.order_at(column))
    assert np.median(np.abs(error_px)) < 0.2


def slanted_board(slope_x: float) -> HeadCapture:
    """A few rows of a board at 0.6 m."""
    board = AnalyticScene.of((Relief(0.6, slope_x=slope_x, slope_y=0.05),), 0.0, rig_of_rows(48), PROJECTOR_SIZE)
    light = Light(offset=80.0, amplitude=70.0, blur_px=0.5)
    left, right = board.images(paper_pattern(), [light], noise=1.5)
    return HeadCapture(left, right, board.depth_m, board.covisible, board.lit, board.rig, paper_pattern())


@whole_scene
@pytest.mark.parametrize("slope_x", [0.10, 0.15, 0.26])
def test_a_slanted_board_is_not_taken_for_one_three_orders_farther(slope_x: float) -> None:
    """At 0.6 m the fringes of a slanted board come closer, and those three orders off lie within the tolerance."""
    capture = slanted_board(slope_x)
    result = of(capture)
    check_aim(result, capture, wrong_order=0.001)
    # Two edges a period, as on any scene: none is lost for the doubt.
    possible = capture.covisible.sum() / (capture.pattern.period_px / 2.0)
    assert truth_at(result, capture)[1].sum() >= 0.9 * possible
    as_the_paper = of(capture, EdgeSettings(lambda_off=0.0, doubtful_share=2.0))
    error_px, _ = truth_at(as_the_paper, capture)
    assert np.mean(np.abs(error_px) > 14.8) > 0.9


@whole_scene
@pytest.mark.parametrize("slope_x", [0.19, 0.20, 0.21, 0.22])
def test_two_boards_that_fit_one_exposure_are_ambiguous(slope_x: float) -> None:
    """Seven left fringes are there as wide as three candidates: J prefers the farther board, which shares more edges.

    Only the images' borders would tell the two apart.
    """
    capture = slanted_board(slope_x)
    result = of(capture)
    assert result.points.row.size <= 0.01 * capture.covisible.sum() / (capture.pattern.period_px / 2.0)
    assert np.isnan(result.shot.depth_m).mean() > 0.999
    # Between the edges it always is; at them it tells that there is a match.
    assert np.mean(result.shot.status[:, 100:] == Status.AMBIGUOUS) > 0.95


def test_shot_holds_every_point_at_the_pixel_nearest_to_it() -> None:
    result = measured("small_plate", 16)
    shot, points = result.shot, result.points
    column = np.floor(points.left_x_px + 0.5).astype(int)
    known = np.zeros(shot.depth_m.shape, dtype=bool)
    known[points.row, column] = True
    assert known.sum() == points.row.size
    assert np.array_equal(known, np.isfinite(shot.depth_m))
    assert np.array_equal(known, shot.status == Status.OK)
    assert np.array_equal(known, shot.fringe_order != UNKNOWN_ORDER)
    assert np.array_equal(known, np.isfinite(shot.depth_sigma_m))
    np.testing.assert_array_equal(shot.depth_m[points.row, column], points.depth_m.astype(np.float32))
    np.testing.assert_allclose(shot.disparity_px[known], paper_rig().disparity_px(shot.depth_m[known]), rtol=1e-6)
    assert shot.confidence.min() >= 0.0
    assert shot.confidence.max() <= 1.0
    assert np.all(shot.confidence[~known] == 0.0)
    assert {value.dtype.name for value in (shot.depth_m, shot.depth_sigma_m, shot.background)} == {"float32"}


@whole_scene
@pytest.mark.parametrize("rows", [4, 16])
@pytest.mark.parametrize("name", [name for name in SCENES if name in ("waves", "spheres", "stairs", "small_plate")])
def test_following_rows_keeps_the_accuracy_and_nearly_all_points(name: str, rows: int) -> None:
    capture, result = captured(name), measured(name, rows)
    check_aim(result, capture, wrong_order=0.001)
    assert result.points.row.size >= 0.97 * measured(name).points.row.size


@whole_scene
def test_result_is_the_same_every_time() -> None:
    capture = captured("small_plate")
    first, second = measured("small_plate"), of(capture)
    for name in ("row", "left_x_px", "right_x_px", "depth_m", "fringe_order"):
        assert np.array_equal(getattr(first.points, name), getattr(second.points, name))


@whole_scene
def test_sixteen_bits_scale_to_the_same_points() -> None:
    capture, first = captured("small_plate"), measured("small_plate")
    wide = [(image.astype(np.uint16) * 16).astype(np.uint16) for image in (capture.left, capture.right)]
    second = fringe_edges(*wide, capture.rig, capture.pattern, RANGE_M, saturation_level=255.0 * 16.0)
    assert np.array_equal(first.points.row, second.points.row)
    np.testing.assert_allclose(second.points.left_x_px, first.points.left_x_px, atol=1e-3)


@whole_scene
def test_depth_scales_with_the_rig() -> None:
    capture, first = captured("small_plate"), measured("small_plate")
    larger = [matrix * np.array([1.0, 1.0, 1.0, 3.0]) for matrix in (capture.rig.P_right, capture.rig.P_projector)]
    rig = StereoRig.from_projections(capture.rig.P_left, *larger, capture.rig.image_size)
    second = fringe_edges(capture.left, capture.right, rig, capture.pattern, (1.5, 6.0))
    assert np.array_equal(first.points.row, second.points.row)
    np.testing.assert_allclose(second.points.depth_m, 3.0 * first.points.depth_m, rtol=1e-9)


@whole_scene
def test_a_step_of_the_programme_moves_the_fringes_not_the_depth() -> None:
    pattern = paper_pattern(4)
    capture = analytic_capture("small_plate", pattern)
    result = fringe_edges(capture.left[3], capture.right[3], capture.rig, pattern, RANGE_M, first_step=3)
    check_aim(result, capture, wrong_order=0.001)
    first = analytic_capture("small_plate")
    plain = truth_at(of(first), first)[1].sum()
    assert truth_at(result, capture)[1].sum() == pytest.approx(plain, rel=0.02)


@whole_scene
@pytest.mark.parametrize(
    ("angles_rad", "place_m"),
    [((0.0, 0.0, np.pi), (PROJECTOR_X_M, 0.0, 0.0)), ((0.02, -0.05, 0.1), (0.2, 0.02, -0.02))],
    ids=["upside_down", "outside"],
)
def test_the_projector_may_be_anywhere(angles_rad: Triple, place_m: Triple) -> None:
    capture = analytic_capture("cylinder_and_box", rig=rig_with_projector(angles_rad, place_m))
    result = of(capture)
    check_aim(result, capture, wrong_order=0.005)
    assert result.points.row.size > 15000


@whole_scene
@pytest.mark.parametrize("variant", ["square", "gamma", "amplitude_20"])
def test_other_waves_and_low_contrast(variant: str) -> None:
    """Issue 3 allows three times the limits here; the scene needs them not."""
    square = replace(paper_pattern(), waveform="square")
    capture = {
        "square": lambda: analytic_capture("cylinder_and_box", square),
        "gamma": lambda: analytic_capture("cylinder_and_box", gamma=2.2),
        "amplitude_20": lambda: analytic_capture("cylinder_and_box", amplitude=20.0),
    }[variant]()
    error_px, covisible = truth_at(of(capture), capture)
    assert covisible.sum() > 26000
    assert np.mean(np.abs(error_px[covisible]) <= 1.0) >= 0.97
    assert np.mean(np.abs(error_px[covisible]) > 14.8) <= 0.001


@whole_scene
def test_a_pole_is_kept_or_left_out_but_not_moved() -> None:
    """Poles 20 mm wide in front of a wall break the ordering constraint: what cannot be ordered has no depth."""
    capture, result = captured("thin_poles"), measured("thin_poles")
    error_px, covisible = truth_at(result, capture)
    on_pole = capture.depth_m[result.points.row, np.floor(result.points.left_x_px + 0.5).astype(int)] < 1.2
    pole = covisible & on_pole
    share = pole.sum() / ((capture.covisible & (capture.depth_m < 1.2)).sum() / (capture.pattern.period_px / 2.0))
    # Seen: four fifths of the nearest pole, next to nothing of the other two.
    assert 0.1 < share < 0.9
    assert np.mean(np.abs(error_px[pole]) > 14.8) <= 0.01


def test_images_without_fringes_give_no_points() -> None:
    generator = np.random.default_rng(1)
    constant = np.full((480, 640), 128, dtype=np.uint8)
    saturated, dark = np.full((480, 640), 255, dtype=np.uint8), np.zeros((480, 640), dtype=np.uint8)
    noise = np.clip(128 + 4 * generator.standard_normal((480, 640)), 0, 255).astype(np.uint8)
    for image, status in ((constant, Status.UNLIT), (saturated, Status.SATURATED), (dark, Status.UNLIT), (noise, None)):
        result = fringe_edges(image, image, paper_rig(), paper_pattern(), RANGE_M)
        assert result.points.row.size == 0
        assert np.isnan(result.shot.depth_m).all()
        assert status is None or np.all(result.shot.status == status)


@whole_scene
def test_half_an_image_still_gives_the_other_half() -> None:
    capture = captured("small_plate")
    left = capture.left.copy()
    left[:, :320] = 0
    result = fringe_edges(left, capture.right, capture.rig, capture.pattern, RANGE_M)
    check_aim(result, capture, wrong_order=0.001)
    assert result.points.left_x_px.min() >= 319.0
    assert result.points.row.size > 15000


@whole_scene
def test_swapped_cameras_and_a_wrong_period_show_in_the_mismatch() -> None:
    """On a plane nearly every edge still finds a wrong partner, about 0.6 px off; on a scene with depth few do."""
    capture, right = captured("small_plate"), measured("small_plate").shot
    finer = replace(capture.pattern, period_px=capture.pattern.period_px * 0.9)
    wrong = [
        fringe_edges(capture.right, capture.left, capture.rig, capture.pattern, RANGE_M).shot,
        fringe_edges(capture.left, capture.right, capture.rig, finer, RANGE_M).shot,
    ]
    assert np.mean(right.confidence[right.status == Status.OK] > 0.9) > 0.85
    for shot in wrong:
        assert np.sum(shot.confidence > 0.9) < 0.01 * np.sum(right.confidence > 0.9)
        assert not shot.typical_mismatch_rad < 5.0 * right.typical_mismatch_rad


def test_bad_input_is_refused() -> None:
    image, rig, pattern = captured("small_plate").left, paper_rig(), paper_pattern()
    with pytest.raises(ImageError, match=r"left image has shape \(2, 480, 640\)"):
        fringe_edges(np.stack([image, image]), image, rig, pattern, RANGE_M)
    with pytest.raises(ImageError, match="right image is float64; give uint8 or uint16"):
        fringe_edges(image, image.astype(float), rig, pattern, RANGE_M)  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match=r"depth_range_m is \(2\.0, 0\.5\)"):
        fringe_edges(image, image, rig, pattern, (2.0, 0.5))
    with pytest.raises(SettingsError, match=r"saturation_level is 0\.0"):
        fringe_edges(image, image, rig, pattern, RANGE_M, saturation_level=0.0)
