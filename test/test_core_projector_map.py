"""ProjectorMap against projected points, its compiled twins, and the projector's lens against OpenCV."""

from __future__ import annotations

import numpy as np
import pytest
from core_rigs import SIZE, Array, intrinsic, projection, random_world, rotation, seen_points
from hypothesis import given, settings
from hypothesis import strategies as st

from moire_sensor.errors import RigError
from moire_sensor.paper_rig import PROJECTOR_CX_PX, PROJECTOR_X_M, paper_pattern, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.projector_lens import ShiftTable
from moire_sensor.projector_map import ProjectorMap, disparity_of_phase, phase_of_disparity
from moire_sensor.rig import StereoRig

few = settings(derandomize=True, deadline=None, max_examples=25)
seeds = st.integers(0, 2**32 - 1)
PATTERN = FringePattern(16.665, 0.7)
DEVICE = (960, 480)
LENSES = {
    "barrel": (-0.2, 0.1, 0.001, -0.001, 0.0),
    "pincushion": (0.3, 0.1, 0.0, 0.0),
    "rational": (0.3, -0.1, 0.001, 0.0005, 0.05, 0.1, 0.02, 0.01),
    "weak": (0.01, 0.0, 0.0, 0.0),
}


@few
@given(seeds)
def test_column_is_the_one_that_the_point_projects_to(seed: int) -> None:
    rig = random_world(seed).rig()
    x, y, depth_m, points = seen_points(np.random.default_rng(seed), rig, 200)
    projector = ProjectorMap.build(rig, PATTERN)
    expected = rig.projector_pixels(points)[:, 0]
    scale = np.maximum(np.abs(expected), 1.0)
    found = projector.column_px(x, y, rig.disparity_px(depth_m))
    known = np.isfinite(expected)
    assert known.mean() > 0.9
    assert (np.abs(found - expected) / scale)[known].max() < 1e-9
    phase = projector.phase_rad_at(x, y, rig.disparity_px(depth_m))
    np.testing.assert_allclose(phase[known], PATTERN.phase_at(expected)[known], rtol=1e-9, atol=1e-7)


def test_the_paper_rig_by_hand() -> None:
    projector = ProjectorMap.build(paper_rig(), paper_pattern())
    # the column moves by the projector's share of the disparity, 53 of 94 mm
    x, disparity_px = np.array([100.0, 320.0]), np.array([90.0, 120.0])
    expected = x + PROJECTOR_CX_PX - 323.54041 - disparity_px * PROJECTOR_X_M / 0.094
    np.testing.assert_allclose(projector.column_px(x, np.array([0.0, 400.0]), disparity_px), expected, rtol=1e-12)
    assert projector.packed().shape == (10,)


def lens_rig(lens: tuple[float, ...], turned: bool = False) -> StereoRig:
    paper = paper_rig()
    K = intrinsic(1249.9, 1254.9, 483.5, 221.6)
    turn = rotation(6.0, -8.0, 172.0) if turned else np.eye(3)
    place = np.array([0.15, 0.05, 0.01]) if turned else np.array([PROJECTOR_X_M, 0.0, 0.0])
    P = projection(K, turn, place)
    return StereoRig.from_projections(paper.P_left, paper.P_right, P, SIZE, lens, K, DEVICE)


def lit_points(rig: StereoRig) -> tuple[Array, Array, Array, Array]:
    """Left pixels, disparities and device columns of points on which the projector throws a pixel."""
    x, y, depth_m, points = seen_points(np.random.default_rng(0), rig, 4000)
    device = rig.projector_pixels(points)
    lit = ((device >= 0.0) & (device <= np.array(DEVICE) - 1.0)).all(axis=1)
    assert lit.mean() > 0.3
    return x[lit], y[lit], rig.disparity_px(depth_m)[lit], device[lit, 0]


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", LENSES)
def test_a_lens_is_honoured_both_ways(name: str, turned: bool) -> None:
    rig = lens_rig(LENSES[name], turned)
    projector = ProjectorMap.build(rig, PATTERN)
    x, y, disparity_px, device = lit_points(rig)
    ideal = ProjectorMap.build(lens_rig((), turned), PATTERN).column_px(x, y, disparity_px)
    assert np.abs(ideal - device).max() > 0.5, "a lens that does nothing tests nothing"
    # the limit; the tables promise 0.002 px
    assert np.abs(projector.column_px(x, y, disparity_px) - device).max() < 0.01
    back = projector.disparity_px_at(x, y, PATTERN.phase_at(device))
    nearer, farther = (projector.column_px(x, y, disparity_px + d) for d in (0.5, -0.5))
    assert (np.abs(back - disparity_px) * np.abs(nearer - farther)).max() < 0.01


@pytest.mark.parametrize("lens", [(), LENSES["barrel"]])
def test_compiled_twins_agree(lens: tuple[float, ...]) -> None:
    rig = lens_rig(lens, turned=True)
    projector = ProjectorMap.build(rig, PATTERN)
    packed = projector.packed()
    x, y, disparity_px, device = (values[:300] for values in lit_points(rig))
    phase = PATTERN.phase_at(device)
    slow, slope = projector.phase_rad_at(x, y, disparity_px), np.empty(300)
    for i in range(300):
        found, slope[i] = phase_of_disparity(packed, x[i], y[i], disparity_px[i])
        assert found == pytest.approx(slow[i], abs=1e-9)
        back = disparity_of_phase(packed, x[i], y[i], phase[i])
        assert back == pytest.approx(float(projector.disparity_px_at(x[i], y[i], phase[i])), abs=1e-9)
    step = projector.phase_rad_at(x, y, disparity_px + 1e-5) - projector.phase_rad_at(x, y, disparity_px - 1e-5)
    # all but the few whose step crosses from one cell of the table to the next
    assert np.quantile(np.abs(step / 2e-5 - slope), 0.98) < 1e-6


def test_without_a_lens_there_and_back_is_exact() -> None:
    rig = random_world(7).rig()
    x, y, depth_m, _ = seen_points(np.random.default_rng(0), rig, 500)
    projector = ProjectorMap.build(rig, PATTERN)
    disparity_px = rig.disparity_px(depth_m)
    back = projector.disparity_px_at(x, y, projector.phase_rad_at(x, y, disparity_px))
    np.testing.assert_allclose(back, disparity_px, atol=1e-6)


@pytest.mark.parametrize("lens", [(), LENSES["barrel"]])
def test_unknown_stays_unknown(lens: tuple[float, ...]) -> None:
    projector = ProjectorMap.build(lens_rig(lens), PATTERN)
    packed = projector.packed()
    assert np.isnan(projector.column_px(np.array([3.0]), np.array([3.0]), np.array([np.nan]))).all()
    assert np.isnan(projector.disparity_px_at(np.array([3.0]), np.array([3.0]), np.array([np.nan]))).all()
    assert np.isnan(disparity_of_phase(packed, 3.0, 3.0, np.nan))
    assert np.isnan(phase_of_disparity(packed, 3.0, 3.0, np.nan)[0])
    for far in (-1e7, 1e7):
        assert np.isfinite(disparity_of_phase(packed, 3.0, 3.0, far))
        assert np.isfinite(phase_of_disparity(packed, 3.0, 3.0, far)[0])


@pytest.mark.parametrize("lens", [(-3.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.5, 2.0), (50.0, 0.0, 0.0, 0.0)])
def test_a_lens_that_folds_its_image_is_refused(lens: tuple[float, ...]) -> None:
    with pytest.raises(RigError, match=r"folds or tears its image of .960, 480. pixels; calibrate again"):
        ProjectorMap.build(lens_rig(lens), PATTERN)


def test_tables_are_bilinear_and_constant_outside() -> None:
    table = ShiftTable(10.0, 20.0, 4.0, np.array([[0.0, 4.0, 8.0], [8.0, 12.0, 16.0]]))
    columns = np.array([10.0, 12.0, 16.0, 18.0, 18.0, -5.0, 99.0, 99.0, 10.0])
    rows = np.array([20.0, 20.0, 22.0, 24.0, 20.0, -5.0, 99.0, 20.0, 99.0])
    np.testing.assert_allclose(table.at(columns, rows), [0.0, 2.0, 10.0, 16.0, 8.0, 0.0, 16.0, 8.0, 8.0])
