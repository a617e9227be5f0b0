"""Row phase and the moire of two gratings against known phases; height formulas; rays against light sheets."""

from __future__ import annotations

import numpy as np
import pytest
from edge_rigs import rigs_under_test

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.reference_height import height_of_shift_m, shift_of_height_m, shift_of_phase_m
from moire_sensor.reference_phase import fringe_signal, grating, low_passed, moire_phase_periods, superposed
from moire_sensor.reference_ray import CAMERAS, check_camera, disparity_on_ray_px, phase_seen_rad

PERIOD = 16.6652
COLUMNS = np.arange(640.0)
CARRIER = 2.0 * np.pi / PERIOD * COLUMNS[None]
# The background's window of two periods and the fringe's, one after the other, are cut at the ends of a row.
INSIDE = slice(40, -40)
RIGS = rigs_under_test()


def wrapped(angle_rad: np.ndarray) -> np.ndarray:
    return np.angle(np.exp(1j * angle_rad))


def test_phase_of_a_shifted_fringe_is_exact_up_to_the_ends() -> None:
    shifts = np.linspace(-3.0, 3.0, 13)[:, None]
    found = fringe_signal(90.0 + 70.0 * np.cos(CARRIER + shifts), np.broadcast_to(CARRIER, (13, 640)), PERIOD)
    # Nothing of background and double frequency passes but what the cut window lets through, 2e-3 at the very end.
    assert np.abs(wrapped(np.angle(found) - shifts))[:, INSIDE].max() < 1e-4
    assert np.abs(wrapped(np.angle(found) - shifts)).max() < 2e-3
    np.testing.assert_allclose(np.abs(found), 70.0, rtol=2e-3)


def test_a_sloping_background_and_the_second_harmonic_do_not_move_the_phase() -> None:
    bent = 20.0 * np.cos(2.0 * (CARRIER + 0.7)) + 0.1 * COLUMNS
    found = fringe_signal(90.0 + 60.0 * np.cos(CARRIER + 0.7) + bent, CARRIER, PERIOD)
    assert np.abs(np.angle(found) - 0.7)[:, INSIDE].max() < 2e-3


def test_predicted_phase_noise_is_that_of_the_triangle() -> None:
    generator = np.random.default_rng(2)
    noise = generator.standard_normal((60, 640))
    passed = low_passed(noise * np.exp(-1j * CARRIER), PERIOD)[:, INSIDE]
    # A triangle of unit area and width 2 T has the noise power 2 / (3 T); 60 rows hold some 2000 independent values.
    assert np.mean(np.abs(passed) ** 2) == pytest.approx(2.0 / (3.0 * PERIOD), rel=0.1)


def test_low_pass_is_the_convolution_with_two_boxes_of_a_period() -> None:
    row = np.random.default_rng(3).uniform(0, 1, 400)
    period = 16
    triangle = np.convolve(np.ones(period), np.ones(period)) / period**2
    direct = np.convolve(row, triangle, mode="same")
    # Boxes of continuous and of sampled columns differ above half the sampling rate only: 1e-2 of white noise.
    assert np.abs(low_passed(row[None].astype(complex), period).real[0] - direct)[INSIDE].max() < 0.02


def test_equation_4_is_the_sum_of_the_gratings() -> None:
    c, psi = 0.4, 0.3 * np.sin(COLUMNS / 70.0)
    both = superposed(grating(CARRIER, c), grating(CARRIER + 2.0 * np.pi * psi, c))
    beat = 2.0 * c * (1.0 + np.cos(np.pi * psi) * np.cos(CARRIER + np.pi * psi))
    np.testing.assert_allclose(both, beat, atol=1e-12)


@pytest.mark.parametrize("model", [0.4, 0.2])
def test_general_moire_recovers_psi_modulo_one(model: float) -> None:
    """Also where the model grating is darker than the reference, as on a grey object."""
    psi = 1.4 * np.sin(COLUMNS / 150.0)[None]
    both = superposed(grating(CARRIER, 0.4), grating(CARRIER + 2.0 * np.pi * psi, model))
    found = moire_phase_periods(both, CARRIER, 0.4, PERIOD)
    error = wrapped(2.0 * np.pi * (found - psi)) / (2.0 * np.pi)
    # The window smooths psi: its curvature 1.4 / 150^2 times the triangle's variance T^2 / 6 and a half: 1.5e-3.
    assert np.abs(error)[:, INSIDE].max() < 3e-3
    assert np.abs(found).max() <= 0.5


def test_general_and_projection_moire_give_the_same_psi() -> None:
    """Section 2.2: the psi found by superposition and the psi found from the fringes alone are the same."""
    psi = 0.3 * np.cos(COLUMNS / 90.0)[None]
    model = grating(CARRIER + 2.0 * np.pi * psi, 0.4)
    superposition = moire_phase_periods(superposed(grating(CARRIER, 0.4), model), CARRIER, 0.4, PERIOD)
    alone = np.angle(fringe_signal(model, CARRIER, PERIOD)) / (2.0 * np.pi)
    np.testing.assert_allclose(superposition[:, INSIDE], alone[:, INSIDE], atol=1e-3)


def test_height_and_shift_invert_each_other_and_the_printed_form_does_not() -> None:
    """physics.md: a board at 1000 mm before a plane at 1500 mm would read 750 by equation (6)."""
    height = np.linspace(-0.5, 1.4, 50)
    np.testing.assert_allclose(height_of_shift_m(shift_of_height_m(height, 1.5, 0.053), 1.5, 0.053), height, atol=1e-12)
    shift = shift_of_height_m(0.5, 1.5, 0.053)
    assert float(shift) == pytest.approx(0.0265)
    assert 1.5 - float(shift) * 1.5 / 0.053 == pytest.approx(0.75)
    assert 1.5 - float(height_of_shift_m(shift, 1.5, 0.053)) == pytest.approx(1.0)
    assert np.isnan(height_of_shift_m(-0.06, 1.5, 0.053))
    assert float(shift_of_phase_m(0.5, 0.02)) == 0.01


def test_the_papers_formula_is_the_intersection_of_ray_and_light_sheet() -> None:
    rig = RIGS["paper"]
    projector = ProjectorMap.build(rig, paper_pattern())
    psi = np.linspace(-0.45, 0.45, 19)
    for camera, separation_m, sign in (("left", 0.053, -1.0), ("right", 0.041, 1.0)):
        x, y = np.full(19, 333.0), np.full(19, 100.0)
        plane_rad = phase_seen_rad(projector, camera, x, y, float(rig.disparity_px(1.5)))
        disparity = disparity_on_ray_px(projector, camera, x, y, plane_rad + 2.0 * np.pi * psi)
        height_m = height_of_shift_m(shift_of_phase_m(sign * psi, 0.020), 1.5, separation_m)
        np.testing.assert_allclose(rig.depth_m(disparity), 1.5 - height_m, rtol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", RIGS)
def test_ray_and_light_sheet_meet_where_the_phase_is_seen(name: str, camera) -> None:
    generator = np.random.default_rng(4)
    projector = ProjectorMap.build(RIGS[name], paper_pattern())
    x, y = generator.uniform(0, 639, 200), generator.uniform(0, 479, 200)
    disparity = generator.uniform(58.0, 235.0, 200)
    phase = phase_seen_rad(projector, camera, x, y, disparity)
    np.testing.assert_allclose(disparity_on_ray_px(projector, camera, x, y, phase), disparity, rtol=1e-9)


def test_a_right_pixel_sees_what_its_left_partner_sees() -> None:
    projector = ProjectorMap.build(RIGS["outside"], paper_pattern())
    x, y, d = np.array([300.0]), np.array([90.0]), 80.0
    left = phase_seen_rad(projector, "left", x, y, d)
    np.testing.assert_allclose(phase_seen_rad(projector, "right", x - d, y, d), left, rtol=1e-12)


def test_an_unknown_camera_is_refused() -> None:
    with pytest.raises(SettingsError, match="camera is 'middle'; it must be one of left, right"):
        check_camera("middle")
