"""The one-period least squares of a single shot against plain linear algebra, and the choice of windows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from dense_rigs import SMALL, Array, Float32, outside_rig, small_carriers, small_map, small_rig

from moire_sensor.paper_rig import paper_pattern
from moire_sensor.phase_carrier import Carrier
from moire_sensor.phase_fit import empty_planes, fit_next, fit_work, next_columns, start_columns
from moire_sensor.phase_image import PhaseImage
from moire_sensor.phase_planes import (
    ALONG,
    AMPLITUDE,
    BACKGROUND,
    CARRIED,
    DOWN,
    OFFSET,
    UNUSABLE,
    VARIANCE,
    slope_down,
)
from moire_sensor.phase_single import (
    BAND_ROWS,
    SAMPLED_COLUMNS,
    SAMPLED_ROWS,
    carrier_rows,
    choice_of,
    phase_from_single,
)
from moire_sensor.phase_sums import SUM_ROOM, sum_windows
from moire_sensor.phase_table import FitTable, ripple_factor
from moire_sensor.phase_windows import SHIFT_PENALTY, pick_row, room_for
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings
from moire_sensor.shot import Status

# Sums of 85 squares of up to 128^2 in float32: relative 6e-8 times some hundred additions and removals.
FLOAT32_SUMS = 0.05


def carrier_of(rows: int = 2) -> Carrier:
    return small_carriers(small_map(small_rig()), rows=rows)[0]


def fringes(carrier: Carrier, detuning: float = 0.0, noise: float = 2.0, seed: int = 0) -> Float32:
    """Fringes finer than the carrier by a share, on a background that slopes."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(carrier.phase_rad.shape)
    phase = carrier.phase_rad.astype(np.float64) + 0.7 + detuning * carrier.rad_per_px * (x - 48.0) + 0.01 * y
    image = 110.0 + 0.2 * x + 60.0 * np.cos(phase) + rng.normal(0.0, noise, x.shape)
    return image.astype(np.float32)


class Planes:
    """Fits of a whole image, as the kernels see them: planes with a margin left and right, blank rows below."""

    def __init__(self, carrier: Carrier) -> None:
        self.carrier, self.rows = carrier, carrier_rows(carrier)
        height, width = carrier.cos.shape
        self.step = max(carrier.half_height_px, 1)
        self.values = empty_planes(self.rows, height + 4 * self.step)
        self.margin = (self.values.shape[2] - width) // 2

    def inside(self, plane: int) -> Float32:
        height, width = self.carrier.cos.shape
        return self.values[plane, :height, self.margin : self.margin + width]

    def fit(self, image: Float32) -> Planes:
        work, height = fit_work(self.rows), image.shape[0]
        start_columns(image, self.rows, self.carrier.half_height_px, work)
        for y in range(height):
            next_columns(image, self.rows, y, work)
            fit_next(image, self.rows, y, work, self.values)
        for y in range(height):
            slope_down(self.values, y, self.step)
        return self

    def picked(self, good: float) -> PhaseImage:
        """What pixels take, without regard to the noise."""
        shape = self.carrier.cos.shape
        image, status = np.zeros(shape, dtype=np.float32), np.empty(shape, dtype=np.uint8)
        offset, background, amplitude, sigma = np.empty((4, *shape), dtype=np.float32)
        choice = choice_of(self.carrier, 0.0, Settings(min_amplitude_to_noise=0.0))
        for y in range(shape[0]):
            pick_row(
                image[y], self.values, y, choice, room_for(shape[1]), np.float32(good), offset[y], background[y],
                amplitude[y], sigma[y], status[y],
            )  # fmt: skip
        return PhaseImage(offset, amplitude, background, sigma, status)


def fitted(image: Float32, carrier: Carrier) -> Planes:
    return Planes(carrier).fit(image)


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


def check_fit(image: Float32, carrier: Carrier, ys: Sequence[int], xs: Sequence[int]) -> None:
    planes = fitted(image, carrier)
    offset, variance = planes.inside(OFFSET), planes.inside(VARIANCE)
    for y in ys:
        for x in xs:
            expected = slow_fit(image, carrier, y, x)
            assert abs(np.angle(np.exp(1j * (offset[y, x] - expected[0])))) < 1e-4
            assert planes.inside(BACKGROUND)[y, x] == pytest.approx(expected[1], abs=1e-3)
            assert planes.inside(AMPLITUDE)[y, x] == pytest.approx(expected[2], abs=1e-3)
            assert variance[y, x] == pytest.approx(expected[3], rel=FLOAT32_SUMS)


@pytest.mark.parametrize("detuning", [0.0, 0.06])
@pytest.mark.parametrize("rows", [0, 2])
def test_fit_windows_is_least_squares(rows: int, detuning: float) -> None:
    carrier = carrier_of(rows)
    half = carrier.half_width_px
    check_fit(fringes(carrier, detuning), carrier, (rows, 17, SMALL[1] - 1 - rows), (half, 30, 55, SMALL[0] - 1 - half))


def test_fit_windows_under_a_turned_projector() -> None:
    """A carrier that bends: the constants of the fit change along the row and, between rows of the table, down it."""
    rig, size = outside_rig(), (640, 480)
    carrier = Carrier.left(ProjectorMap.build(rig, paper_pattern()), size, 60.0, 2)
    assert carrier.table.rows.size > 2
    noise = np.random.default_rng(1).normal(0.0, 2.0, size[::-1])
    image = (40.0 + 30.0 * np.cos(carrier.phase_rad + 0.7) + noise).astype(np.float32)
    between = int(carrier.table.rows[:2].mean())
    check_fit(image, carrier, (2, between, 203, 477), (carrier.half_width_px, 100, 317, 639 - carrier.half_width_px))


@pytest.mark.parametrize("size", [5, 6, 7, 8, 16, 17, 21, 31])
def test_window_sums_by_doubling(size: int) -> None:
    width = 40
    columns = np.random.default_rng(size).normal(0.0, 50.0, (4, width)).astype(np.float32)
    room, sums = np.zeros((SUM_ROOM, width), dtype=np.float32), np.empty((6, width + 1 - size), dtype=np.float32)
    sum_windows(columns, size, room, sums)
    windows = np.lib.stride_tricks.sliding_window_view(columns.astype(np.float64), size, axis=1)
    # a sum of 31 values of 50 in float32; the ramp multiplies by up to 30
    np.testing.assert_allclose(sums[:4], windows.sum(axis=2), atol=1e-3)
    np.testing.assert_allclose(sums[4:], windows[2:] @ np.arange(size), atol=4e-2)


def test_windows_that_leave_the_image_are_unusable() -> None:
    carrier = carrier_of()
    planes = fitted(fringes(carrier), carrier)
    inside = np.zeros(SMALL[::-1], dtype=bool)
    inside[2:-2, carrier.half_width_px : -carrier.half_width_px] = True
    np.testing.assert_array_equal(planes.inside(VARIANCE) == UNUSABLE, ~inside)
    planes.inside(VARIANCE)[:] = UNUSABLE
    assert (planes.values[VARIANCE] == UNUSABLE).all()


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_bands_are_the_whole_image(rows: int) -> None:
    """A band at a time, with its few rows of memory, gives what the fits of the whole image give."""
    size = (96, 2 * BAND_ROWS + 10)
    carrier = Carrier.left(small_map(small_rig()), size, 90.0, rows)
    rng = np.random.default_rng(4)
    patches = 2.0 * (rng.random((size[1] // 25 + 1, 3)).repeat(25, 0).repeat(32, 1) < 0.5)
    phase = carrier.phase_rad + patches[: size[1]]
    image = (120.0 + 60.0 * np.cos(phase) + rng.normal(0.0, 2.0, phase.shape)).astype(np.float32)
    banded = phase_from_single(image, carrier, 0.0, Settings(min_amplitude_to_noise=0.0))
    planes = fitted(image, carrier)
    sampled = [min(rows + SAMPLED_ROWS * i, size[1] - 1 - rows) for i in range(size[1] // SAMPLED_ROWS + 1)]
    half = carrier.half_width_px
    good = 1.3 * np.median(planes.inside(VARIANCE)[sampled][:, half:-half:SAMPLED_COLUMNS])
    whole = planes.picked(good)
    # Sums that start at another row round otherwise, 1e-4 of the variance, and then another window may be as good.
    for name in ("offset_rad", "amplitude", "background", "sigma_rad"):
        apart = np.abs(getattr(banded, name) - getattr(whole, name))
        assert np.mean(apart > 1e-3 * np.nanmedian(np.abs(getattr(whole, name)))) < 2e-3
    assert np.mean(banded.status != whole.status) < 1e-3


@pytest.mark.parametrize(("half_height", "step"), [(2, 2), (2, 3), (1, 2), (4, 6), (0, 2)])
def test_some_rows_are_those_of_the_whole_image(half_height: int, step: int) -> None:
    size = (96, 2 * BAND_ROWS + 11)
    carrier = Carrier.left(small_map(small_rig()), size, 90.0, half_height)
    image = fringes(carrier, 0.04, seed=2)
    image[70:90, 30:50] = 128.0
    some = phase_from_single(image, carrier, 0.3, Settings(), row_step=step)
    whole = phase_from_single(image, carrier, 0.3, Settings())
    assert some.rows[0] == (size[1] - 1) % step // 2
    assert len(some.rows) == len(some.offset_rad)
    for name in ("offset_rad", "amplitude", "background", "sigma_rad", "status"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[some.rows])


def test_buffer_is_used_again() -> None:
    """The second image's phase does not know of the first; what the Shot keeps is no part of the buffer."""
    carrier = carrier_of()
    buffer = np.empty((3, *SMALL[::-1]), dtype=np.float32)
    first = phase_from_single(fringes(carrier, seed=5), carrier, 0.0, Settings(), buffer)
    kept = first.background.copy(), first.status.copy()
    image = fringes(carrier, 0.03, seed=6)
    image[:, 60:] = 20.0
    second, alone = (phase_from_single(image, carrier, 0.0, Settings(), used) for used in (buffer, None))
    assert np.shares_memory(second.offset_rad, buffer)
    for name in ("offset_rad", "amplitude", "background", "sigma_rad", "status"):
        np.testing.assert_array_equal(getattr(second, name), getattr(alone, name))
    np.testing.assert_array_equal(first.background, kept[0])
    np.testing.assert_array_equal(first.status, kept[1])


def slow_slope(offset: Array, variance: Array) -> float:
    """Change over two steps from the pair of the windows -2..2 whose worse fit is best; 0 if the centre fits better."""
    pairs = (
        (max(variance[1], variance[3]), offset[3] - offset[1]),
        (1.5 * max(variance[0], variance[2]), offset[2] - offset[0]),
        (1.5 * max(variance[2], variance[4]), offset[4] - offset[2]),
    )
    worst, change = min(pairs, key=lambda pair: pair[0])
    return 0.0 if worst > 4.0 * variance[2] + 4.0 else float(np.angle(np.exp(1j * change)))


def test_slopes_come_from_the_pair_that_fits() -> None:
    """Two surfaces with an edge between them: slopes along and down, of the plain definition."""
    carrier = carrier_of()
    image = fringes(carrier, 0.05)
    image[18:, 40:] = fringes(carrier, -0.04, seed=1)[18:, 40:] * 0.7
    planes = fitted(image, carrier)
    offset, variance = (planes.values[k].astype(np.float64) for k in (OFFSET, VARIANCE))
    quarter, step = planes.margin // 2, planes.step
    limit = 0.6 * np.abs(carrier.rad_per_px)
    shifts = np.arange(-2, 3)
    for y, x in np.argwhere(planes.inside(VARIANCE) < UNUSABLE)[::7]:
        at = x + planes.margin
        along = slow_slope(*(plane[y, at + quarter * shifts] for plane in (offset, variance))) / (2 * quarter)
        down = slow_slope(*(plane[y + step * shifts, at] for plane in (offset, variance))) / (2 * step)
        # differences of float32 angles, and the factor of the penalty, decide between pairs that fit equally well
        assert planes.inside(ALONG)[y, x] == pytest.approx(np.clip(along, -limit[y, x], limit[y, x]), abs=1e-5)
        assert planes.inside(DOWN)[y, x] == pytest.approx(down, abs=1e-5)


def test_detuned_fringe_leaves_no_residual() -> None:
    """A fringe 5 % finer is a good fringe: its residual is of second order, its noise-free variance near zero."""
    carrier = carrier_of()
    x = np.arange(SMALL[0])
    image = (100.0 + 60.0 * np.cos(carrier.phase_rad + 0.05 * carrier.rad_per_px * (x - 48.0))).astype(np.float32)
    inside = fitted(image, carrier).inside(VARIANCE)[2:-2, carrier.half_width_px : -carrier.half_width_px]
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


def filled(carrier: Carrier, fits: dict[int, Array | float]) -> Planes:
    """Planes with given fits all over the image."""
    planes = Planes(carrier)
    for plane, values in fits.items():
        planes.inside(plane)[:] = values
    return planes


def test_pick_windows_takes_the_best_fit_and_carries_its_phase() -> None:
    carrier = carrier_of()
    rng = np.random.default_rng(3)
    shape = SMALL[::-1]
    # a tenth fits far better than the rest, so nearly no centred window is good as it is
    variance = np.where(rng.random(shape) < 0.1, 0.1, 1.0) * rng.uniform(20.0, 40.0, shape)
    fits = {CARRIED: 0.3, BACKGROUND: rng.uniform(50, 150, shape), AMPLITUDE: rng.uniform(20, 70, shape)}
    planes = filled(carrier, {**fits, VARIANCE: variance, ALONG: 0.02, DOWN: -0.03})
    good = 32.0
    found = planes.picked(good)
    fitted_variance = planes.inside(VARIANCE)
    shifted = 0
    for y in range(shape[0]):
        for x in range(shape[1]):
            needs_none = fitted_variance[y, x] <= good
            at = (y, x) if needs_none else slow_choice(fitted_variance, y, x, carrier.half_width_px, 2)
            shifted += at != (y, x)
            assert found.background[y, x] == planes.inside(BACKGROUND)[at]
            assert found.amplitude[y, x] == planes.inside(AMPLITUDE)[at]
            # 85 samples and two unknowns that matter: sigma of the phase is noise / amplitude * sqrt(2 / 85)
            expected = np.sqrt(fitted_variance[at] * 2.0 / 85.0) / found.amplitude[y, x]
            assert found.sigma_rad[y, x] == pytest.approx(expected, rel=1e-5)
            carried = 0.3 + 0.02 * (x - at[1]) - 0.03 * (y - at[0])
            assert found.offset_rad[y, x] == pytest.approx(carried, abs=1e-5)
    assert shifted > 100


def test_good_windows_need_no_rival() -> None:
    variance = np.full(SMALL[::-1], 5.0)
    variance[6, 24] = 1.0
    found = filled(carrier_of(), {AMPLITUDE: 10.0, VARIANCE: variance}).picked(6.0)
    # rounding of the square root
    np.testing.assert_allclose((found.sigma_rad * 10.0) ** 2 * 85.0 / 2.0, variance, rtol=1e-5)


def test_window_does_not_straddle_a_jump() -> None:
    """Two surfaces whose phases differ by 2 rad: beside the edge each pixel has the phase of its own side."""
    carrier = carrier_of()
    step = np.where(np.arange(SMALL[0]) < 48, 0.0, 2.0)
    image = (120.0 + 70.0 * np.cos(carrier.phase_rad + step)).astype(np.float32)
    found = phase_from_single(image, carrier, 0.0, Settings())
    off = np.abs(np.angle(np.exp(1j * (found.offset_rad - step))))
    assert np.nanmax(off) < 0.02


def test_rows_that_are_all_the_same_need_the_constants_of_one_window() -> None:
    """As many as are worked out from all rows, and the same."""
    projector = small_map(small_rig())
    carrier = small_carriers(projector, 90.0, rows=2)[0]
    columns, rows = np.meshgrid(np.arange(float(SMALL[0])), np.arange(float(SMALL[1])))
    phase = projector.phase_rad_at(columns, rows, 90.0)
    assert (phase == phase[:1]).all()
    speed, half_width = np.gradient(phase, axis=1), carrier.half_width_px
    ripple = ripple_factor(float(np.median(np.abs(speed))), half_width)
    whole = FitTable.build(phase, speed, half_width, half_height=2, ripple=ripple)
    assert carrier.table.rows.tolist() == whole.rows.tolist() == [2]
    np.testing.assert_array_equal(carrier.table.entries, whole.entries)
