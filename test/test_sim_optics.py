"""Real optics against truth: ray-traced scenes, numerical integrals, closed forms and the noise's own model."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sim_rigs import QUARTER_PROJECTOR, quarter_pattern, quarter_rig, real_digest, real_options

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import FX_PX, PROJECTOR_X_M
from moire_sensor.pattern import FringePattern
from moire_sim import HeadOptions, Light, Optics, SimulatorError, VirtualHead, preset
from moire_sim.camera_chip import lamp
from moire_sim.exposure import projected_signal
from moire_sim.finish import Finish
from moire_sim.optics import IDEAL
from moire_sim.projector_light import blurred_signal
from moire_sim.renderer_choice import egl_works
from moire_sim.score import near_edges
from tools.bench.validation import (
    CASES,
    DEPTH_LIMIT_MM,
    EDGE_LIMIT_PX,
    PHASE_LIMIT_PX,
    agreements,
    noise_figures,
)

ROOT = Path(__file__).parents[1]
QUIET = HeadOptions(noise=0.0, bits=16, projector_size=QUARTER_PROJECTOR)
# The other cases are test_sim_head's, which looks at them more closely, and make bench's, which samples more finely.
(SPHERE,) = (case for case in CASES if case.name == "sphere through bent lenses")


def small_head(scene: str = "flat_board", **changes: float) -> VirtualHead:
    """A quick head without noise, its optics ideal but for the changes."""
    optics = replace(IDEAL, **changes)  # type: ignore[arg-type]
    return VirtualHead(scene, rig=quarter_rig(), options=replace(QUIET, optics=optics))


def grey(head: VirtualHead, pattern: FringePattern | None = None) -> np.ndarray:
    """Left picture in 8-bit grey levels."""
    return np.asarray(head.expose(pattern)[0]) / 257.0


def test_rendered_pictures_agree_with_ray_traced_ones() -> None:
    (found,) = agreements(replace(SPHERE, optics=replace(SPHERE.optics, supersampling=1)))
    assert found.judged > 0.85
    assert found.phase_px < PHASE_LIMIT_PX
    assert found.edge_px <= EDGE_LIMIT_PX
    assert found.depth_mm < DEPTH_LIMIT_MM


def test_noise_statistics_are_those_of_the_model() -> None:
    """Deviations from 40 x 200 x 200 numbers are good to 0.06 %, from 200 x 200 to 0.35 %; five times that."""
    for figure, share in zip(noise_figures(), (0.003, 0.018, 0.01, 0.018), strict=True):
        assert figure.measured == pytest.approx(figure.model, rel=share), figure.name


@pytest.mark.parametrize(("waveform", "gamma"), [("sine", 1.0), ("sine", 2.2), ("square", 1.0)])
def test_a_blurred_projector_shows_the_fringes_convolved_with_a_gaussian(waveform: str, gamma: float) -> None:
    pattern = FringePattern(16.7, 0.4, (0.0, 1.1), "square" if waveform == "square" else "sine")
    columns = np.linspace(100.0, 140.0, 50)
    places = np.linspace(-15.0, 15.0, 6001)
    for blur_px in (0.8, 3.0):
        weight = np.exp(-0.5 * np.square(places / blur_px))
        around = projected_signal(pattern, columns[:, None] + places, 1, gamma)
        expected = around @ weight / weight.sum()
        # What harmonics beyond the 40th hold: less than a hundredth of a grey level.
        np.testing.assert_allclose(blurred_signal(pattern, 1, gamma, columns, blur_px), expected, atol=2e-4)


def test_the_projector_is_sharp_at_its_focus_and_dull_before_and_behind() -> None:
    """Contrast of sine fringes falls by exp(-2 (pi sigma / p)^2), sigma a quarter of the disc of confusion."""
    aperture_m, focal_px, period_px = 0.03, FX_PX / 4.0, quarter_pattern().period_px
    for distance_m in (0.6, 1.0, 1.8):
        with small_head(f"flat_board:distance_m={distance_m}", projector_aperture_mm=aperture_m * 1e3) as head:
            images = np.asarray(head.capture(quarter_pattern(4)).left)[:, 40:80, 40:120] / 257.0
        amplitude = np.median(np.hypot(images[3] - images[1], images[0] - images[2]) / 2.0)
        with small_head(f"flat_board:distance_m={distance_m}", projector_blur_px=1e-6) as head:
            images = np.asarray(head.capture(quarter_pattern(4)).left)[:, 40:80, 40:120] / 257.0
        sharp = np.median(np.hypot(images[3] - images[1], images[0] - images[2]) / 2.0)
        sigma_px = aperture_m * focal_px * abs(1.0 / distance_m - 1.0) / 4.0
        expected = math.exp(-2.0 * (math.pi * sigma_px / period_px) ** 2)
        assert amplitude / sharp == pytest.approx(expected, abs=2e-3)


def test_light_falls_off_with_the_square_of_the_distance_and_towards_corners() -> None:
    def middle(**changes: float) -> float:
        with small_head("flat_board:distance_m=0.8", **changes) as head:
            return float(grey(head, quarter_pattern()).mean() - 20.0)

    even = middle(projector_blur_px=1e-6)
    # Directions differ within the field, by up to 6 % of the distance squared.
    assert middle(fall_off_m=0.9) / even == pytest.approx((0.9 / 0.8) ** 2, rel=0.04)
    assert 0.9 < middle(projector_vignetting=0.3) / even < 0.98
    with small_head(vignetting=0.3) as head:
        picture = grey(head)
    assert picture[0, 0] == pytest.approx(0.7 * 20.0, abs=0.1)
    assert picture[60, 80] == pytest.approx(20.0, abs=0.1)


def test_exposure_and_gain_scale_the_picture_and_white_saturates() -> None:
    with small_head(exposure_ms=20.0, gain=1.5) as head:
        np.testing.assert_allclose(grey(head), 60.0, atol=0.1)
    with small_head(exposure_ms=50.0) as head:
        assert grey(head, quarter_pattern()).max() == 255.0
    even = replace(QUIET, light=Light(amplitude=0.0), optics=Optics(auto_exposure_grey=200.0))
    with VirtualHead("flat_board", rig=quarter_rig(), options=even) as head:
        assert np.percentile(grey(head, quarter_pattern()), 99.0) == pytest.approx(200.0, abs=0.5)


def test_twelve_bits_are_white_at_4095() -> None:
    light = Light(ambient=255.0, offset=0.0, amplitude=0.0)
    with VirtualHead("flat_board", rig=quarter_rig(), options=replace(QUIET, bits=12, light=light)) as head:
        left, _ = head.ambient()
    assert left.dtype == np.uint16
    assert np.all(left == 4095)


def test_a_lamp_is_averaged_over_the_exposure() -> None:
    optics = Optics(flicker=0.4, lamp_hz=100.0)
    for time_s, exposure_ms in ((0.0013, 4.0), (0.2, 7.0), (0.0, 10.0)):
        times = time_s + np.linspace(-0.5, 0.5, 20001) * exposure_ms * 1e-3
        expected = 1.0 + 0.4 * np.sin(2.0 * math.pi * 100.0 * times).mean()
        assert lamp(optics, time_s, exposure_ms) == pytest.approx(expected, abs=1e-4)
    with small_head(flicker=0.4, exposure_ms=10.0 / 4.0) as head:
        head.set_time(0.0025)
        bright = grey(head).mean()
        head.set_time(0.0075)
        expected = lamp(optics, 0.0025, 2.5) / lamp(optics, 0.0075, 2.5)
        assert bright / grey(head).mean() == pytest.approx(expected, rel=1e-3)


def test_gloss_peaks_where_the_light_is_mirrored() -> None:
    """A wall across the axis mirrors the projector into the left camera halfway between both, at x = 26.5 mm."""
    with small_head(surface_specular=1.0) as head:
        gain = grey(head, quarter_pattern(1)) - 0.0
    with small_head(projector_blur_px=1e-6) as head:
        dull = grey(head, quarter_pattern(1))
    row, column = np.unravel_index(np.argmax((gain - dull) / (dull - 19.0)), dull.shape)
    centre = quarter_rig().P_left[:, 2]
    assert column == pytest.approx(centre[0] + FX_PX / 4.0 * PROJECTOR_X_M / 2.0, abs=3.0)
    assert row == pytest.approx(centre[1], abs=3.0)


@pytest.mark.parametrize("texture", ["checker", "stripes", "noise"])
def test_textures_darken_by_their_contrast_and_stay_on_the_body(texture: str) -> None:
    finish = Finish(texture, 0.5, 0.05)  # type: ignore[arg-type]
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (20000, 3))
    shade = finish.shade(points)
    assert 0.5 <= shade.min() < 0.6 + 0.1 * (texture == "noise")
    assert 0.9 - 0.1 * (texture == "noise") < shade.max() <= 1.0
    np.testing.assert_array_equal(shade, finish.shade(points))
    if texture == "checker":
        np.testing.assert_array_equal(finish.shade(points + np.array([0.05, 0.0, 0.0])), 1.5 - shade)


def test_a_swept_pattern_bends_on_what_moves_meanwhile(tmp_path: Path) -> None:
    """Closed form: column u is lit at (u / (W - 1) - 1/2) of the sweep, when the board is at 1 m + v t.

    At a pixel x the board at depth z is lit through column u = x - cx + cx_p - f B / z.
    """
    speed_m_s, sweep_s = 1.0, 0.04
    path = tmp_path / "coming.yaml"
    path.write_text(
        "format: 1\nbodies:\n- board: {z_m: 1.0, half_size_m: [2.0, 1.5]}\n  motion:\n    path:\n"
        f"      times_s: [0.0, 2.0]\n      shifts_m: [[0, 0, -1], [0, 0, {2.0 * speed_m_s - 1.0}]]\n",
        encoding="utf-8",
    )
    rig, pattern = quarter_rig(), quarter_pattern(4)
    with small_head(str(path), sweep_ms=sweep_s * 1e3) as head:
        head.set_time(1.0)
        np.testing.assert_allclose(head.depth_m, 1.0, atol=1e-5)
        images = np.stack([head.expose(pattern, step)[0] for step in range(4)]).astype(float)
    phase = np.arctan2(images[3] - images[1], images[0] - images[2])[20:-20]
    columns = np.arange(rig.image_size[0], dtype=float)
    still_px = columns - rig.P_left[0, 2] + rig.P_projector[0, 2]
    device_px = still_px - FX_PX / 4.0 * PROJECTOR_X_M
    for _ in range(20):
        z_m = 1.0 + speed_m_s * sweep_s * (device_px / (QUARTER_PROJECTOR[0] - 1.0) - 0.5)
        device_px = still_px - FX_PX / 4.0 * PROJECTOR_X_M / z_m
    off_px = np.angle(np.exp(1j * (phase - pattern.phase_at(device_px)))) * pattern.period_px / (2.0 * math.pi)
    unbent_px = np.abs(device_px - (still_px - FX_PX / 4.0 * PROJECTOR_X_M)).max()
    assert unbent_px > 0.15
    # Between five moments light is mixed, not moved: a hundredth of the bend.
    assert np.abs(off_px[:, 5:-5]).max() < 0.02


def test_a_sweep_of_what_stands_still_changes_nothing() -> None:
    with small_head("cylinder_and_box", projector_blur_px=0.3) as flash, small_head(
        "cylinder_and_box", projector_blur_px=0.3, sweep_ms=20.0
    ) as swept:
        np.testing.assert_array_equal(grey(flash, quarter_pattern()), grey(swept, quarter_pattern()))


def test_supersampling_covers_parts_of_pixels_and_keeps_the_truth() -> None:
    """The plate's front ends between pixels: finely sampled, its border takes levels between plate and wall."""
    with small_head("board_before_plane", supersampling=4) as fine, small_head("board_before_plane", k1=1e-9) as coarse:
        np.testing.assert_array_equal(fine.depth_m, coarse.depth_m)
        flat = Light(blur_px=0.0)
        pictures = []
        for samples in (1, 4):
            options = replace(QUIET, light=flat, optics=Optics(supersampling=samples, projector_blur_px=1e-6))
            with VirtualHead("board_before_plane", rig=quarter_rig(), options=options) as head:
                pictures.append(np.asarray(head.ambient()[0]) / 257.0)
    levels = [np.unique(np.round(picture, 1)).size for picture in pictures]
    assert levels[0] == 2
    assert levels[1] > 4


def test_the_same_seed_gives_the_same_real_pictures_in_another_process() -> None:
    code = (
        "import hashlib, sys; sys.path.insert(0, 'test')\n"
        "from sim_rigs import real_digest; print(real_digest())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert real_digest() in done.stdout


def test_noise_changes_and_speckle_and_pattern_stay_while_nothing_moves() -> None:
    with VirtualHead("flat_board", 3, quarter_rig(), real_options()) as head:
        pictures = np.stack([head.expose(quarter_pattern(), 0, index)[0] for index in range(30)]).astype(float)
    assert np.all(pictures.std(axis=0).mean() > 0.5)
    halves = [pictures[:15].mean(axis=0), pictures[15:].mean(axis=0)]
    fine = [half - 0.5 * (np.roll(half, 1, axis=0) + np.roll(half, -1, axis=0)) for half in halves]
    correlation = np.corrcoef(fine[0][2:-2].ravel(), fine[1][2:-2].ravel())[0, 1]
    assert correlation > 0.8


def test_wrong_optics_are_refused_in_one_line() -> None:
    with pytest.raises(SettingsError, match=r"speckle is 2\.0; allowed is 0\.0 to 1\.0"):
        Optics(speckle=2.0)
    with pytest.raises(SettingsError, match="optics is 'dirty'; choose one of clean, realistic"):
        preset("dirty")
    with pytest.raises(SimulatorError, match="a lens with k1, k2, p1, p2, k3 = -2, 0, 0, 0, 0 folds its") as caught:
        small_head(k1=-2.0)
    assert "\n" not in str(caught.value)


def test_edges_of_this_rig_are_where_its_truth_has_them() -> None:
    """The realistic preset leaves truth and masks as they are."""
    with VirtualHead("cylinder_and_box", 0, quarter_rig(), real_options()) as real, VirtualHead(
        "cylinder_and_box", 0, quarter_rig(), QUIET
    ) as clean:
        captures = [head.capture(quarter_pattern()) for head in (real, clean)]
    for name in ("depth_m", "covisible", "lit"):
        np.testing.assert_array_equal(getattr(captures[0], name), getattr(captures[1], name))
    assert near_edges(captures[0]).mean() < 0.9


def test_egl_draws_what_the_tiny_renderer_draws() -> None:
    """OpenGL snaps corners to 1/256 px, which a slope turns into depth: 0.05 mm at 1 m for the paper's pixels."""
    if not egl_works():
        pytest.skip("EGL does not render on this machine")
    options = replace(QUIET, optics=Optics(projector_blur_px=1e-6))
    captures = []
    for renderer in ("tiny", "egl"):
        chosen = replace(options, renderer=renderer)
        with VirtualHead("flat_board:slope=0.5", rig=quarter_rig(), options=chosen) as head:
            assert head.uses_egl == (renderer == "egl")
            captures.append(head.capture(quarter_pattern(4)))
    tiny, egl = captures
    # Pixels of this rig are four times as wide as the paper's, and so is what a 256th of one does to depth.
    assert np.quantile(np.abs(egl.depth_m - tiny.depth_m), 0.99) < 4 * 5e-5
    phases = [np.arctan2(one.left[3] - 1.0 * one.left[1], one.left[0] - 1.0 * one.left[2]) for one in captures]
    off_px = np.angle(np.exp(1j * (phases[1] - phases[0]))) * quarter_pattern().period_px / (2.0 * math.pi)
    assert np.quantile(np.abs(off_px[tiny.lit]), 0.99) < PHASE_LIMIT_PX
    # Albedos come in 8 bits, and may be rounded otherwise.
    np.testing.assert_allclose(egl.left.mean(), tiny.left.mean(), rtol=1.0 / 255.0)


def test_an_unknown_renderer_is_refused() -> None:
    with pytest.raises(SettingsError, match="renderer is 'vulkan'; choose one of tiny, egl, auto"):
        VirtualHead(options=HeadOptions(renderer="vulkan"))
