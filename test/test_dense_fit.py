"""The one-period least squares of a single shot against plain linear algebra, and the choice of windows."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import SMALL, Array, Float32, small_carriers, small_map, small_rig

from moire_sensor.phase_carrier import Carrier, ripple_factor
from moire_sensor.phase_single import SHIFT_PENALTY, UNUSABLE, fit_windows, phase_from_single, pick_windows
from moire_sensor.settings import Settings
from moire_sensor.shot import Status

# Sums of 85 squares of up to 128^2 in float32: relative 6e-8 times some hundred additions and removals.
FLOAT32_SUMS = 0.05


def carrier_of(rows: int = 2) -> Carrier:
    return small_carriers(small_map(small_rig()), rows=rows)[0]


def fringes(carrier: Carrier, detuning: float = 0.0, noise: float = 2.0, seed: int = 0) -> Float32:
    """Fringes finer than the carrier by a share, on a background that slopes."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : SMALL[1], 0 : SMALL[0]]
    phase = carrier.phase_rad.astype(np.float64) + 0.7 + detuning * carrier.rad_per_px * (x - 48.0) + 0.01 * y
    image = 110.0 + 0.2 * x + 60.0 * np.cos(phase) + rng.normal(0.0, noise, x.shape)
    return image.astype(np.float32)


def fitted(image: Float32, carrier: Carrier) -> Float32:
    fit = np.zeros((4, *image.shape), dtype=np.float32)
    fit_windows(
        image, carrier.cos, carrier.sin, carrier.rad_per_px, carrier.inverse, carrier.detuned,
        carrier.half_width_px, carrier.half_height_px, fit,
    )  # fmt: skip
    return fit


def slow_fit(image: Float32, carrier: Carrier, y: int, x: int) -> tuple[float, float, float, float]:
    """Offset, background, amplitude and residual variance of one window by numpy's least squares."""
    rows, columns = carrier.half_height_px, carrier.half_width_px
    part = np.s_[y - rows : y + rows + 1, x - columns : x + columns + 1]
    values, phase = image[part].astype(np.float64).ravel(), carrier.phase_rad[part].astype(np.float64).ravel()
    design = np.stack([np.ones_like(phase), np.cos(phase), -np.sin(phase)], axis=1)
    found = np.linalg.lstsq(design, values, rcond=None)[0]
    offset, amplitude = np.arctan2(found[2], found[1]), np.hypot(found[1], found[2])
    t = np.tile(np.arange(-columns, columns + 1.0), 2 * rows + 1)
    column: Array = -t * amplitude * np.sin(phase + offset)
    with_detuning = np.column_stack([design, column])
    left_over = values - with_detuning @ np.linalg.lstsq(with_detuning, values, rcond=None)[0]
    return float(offset), float(found[0]), float(amplitude), float(left_over @ left_over / (values.size - 4))


@pytest.mark.parametrize("detuning", [0.0, 0.06])
@pytest.mark.parametrize("rows", [0, 2])
def test_fit_windows_is_least_squares(rows: int, detuning: float) -> None:
    carrier = carrier_of(rows)
    image = fringes(carrier, detuning)
    fit = fitted(image, carrier)
    for y in (rows, 17, SMALL[1] - 1 - rows):
        for x in (carrier.half_width_px, 30, 55, SMALL[0] - 1 - carrier.half_width_px):
            offset, background, amplitude, variance = slow_fit(image, carrier, y, x)
            assert abs(np.angle(np.exp(1j * (fit[0, y, x] - offset)))) < 1e-4
            assert fit[1, y, x] == pytest.approx(background, abs=1e-3)
            assert fit[2, y, x] == pytest.approx(amplitude, abs=1e-3)
            assert fit[3, y, x] == pytest.approx(variance, rel=FLOAT32_SUMS)


def test_windows_that_leave_the_image_are_unusable() -> None:
    carrier = carrier_of()
    fit = fitted(fringes(carrier), carrier)
    inside = np.zeros(fit.shape[1:], dtype=bool)
    inside[2:-2, carrier.half_width_px : -carrier.half_width_px] = True
    np.testing.assert_array_equal(fit[3] == UNUSABLE, ~inside)


def test_detuned_fringe_leaves_no_residual() -> None:
    """A fringe 5 % finer is a good fringe: its residual is of second order, its noise-free variance near zero."""
    carrier = carrier_of()
    x = np.arange(SMALL[0])
    image = (100.0 + 60.0 * np.cos(carrier.phase_rad + 0.05 * carrier.rad_per_px * (x - 48.0))).astype(np.float32)
    inside = fitted(image, carrier)[3, 2:-2, carrier.half_width_px : -carrier.half_width_px]
    # Taylor's next term, b (w e t)^2 / 2 with t up to 8 px, squared and averaged: below 0.15 grey levels.
    assert np.sqrt(inside.max()) < 0.15


def test_phase_is_unbiased_by_detuning() -> None:
    """A fringe 5 % finer than the carrier; what remains is far below the 3e-3 rad of the noise floor."""
    carrier = carrier_of()
    x = np.arange(SMALL[0])
    truth = np.broadcast_to(0.05 * carrier.rad_per_px * (x - 48.0), carrier.phase_rad.shape)
    image = (120.0 + 70.0 * np.cos(carrier.phase_rad + truth)).astype(np.float32)
    found = phase_from_single(image, carrier, 0.0, Settings())
    off = np.angle(np.exp(1j * (found.offset_rad - truth)))[:, 24:-24]
    assert np.median(np.abs(off)) < 1e-3
    ripple = abs(ripple_factor(float(np.abs(carrier.rad_per_px[20, 48])), carrier.half_width_px)) * 0.05
    assert ripple > 5e-3, "the ripple that was removed must be worth removing"


def test_phase_is_unbiased_by_background_and_step() -> None:
    carrier = carrier_of()
    image = (60.0 + 50.0 * np.cos(carrier.phase_rad + 0.4 + np.pi / 2)).astype(np.float32)
    found = phase_from_single(image, carrier, np.pi / 2, Settings())
    np.testing.assert_allclose(found.offset_rad, 0.4, atol=1e-4)
    np.testing.assert_allclose(found.amplitude, 50.0, atol=1e-2)
    np.testing.assert_allclose(found.background, 60.0, atol=1e-2)


@pytest.mark.parametrize(("grey", "status"), [(10.0, Status.UNLIT), (255.0, Status.SATURATED)])
def test_pixels_without_fringes_say_why(grey: float, status: Status) -> None:
    carrier = carrier_of()
    found = phase_from_single(np.full(SMALL[::-1], grey, dtype=np.float32), carrier, 0.0, Settings())
    assert np.isnan(found.offset_rad).all()
    assert (found.status == status).all()


def slow_choice(variance: Float32, y: int, x: int, half_width: int, half_height: int) -> tuple[int, int]:
    """Of the fifteen windows that hold the pixel the one that fits best, shifted ones with their penalty."""
    quarter = (half_width + 1) // 2
    ranked = []
    for j, dy in ((-1, -half_height), (0, 0), (1, half_height)):
        for i, dx in ((-2, -half_width), (-1, -quarter), (0, 0), (1, quarter), (2, half_width)):
            if 0 <= y + dy < variance.shape[0] and 0 <= x + dx < variance.shape[1]:
                penalty = SHIFT_PENALTY[max(abs(i), abs(j))]
                ranked.append((variance[y + dy, x + dx] * np.float32(penalty), len(ranked), y + dy, x + dx))
    return min(ranked)[2:]


def test_pick_windows_takes_the_best_fit_and_carries_its_phase() -> None:
    rng = np.random.default_rng(3)
    shape = (20, 60)
    ranges = ((0.3, 0.3), (50, 150), (20, 70), (1, 40))
    fit = np.stack([rng.uniform(*limits, shape) for limits in ranges]).astype(np.float32)
    slope = np.stack([np.full(shape, 0.02), np.full(shape, -0.03)]).astype(np.float32)
    picked = np.empty((4, *shape), dtype=np.float32)
    pick_windows(fit, fit[0], slope, 8, 2, 85, np.float32(0.0), picked)
    for y in range(shape[0]):
        for x in range(shape[1]):
            at = slow_choice(fit[3], y, x, 8, 2)
            assert tuple(picked[1:, y, x]) == tuple(fit[1:, at[0], at[1]])
            carried = 0.3 + 0.02 * (x - at[1]) - 0.03 * (y - at[0])
            assert picked[0, y, x] == pytest.approx(carried, abs=1e-5)


def test_good_windows_need_no_rival() -> None:
    shape = (12, 40)
    fit = np.full((4, *shape), 5.0, dtype=np.float32)
    fit[0] = 0.0
    fit[3, 6, 24] = 1.0
    picked = np.empty((4, *shape), dtype=np.float32)
    pick_windows(fit, fit[0], np.zeros((2, *shape), dtype=np.float32), 8, 2, 85, np.float32(6.0), picked)
    np.testing.assert_array_equal(picked[3], fit[3])


def test_window_does_not_straddle_a_jump() -> None:
    """Two surfaces whose phases differ by 2 rad: beside the edge each pixel has the phase of its own side."""
    carrier = carrier_of()
    step = np.where(np.arange(SMALL[0]) < 48, 0.0, 2.0)
    image = (120.0 + 70.0 * np.cos(carrier.phase_rad + step)).astype(np.float32)
    found = phase_from_single(image, carrier, 0.0, Settings())
    off = np.abs(np.angle(np.exp(1j * (found.offset_rad - step))))
    assert np.nanmax(off) < 0.02
