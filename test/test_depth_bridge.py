"""Narrow gaps between surfaces: filled by the plane between them if the views show it, else left unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dense_rigs import Array, Float32

from moire_sensor.depth_bridge import LENGTH_PX, STEP_PX, bridge
from moire_sensor.depth_refine import Match
from moire_sensor.settings import Settings

HEIGHT, WIDTH = 40, 160
FIRST, NOISE = 18, 1.5
RAD_PER_PX = 2.0 * np.pi / 18.0
# Disparity above and below the gap.
ABOVE_PX, BELOW_PX = 20.0, 23.0


def surface(length: int, below_px: float = BELOW_PX) -> Array:
    """Disparity (H, W) of two boards that face the head, joined by a face that is ``length`` rows high."""
    rows = np.arange(HEIGHT, dtype=float)
    line = np.interp(rows, (FIRST - 1, FIRST + length), (ABOVE_PX, below_px))
    return np.repeat(line[:, None], WIDTH, axis=1)


def views(disparity: Array, dim: float = 1.0) -> tuple[Float32, Float32]:
    """Left and right view of fringes on a surface whose disparity is constant along each row, dimmer in the gap."""
    x = np.arange(WIDTH, dtype=float)[None]
    face = (disparity > ABOVE_PX) & (disparity < disparity.max())
    bright = 90.0 * np.where(face, dim, 1.0)
    rng = np.random.default_rng(3)
    left, right = (
        (bright * (1.0 + 0.8 * np.cos(2.0 * np.pi * (x + shift) / 18.0))) + rng.normal(0.0, NOISE, disparity.shape)
        for shift in (np.zeros_like(disparity), disparity)
    )
    return np.float32(left), np.float32(right)


def match_of(disparity: Array, length: int) -> Match:
    known = disparity.astype(np.float32)
    known[FIRST : FIRST + length] = np.nan
    flat = np.full_like(known, 0.02)
    return Match(known, flat, flat.copy(), flat.copy())


def filled(length: int, below_px: float = BELOW_PX, seen: Array | None = None, dim: float = 1.0) -> Float32:
    """Disparity after bridging a gap of ``length`` rows, where the views show ``seen``."""
    true = surface(length, below_px)
    match = match_of(true, length)
    amplitude = np.full(true.shape, 72.0 * dim, dtype=np.float32)
    greys = views(true if seen is None else seen, dim)
    bridge(match, greys, amplitude, RAD_PER_PX, replace(Settings(), image_noise=NOISE))
    return match.disparity_px


@pytest.mark.parametrize("length", [1, 4, LENGTH_PX])
def test_a_face_that_the_views_show_is_filled_by_its_plane(length: int) -> None:
    """Columns whose row of grey levels would leave the right view stay as they are."""
    inside = slice(30, WIDTH - 5)
    np.testing.assert_allclose(filled(length)[:, inside], surface(length)[:, inside], atol=1e-5)


@pytest.mark.parametrize("length", [4, LENGTH_PX])
@pytest.mark.parametrize("lit", [0.0, 0.3])
def test_the_mixed_pixels_of_a_dark_face_tell_where_it_begins(length: int, lit: float) -> None:
    """The face begins ``lit`` pixels into its first row, and ends as much before the end of its last.

    Where a fringe is darkest a board is 15 grey levels brighter than the face: two samples of noise move an end by a
    seventh of a pixel, three sigmas of that by 0.42; the mean over the columns is known ten times better.
    """
    rows = np.arange(HEIGHT, dtype=float)
    ends = FIRST - 0.5 + lit, FIRST + length - 0.5 - lit
    true = np.repeat(np.interp(rows, ends, (ABOVE_PX, BELOW_PX))[:, None], WIDTH, axis=1)
    left, right = views(true, 0.15)
    for view, column in ((left, left.shape[1]), (right, right.shape[1])):
        for mixed, board in ((FIRST, FIRST - 2), (FIRST + length - 1, FIRST + length + 1)):
            view[mixed, :column] += np.float32(lit) * (view[board, :column] - view[mixed, :column])
    match = match_of(true, length)
    amplitude = np.full(true.shape, 72.0, dtype=np.float32)
    amplitude[FIRST : FIRST + length] *= 0.15
    bridge(match, (left, right), amplitude, RAD_PER_PX, Settings())
    face = (slice(FIRST, FIRST + length), slice(30, WIDTH - 5))
    found, known = match.disparity_px[face], np.isfinite(match.disparity_px[face])
    slope = (BELOW_PX - ABOVE_PX) / (ends[1] - ends[0])
    assert known.mean() > 0.9
    error = np.where(known, found - true[face], 0.0)
    assert np.abs(error).max() < 0.42 * slope
    assert np.abs(error.mean(axis=1)).max() < 0.1 * slope


def test_sigma_tells_the_doubt_about_the_ends() -> None:
    true = surface(4)
    match = match_of(true, 4)
    bridge(match, views(true), np.full(true.shape, 72.0, dtype=np.float32), RAD_PER_PX, Settings())
    slope = (BELOW_PX - ABOVE_PX) / 5.0
    np.testing.assert_allclose(match.sigma_px[FIRST : FIRST + 4, 30:-5], 0.02 + 0.25 * slope, rtol=1e-5)
    assert np.isnan(match.signed_mismatch_rad[FIRST : FIRST + 4, 30:-5]).all()


@pytest.mark.parametrize(("length", "below_px"), [(LENGTH_PX + 1, BELOW_PX), (4, ABOVE_PX + float(STEP_PX) + 1.0)])
def test_wide_gaps_and_high_steps_stay_unknown(length: int, below_px: float) -> None:
    assert np.isnan(filled(length, below_px)[FIRST : FIRST + length]).all()


def test_a_gap_that_shows_something_else_stays_unknown() -> None:
    """What lies in the gap is 7 px nearer, more than a third of a fringe: nowhere do the grey levels of a row agree."""
    seen = surface(4)
    seen[FIRST : FIRST + 4] += 7.0
    assert np.isnan(filled(4, seen=seen)[FIRST : FIRST + 4]).all()


def test_a_mixed_end_does_not_tilt_the_bridge() -> None:
    """The dim pixel above the gap was taken for the upper board; the bridge begins behind it and corrects it."""
    true = surface(5)
    match = match_of(true, 5)
    match.disparity_px[FIRST] = ABOVE_PX + 0.1
    amplitude = np.full(true.shape, 72.0, dtype=np.float32)
    amplitude[FIRST : FIRST + 5] = 30.0
    bridge(match, views(true), amplitude, RAD_PER_PX, Settings())
    np.testing.assert_allclose(match.disparity_px[:, 30:-5], true[:, 30:-5], atol=1e-5)


def beside(step_px: float, dark: float | None, crest: float) -> Array:
    """Gap of three columns, whose bridge is wanted, between two boards that face the head, seen in dark or in fringes.

    The fringes of the left board are brightest at column ``crest``. The right camera sees nothing of the face.
    """
    x = np.arange(WIDTH)
    disparity = np.where(x < 60, ABOVE_PX, ABOVE_PX + step_px) + np.zeros((HEIGHT, 1))
    match = match_of(disparity, 0)
    match.disparity_px[:, 60:63] = np.nan
    left, right = (
        90.0 * (1.0 + 0.8 * np.cos(RAD_PER_PX * (x - crest + shift))) for shift in (0.0 * disparity, disparity)
    )
    if dark is not None:
        left[:, 60:63] = dark
    noise = np.random.default_rng(4).normal(0.0, NOISE, (2, HEIGHT, WIDTH))
    amplitude = np.full(disparity.shape, 72.0, dtype=np.float32)
    greys = np.float32(left + noise[0]), np.float32(right + noise[1])
    bridge(match, greys, amplitude, RAD_PER_PX, replace(Settings(), image_noise=NOISE))
    return np.asarray(match.disparity_px[:, 60:63], dtype=float)


def test_a_dark_face_too_steep_for_the_right_camera_lies_between_its_ends() -> None:
    line = ABOVE_PX + 2.6 * np.array([[0.25, 0.5, 0.75]] * HEIGHT)
    np.testing.assert_allclose(beside(2.6, 25.0, 61.0), line, atol=1e-5)


@pytest.mark.parametrize(
    ("step_px", "dark", "crest"),
    [(2.6, None, 55.0), (2.6, None, 58.0), (2.6, 25.0, 70.0), (3.4, 25.0, 61.0), (0.9, 25.0, 61.0), (-2.6, 25.0, 61.0)],
)
def test_a_steep_gap_is_left_unknown(step_px: float, dark: float | None, crest: float) -> None:
    """Fringes go on, or are as dark themselves; the step is too high, too low for the gap, or the other way."""
    assert np.isnan(beside(step_px, dark, crest)).all()


def test_known_pixels_and_open_ends_stay_bit_for_bit() -> None:
    true = surface(4)
    match = match_of(true, 4)
    match.disparity_px[FIRST:] = np.nan
    before = match.disparity_px.copy()
    bridge(match, views(true), np.full(true.shape, 72.0, dtype=np.float32), RAD_PER_PX, Settings())
    np.testing.assert_array_equal(match.disparity_px, before)
