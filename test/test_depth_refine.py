"""Refinement, fringe order and patch match against plain numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dense_rigs import SMALL, Array, Float32, outside_rig, small_carriers, small_map, small_rig

from moire_sensor.depth_patch import match_patches, measures_by_stereo, right_as_left
from moire_sensor.depth_refine import Match, fringe_orders, refine
from moire_sensor.order_range import OrderRange
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.phase_carrier import Carrier
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings
from moire_sensor.shot import UNKNOWN_ORDER

LENS = (-0.05, 0.02, 0.001, -0.0005)


def phases_of(
    truth_px: Array, projector: ProjectorMap, carriers: tuple[Carrier, Carrier], noise_rad: tuple[float, float]
) -> tuple[PhaseImage, PhaseImage]:
    """Phases of both views of a surface of constant disparity, with noise."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[0 : SMALL[1], 0 : SMALL[0]].astype(float)
    result = []
    for columns, carrier, noise in zip((x, x + truth_px), carriers, noise_rad, strict=True):
        phase = projector.phase_rad_at(columns, y, truth_px) + rng.normal(0.0, noise, x.shape) - carrier.phase_rad
        offset = np.angle(np.exp(1j * phase)).astype(np.float32)
        flat = np.full(x.shape, 50.0, dtype=np.float32)
        sigma = np.full(x.shape, noise, dtype=np.float32)
        result.append(PhaseImage(offset, flat, flat, sigma, np.zeros(x.shape, dtype=np.uint8)))
    return result[0], result[1]


def true_labels(truth_px: Array, projector: ProjectorMap, carrier: Carrier, left: PhaseImage, first: int) -> Array:
    y, x = np.mgrid[0 : SMALL[1], 0 : SMALL[0]].astype(float)
    turns = (projector.phase_rad_at(x, y, truth_px) - carrier.phase_rad - left.offset_rad) / (2 * np.pi)
    return (np.rint(turns) - first).astype(np.int8)


def refined(noise_rad: tuple[float, float], lens: tuple[float, ...] = ()) -> tuple[Match, float]:
    projector = small_map(small_rig(lens))
    carriers = small_carriers(projector, 12.0)
    orders = OrderRange.build(projector, carriers[0], (-10.0, 34.0))
    truth = np.full(SMALL[::-1], 8.3)
    phases = phases_of(truth, projector, carriers, noise_rad)
    label = true_labels(truth, projector, carriers[0], phases[0], orders.first)
    return refine(label, phases, carriers, projector, orders, Settings()), 8.3


@pytest.mark.parametrize("lens", [(), LENS], ids=["ideal", "lens"])
def test_exact_phases_give_the_exact_disparity(lens: tuple[float, ...]) -> None:
    match, truth = refined((0.0, 0.0), lens)
    # The lens turns the device columns by a little more in the right view's carrier than one column shift tells.
    np.testing.assert_allclose(match.disparity_px[:, 20:], truth, atol=2e-3)
    assert np.nanmax(match.mismatch_rad[:, 20:]) < 2e-3


def test_refinement_is_generalised_least_squares() -> None:
    """The closed solution of two measurements with covariance [[sL^2 + g^2, g^2], [g^2, sR^2 + a^2 + g^2]]."""
    noise = 0.02, 0.03
    match, _ = refined(noise)
    rig = small_rig()
    projector = small_map(rig)
    carriers = small_carriers(projector, 12.0)
    truth = np.full(SMALL[::-1], 8.3)
    left, right = phases_of(truth, projector, carriers, noise)
    settings = Settings()
    rad_per_px = 2 * np.pi / paper_pattern().period_px
    # Parallel axes: phase at the left pixel falls by (projector offset / baseline) of a turn a pixel of disparity.
    slope_left = -rad_per_px * 53.0 / 94.0
    slope_right = slope_left + rad_per_px
    g2, a2 = settings.common_error_rad**2, (settings.alignment_px * rad_per_px) ** 2
    covariance = np.array([[noise[0] ** 2 + g2, g2], [g2, noise[1] ** 2 + a2 + g2]])
    slopes = np.array([slope_left, slope_right])
    gain = np.linalg.solve(covariance, slopes) / (slopes @ np.linalg.solve(covariance, slopes))
    # The kernel takes the slope of the right phase from two noisy pixels; its median is the true one.
    predicted = float(np.hypot(gain[0] * noise[0], gain[1] * noise[1]))
    assert float(np.median(match.sigma_px[:, 20:])) == pytest.approx(predicted, rel=0.02)
    y, x = 20, 60
    y_grid, x_grid = np.array(float(y)), np.array(float(x))
    phase = projector.phase_rad_at(x_grid, y_grid, 8.3)
    measured = phase + np.angle(np.exp(1j * (carriers[0].phase_rad[y, x] + left.offset_rad[y, x] - phase)))
    disparity = 8.3
    for _ in range(4):
        column = x - disparity
        near = int(np.floor(column))
        pair = carriers[1].phase_rad[y, near : near + 2] + right.offset_rad[y, near : near + 2]
        seen = np.interp(column, [near, near + 1], np.unwrap(pair))
        expected = projector.phase_rad_at(x_grid, y_grid, disparity)
        steep = slope_left + (np.unwrap(pair)[1] - np.unwrap(pair)[0])
        now = np.array([slope_left, steep])
        weight = np.linalg.solve(covariance, now) / (now @ np.linalg.solve(covariance, now))
        disparity += weight @ [measured - expected, np.angle(np.exp(1j * (seen - expected)))]
    # Two rounds instead of four, and the last slope taken before the last step.
    assert match.disparity_px[y, x] == pytest.approx(disparity, abs=2e-3)


def test_scatter_is_the_predicted_sigma() -> None:
    match, truth = refined((0.02, 0.02))
    scatter = float(np.std(match.disparity_px[:, 20:] - truth))
    # 3000 pixels tell a standard deviation to 1.3 %; right phases are interpolated, which averages two at half a pixel.
    assert scatter == pytest.approx(float(np.median(match.sigma_px[:, 20:])), rel=0.2)


@pytest.mark.parametrize("name", ["paper", "outside", "lens"])
def test_fringe_orders_are_those_of_the_pattern(name: str) -> None:
    rig = {"paper": paper_rig, "outside": outside_rig, "lens": lambda: small_rig(LENS)}[name]()
    pattern = replace(paper_pattern(), phase_rad=0.8)
    width, height = rig.image_size
    rng = np.random.default_rng(5)
    depth = rng.uniform(0.6, 1.8, (height, width)).astype(np.float32)
    depth[rng.uniform(size=depth.shape) < 0.2] = np.nan
    columns = rig.projector_pixels(rig.rays() * depth[..., None])[..., 0]
    fast = fringe_orders(rig.disparity_px(depth).astype(np.float32), ProjectorMap.build(rig, pattern))
    expected = pattern.order_at(columns)
    part = columns / pattern.period_px + pattern.phase_rad / (2 * np.pi) + 0.5
    # A thousandth of a period from a border, float32 disparity and the lens tables (0.01 px) may fall on either side.
    clear = ~(np.abs(part - np.rint(part)) < 1e-3)
    np.testing.assert_array_equal(fast[clear], expected[clear])
    assert (fast[np.isnan(depth)] == UNKNOWN_ORDER).all()


def shifted_pair(disparity: float, seed: int) -> tuple[Float32, Float32]:
    """Smooth random images, the right one shifted by ``disparity`` exactly (band-limited, by Fourier)."""
    rng = np.random.default_rng(seed)
    k = np.fft.fftfreq(128)
    spectrum = np.fft.fft(rng.normal(size=(20, 128)), axis=1) * np.exp(-((k * 22.0) ** 2) / 2)
    left = np.fft.ifft(spectrum, axis=1).real
    right = np.fft.ifft(spectrum * np.exp(2j * np.pi * k * disparity), axis=1).real
    scale = 50.0 / left.std()
    return (128 + scale * left).astype(np.float32), (128 + scale * right).astype(np.float32)


def slow_patch(left: Float32, right: Float32, y: int, x: int, half_width: int, start: float) -> float:
    """Disparity of least squared difference of a patch by trying all in steps of 0.005 px."""
    rows = np.s_[y - 2 : y + 3]
    columns = np.arange(x - half_width, x + half_width + 1)
    tries = np.arange(start - 1.5, start + 1.5, 0.005)
    errors = []
    for disparity in tries:
        seen = np.stack([np.interp(columns - disparity, np.arange(128), row) for row in right[rows]])
        errors.append(np.mean((left[rows, columns] - seen) ** 2))
    return float(tries[int(np.argmin(errors))])


def test_patch_match_is_the_least_squares_shift() -> None:
    left, right = shifted_pair(10.3, 1)
    shape = left.shape
    disparity = np.full(shape, 11.0, dtype=np.float32)
    sigma = np.zeros(shape, dtype=np.float32)
    match_patches(
        left, right, np.full(shape, 0.5, dtype=np.float32), np.full(shape, 50.0, dtype=np.float32), 4, 0.1, 1.5, 0.15,
        disparity, sigma,
    )  # fmt: skip
    for y, x in ((6, 40), (10, 60), (12, 100)):
        # The kernel stops when a step is below 0.02 px.
        assert disparity[y, x] == pytest.approx(slow_patch(left, right, y, x, 4, 10.3), abs=0.02)
    # Linear interpolation between pixels biases a shift by a few hundredths of a pixel.
    assert np.median(np.abs(disparity[:, 30:100] - 10.3)) < 0.03


def test_only_doubtful_pixels_are_matched_again_and_misfits_dropped() -> None:
    left = shifted_pair(10.3, 2)[0]
    shape = left.shape
    mismatch = np.zeros(shape, dtype=np.float32)
    mismatch[:, 64:] = 0.5
    disparity = np.full(shape, 11.0, dtype=np.float32)
    unrelated = shifted_pair(10.3, 3)[1]
    sigma = np.zeros(shape, dtype=np.float32)
    amplitude = np.full(shape, 50.0, dtype=np.float32)
    match_patches(left, unrelated, mismatch, amplitude, 4, 0.1, 1.5, 0.15, disparity, sigma)
    assert (disparity[:, :64] == 11.0).all()
    assert np.isnan(disparity[:, 64:]).mean() > 0.95


def test_right_as_left_equalises_gain_and_shift() -> None:
    projector = small_map(small_rig())
    carriers = small_carriers(projector, 12.0)
    phases = phases_of(np.full(SMALL[::-1], 8.3), projector, carriers, (0.0, 0.0))
    dim = replace(phases[1], amplitude=phases[1].amplitude * np.float32(0.8), background=phases[1].background * 0.8 - 5)
    disparity = np.full(SMALL[::-1], 8.3, dtype=np.float32)
    right = np.random.default_rng(0).uniform(0, 150, SMALL[::-1]).astype(np.float32)
    np.testing.assert_allclose(right_as_left(right, disparity, (phases[0], dim)), (right + 5.0) / 0.8, rtol=1e-4)


def test_views_that_measure_follow_from_the_rig() -> None:
    """The paper's projector stands between the cameras; one 200 mm outside a 40 mm pair measures better."""
    for rig, by_stereo in ((paper_rig(), True), (outside_rig(), False)):
        projector = ProjectorMap.build(rig, paper_pattern())
        carrier = Carrier.left(projector, rig.image_size, float(rig.disparity_px(1.0)), 2)
        assert measures_by_stereo(carrier, projector) is by_stereo
