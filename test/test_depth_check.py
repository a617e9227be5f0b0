"""Uniqueness, confidence and the agreement of the views against slow loops and known cases."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from dense_rigs import Float32, capture, dense_shot, sensor

from moire_sensor import Reconstructor, Status
from moire_sensor.depth_check import MISMATCH_WEIGHT, drop_rivals
from moire_sensor.depth_confidence import WEIGHTS, confidence_of
from moire_sensor.depth_refine import Match
from moire_sensor.depth_views import PATCH_PX, patch_mismatch_rad
from moire_sensor.right_view import REACH_PX


def random_match(seed: int, shape: tuple[int, int] = (24, 80)) -> Match:
    rng = np.random.default_rng(seed)
    disparity = np.where(rng.uniform(size=shape) < 0.5, 20.0, 34.0) + rng.normal(0, 0.3, shape)
    disparity[rng.uniform(size=shape) < 0.2] = np.nan
    sigma, mismatch = rng.uniform(0.01, 0.1, shape), rng.normal(0, 0.2, shape)
    signed = mismatch.astype(np.float32)
    return Match(disparity.astype(np.float32), sigma.astype(np.float32), signed, np.abs(signed))


def slow_badness(
    match: Match, amplitude: Float32, left: Float32, right: Float32, place: tuple[int, int], x: int
) -> float:
    """Of a pixel of the match's row ``place[0]``, the images' row ``place[1]``."""
    (y, image_y), (height, width) = place, left.shape
    column = float(np.float32(x) - match.disparity_px[y, x])
    rows = [row for row in (image_y - 1, image_y, image_y + 1) if 0 <= row < height]
    grey = []
    for row in rows:
        shifts = [s for s in range(-REACH_PX, REACH_PX + 1, 2)
                  if 0 <= x + s < width and 0 <= np.floor(column) + s < width - 1]  # fmt: skip
        seen = np.interp([column + s for s in shifts], np.arange(width), right[row])
        apart = [abs(float(left[row, x + s]) - v) for s, v in zip(shifts, seen, strict=True)]
        grey.append(np.mean(apart) if len(apart) > 1 else math.inf)
    return float(np.mean(grey) / max(amplitude[y, x], 1.0) + MISMATCH_WEIGHT * match.mismatch_rad[y, x])


@pytest.mark.parametrize("rows_of", [np.arange, lambda count: 1 + 2 * np.arange(count)])
def test_unique_pixels_equal_the_slow_loop(rows_of: Callable[[int], npt.NDArray[np.int64]]) -> None:
    match = random_match(1)
    rng = np.random.default_rng(2)
    shape = match.disparity_px.shape
    rows = rows_of(shape[0])
    left, right = (rng.uniform(20, 200, (rows[-1] + 1, shape[1])).astype(np.float32) for _ in range(2))
    amplitude = rng.uniform(20, 200, shape).astype(np.float32)
    expected = np.zeros(shape, dtype=bool)
    for y in range(shape[0]):
        claims: dict[int, list[int]] = {}
        for x in np.flatnonzero(np.isfinite(match.disparity_px[y])):
            column = math.floor(x - match.disparity_px[y, x] + 0.5)
            if 0 <= column < shape[1]:
                claims.setdefault(column, []).append(int(x))
        for pixels in claims.values():
            best = pixels[0]
            for x in pixels[1:]:
                other_surface = abs(match.disparity_px[y, best] - match.disparity_px[y, x]) > 1.0
                badness = [slow_badness(match, amplitude, left, right, (y, rows[y]), at) for at in (x, best)]
                best = x if other_surface and badness[0] < badness[1] else best
            for x in pixels:
                expected[y, x] = abs(match.disparity_px[y, best] - match.disparity_px[y, x]) <= 1.0
    found = match.disparity_px.copy()
    drop_rivals(found, match.mismatch_rad, amplitude, (left, right), rows)
    np.testing.assert_array_equal(found, np.where(expected, match.disparity_px, np.nan))
    assert 0.1 < expected.mean() < 0.9


def test_confidence_is_the_logistic_regression_of_its_five_properties() -> None:
    match = random_match(5)
    margin = np.random.default_rng(6).uniform(0, 6, match.disparity_px.shape).astype(np.float32)
    found = confidence_of(match.disparity_px, match, margin)
    height, width = match.disparity_px.shape
    padded = np.pad(match.disparity_px, 5, mode="reflect")
    for y in range(height):
        for x in range(width):
            if np.isnan(match.disparity_px[y, x]):
                assert found[y, x] == 0.0
                continue
            window = match.disparity_px[max(y - 3, 0) : y + 4, max(x - 3, 0) : x + 4]
            share = np.isfinite(padded[y : y + 11, x : x + 11]).mean()
            spread = np.nanmax(window) - np.nanmin(window)
            terms = (
                1.0,
                math.log(match.mismatch_rad[y, x] + 0.02),
                min(margin[y, x], 4.0),
                1.0 - share,
                math.log(min(spread, 8.0) + 0.1),
                min(match.sigma_px[y, x] + 1e-4, 1.0),
            )
            doubt = sum(float(weight) * term for weight, term in zip(WEIGHTS, terms, strict=True))
            assert found[y, x] == pytest.approx(1.0 / (1.0 + math.exp(doubt)), abs=1e-4)


def test_typical_mismatch_is_the_upper_quartile_of_patch_means() -> None:
    match = random_match(7, (3 * PATCH_PX + 5, 4 * PATCH_PX + 9))
    match.signed_mismatch_rad[:PATCH_PX] += np.float32(0.5)
    keep = np.isfinite(match.disparity_px)
    means = []
    for y in range(3):
        for x in range(4):
            part = np.s_[y * PATCH_PX : (y + 1) * PATCH_PX, x * PATCH_PX : (x + 1) * PATCH_PX]
            means.append(abs(match.signed_mismatch_rad[part][keep[part]].mean()))
    found = patch_mismatch_rad(match.signed_mismatch_rad, match.disparity_px)
    assert found == pytest.approx((np.percentile(means, 75), max(means)), abs=1e-5)
    nothing = np.full_like(match.disparity_px, np.nan)
    assert all(math.isnan(value) for value in patch_mismatch_rad(match.signed_mismatch_rad, nothing))


SWAP_SCENES = ["plane_600", "plane_1000", "plane_1500", "tilt_0.5", "cylinder_and_box", "small_plate", "thin_poles"]


@pytest.mark.parametrize("name", SWAP_SCENES)
def test_swapped_cameras_are_refused(name: str) -> None:
    """At 1 m a swapped pair meets the fringes 0.07 rad off, three orders away (physics.md): no depth may come of it."""
    seen = capture(name)
    shot = sensor().reconstruct(seen.right, seen.left)
    assert np.isnan(shot.depth_m).all()
    assert (shot.confidence == 0.0).all()
    assert (shot.status == Status.AMBIGUOUS).mean() > 0.5


@pytest.mark.parametrize("name", ["plane_1000", "cylinder_and_box"])
def test_swapped_cameras_are_refused_by_phase_shift(name: str) -> None:
    seen = capture(name, 4)
    assert np.isnan(sensor("phase_shift", 4).reconstruct(seen.right, seen.left).depth_m).all()


@pytest.mark.parametrize("scale", [0.9, 1.1])
@pytest.mark.parametrize("name", ["plane_1000", "tilt_0.5", "slope_1.2", "cylinder_and_box"])
def test_wrong_period_is_refused(name: str, scale: float) -> None:
    seen = capture(name)
    pattern = replace(seen.pattern, period_px=seen.pattern.period_px * scale)
    shot = Reconstructor(seen.rig, pattern).reconstruct(seen.left, seen.right)
    assert np.isnan(shot.depth_m).all()


def test_valid_texture_is_not_refused() -> None:
    """Texture moves the phases of single pixels by more than a swapped pair does, but either way."""
    for name in ("slope_1.2", "plane_1500"):
        assert np.isfinite(dense_shot(name, texture=0.3).depth_m).mean() > 0.7
