"""The numbers of the paper's experiments, each against what physics or the exact scene says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from moire_sensor.paper_rig import PERIOD_PX
from moire_sensor.rig import StereoRig
from moire_sim.fringe_image import Light
from tools.figures import board_shift, candidates, convex, free_form, gratings, rig_plan, small_board, solids, speed_up
from tools.figures.shapes import face_angle_deg, sine_amplitudes_mm, upright_cylinder
from tools.figures.stage import RIGHT_BASE_M, TURN, rig_focal_px, rig_of_rows, shift_px
from tools.figures.surface_methods import SurfaceResult

FEW_ROWS = 64
FOCAL_PX = 1249.89117
# Phase of one pixel: noise of 1.5 grey levels under a triangle two periods wide (2 / (3 T) of its power, both parts).
PHASE_SIGMA_RAD = 1.5 / Light().amplitude * math.sqrt(2.0 * 2.0 / (3.0 * PERIOD_PX))
# Fringe analysis at the ends of a row, where its window is cut: test_reference_phase.
CUT_WINDOW_PX = 2e-3 / TURN * PERIOD_PX


@pytest.fixture(scope="module")
def rig() -> StereoRig:
    return rig_of_rows(FEW_ROWS)


@pytest.fixture(scope="module")
def surface() -> SurfaceResult:
    return free_form.measure()


@pytest.fixture(scope="module")
def solid() -> SurfaceResult:
    return solids.measure(rig_of_rows(200))


def test_rig_with_few_rows_keeps_the_rays() -> None:
    few, all_rows = rig_of_rows(FEW_ROWS), rig_of_rows()
    first = (480 - FEW_ROWS) // 2
    np.testing.assert_allclose(few.rays(), all_rows.rays()[first : first + FEW_ROWS], atol=1e-12)


def test_figure_8_rig_as_the_paper_states_it() -> None:
    plan = rig_plan.measure()
    assert plan.pitch_m == pytest.approx(0.020, abs=1e-12)
    assert plan.camera_deg == pytest.approx(
        math.degrees(math.atan(324.04041 / FOCAL_PX) + math.atan(315.95959 / FOCAL_PX)), abs=1e-9
    )
    # 160 more columns on either side than the cameras have; half a step of the grid of depths.
    assert plan.lit_from_m == pytest.approx(0.053 * FOCAL_PX / 160.0, abs=1e-4)
    assert plan.common_from_m == pytest.approx(0.094 * FOCAL_PX / 640.0, abs=1e-4)
    for depth, width, share in plan.common:
        assert width == pytest.approx(640.0 * depth / FOCAL_PX, rel=1e-12)
        assert share == pytest.approx(1.0 - 0.094 / width, rel=1e-12)


def test_figure_1_height_out_of_two_gratings() -> None:
    result = gratings.measure(120)
    # Equation (4) is an identity of cosines: rounding of phases of 250 radians remains.
    assert result.identity_error < 1e-12
    # The triangle, variance T^2 / 6, moves the phase by half of that times its curvature, 3 / 110^2 periods at the top.
    mm_per_period = gratings.PITCH_M / gratings.TANGENTS * 1e3
    bend_mm = gratings.PITCH_PX**2 / 12.0 * result.contours / gratings.HUMP_WIDTH_PX[0] ** 2 * mm_per_period
    noise_mm = 0.005 / gratings.C * math.sqrt(4.0 / (3.0 * gratings.PITCH_PX)) / TURN * mm_per_period
    inside = result.error_mm[:, 40:-40]
    # Five sigma for the largest of some thousand independent values.
    assert np.abs(inside).max() < bend_mm + 5.0 * noise_mm
    # The top lies between two rows and columns.
    assert result.contours == pytest.approx(3.0, abs=1e-3)


def test_figure_5_candidates_and_the_one_that_the_left_camera_confirms(rig: StereoRig) -> None:
    result = candidates.measure(rig)
    assert result.orders.tolist() == [-1.0, 0.0, 1.0, 2.0, 3.0]
    # On a ray of the right camera the shift of the fringes is k periods; four sigma of the pixel's phase.
    expected = 1.0 / (1.0 + result.orders * PERIOD_PX / (RIGHT_BASE_M * FOCAL_PX))
    sigma_m = expected**2 * PHASE_SIGMA_RAD / TURN * PERIOD_PX / (RIGHT_BASE_M * FOCAL_PX)
    assert (np.abs(result.depth_m - expected) < 4.0 * sigma_m).all()
    # Known of this rig: off by 105, 149 and 44 degrees for 1, 2 and 3 orders, to half a degree.
    np.testing.assert_allclose(np.abs(result.expected_deg), [105.0, 0.0, 105.0, 149.0, 44.0], atol=0.5)
    # Four sigma of the left phase, and of the right one, which also moves the place on the left by 94 / 41 of itself.
    limit_deg = 4.0 * math.degrees(PHASE_SIGMA_RAD) * math.hypot(1.0, 94.0 / 41.0 - 1.0)
    assert np.abs(result.mismatch_deg - result.expected_deg).max() < limit_deg
    assert result.orders[result.chosen] == 0.0


def test_figure_9_fringes_shift_by_the_geometry_and_repeat_at_755_mm(rig: StereoRig) -> None:
    series = board_shift.measure(rig)
    assert series.distance_m.tolist() == [1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6]
    # Noise of the mean phase is a tenth of this.
    assert np.abs(series.shift_px - series.expected_px).max() < CUT_WINDOW_PX
    assert (np.diff(series.shift_px) > 0.0).all()
    # 1 / z moves by the period over 41 mm f.
    for periods in (1, 2):
        exact_m = 1.0 / (1.0 + periods * PERIOD_PX / (0.041 * FOCAL_PX))
        assert series.repeat_m(periods) == pytest.approx(exact_m, abs=CUT_WINDOW_PX / (0.041 * FOCAL_PX))
    assert series.repeat_m() == pytest.approx(0.7546, abs=5e-5)
    assert series.likest_m == 0.75
    # The picture shows 38.4 periods: the cut one is 1 % of it.
    np.testing.assert_allclose(series.likeness, np.cos(TURN * series.expected_px / PERIOD_PX), atol=0.015)


def test_figure_9_what_would_make_700_mm_repeat(rig: StereoRig) -> None:
    text = board_shift.repeat_text(board_shift.measure(rig))
    assert "31.1 mm from projector" in text
    assert pytest.approx(PERIOD_PX, abs=0.03) == 0.0311 * FOCAL_PX * (1.0 / 0.7 - 1.0)
    assert "fringes of 26.4 mm" in text
    assert shift_px(0.7, 1.0) == pytest.approx(0.02635 * FOCAL_PX / 1.5, abs=0.01)
    assert "122 mm in front" in text
    assert shift_px(0.822, 1.122) == pytest.approx(PERIOD_PX, abs=0.03)
    assert "3.02 periods" in text
    assert 0.094 * rig_focal_px() * (1.0 / 0.7 - 1.0) / PERIOD_PX == pytest.approx(3.02, abs=0.005)


def test_figure_10_board_shifts_fringes_left_and_throws_a_shadow_as_wide(rig: StereoRig) -> None:
    for one in small_board.measure(rig):
        assert one.expected_px == pytest.approx(0.041 * FOCAL_PX * (1.0 / one.distance_m - 1.0 / 1.5), rel=1e-6)
        assert one.shift_px == pytest.approx(one.expected_px, abs=CUT_WINDOW_PX)
        # Half a pixel: how bright the plane is, fringe by fringe, the picture of it alone tells but for a few per cent.
        assert one.shadow_px == pytest.approx(one.expected_px, abs=0.5)
        # A board that faces the head keeps the period; the slope of a line through 100 pixels or more.
        assert one.period_px == pytest.approx(PERIOD_PX, rel=1e-4)


def test_figure_10_shadows_end_between_pixels() -> None:
    lit = np.array([90.0, 60.0, 27.0, 27.0, 50.0, 90.0] + 6 * [70.0])
    dark = small_board.SHADOW_GREY
    assert small_board.lacking_px(lit, 1.2 * lit) == pytest.approx(0.0, abs=1e-9)
    # Three pixels and a third, the last of a dark fringe; blurred, the same.
    for shares in ([1.0, 1.0, 1.0, 1.0 / 3.0], [1.0, 1.0, 0.9, 0.4, 1.0 / 30.0]):
        profile = lit - np.pad(shares, (0, lit.size - len(shares))) * (lit - dark)
        assert small_board.lacking_px(profile, 0.9 * lit) == pytest.approx(10.0 / 3.0, abs=1e-9)


def test_figure_10_convex_surface_has_longer_periods_on_the_right(rig: StereoRig) -> None:
    result = convex.measure(rig)
    known = np.isfinite(result.measured_px)
    # Half a per cent of the period, an eighth of the effect: the limbs leak into the filter's tails.
    assert np.abs(result.measured_px[known] / result.expected_px[known] - 1.0).max() < 0.005
    left, right = result.slope[known] < -0.2, result.slope[known] > 0.2
    assert result.measured_px[known][left].max() < PERIOD_PX < result.measured_px[known][right].min()
    # To first order the frequency changes by 41 mm / z times the slope; the apex is at 1.1 m. A tenth for the rest.
    for slope in (-0.5, 0.5):
        change = 1.0 - PERIOD_PX / result.at(slope, result.measured_px)
        assert change == pytest.approx(0.041 / 1.12 * slope, rel=0.1)


def test_figure_11_classic_moire_needs_its_plane_in_the_surface(surface: SurfaceResult) -> None:
    far, near = surface.outcome("reference_plane"), surface.outcome("reference_plane at 1.1 m")
    # Half a fringe of the left camera before the plane at 1500 mm is 1262 mm: the surface is nearer everywhere.
    assert np.nanmax(surface.capture.depth_m) < 1.0 / (1.0 / 1.5 + 0.5 * PERIOD_PX / (0.053 * FOCAL_PX))
    assert far.score.outlier_share == 1.0
    assert far.whole_orders > 0.99
    assert near.score.outlier_share == 0.0


@pytest.mark.parametrize("label", ["fringe_edges", "dense", "phase_shift"])
def test_figure_11_two_cameras_measure_the_sine(surface: SurfaceResult, label: str) -> None:
    outcome = surface.outcome(label)
    assert outcome.score.outlier_share < 1e-3
    # The scene's mesh of 3 and 4 mm triangles lies up to 0.02 mm inside the sine; the rest is noise of the fit.
    found = free_form.amplitudes_mm(surface, outcome)
    assert found == pytest.approx(free_form.AMPLITUDES_MM, abs=0.1)


def test_figure_11_density(surface: SurfaceResult) -> None:
    # Two edges a period.
    assert surface.outcome("fringe_edges").score.completeness == pytest.approx(2.0 / PERIOD_PX, abs=0.01)
    assert surface.outcome("dense").score.completeness > 0.99
    assert surface.outcome("phase_shift").score.completeness > 0.99


def test_figure_12_classic_moire_fails_across_jumps(solid: SurfaceResult) -> None:
    outcome = solid.outcome("reference_plane")
    solids_share = sum(mask.sum() for name, mask in solids.parts(solid).items() if name != "plane")
    # All of the solids that the parts name, and no more than what is not plane.
    assert outcome.score.outlier_share >= 0.95 * solids_share / solid.capture.covisible.sum()
    assert np.nanmedian(np.abs(outcome.error_mm[solids.parts(solid)["plane"]])) < 2.0
    assert outcome.whole_orders > 0.95


@pytest.mark.parametrize("label", ["dense", "phase_shift"])
def test_figure_12_dimensions(solid: SurfaceResult, label: str) -> None:
    radius, axis, turn, plane = solids.dimensions(solid, solid.outcome(label))
    # Round a cylinder the mesh's facets alone lie up to 0.2 mm inside; shading moves fringes by some tenths more.
    assert (radius, axis) == pytest.approx((80.0, 1200.0), abs=0.5)
    assert turn == pytest.approx(math.degrees(0.5), abs=0.1)
    assert plane == pytest.approx(1500.0, abs=0.2)
    # The demo's own limit.
    assert solid.outcome(label).score.outlier_share < 0.02


def test_figure_12_fringe_edges_find_the_solids_too(solid: SurfaceResult) -> None:
    outcome = solid.outcome("fringe_edges")
    assert outcome.score.outlier_share < 0.01
    # Noise floor of an edge at 1 m: 1.05 mm at amplitude 50 and noise 2, here 70 and 1.5; as a median. The solids are
    # lit askew, by the cosine of up to a half.
    assert outcome.score.median_error_mm < 2.0 * 0.6745 * 1.05 * (50.0 / 70.0) * (1.5 / 2.0)
    radius, axis, turn, plane = solids.dimensions(solid, outcome)
    # A pixel of disparity, 8.5 mm at 1 m, is what the score calls right: edges err where the light falls off.
    assert (radius, axis) == pytest.approx((80.0, 1200.0), abs=8.5)
    assert turn == pytest.approx(math.degrees(0.5), abs=0.5)
    assert plane == pytest.approx(1500.0, abs=0.5)


def test_propagation_between_rows_keeps_points_and_score() -> None:
    every, eighth = speed_up.measure(rig_of_rows(128), rows=(1, 8), repeats=0)
    assert every.agree == 1.0
    # Lost is what lies wholly between two solved rows: one row in a hundred at the solids' upper edges.
    assert eighth.points > 0.97 * every.points
    assert eighth.agree > 0.995
    assert eighth.score.outlier_share < 0.002
    assert math.isnan(eighth.whole_ms)


def test_fits_return_known_shapes() -> None:
    rng = np.random.default_rng(1)
    angle = rng.uniform(-1.0, 1.0, 4000)
    radius = 0.08 + rng.normal(0.0, 5e-4, angle.size)
    points = np.stack(
        [0.1 + radius * np.sin(angle), rng.uniform(-0.1, 0.1, angle.size), 1.2 - radius * np.cos(angle)], -1
    )
    points[::7] = np.nan
    # Four sigma of a circle's fit to a third of its round: about 10 sigma / sqrt(n).
    assert upright_cylinder(points) == pytest.approx((0.1, 1.2, 0.08), abs=4 * 10 * 5e-4 / math.sqrt(3400))
    x, y = rng.uniform(-0.2, 0.2, (2, 3000))
    waves = 1.1 + 0.04 * np.sin(TURN * x / 0.3 + 0.4) + 0.016 * np.sin(TURN * y / 0.45)
    assert sine_amplitudes_mm(np.stack([x, y, waves], -1), (0.3, 0.45)) == pytest.approx((40.0, 16.0), abs=1e-6)
    face = np.stack([x, y, 1.0 + math.tan(0.5) * x], -1)
    assert face_angle_deg(face) == pytest.approx(math.degrees(0.5), abs=1e-9)
