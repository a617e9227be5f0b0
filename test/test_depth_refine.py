"""Refinement and fringe order against plain numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dense_rigs import SMALL, Array, outside_rig, small_carriers, small_map, small_rig

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


TRUTH_PX = 8.3


def scene_of(
    noise_rad: tuple[float, float], lens: tuple[float, ...] = ()
) -> tuple[Array, tuple[PhaseImage, PhaseImage], tuple[Carrier, Carrier], ProjectorMap, OrderRange]:
    """True labels and what ``refine`` needs beside them."""
    projector = small_map(small_rig(lens))
    carriers = small_carriers(projector, 12.0)
    orders = OrderRange.build(projector, carriers[0], (-10.0, 34.0))
    truth = np.full(SMALL[::-1], TRUTH_PX)
    phases = phases_of(truth, projector, carriers, noise_rad)
    return true_labels(truth, projector, carriers[0], phases[0], orders.first), phases, carriers, projector, orders


def refined(noise_rad: tuple[float, float], lens: tuple[float, ...] = ()) -> tuple[Match, float]:
    return refine(*scene_of(noise_rad, lens), Settings(), 1.2), TRUTH_PX


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


def test_phases_that_disagree_give_no_disparity_but_their_mismatch() -> None:
    plain, _ = refined((0.05, 0.05))
    strict = refine(*scene_of((0.05, 0.05)), Settings(), 0.07)
    agree = plain.mismatch_rad <= 0.07
    assert 0.3 < agree.mean() < 0.9
    np.testing.assert_array_equal(strict.disparity_px, np.where(agree, plain.disparity_px, np.nan))
    np.testing.assert_array_equal(strict.mismatch_rad, plain.mismatch_rad)
    np.testing.assert_array_equal(strict.mismatch_rad, np.abs(strict.signed_mismatch_rad))


def test_a_second_choice_changes_the_match_where_it_has_a_label() -> None:
    label, *rest = scene_of((0.01, 0.01))
    match, again = (refine(label, *rest, Settings(), 1.2) for _ in range(2))
    other = np.full_like(label, -1)
    other[10:20] = label[10:20]
    match.disparity_px[8:22] = 0.0
    expected = again.disparity_px.copy()
    expected[[8, 9, 20, 21]] = 0.0
    assert refine(other, *rest, Settings(), 1.2, match) is match
    np.testing.assert_array_equal(match.disparity_px, expected)
    np.testing.assert_array_equal(match.sigma_px, again.sigma_px)
    alone = refine(other, *rest, Settings(), 1.2)
    np.testing.assert_array_equal(np.isfinite(alone.disparity_px), np.isfinite(again.disparity_px) & (other >= 0))


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
