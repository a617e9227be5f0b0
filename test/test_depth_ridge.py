"""Ridges across rows: pixels beside them go to the face they are on, and nothing else moves."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import Array, Float32

from moire_sensor.depth_refine import Match
from moire_sensor.depth_ridge import DOUBT_PX, STEPS, matched, sharpen

HEIGHT, WIDTH, RIDGE = 20, 120, 60
NOISE, PERIOD_PX = 1.5, 17.0
BRIGHT, DIM = 60.0, 12.0


def lines(bend: float, step: float = 0.0) -> Array:
    """Disparity of a row whose slope changes by ``bend`` in column ``RIDGE``, where it also steps."""
    away = np.arange(WIDTH) - float(RIDGE)
    return 20.0 + 0.03 * away + np.where(away < 0.0, 0.0, bend * away + step)


def views(line: Array) -> tuple[Float32, Float32]:
    """Fringes (H, W) on that surface, dim from the ridge on, seen by both cameras; the right one by interpolation."""
    rng = np.random.default_rng(4)
    fine = np.linspace(-40.0, WIDTH + 40.0, 16 * (WIDTH + 80) + 1)
    seen = np.where(fine < RIDGE, BRIGHT, DIM) * (1.5 + np.cos(2.0 * np.pi * fine / PERIOD_PX))
    at = fine - np.interp(fine, np.arange(WIDTH), line)
    left = np.interp(np.arange(WIDTH), fine, seen)
    right = np.interp(np.arange(WIDTH), at, seen)
    noisy = [np.float32(row + rng.normal(0.0, NOISE, (HEIGHT, WIDTH))) for row in (left, right)]
    return noisy[0], noisy[1]


def match_at(line: Array) -> Match:
    disparity = np.broadcast_to(np.float32(line), (HEIGHT, WIDTH)).copy()
    return Match(disparity, *(np.full_like(disparity, value) for value in (0.3, 0.1, 0.1)))


def amplitudes() -> Float32:
    return np.broadcast_to(np.where(np.arange(WIDTH) < RIDGE, np.float32(BRIGHT), np.float32(DIM)), (HEIGHT, WIDTH))


def rounded(line: Array) -> Array:
    """The line as a window of a fringe leaves the dim face: a pixel off at the ridge."""
    away = np.arange(WIDTH) - float(RIDGE)
    return np.asarray(line + np.where(away < 0.0, 0.0, -1.2 * np.exp(-away / 3.0)))


@pytest.mark.parametrize("mirror", [False, True])
def test_a_rounded_ridge_is_sharpened(mirror: bool) -> None:
    line = lines(-0.55)
    match = match_at(rounded(line))
    greys, amplitude = views(line), amplitudes()
    if mirror:
        # From behind: right and left change places, and disparities belong to the view that was the right one.
        turned = [np.ascontiguousarray(image[:, ::-1]) for image in (match.disparity_px, *greys, amplitude)]
        match = Match(-turned[0], *(image.copy() for image in match.images()[1:]))
        sharpen(match, (turned[1], turned[2]), turned[3])
        error = -match.disparity_px[:, ::-1] - line
    else:
        sharpen(match, greys, amplitude)
        error = match.disparity_px - line
    beside = slice(RIDGE, RIDGE + DOUBT_PX)
    assert np.abs(rounded(line) - line)[RIDGE] > 1.0
    # Five rows of a dozen pixels of 12 grey levels tell a line to 0.1 px, at its end to 0.2 px; four sigmas of that,
    # and half a pixel is what the stage leaves alone.
    assert np.abs(error[:, beside]).max() < 0.8
    assert np.median(np.abs(error[:, RIDGE])) < 0.3
    np.testing.assert_allclose(error[:, : RIDGE - 1], 0.0, atol=1e-5)


def test_moved_pixels_tell_how_sure_they_are() -> None:
    line = lines(-0.55)
    match = match_at(rounded(line))
    sharpen(match, views(line), amplitudes())
    moved = np.abs(match.disparity_px - rounded(line)) > 0.4
    ratio = (match.disparity_px - line)[moved] / match.sigma_px[moved]
    # Twenty rows, five of which share their grey levels: a standard deviation to a quarter.
    assert moved.sum() >= HEIGHT
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.5)
    # Noise of two views, one of them interpolated, in amplitudes of the dim face.
    np.testing.assert_allclose(match.mismatch_rad[moved], np.sqrt(1.7) * NOISE / DIM, rtol=0.4)
    assert np.isnan(match.signed_mismatch_rad[moved]).all()
    assert (match.sigma_px[~moved] == np.float32(0.3)).all()


@pytest.mark.parametrize("line", [lines(0.0, 1.5), lines(-0.55, -6.0), lines(0.0)], ids=["step", "jump", "flat"])
def test_what_is_no_ridge_stays(line: Array) -> None:
    """Parallel faces do not meet, and faces of different depths do not meet here."""
    match = match_at(line)
    before = match.disparity_px.copy()
    sharpen(match, views(line), amplitudes())
    np.testing.assert_array_equal(match.disparity_px, before)


def test_unknown_pixels_stay_unknown_and_a_short_face_tells_nothing() -> None:
    line = lines(-0.55)
    hole = rounded(line)
    hole[RIDGE - 1 : RIDGE + 2] = np.nan
    match = match_at(hole)
    sharpen(match, views(line), amplitudes())
    np.testing.assert_array_equal(np.isnan(match.disparity_px[0]), np.isnan(hole))
    short = rounded(line)
    short[RIDGE + 10 :] = np.nan
    match = match_at(short)
    sharpen(match, views(line), amplitudes())
    np.testing.assert_array_equal(match.disparity_px, match_at(short).disparity_px)


def test_a_line_is_matched_as_the_slow_least_squares() -> None:
    line = lines(-0.55)
    left, right = views(line)
    first, end, middle, y = RIDGE + 1, RIDGE + 14, RIDGE + 8, 9
    found = matched(left, right, y, first, end, middle, np.float32(line[middle] + 0.2), np.float32(-0.5))
    columns = np.tile(np.arange(first, end), 5)
    rows = np.repeat(np.arange(y - 2, y + 3), end - first)
    parameters = np.array([line[middle] + 0.2, -0.5])
    for _ in range(STEPS):
        at = columns - parameters[0] - parameters[1] * (columns - middle)
        base, part = at.astype(int), at - at.astype(int)
        four = [right[rows, base + n].astype(float) for n in (-1, 0, 1, 2)]
        value = four[1] + part * (four[2] - four[1])
        grade = 0.5 * ((1.0 - part) * (four[2] - four[0]) + part * (four[3] - four[1]))
        design = np.stack([grade, grade * (columns - middle)], axis=1)
        step, rest, _, _ = np.linalg.lstsq(design, value - left[rows, columns], rcond=None)
        parameters += step
    variance = rest[0] / (columns.size - 2)
    np.testing.assert_allclose(found[1:4], [*parameters, variance], rtol=1e-3)
    covariance = np.linalg.inv(design.T @ design)
    expected = covariance[0, 0], 2.0 * covariance[0, 1], covariance[1, 1]
    np.testing.assert_allclose(found[4], expected, rtol=1e-3, atol=1e-6)
