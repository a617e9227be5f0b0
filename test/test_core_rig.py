"""StereoRig: geometry against projected points, and every rig it must refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from core_rigs import SIZE, World, intrinsic, pixels, projection, random_world, rotation, seen_points
from hypothesis import given, settings
from hypothesis import strategies as st

from moire_sensor.errors import RigError
from moire_sensor.paper_rig import (
    CX_PX,
    CY_PX,
    FX_PX,
    FY_PX,
    PERIOD_PX,
    PROJECTOR_SIZE,
    REFERENCE_DEPTH_M,
    REFERENCE_FRINGE_M,
    RIGHT_X_M,
    paper_pattern,
    paper_rig,
)
from moire_sensor.projection import split_projection
from moire_sensor.rig import StereoRig

PAPER = paper_rig()
few = settings(derandomize=True, deadline=None, max_examples=25)
seeds = st.integers(0, 2**32 - 1)


def build(left: object = None, right: object = None, projector: object = None, size: object = SIZE) -> StereoRig:
    """The paper's rig with some of its parts replaced."""
    parts = (PAPER.P_left if left is None else left, PAPER.P_right if right is None else right)
    return StereoRig.from_projections(*parts, PAPER.P_projector if projector is None else projector, size)  # type: ignore[arg-type]


def test_paper_rig_is_that_of_section_4() -> None:
    assert (PAPER.fx_px, PAPER.fy_px, PAPER.centre_px) == (FX_PX, FY_PX, (CX_PX, CY_PX))
    assert PAPER.baseline_m == pytest.approx(RIGHT_X_M, rel=1e-12)
    assert PAPER.projector_size == PROJECTOR_SIZE
    # Equation (9) by hand: 1249.89117 * 0.094 / 1.0.
    assert float(PAPER.disparity_px(1.0)) == pytest.approx(117.48977, abs=1e-5)
    fringe_m = REFERENCE_DEPTH_M / FX_PX * PERIOD_PX
    assert fringe_m == pytest.approx(REFERENCE_FRINGE_M)
    assert paper_pattern(4).step_count == 4


@few
@given(seeds)
def test_any_world_frame_gives_the_same_rig(seed: int) -> None:
    world = random_world(seed)
    rig = world.rig()
    x, y, depth_m, points = seen_points(np.random.default_rng(seed), rig, 50)
    assert rig.baseline_m == pytest.approx(world.baseline_m, rel=1e-9)
    for told, kept in zip(world.projections, (rig.P_left, rig.P_right, rig.P_projector), strict=True):
        # float64 rounding of pixels of a few thousand, through a matrix inverse
        np.testing.assert_allclose(pixels(kept, points), pixels(told, world.to_world(points)), rtol=0, atol=1e-7)
    np.testing.assert_allclose(pixels(rig.P_left, points), np.stack([x, y], axis=1), atol=1e-9)
    disparity = x - pixels(rig.P_right, points)[:, 0]
    np.testing.assert_allclose(rig.disparity_px(depth_m), disparity, atol=1e-7)
    np.testing.assert_allclose(rig.depth_m(disparity), depth_m, rtol=1e-7)


@few
@given(seeds, st.sampled_from([-1.0, 1e-3, -250.0]))
def test_a_projection_is_known_up_to_a_factor(seed: int, factor: float) -> None:
    world = random_world(seed)
    rig, scaled = world.rig(), StereoRig.from_projections(*(factor * matrix for matrix in world.projections), SIZE)
    points = seen_points(np.random.default_rng(seed), rig, 20)[3]
    np.testing.assert_allclose(scaled.P_left, rig.P_left, atol=1e-8)
    np.testing.assert_allclose(scaled.projector_pixels(points), rig.projector_pixels(points), atol=1e-7)


def test_a_rig_built_from_itself_is_the_same_to_the_bit() -> None:
    rig = random_world(1).rig()
    again = StereoRig.from_projections(rig.P_left, rig.P_right, rig.P_projector, SIZE)
    for name in ("P_left", "P_right", "P_projector", "projector_matrix"):
        np.testing.assert_array_equal(getattr(again, name), getattr(rig, name))


def test_a_rig_does_not_follow_later_changes_of_its_matrices() -> None:
    left = PAPER.P_left.copy()
    rig = build(left=left)
    left[:] = 0.0
    np.testing.assert_array_equal(rig.P_left, PAPER.P_left)


@few
@given(seeds)
def test_projection_splits_into_intrinsics_rotation_and_place(seed: int) -> None:
    rng = np.random.default_rng(seed)
    K = intrinsic(*rng.uniform(300, 3000, 2), *rng.uniform(-500, 1500, 2))
    K[0, 1] = rng.uniform(-20, 20)
    R, place = rotation(*rng.uniform(-150, 150, 3)), rng.uniform(-3, 3, 3)
    found = split_projection(projection(K, R, place))
    for value, truth in zip(found, (K, R, place), strict=True):
        np.testing.assert_allclose(value, truth, rtol=1e-9, atol=1e-8)


def test_principal_points_may_differ() -> None:
    moved = PAPER.P_right.copy()
    moved[0, 2] -= 40.0
    rig = build(right=moved)
    assert rig.disparity_at_infinity_px == pytest.approx(40.0)
    assert rig.baseline_m == pytest.approx(RIGHT_X_M)
    np.testing.assert_allclose(rig.disparity_px([0.5, 2.0]), PAPER.disparity_px([0.5, 2.0]) + 40.0)
    np.testing.assert_allclose(rig.depth_m(rig.disparity_px([0.5, 2.0])), [0.5, 2.0])


def test_depth_and_disparity_are_unknown_where_nothing_can_be() -> None:
    np.testing.assert_array_equal(PAPER.depth_m([0.0, -3.0, np.nan]), np.full(3, np.nan))
    np.testing.assert_array_equal(PAPER.disparity_px([0.0, -1.0, np.nan]), np.full(3, np.nan))
    assert float(PAPER.disparity_px(np.inf)) == 0.0


def test_points_project_back_to_their_pixels() -> None:
    skewed = random_world(3).rig()
    depth_m = np.random.default_rng(0).uniform(0.5, 2.0, SIZE[::-1]).astype(np.float32)
    depth_m[10, 20] = np.nan
    points = skewed.points(depth_m)
    assert points.dtype == np.float32
    assert np.isnan(points[10, 20]).all()
    np.testing.assert_array_equal(points[..., 2][depth_m > 0], depth_m[depth_m > 0])
    seen = pixels(skewed.P_left, points.reshape(-1, 3).astype(np.float64)).reshape(*SIZE[::-1], 2)
    rows, columns = np.indices(SIZE[::-1])
    known = np.isfinite(depth_m)
    # float32 of points up to a metre, times a focal length of up to 2000 px: 2e-4 px
    np.testing.assert_allclose(seen[known], np.stack([columns, rows], axis=-1)[known], atol=5e-4)


def test_projector_pixels_behind_the_projector_are_unknown() -> None:
    assert np.isnan(PAPER.projector_pixels([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])).all()
    assert np.isfinite(PAPER.projector_pixels([0.0, 0.0, 1.0])).all()


def test_a_mirroring_projector_shows_in_front() -> None:
    mirrored = np.diag([-1.0, 1.0, 1.0]) @ PAPER.P_projector
    points = seen_points(np.random.default_rng(0), PAPER, 10)[3]
    for sign in (1.0, -1.0):
        seen = build(projector=sign * mirrored).projector_pixels(points)
        np.testing.assert_allclose(seen * [-1.0, 1.0], PAPER.projector_pixels(points), atol=1e-9)


def rolled(degrees: float) -> np.ndarray:
    K, R, place = split_projection(PAPER.P_right)
    return projection(K, rotation(0, 0, degrees) @ R, place)


def test_a_pair_that_is_not_rectified_is_refused_with_the_pixels() -> None:
    _, R, place = split_projection(PAPER.P_right)
    lower = projection(intrinsic(FX_PX, FY_PX, CX_PX, CY_PX + 2.5), R, place)
    with pytest.raises(RigError, match=r"rows disagree by up to 2\.50 px.*rectify_pair"):
        build(right=lower)
    wider = projection(intrinsic(FX_PX + 1.0, FY_PX, CX_PX, CY_PX), R, place)
    # corner at 323.54 px from the centre and its opposite at 315.46: (323.54 + 315.46) / 1249.89 = 0.51 px
    with pytest.raises(RigError, match=r"disparity at one depth varies by 0\.51 px"):
        build(right=wider)


def bad_rigs() -> dict[str, tuple[dict[str, object], str]]:
    nan = PAPER.P_left.copy()
    nan[1, 1] = np.nan
    far = PAPER.P_right.copy()
    return {
        "swapped": ({"left": PAPER.P_right, "right": PAPER.P_left}, r"lies -94\.0 mm to the right.*swap left"),
        "same place": ({"right": PAPER.P_left}, r"right camera lies (-?0\.0) mm"),
        "upside down": ({"right": rolled(180.0)}, "not a rectified pair"),
        "looking back": ({"right": far @ np.diag([-1.0, 1.0, -1.0, 1.0])}, "does not look where the left one looks"),
        "nan": ({"left": nan}, "P_left contains NaN or infinity"),
        "shape": ({"right": np.eye(3)}, r"P_right has shape \(3, 3\); it must have shape \(3, 4\)"),
        "ragged": ({"right": [[1, 2], [3]]}, "P_right is not an array of numbers"),
        "words": ({"projector": "calibration"}, "P_projector is not an array of numbers"),
        "zero": ({"projector": np.zeros((3, 4))}, r"P_projector is singular \(all zero\?\)"),
        "flat": ({"left": np.ones((3, 4))}, "P_left is singular"),
        "size of three": ({"size": (640, 480, 3)}, "image_size is"),
        "size of parts": ({"size": (640.5, 480)}, "image_size is"),
        "size in words": ({"size": "VGA"}, "image_size is VGA"),
        "no size": ({"size": None}, "image_size is None"),
        "tiny": ({"size": (640, 8)}, "at least 16 pixels"),
    }


@pytest.mark.parametrize("case", bad_rigs())
def test_what_is_no_rig_is_refused_in_one_line(case: str) -> None:
    parts, message = bad_rigs()[case]
    with pytest.raises(RigError, match=message) as refusal:
        build(**parts)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("lens", "matrix", "size", "message"),
    [
        ((0.1, 0.0, 0.0), None, (960, 480), "lens of the projector has 3 coefficients"),
        ((0.1, np.nan, 0.0, 0.0), None, (960, 480), "lens of the projector contains NaN"),
        ((0.1, 0.0, 0.0, 0.0), None, None, "without projector_size"),
        ((0.1, 0.0, 0.0, 0.0), np.zeros((3, 3)), (960, 480), "intrinsic matrix of the projector is"),
        ((0.1, 0.0, 0.0, 0.0), np.eye(4), (960, 480), r"shape \(4, 4\)"),
        ((), None, (960, 4), "projector_size is"),
    ],
)
def test_an_unusable_projector_lens_is_refused(lens: object, matrix: object, size: object, message: str) -> None:
    matrices = (PAPER.P_left, PAPER.P_right, PAPER.P_projector)
    with pytest.raises(RigError, match=message):
        StereoRig.from_projections(*matrices, SIZE, lens, matrix, size)  # type: ignore[arg-type]


def test_depth_of_another_size_is_refused() -> None:
    with pytest.raises(RigError, match=r"shape \(10, 10\); this rig needs \(480, 640\)"):
        PAPER.points(np.ones((10, 10)))


def test_the_real_rig_is_refused_until_it_is_rectified(capture_folder: Path) -> None:
    told = yaml.safe_load((capture_folder / "rig.yaml").read_text())["projections"]
    with pytest.raises(RigError, match=r"rows disagree by up to [23]\.\d\d px"):
        StereoRig.from_projections(told["left"], told["right"], told["projector"], SIZE)


def test_world_helper_is_right() -> None:
    world: World = random_world(5)
    point = np.array([[0.1, -0.05, 1.0]])
    K, R, place = split_projection(world.projections[0])
    np.testing.assert_allclose((world.to_world(point) - place) @ R.T, point, atol=1e-9)
    assert K[0, 0] > 0
