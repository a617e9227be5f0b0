"""Disparities by grey levels: the kernels against loops, and known sub-pixel shifts of noisy fringes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dense_rigs import Array, Float32, outside_rig

from moire_sensor.depth_foreign import drop_foreign
from moire_sensor.depth_grey import (
    add_moves,
    approach_greys,
    check_greys,
    compare,
    match_greys,
    measures_by_stereo,
    right_as_left,
    typical_noise,
)
from moire_sensor.depth_measure import (
    BAND_ROWS,
    EXCESS,
    FOREIGN_SHARE,
    LARGEST_STEP_PX,
    ROUNDS_SIGMA,
    SAME_ROWS,
    fill_sigma,
    measure,
)
from moire_sensor.depth_refine import Match
from moire_sensor.depth_rows import all_rows
from moire_sensor.paper_rig import PERIOD_PX, paper_pattern, paper_rig
from moire_sensor.phase_carrier import Carrier
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

HALF_WIDTH = 8
NOISE = 1.5


def random_views(seed: int, shape: tuple[int, int]) -> tuple[Float32, Float32, Float32, Float32]:
    """Left and right grey levels, disparities with holes and beyond both borders, amplitudes."""
    rng = np.random.default_rng(seed)
    left, right = (rng.uniform(0.0, 255.0, shape).astype(np.float32) for _ in range(2))
    disparity = rng.uniform(-0.4 * shape[1], 0.9 * shape[1], shape).astype(np.float32)
    disparity[:, ::7] = np.rint(disparity[:, ::7])
    disparity[rng.uniform(size=shape) < 0.1] = np.nan
    return left, right, disparity, rng.uniform(50.0, 600.0, shape).astype(np.float32)


def cubic(row: Array, column: float) -> tuple[float, float]:
    """Value and slope of the cubic through the nearest two pixels with their central differences as slopes."""
    base = int(column)
    t = column - base
    before, near, far, after = row[base - 1 : base + 3].astype(float)
    starts, ends = (far - before) / 2.0, (after - near) / 2.0
    # Hermite's base functions and their derivatives.
    value = (2 * t**3 - 3 * t**2 + 1) * near + (t**3 - 2 * t**2 + t) * starts
    value += (-2 * t**3 + 3 * t**2) * far + (t**3 - t**2) * ends
    slope = (6 * t**2 - 6 * t) * (near - far) + (3 * t**2 - 4 * t + 1) * starts + (3 * t**2 - 2 * t) * ends
    return value, slope


def slow_compare(left: Float32, right: Float32, disparity: Float32, amplitude: Float32) -> Array:
    """Slope times slope, slope times difference, difference: (3, H, W)."""
    height, width = left.shape
    result = np.zeros((3, height, width))
    for y, x in np.argwhere(np.isfinite(disparity)):
        column = float(np.float32(x) - disparity[y, x])
        if not 1.0 <= column <= width - 3:
            continue
        value, slope = cubic(right[y], column)
        beside = left[y, [max(x - 1, 0), min(x + 1, width - 1)]].astype(float)
        own = (beside[1] - beside[0]) / 2.0
        difference = float(left[y, x]) - value
        result[2, y, x] = abs(difference)
        if abs(difference) < FOREIGN_SHARE * amplitude[y, x] + 3.0 * NOISE:
            result[:2, y, x] = own * slope, -own * difference
    return result


@pytest.mark.parametrize("shape", [(12, 60), (1, 8), (5, 4)])
def test_comparison_is_that_of_the_slow_loop(shape: tuple[int, int]) -> None:
    left, right, disparity, amplitude = random_views(1, shape)
    found = np.full((3, *shape), np.nan, dtype=np.float32)
    compare(left, right, disparity, amplitude, np.float32(NOISE), *found)
    expected = slow_compare(left, right, disparity, amplitude)
    # Products of two slopes of up to 300 grey levels a pixel, in float32 with columns to 4e-6 px.
    np.testing.assert_allclose(found, expected, atol=0.5, rtol=1e-4)
    if shape[1] == 60:
        known, same = expected[2] > 0.0, expected[0] != 0.0
        assert 0.3 < known.mean() < 0.8
        assert 0.3 < same.sum() / known.sum() < 0.9


def test_columns_at_the_images_borders_have_slopes_of_their_own_row() -> None:
    """The last column has no right neighbour: what stands in the next row must not matter."""
    left, right, disparity, amplitude = random_views(2, (6, 40))
    disparity[:] = 3.25
    found = []
    for scale in (1.0, 0.0):
        left[1::2] *= np.float32(scale)
        result = np.full((3, *left.shape), np.nan, dtype=np.float32)
        compare(left, right, disparity, amplitude, np.float32(NOISE), *result)
        found.append(result[:, ::2])
    np.testing.assert_array_equal(found[0], found[1])


def window_sums(values: Array, columns: int, rows: int) -> Array:
    """Sums over the window centred on each pixel, as if the image went on with zeros."""
    padded = np.pad(values, ((rows // 2,) * 2, (columns // 2,) * 2))
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, (rows, columns)).sum(axis=(2, 3)))


@pytest.mark.parametrize(("columns", "far_px", "enough"), [(7, 0.2, 3e3), (17, 0.2, 9e3), (25, 0.2 * 25 / 17, 1.5e4)])
def test_a_round_moves_disparities_as_the_slow_loop(columns: int, far_px: float, enough: float) -> None:
    """Two bands of an image whose rows have nothing in common; where fringes are wide, few steps are far."""
    shape, half_height, enough = (BAND_ROWS + 11, 40), 3, np.float32(enough)
    left, right, disparity, amplitude = random_views(3, shape)
    apart, power, found = np.full((3, *shape), np.nan, dtype=np.float32)
    far = measure(
        left, right, disparity, amplitude, 0, 1, columns, half_height, np.float32(NOISE), enough, apart, power, found
    )
    products = slow_compare(left, right, disparity, amplitude)
    powers, mets = (window_sums(part, columns, 2 * half_height + 1) for part in products[:2])
    step = np.where(powers > enough, np.clip(mets / np.maximum(powers, enough), -LARGEST_STEP_PX, LARGEST_STEP_PX), 0.0)
    # Sums of some twenty squares of 100 grey levels a pixel; where just enough is seen, a pixel may move or not.
    np.testing.assert_allclose(power, powers, atol=5.0, rtol=1e-4)
    np.testing.assert_allclose(apart, products[2], atol=0.5)
    clear = np.abs(powers - enough) > 10.0
    np.testing.assert_allclose(found[clear], (disparity + step)[clear], atol=1e-3)
    assert far == pytest.approx(np.count_nonzero((np.abs(step) > far_px) & np.isfinite(disparity)), abs=5)
    assert 0.2 < np.mean(powers > enough) < 0.9
    assert (np.abs(step) == LARGEST_STEP_PX).any()


def test_a_round_of_some_rows_is_that_of_their_images() -> None:
    left, right, disparity, amplitude = random_views(4, (31, 40))
    some = [np.ascontiguousarray(image[1::3]) for image in (left, right, disparity, amplitude)]
    results = [np.full((3, *some[0].shape), np.nan, dtype=np.float32) for _ in range(2)]
    settings = 7, 2, np.float32(NOISE), np.float32(3e3)
    measure(left, right, *some[2:], 1, 3, *settings, *results[0])
    measure(*some, 0, 1, *settings, *results[1])
    np.testing.assert_array_equal(*results)


def sigma_of(apart: Float32, power: Float32) -> Float32:
    sigma = np.empty_like(apart)
    fill_sigma(apart, power, 17, 7, np.float32(225.0), typical_noise(apart), sigma)
    return sigma


def test_sigma_is_that_of_the_differences_left_over() -> None:
    """Normal noise of known size on known slopes: the window's standard deviation, what both rounds add included."""
    rng = np.random.default_rng(3)
    apart = np.abs(rng.normal(0.0, 2.0, (60, 80))).astype(np.float32)
    apart[rng.uniform(size=apart.shape) < 0.3] = 0.0
    power = np.full(apart.shape, 900.0, dtype=np.float32)
    sigma = sigma_of(apart, power)
    # Some 200 pixels tell a mean magnitude to 5 %.
    np.testing.assert_allclose(sigma[8:-8, 9:-9], ROUNDS_SIGMA * 2.0 / 30.0, rtol=0.25)
    assert np.median(sigma) == pytest.approx(ROUNDS_SIGMA * 2.0 / 30.0, rel=0.03)
    # Where there is nothing to measure by, as if there were just enough.
    assert sigma_of(apart, -power) == pytest.approx(2.0 * sigma, rel=1e-5)


def test_differences_above_the_usual_ones_count_for_all_rows() -> None:
    """Beside a sharp step of brightness, in columns 40 to 44, interpolation errs by 20 grey levels in every row."""
    apart = np.abs(np.random.default_rng(3).normal(0.0, 2.0, (60, 120))).astype(np.float32)
    apart[:, 40:45] += np.float32(20.0)
    sigma = sigma_of(apart, np.full(apart.shape, 900.0, dtype=np.float32))
    # A twentieth of the pixels moves a median by a twelfth of a standard deviation.
    assert typical_noise(apart) == pytest.approx(2.0, rel=0.15)
    of_window = np.sqrt(np.pi / 2.0) * window_sums(apart.astype(float), 17, 15) / (17 * 15)
    noise = float(typical_noise(apart))
    variance = of_window**2 + SAME_ROWS * np.maximum(of_window**2 - EXCESS * noise**2, 0.0)
    inside = np.s_[8:-8, 9:-9]
    np.testing.assert_allclose(sigma[inside], (ROUNDS_SIGMA * np.sqrt(variance) / 30.0)[inside], rtol=1e-3)
    assert np.median(sigma[inside][:, 33:35]) > 10.0 * np.median(sigma[inside][:, 60:])


def test_what_the_last_round_moved_is_added_to_sigma() -> None:
    moves = np.random.default_rng(7).normal(0.0, 0.05, (40, 60)).astype(np.float32)
    moves[:, 25] = np.nan
    sigma = np.full(moves.shape, 0.12, dtype=np.float32)
    add_moves(sigma, moves, 8, 7)
    y, x = 20, 30
    window = moves[y - 7 : y + 8, x - 8 : x + 9].astype(float)
    assert sigma[y, x] == pytest.approx(np.sqrt(0.12**2 + np.nanmean(window**2)), rel=1e-4)
    assert np.isfinite(sigma).all()


@pytest.mark.parametrize(("half_rows", "height"), [(0, 130), (1, 130), (1, 1)])
def test_a_pixel_is_foreign_if_the_views_differ_in_every_window_that_holds_it(half_rows: int, height: int) -> None:
    width = 24
    apart = np.random.default_rng(5).uniform(0.0, 9.0, (height, width)).astype(np.float32)
    amplitude = np.full_like(apart, 10.0)
    mirrored = np.pad(apart, 2, mode="reflect").astype(float)
    rows = range(-half_rows, half_rows + 1)
    means = {
        (y, x): np.mean([mirrored[y + 2 + down, x : x + 5] for down in rows])
        for y in range(height)
        for x in range(width)
    }
    best = np.array([
        [min(means.get((y + down, x + aside), np.inf) for down in rows for aside in range(-2, 3)) for x in range(width)]
        for y in range(height)
    ])  # fmt: skip
    disparity, limit = np.full_like(apart, 5.0), float(np.median(best))
    drop_foreign(disparity, apart, amplitude, half_rows, Settings(image_noise=0.5 * (limit - 1.0), max_misfit=0.1))
    decided = np.abs(best - limit) > 1e-4
    np.testing.assert_array_equal(np.isnan(disparity)[decided], (best > limit)[decided])


def fringes(columns: Array, amplitude: float) -> Array:
    """A fringe on a surface whose background falls to the right and is textured."""
    background = 120.0 - 0.15 * columns + 4.0 * np.sin(columns / 23.0)
    return background + amplitude * np.cos(2.0 * np.pi * columns / PERIOD_PX)


def shifted_views(disparity: float, amplitude: float, seed: int, slope: float = 0.0) -> tuple[Float32, Float32]:
    """Both views of a plane of disparity ``disparity + slope x``, (240, 320), with noise of their own."""
    rng = np.random.default_rng(seed)
    x = np.arange(320.0)
    left, right = fringes(x, amplitude), fringes((x + disparity) / (1.0 - slope), amplitude)
    noisy = [np.float32(line + rng.normal(0.0, NOISE, (240, 320))) for line in (left, right)]
    return noisy[0], noisy[1]


def start(disparity: Array | float) -> Match:
    flat = np.broadcast_to(np.float32(disparity), (240, 320)).copy()
    return Match(flat, np.full_like(flat, 0.1), np.zeros_like(flat), np.zeros_like(flat))


def settled(views: tuple[Float32, Float32], amplitude: float, first: Array | float) -> Match:
    """Measured as the pipeline does it: every second row first."""
    match, flat = start(first), np.full((120, 320), amplitude, dtype=np.float32)
    some = Match(*(np.ascontiguousarray(image[::2]) for image in match.images()))
    phase = PhaseImage(flat, flat, flat, flat, np.zeros(flat.shape, dtype=np.uint8), 0, 2)
    some = approach_greys(some, views, phase, HALF_WIDTH, Settings())
    match, _, seen = all_rows(some, flat, phase, np.empty((6, 240, 320), dtype=np.float32))
    return match_greys(match, views, seen.amplitude, HALF_WIDTH, Settings())


def floor_px(amplitude: float, rows: int = 15) -> float:
    """Noise floor: standard deviation of a shift of one period's pixels in two images (Cramer and Rao)."""
    squares = (2.0 * np.pi / PERIOD_PX * amplitude) ** 2 / 2.0 * (2 * HALF_WIDTH + 1) * rows
    return float(NOISE * np.sqrt(2.0 / squares))


def interpolation_px(disparity: float) -> float:
    """Shift of a fringe that central differences as slopes cost: their error is a sixth of the third derivative."""
    t = 1.0 - disparity % 1.0
    return abs(t * (1.0 - t) * (1.0 - 2.0 * t)) / 6.0 * (2.0 * np.pi / PERIOD_PX) ** 2


WHOLE = np.s_[10:-10, 40:-20]


@pytest.mark.parametrize("disparity", [12.0, 12.2, 12.5, 12.8])
@pytest.mark.parametrize("amplitude", [20.0, 70.0])
def test_a_known_shift_is_measured_without_bias(disparity: float, amplitude: float) -> None:
    """Squared slopes of one image would draw shifts at amplitude 20 to whole pixels by half the noise floor."""
    match = settled(shifted_views(disparity, amplitude, 6), amplitude, disparity + 0.3)
    error = match.disparity_px[WHOLE] - disparity
    # Some 220 independent windows tell the mean to 7 % of the floor.
    assert abs(error.mean()) < 0.2 * floor_px(amplitude) + interpolation_px(disparity)
    assert error.std() < 1.3 * floor_px(amplitude)


@pytest.mark.parametrize("slope", [-0.15, 0.25])
def test_a_sloped_plane_is_measured_without_bias(slope: float) -> None:
    truth = 12.3 + slope * np.arange(320.0)
    match = settled(shifted_views(12.3, 70.0, 7, slope), 70.0, truth - 0.25)
    inside = match.disparity_px[10:-10, 110:270] - truth[110:270]
    assert abs(inside.mean()) < 0.3 * floor_px(70.0)
    assert np.isfinite(inside).all()


@pytest.mark.parametrize("amplitude", [20.0, 70.0])
def test_predicted_sigma_is_the_scatter(amplitude: float) -> None:
    match = settled(shifted_views(12.4, amplitude, 8), amplitude, 12.5)
    # What issue and contract demand of depth_sigma_m.
    assert np.median(match.sigma_px[WHOLE]) == pytest.approx((match.disparity_px[WHOLE] - 12.4).std(), rel=0.2)


def test_unknown_stays_unknown_and_edges_do_not_move_what_lies_beside_them() -> None:
    """Two surfaces 9.5 px apart: each is measured as if the other were not there, beyond what windows can reach.

    Two windows and the mean between them reach 3 x 8 px; columns 150 to 160 are hidden from the right camera.
    """
    pairs = zip(shifted_views(12.2, 70.0, 9), shifted_views(21.7, 70.0, 10), strict=True)
    # The near surface begins at left column 160, so at right column 138.3.
    views = [np.where(np.arange(320) < border, *pair) for border, pair in zip((160, 139), pairs, strict=True)]
    first = np.where(np.arange(320) < 160, 12.4, 21.5) * np.ones((240, 1))
    first[100:110, 60:70] = np.nan
    match = settled((views[0], views[1]), 70.0, first)
    assert np.isnan(match.disparity_px[100:110, 60:70]).all()
    assert np.isfinite(match.disparity_px[:, 160:280]).mean() > 0.99
    for columns, truth in ((np.s_[40:126], 12.2), (np.s_[184:290], 21.7)):
        error = match.disparity_px[10:-10, columns] - truth
        assert abs(np.nanmean(error)) < 0.3 * floor_px(70.0) + interpolation_px(truth)
        # 4 to 5 sigma are the largest of some 80 independent windows.
        assert np.nanmax(np.abs(error)) < 6.0 * floor_px(70.0)


def test_views_that_look_different_lose_their_disparity() -> None:
    left, right = shifted_views(12.2, 70.0, 11)
    right[:, 150:] = fringes(np.arange(150, 320) + 12.2 + 0.5 * PERIOD_PX, 70.0)
    match = settled((left, right), 70.0, 12.3)
    assert np.isfinite(match.disparity_px[:, 20:150]).all()
    assert np.isnan(match.disparity_px[:, 172:300]).mean() > 0.9


def test_check_leaves_what_fits_and_drops_what_does_not() -> None:
    left, right = shifted_views(12.2, 70.0, 12)
    match = start(12.2)
    match.disparity_px[120:, :] += np.float32(0.5 * PERIOD_PX)
    match.disparity_px[50:60, 100:120] = np.nan
    before = match.disparity_px.copy()
    check_greys(match, (left, right), np.full(left.shape, 70.0, dtype=np.float32), Settings())
    after = match.disparity_px
    known = np.isfinite(after)
    np.testing.assert_array_equal(after[known], before[known])
    assert known[:119, 20:300].mean() == pytest.approx(1.0 - 200.0 / (119 * 280))
    # Half a period off, a cosine meets its own negative, and crosses it twice a period: windows of five columns there.
    assert known[121:, 40:300].mean() < 0.35


FLAT = (100, 200)


def flat_phases() -> tuple[PhaseImage, PhaseImage]:
    known = np.zeros(FLAT, dtype=np.float32)
    x = np.broadcast_to(np.arange(FLAT[1], dtype=np.float32), FLAT)
    left = PhaseImage(known, 50.0 + 0.1 * x, 80.0 + x, known + 0.01, np.zeros(FLAT, dtype=np.uint8))
    # What the left camera sees at column x the right one sees 8 columns farther left, dimmer.
    dim = replace(left, amplitude=0.8 * (left.amplitude + 0.8), background=0.8 * (left.background + 8.0) - 5.0)
    return left, dim


def test_right_as_left_equalises_gain_and_shift() -> None:
    disparity = np.full(FLAT, 8.3, dtype=np.float32)
    disparity[::2] = np.nan
    right = np.random.default_rng(0).uniform(0, 150, FLAT).astype(np.float32)
    np.testing.assert_allclose(right_as_left(right, disparity, flat_phases()), (right + 5.0) / 0.8, rtol=2e-4)


def test_too_few_matches_tell_no_gain() -> None:
    disparity = np.full(FLAT, np.nan, dtype=np.float32)
    disparity[:20, :20] = 8.3
    right = np.random.default_rng(0).uniform(0, 150, FLAT).astype(np.float32)
    np.testing.assert_array_equal(right_as_left(right, disparity, flat_phases()), right)


def test_views_that_measure_follow_from_the_rig() -> None:
    """The paper's projector stands between the cameras; one 200 mm outside a 40 mm pair measures better."""
    for rig, by_stereo in ((paper_rig(), True), (outside_rig(), False)):
        projector = ProjectorMap.build(rig, paper_pattern())
        carrier = Carrier.left(projector, rig.image_size, float(rig.disparity_px(1.0)), 2)
        assert measures_by_stereo(carrier, projector) is by_stereo
