"""Phase-shifted depth against exact truth, and against what single exposures give.

The floor of four steps, one pixel, at amplitude 70 and noise 1.5: 0.33 mm scaled to 1 m; aim 0.36.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from dense_rigs import capture, dense_shot, outside_rig, stepped_shot

from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.settings import Settings
from moire_sensor.shot import Shot, Status
from moire_sim.analytic_scenes import AnalyticScene, analytic_capture, analytic_scene_names, scene_surfaces
from moire_sim.analytic_surfaces import Box, Relief
from moire_sim.capture import HeadCapture
from moire_sim.fringe_image import Light
from moire_sim.score import score
from tools.bench.confidence import error_by_sigma

AIM_MM, AIM_OF_MEAN_MM, AMPLITUDE = 0.36, 0.15, 70.0
# Amplitude of the fringes on surfaces that turn from the light; the floor, and so the aim, is inverse to it.
DIMMED = {"slope_1.2": 44.0, "waves": 58.0}


@pytest.mark.parametrize("name", analytic_scene_names())
def test_four_steps(name: str) -> None:
    found = score(stepped_shot(name), capture(name, 4))
    assert found.completeness >= 0.985
    assert found.outlier_share <= 0.003
    assert found.median_error_mm_away <= AIM_MM * AMPLITUDE / DIMMED.get(name, AMPLITUDE)
    assert found.ghost_share <= 0.005


@pytest.mark.parametrize("name", list(DIMMED))
def test_four_steps_on_slopes_lit_as_brightly_as_boards(name: str) -> None:
    seen = capture(name, 4, amplitude=AMPLITUDE * AMPLITUDE / DIMMED[name])
    amplitude = (seen.left.max(axis=0).astype(float) - seen.left.min(axis=0))[seen.lit] / 2.0
    # Four steps at quarters of a fringe show between 0.7 and all of the amplitude, 0.9 on the average.
    assert np.mean(amplitude) / 0.9 == pytest.approx(AMPLITUDE, rel=0.05)
    for half_px, aim_mm in ((0, AIM_MM), (1, AIM_OF_MEAN_MM)):
        settings = Settings(half_mean_steps_px=half_px)
        sensor = Reconstructor(seen.rig, seen.pattern, method="phase_shift", settings=settings)
        assert score(sensor.reconstruct(seen.left, seen.right), seen).median_error_mm_away <= aim_mm


@pytest.mark.parametrize("name", ["plane_600", "plane_1500", "tilt_0.5", "cylinder_and_box", "waves"])
def test_sigma_is_the_error(name: str) -> None:
    assert error_by_sigma(stepped_shot(name), capture(name, 4)) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("name", ["plane_600", "plane_1500", "cylinder_and_box"])
def test_mean_along_the_surface_is_quieter_and_mixes_nothing(name: str) -> None:
    """A mean over 3 x 3 pixels: the aim is 0.15 mm, and its sigma is still the error."""
    seen = capture(name, 4)
    settings = Settings(half_mean_steps_px=1)
    shot = Reconstructor(seen.rig, seen.pattern, method="phase_shift", settings=settings).reconstruct(
        seen.left, seen.right
    )
    found, plain = score(shot, seen), score(stepped_shot(name), seen)
    assert found.median_error_mm_away <= AIM_OF_MEAN_MM
    assert found.outlier_share <= plain.outlier_share + 1e-4
    assert found.completeness == pytest.approx(plain.completeness, abs=2e-3)
    assert error_by_sigma(shot, seen) == pytest.approx(1.0, abs=0.2)


def test_gamma_cancels_between_the_cameras() -> None:
    """Gamma 2.2 bends the phase by up to 0.55 mm of projector depth; both cameras see the same bend."""
    found = score(stepped_shot("plane_1000", gamma=2.2), capture("plane_1000", 4, gamma=2.2))
    assert found.median_error_mm_away <= 0.36


def test_gamma_is_no_noise() -> None:
    """The second harmonic leaves four steps' phase alone, but not what the fit leaves over: it is told from noise."""
    seen, shot = capture("cylinder_and_box", 4, gamma=2.2), stepped_shot("cylinder_and_box", gamma=2.2)
    assert error_by_sigma(shot, seen) == pytest.approx(1.0, abs=0.3)
    plain = stepped_shot("cylinder_and_box")
    assert np.mean(shot.confidence > 0.9) >= 0.98 * np.mean(plain.confidence > 0.9)


@pytest.mark.parametrize(("name", "texture"), [("plane_1000", 0.0), ("spheres", 0.3)])
def test_a_flickering_lamp_is_tolerated(name: str, texture: float) -> None:
    """Ambient light as strong as the fringes that swings by 30 % at 100 Hz, frames at 60 per second."""
    scene = AnalyticScene.of(scene_surfaces(name), texture)
    lamp = 1.0 + 0.3 * np.sin(2.0 * np.pi * 100.0 / 60.0 * np.arange(4) + 0.7)
    lights = [Light(ambient=70.0 * float(level), offset=70.0, amplitude=60.0, blur_px=0.5) for level in lamp]
    left, right = scene.images(paper_pattern(4), lights, 1.5)
    seen = HeadCapture(left, right, scene.depth_m, scene.covisible, scene.lit, scene.rig, paper_pattern(4))
    found = score(Reconstructor(seen.rig, seen.pattern, method="phase_shift").reconstruct(left, right), seen)
    # In the spheres' shadows the lamp is another share of the light.
    assert found.completeness >= (0.985 if name == "plane_1000" else 0.97)
    assert found.outlier_share <= 0.003
    # Fringes of 60 instead of 70 grey levels, darker by half of the checker's 30 %.
    assert found.median_error_mm_away <= 0.36 * 70.0 / 60.0 * (1.0 + 0.5 * texture)


def moving_plate(metres_a_frame: float) -> tuple[HeadCapture, Shot]:
    """Five frames of a plate that comes nearer before a wall, with the truth of the middle one, and what they give."""
    scenes = [
        AnalyticScene.of((Relief(1.2), Box((0.02, 0.0, 0.9 - metres_a_frame * (frame - 2)), (0.16, 0.12, 0.005))))
        for frame in range(5)
    ]
    pattern = paper_pattern(4)
    light = Light(offset=80.0, amplitude=70.0, blur_px=0.5)
    one = [replace(pattern, step_phases_rad=(pattern.step_phases_rad[frame % 4],)) for frame in range(5)]
    views = [scene.images(step, [light], 1.5, seed) for seed, (scene, step) in enumerate(zip(scenes, one, strict=True))]
    left, right = (np.stack(frames) for frames in zip(*views, strict=True))
    middle = scenes[2]
    seen = HeadCapture(left, right, middle.depth_m, middle.covisible, middle.lit, middle.rig, pattern)
    return seen, Reconstructor(seen.rig, pattern, method="phase_shift").reconstruct(left, right)


def test_what_moves_too_fast_is_taken_from_the_middle_exposure_and_marked() -> None:
    """40 mm a frame at 0.9 m move the fringes by more than a radian; the wall behind stands still."""
    seen, shot = moving_plate(0.04)
    plate = seen.covisible & (seen.depth_m < 1.0)
    taken = shot.status == Status.FROM_SINGLE_SHOT
    assert np.mean(taken[plate]) > 0.7
    assert np.mean(np.isfinite(shot.depth_m[plate])) > 0.8
    assert np.isfinite(shot.depth_m[(shot.status == Status.OK) | taken]).all()
    error_mm = np.abs(shot.depth_m - seen.depth_m)[plate & taken] * 1e3 / 0.9**2
    # As precise as a single shot, far better than the 40 mm that it moved.
    assert np.median(error_mm) < 0.2
    wall = seen.covisible & ~plate
    assert np.mean(shot.status[wall] == Status.OK) > 0.85


def test_single_shot_and_steps_agree() -> None:
    """Two methods, one surface: apart by their noise (0.09 and 0.36 mm)."""
    apart_mm = np.abs(stepped_shot("plane_1500").depth_m - dense_shot("plane_1500").depth_m) * 1e3 / 1.5**2
    assert np.nanmedian(apart_mm) <= math.hypot(0.09, 0.36)


def test_first_step_tells_which_frame_came_first() -> None:
    seen = capture("plane_1500", 4)
    sensor = Reconstructor(seen.rig, seen.pattern, method="phase_shift")
    turned = sensor.reconstruct(np.roll(seen.left, -1, axis=0), np.roll(seen.right, -1, axis=0), first_step=1)
    apart_m = np.abs(turned.depth_m - stepped_shot("plane_1500").depth_m)
    # Rounding decides at a few pixels whether they are doubtful enough to be matched by grey levels.
    assert np.mean(apart_m > 1e-5) < 1e-3
    assert np.nanmax(apart_m) < 0.02


def test_more_frames_than_steps() -> None:
    """Seven frames of a still scene: at least as good as four."""
    seen = capture("plane_1500", 4)
    sensor = Reconstructor(seen.rig, seen.pattern, method="phase_shift")
    left, right = (np.concatenate([image, image[:3]]) for image in (seen.left, seen.right))
    assert score(sensor.reconstruct(left, right), seen).median_error_mm_away <= 0.36


def test_projector_outside_a_short_pair_measures() -> None:
    """Left-right alone would scatter by 0.33 mm x 94/40 at 1 m; with the projector 200 mm away it is 0.33 x 94/200."""
    rig = outside_rig()
    seen = analytic_capture("tilt_0.5", paper_pattern(4), rig=rig)
    shot = Reconstructor(rig, paper_pattern(4), (0.7, 1.6), "phase_shift").reconstruct(seen.left, seen.right)
    found = score(shot, seen)
    assert found.completeness >= 0.985
    assert found.outlier_share <= 0.003
    assert found.median_error_mm_away <= 0.33 * 94.0 / 200.0
