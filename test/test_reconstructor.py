"""The pipeline's public face: what it refuses, what bad images give, and that only the input decides a result."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import numpy.typing as npt
import pytest
from dense_rigs import capture, dense_shot, sensor

from moire_sensor import ImageError, MoireError, PatternError, Reconstructor, SettingsError, Shot, Status
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.phase_single import phase_bands
from moire_sensor.settings import Settings
from moire_sensor.shot import UNKNOWN_ORDER
from moire_sim.score import disparity_error_px

Grey = npt.NDArray[np.uint8]
SHAPE = (480, 640)


def flat(grey: int) -> Grey:
    return np.full(SHAPE, grey, dtype=np.uint8)


def noise(seed: int) -> Grey:
    return np.random.default_rng(seed).integers(0, 256, SHAPE, dtype=np.uint8)


def check_consistent(shot: Shot) -> None:
    """Unknown is NaN and -32768 and 0 everywhere at once, known is finite, positive, with status OK."""
    known = np.isfinite(shot.depth_m)
    np.testing.assert_array_equal(np.isfinite(shot.disparity_px), known)
    np.testing.assert_array_equal(np.isfinite(shot.depth_sigma_m), known)
    np.testing.assert_array_equal(shot.fringe_order != UNKNOWN_ORDER, known)
    np.testing.assert_array_equal(shot.status == Status.OK, known)
    assert (shot.confidence[~known] == 0.0).all()
    assert ((shot.confidence >= 0.0) & (shot.confidence <= 1.0)).all()
    assert np.isfinite(shot.background).all()


def test_result_types_and_ranges() -> None:
    shot = dense_shot("small_plate")
    check_consistent(shot)
    types = {"depth_m": "f4", "depth_sigma_m": "f4", "disparity_px": "f4", "confidence": "f4", "background": "f4",
             "fringe_order": "i2", "status": "u1"}  # fmt: skip
    for name, dtype in types.items():
        assert getattr(shot, name).dtype == np.dtype(dtype)
        assert getattr(shot, name).shape == SHAPE
    known = np.isfinite(shot.depth_m)
    assert (shot.depth_sigma_m[known] > 0.0).all()
    depths = shot.depth_m[known]
    assert depths.min() >= 0.49
    assert depths.max() <= 2.04


FEATURELESS = {"dark": (0, Status.UNLIT), "grey": (128, Status.UNLIT), "saturated": (255, Status.SATURATED)}


@pytest.mark.parametrize("case", FEATURELESS)
def test_constant_images_have_no_depth_and_say_why(case: str) -> None:
    grey, status = FEATURELESS[case]
    shot = sensor().reconstruct(flat(grey), flat(grey))
    check_consistent(shot)
    assert np.isnan(shot.depth_m).all()
    assert (shot.status == status).all()
    assert np.isnan(shot.typical_mismatch_rad)


@pytest.mark.parametrize("case", FEATURELESS)
def test_constant_frames_have_no_depth_and_say_why(case: str) -> None:
    grey, status = FEATURELESS[case]
    frames = np.stack([flat(grey)] * 4)
    shot = sensor("phase_shift", 4).reconstruct(frames, frames)
    check_consistent(shot)
    assert np.isnan(shot.depth_m).all()
    assert (shot.status == status).all()


def test_noise_gives_no_confident_depth() -> None:
    shot = sensor().reconstruct(noise(1), noise(2))
    check_consistent(shot)
    assert not (shot.confidence > 0.9).any()
    assert np.isfinite(shot.depth_m).mean() < 0.001


def test_noise_frames_give_no_confident_depth() -> None:
    left, right = (np.stack([noise(10 * camera + step) for step in range(4)]) for camera in (1, 2))
    shot = sensor("phase_shift", 4).reconstruct(left, right)
    check_consistent(shot)
    assert not (shot.confidence > 0.9).any()


@pytest.mark.parametrize("name", ["plane_1000", "tilt_0.5", "cylinder_and_box"])
def test_one_image_twice_gives_no_depth(name: str) -> None:
    seen = capture(name)
    for image in (seen.left, seen.right):
        shot = sensor().reconstruct(image, image)
        check_consistent(shot)
        assert not (shot.confidence > 0.9).any()


@pytest.mark.parametrize("camera", ["left", "right"])
def test_one_blind_camera_gives_no_depth(camera: str) -> None:
    seen = capture("plane_1000")
    images = {"left": seen.left, "right": seen.right, camera: flat(3)}
    shot = sensor().reconstruct(images["left"], images["right"])
    check_consistent(shot)
    assert np.isnan(shot.depth_m).all()


def test_half_covered_frames_keep_the_other_half() -> None:
    """A hand before the lower half of both cameras: what is seen stays right, what is not has no depth."""
    seen = capture("small_plate")
    left, right = seen.left.copy(), seen.right.copy()
    left[240:], right[240:] = 20, 20
    shot = sensor().reconstruct(left, right)
    check_consistent(shot)
    assert np.isnan(shot.depth_m[242:]).all()
    known = np.isfinite(shot.depth_m) & seen.covisible
    assert known[:230].sum() >= 0.98 * seen.covisible[:230].sum()
    off = np.abs(disparity_error_px(shot.depth_m, seen))
    assert (off[known] > 1.0).mean() < 0.005


def test_saturated_patch_is_told() -> None:
    seen = capture("plane_1000")
    left = seen.left.copy()
    left[200:260, 300:380] = 255
    shot = sensor().reconstruct(left, seen.right)
    check_consistent(shot)
    assert (shot.status[210:250, 315:365] == Status.SATURATED).all()
    known = np.isfinite(shot.depth_m) & seen.covisible
    assert (np.abs(disparity_error_px(shot.depth_m, seen))[known] > 1.0).mean() < 0.005


def test_laser_off_is_unlit() -> None:
    """A textured scene without fringes: noise on a flat grey."""
    rng = np.random.default_rng(3)
    left, right = (np.clip(rng.normal(80.0, 1.5, SHAPE), 0, 255).astype(np.uint8) for _ in range(2))
    shot = sensor().reconstruct(left, right)
    assert (shot.status == Status.UNLIT).mean() > 0.999
    assert np.isnan(shot.depth_m).all()


@pytest.mark.parametrize(
    ("left", "right", "told"),
    [
        (flat(9)[:100], flat(9), "(100, 640)"),
        (flat(9), flat(9)[:, :100], "(480, 100)"),
        (np.stack([flat(9)] * 2), flat(9), "(2, 480, 640)"),
        (np.zeros((480, 640, 3), dtype=np.uint8), flat(9), "(480, 640, 3)"),
        (flat(9).astype(np.float64), flat(9), "float64"),
        (flat(9), flat(9).astype(np.int16), "int16"),
        (flat(9) > 3, flat(9), "bool"),
    ],
)
def test_wrong_images_are_refused(left: Grey, right: Grey, told: str) -> None:
    with pytest.raises(ImageError) as caught:
        sensor().reconstruct(left, right)
    assert told in str(caught.value)
    assert "480, 640" in str(caught.value) or "uint8 or uint16" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("frames", "told"), [(3, "n >= 4"), (1, "n >= 4")])
def test_too_few_frames_are_refused(frames: int, told: str) -> None:
    images = np.stack([flat(9)] * frames)
    with pytest.raises(ImageError, match=told):
        sensor("phase_shift", 4).reconstruct(images, images)


def test_unequal_numbers_of_frames_are_refused() -> None:
    images = np.stack([flat(9)] * 5)
    with pytest.raises(ImageError, match="5 left frames came with 4 right"):
        sensor("phase_shift", 4).reconstruct(images, images[:4])


@pytest.mark.parametrize("range_m", [(0.0, 1.0), (1.0, 1.0), (2.0, 0.5), (-1.0, 2.0), (0.5, np.inf), (np.nan, 2.0)])
def test_wrong_depth_ranges_are_refused(range_m: tuple[float, float]) -> None:
    with pytest.raises(SettingsError, match="depth_range_m"):
        Reconstructor(paper_rig(), paper_pattern(), range_m)


def test_unknown_method_names_those_there_are() -> None:
    with pytest.raises(SettingsError, match="dense, phase_shift"):
        Reconstructor(paper_rig(), paper_pattern(), method="magic")


@pytest.mark.parametrize("level", [0.0, -1.0, np.nan, 1e6])
def test_wrong_saturation_levels_are_refused(level: float) -> None:
    with pytest.raises(SettingsError, match="1 to 65535"):
        Reconstructor(paper_rig(), paper_pattern(), saturation_level=level)


@pytest.mark.parametrize("period_px", [4.0, 400.0])
def test_unusable_periods_are_refused(period_px: float) -> None:
    with pytest.raises(SettingsError, match="change period_px"):
        Reconstructor(paper_rig(), replace(paper_pattern(), period_px=period_px))


def test_phase_shift_needs_three_steps() -> None:
    with pytest.raises(PatternError, match="needs 3"):
        Reconstructor(paper_rig(), paper_pattern(2), method="phase_shift")


@pytest.mark.parametrize(
    "change", [{"min_amplitude": 0.0}, {"jump_cost": -1.0}, {"half_height_px": 11}, {"max_mismatch_rad": np.nan}]
)
def test_settings_outside_their_range_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(MoireError, match=next(iter(change))):
        Settings(**change)  # type: ignore[arg-type]


def test_four_square_steps_are_refused() -> None:
    square = replace(paper_pattern(4), waveform="square")
    with pytest.raises(PatternError, match="four phases"):
        Reconstructor(paper_rig(), square, method="phase_shift")
    Reconstructor(paper_rig(), square.with_equal_steps(5), method="phase_shift")


@pytest.mark.parametrize("method", ["fringe_edges", "reference_plane"])
def test_a_projector_lens_is_refused_by_methods_that_do_not_model_it(method: str) -> None:
    bent = replace(paper_rig(), projector_distortion=(-0.2, 0.1, 0.0, 0.0, 0.0))
    with pytest.raises(SettingsError, match="knows no projector lens"):
        Reconstructor(bent, paper_pattern(), method=method)


def test_the_papers_sparse_method_is_right_where_it_has_points() -> None:
    scene = capture("small_plate")
    shot = Reconstructor(scene.rig, scene.pattern, method="fringe_edges").reconstruct(scene.left, scene.right)
    error_px = disparity_error_px(shot.depth_m, scene)[scene.covisible & np.isfinite(shot.depth_m)]
    assert error_px.size > 20_000  # an edge every 8.3 columns of some 258 000 co-visible pixels is 31 000
    assert (np.abs(error_px) < 1.0).mean() >= 0.99  # issue of the method: 99 % within 1 px


def test_one_camera_alone_is_right_near_its_plane_and_orders_off_beyond() -> None:
    scene = capture("plane_1500")
    near, far = (
        Reconstructor(scene.rig, scene.pattern, method="reference_plane", settings=Settings(reference_depth_m=depth_m))
        .reconstruct(scene.left, scene.right)
        .depth_m
        for depth_m in (1.5, 1.0)
    )
    # Half a period is 90 mm here; noise is 0.4 mm at 1.5 m.
    assert np.nanmedian(np.abs(near - scene.depth_m)) < 0.001
    assert np.nanmedian(np.abs(far - scene.depth_m)) > 0.1


def test_frames_needed() -> None:
    assert sensor().frames_needed == 1
    for steps, frames in ((3, 5), (4, 5), (5, 7)):
        assert Reconstructor(paper_rig(), paper_pattern(steps), method="phase_shift").frames_needed == frames


def test_warm_up_runs_for_both_methods() -> None:
    sensor().warm_up()
    sensor("phase_shift", 4).warm_up()


def test_memory_layout_changes_nothing() -> None:
    """Images in Fortran order give the same bits, and no kernel is compiled anew for them."""
    seen = capture("small_plate")
    expected = dense_shot("small_plate").depth_m
    compiled = len(phase_bands.signatures)
    shot = sensor().reconstruct(np.asfortranarray(seen.left), np.asfortranarray(seen.right))
    sensor().warm_up()
    np.testing.assert_array_equal(shot.depth_m, expected)
    assert len(phase_bands.signatures) == compiled


def test_input_is_left_alone() -> None:
    seen = capture("small_plate")
    left, right = seen.left.copy(), seen.right.copy()
    left.flags.writeable = right.flags.writeable = False
    sensor().reconstruct(left, right)
    np.testing.assert_array_equal(left, seen.left)


def test_thread_count_changes_nothing() -> None:
    seen = capture("small_plate")
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = sensor().reconstruct(seen.left, seen.right)
    finally:
        numba.set_num_threads(threads)
    for name in ("depth_m", "depth_sigma_m", "confidence", "status", "fringe_order", "background"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(dense_shot("small_plate"), name))


INTERPRETED = """
import numpy as np, sys, warnings
warnings.simplefilter("error")
sys.path[:0] = sys.argv[2:]
from dense_rigs import small_rig
from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern
from moire_sim.analytic_scenes import analytic_capture
for steps, method in ((1, "dense"), (4, "phase_shift")):
    seen = analytic_capture("plane_1000", paper_pattern(steps), rig=small_rig(shift_px=97.0))
    shot = Reconstructor(seen.rig, seen.pattern, (0.8, 1.3), method).reconstruct(seen.left, seen.right)
    np.savez(sys.argv[1] + method, depth_m=shot.depth_m, confidence=shot.confidence, order=shot.fringe_order)
"""


def test_kernels_run_without_the_compiler(tmp_path: Path) -> None:
    """The same results with and without numba's compiler, to its fastmath's rounding; coverage runs without."""
    root = Path(__file__).parent.parent
    for disabled in ("0", "1"):
        folder = tmp_path / disabled
        folder.mkdir()
        environment = {**os.environ, "NUMBA_DISABLE_JIT": disabled}
        command = [sys.executable, "-c", INTERPRETED, f"{folder}/", str(root), str(root / "test")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    for method in ("dense", "phase_shift"):
        compiled, interpreted = (np.load(tmp_path / flag / f"{method}.npz") for flag in ("0", "1"))
        assert np.isfinite(compiled["depth_m"]).mean() > 0.05, "the small image must have some depth"
        apart = np.abs(compiled["depth_m"] - interpreted["depth_m"])
        assert np.nanmax(apart) < 1e-3
        differ = np.isfinite(compiled["depth_m"]) != np.isfinite(interpreted["depth_m"])
        assert differ.mean() < 0.01
