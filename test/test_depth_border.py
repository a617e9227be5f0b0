"""Borders of surfaces: every part against a slow loop, and a plate before a wall whose rims were lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from border_scene import (
    AMPLITUDE,
    BACKGROUND,
    PROJECTOR,
    Mask,
    Scene,
    slow_claims,
    slow_difference,
    slow_extend,
    slow_neighbours,
    slow_row_match,
    slow_trusted,
)
from dense_rigs import Array, Float32

from moire_sensor import depth_around, depth_narrow, depth_trust, depth_window
from moire_sensor import depth_border as border
from moire_sensor import depth_offer as fit
from moire_sensor.depth_refine import Match
from moire_sensor.settings import Settings

SCENE = Scene()
# As large as the slow loop can bear.
SMALL_SCENE = Scene(shape=(34, 120), rows=(11, 23), columns=(55, 85))


def interpreted(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The Python function behind a kernel that is compiled into others."""
    return getattr(kernel, "py_func", kernel)


def rough(seed: int, shape: tuple[int, int] = (30, 90)) -> Float32:
    """Surfaces in steps of a few columns and rows, with holes, some beyond the right image."""
    rng = np.random.default_rng(seed)
    steps = np.add.outer(rng.normal(0.0, 6.0, shape[0] // 10), rng.normal(0.0, 12.0, shape[1] // 15))
    disparity = np.kron(steps, np.ones((10, 15))) + rng.normal(0.0, 0.25, shape)
    disparity[rng.uniform(size=shape) < 0.01] = np.nan
    return disparity.astype(np.float32)


def looked(disparity: Float32) -> depth_trust.Trust:
    """What the first round sees."""
    room = depth_trust.Trust.of(disparity.shape)
    room.look(disparity)
    return room


@pytest.mark.parametrize("shape", [(30, 90), (10, 15), (10, 30)])
def test_trusted_pixels_have_neither_jump_nor_hole_near(shape: tuple[int, int]) -> None:
    disparity = rough(1, shape)
    found = looked(disparity).trust
    np.testing.assert_array_equal(found, slow_trusted(disparity))
    assert shape != (30, 90) or 0.1 < found.mean() < 0.9


def test_only_what_was_not_trusted_before_is_fresh() -> None:
    room = looked(rough(1))
    before = room.trust.copy()
    np.testing.assert_array_equal(room.fresh, before)
    room.look(rough(7))
    np.testing.assert_array_equal(room.fresh, room.trust & ~before & 1)
    assert 0 < room.fresh.sum() < room.trust.sum()
    near, further = (cv2.dilate(room.fresh, np.ones((29, width), dtype=np.uint8)) for width in (29, 41))
    np.testing.assert_array_equal(room.near, near + further)


def test_claims_are_those_of_the_nearest_trusted_surface() -> None:
    disparity = rough(2)
    trust = np.isfinite(disparity) & (np.random.default_rng(2).uniform(size=disparity.shape) < 0.7)
    claim = np.empty_like(disparity)
    depth_trust.fill_claims(disparity, trust.astype(np.uint8), claim)
    np.testing.assert_array_equal(claim, slow_claims(disparity, trust))


# Level, gentle either way, and steeper than what is read pixel by pixel.
PLANES = [
    (12.3, 0.0, 0.0), (14.0, 0.2, -0.3), (-6.5, -0.1, 0.4), (15.2, 0.04, 0.0), (13.0, -0.06, 0.1), (9.0, 0.6, 1.4)
]  # fmt: skip


@pytest.mark.parametrize("plane", PLANES)
def test_small_difference_is_that_of_the_best_window(plane: tuple[float, float, float]) -> None:
    views = SCENE.views()
    plane_px = tuple(np.float32(part) for part in plane)
    sums = np.empty(depth_window.LANES, dtype=np.float32)
    differ = interpreted(depth_window.small_difference)
    for y in (0, 1, 30, 58, 59):
        for x in (0, 1, 3, 4, 11, 13, 16, 17, 28, 90, 92, 94, 150, 206, 207, 208, 215, 216, 219):
            found = differ(*views, y, x, *plane_px, np.float32(AMPLITUDE), sums)
            assert found == pytest.approx(slow_difference(views, y, x, plane), abs=1e-2)


@pytest.mark.parametrize("plane", PLANES)
def test_row_match_is_least_squares(plane: tuple[float, float, float]) -> None:
    views = SCENE.views()
    matched = interpreted(depth_window.row_match)
    for y in (0, 30, 59):
        for x in (0, 3, 14, 27, 28, 29, 90, 150, 199, 204, 209, 212, 219):
            for first in (x - 10, x - 5, x):
                found = matched(*views, y, x, np.float32(plane[0]), np.float32(plane[1]), first)
                np.testing.assert_allclose(found, slow_row_match(views, y, x, plane, first, first + 10), rtol=2e-3)


def test_a_shifted_row_is_matched_by_its_shift() -> None:
    scene = replace(SCENE, noise=0.0, rows=(0, 0), shadow_px=0)
    y, x = 30, 100
    truth = float(scene.disparity_px[y, x])
    matched = interpreted(depth_window.row_match)
    for off in (-0.4, 0.0, 0.3):
        shift, _, variance = matched(*scene.views(), y, x, np.float32(truth + off), np.float32(0.01), x - 5)
        # One step of Newton's on a cosine of 16.7 px: the square of the step times its curvature.
        assert shift == pytest.approx(-off, abs=0.03)
        assert variance < 0.03**2


def test_neighbours_are_the_nearest_trusted_pixels() -> None:
    rng = np.random.default_rng(3)
    trust = rng.uniform(size=(40, 120)) < np.where(np.arange(120) % 60 < 5, 0.3, 0.002)
    neighbour = interpreted(depth_around.neighbour)
    above, below = np.empty((2, 40, 120), dtype=np.uint8)
    depth_trust.fill_rows_away(trust.astype(np.uint8), above, below)
    met = set()
    for y in range(40):
        known = np.flatnonzero(trust[y])
        for x in np.flatnonzero(~trust[y]):
            before, after = max(known[known < x], default=-1), min(known[known > x], default=-1)
            found = [neighbour(above, below, y, x, side, before, after) for side in range(4)]
            assert [at for at in found if at != (-1, -1)] == slow_neighbours(trust, y, x)
            met |= {side for side in range(4) if found[side] != (-1, -1)}
    assert met == {0, 1, 2, 3}


def lost_rims(scene: Scene, rim_px: int) -> Array:
    """True disparities but for shadows, what one camera sees alone, and a rim at the plate's borders."""
    disparity = scene.disparity_px.copy()
    window = np.ones((2 * rim_px + 1, 2 * rim_px + 1), dtype=np.uint8)
    plate = scene.plate.astype(np.uint8)
    rim = cv2.dilate(plate, window) != cv2.erode(plate, window)
    disparity[rim | scene.shadow | scene.hidden] = np.nan
    return disparity


def extended(scene: Scene, match: Match, row_step: int = 2) -> Match:
    result = Match(*(image.copy() for image in match.images()))
    border.extend(result, scene.views(), scene.phase(), PROJECTOR, PROJECTOR.rad_per_column, Settings(), row_step)
    return result


def images(match: Match) -> Array:
    return np.stack([match.disparity_px, match.sigma_px, match.signed_mismatch_rad, match.mismatch_rad])


def spoilt(scene: Scene, seed: int) -> Array:
    """Rims lost or given to the wrong surface, a shadow taken for the wall, holes, and noise."""
    rng = np.random.default_rng(seed)
    disparity = lost_rims(scene, 3)
    rows, columns = scene.rows, scene.columns
    disparity[rows[0] - 4 : rows[0] + 2, columns[0] + 10 : columns[1] - 5] = scene.plate_px
    disparity[rows[0] + 5 : rows[1], columns[0] : columns[0] + 5] = scene.wall_px
    disparity[scene.shadow & (np.indices(scene.shape)[0] < rows[0] + 6)] = scene.wall_px
    disparity[rng.uniform(size=disparity.shape) < 0.001] = np.nan
    return np.asarray(disparity + rng.normal(0.0, 0.02, disparity.shape))


@pytest.mark.parametrize("row_step", [1, 2])
def test_assignment_is_that_of_the_slow_loop(row_step: int) -> None:
    match = SMALL_SCENE.match(spoilt(SMALL_SCENE, 4))
    found = images(extended(SMALL_SCENE, match, row_step))
    expected = slow_extend(SMALL_SCENE.views(), match, row_step)
    changed = expected[0] != images(match)[0]
    same = np.isclose(found, expected, rtol=1e-3, atol=2e-3, equal_nan=True).all(axis=0)
    # float32 may decide otherwise where two offers are alike, or a threshold is met, to 1e-4.
    assert (~same).sum() <= 0.01 * changed.sum()
    assert (changed & np.isfinite(expected[0])).sum() > 200
    assert (np.isnan(expected[0]) & np.isfinite(match.disparity_px)).sum() > 10


def away_from_horizontal_edges(scene: Scene, rows_px: int) -> Mask:
    """Small windows hold the rows above and below: the row on either side of a horizontal edge can fit no surface."""
    y = np.indices(scene.shape)[0]
    near = [(row - rows_px <= y) & (y < row + rows_px) for row in scene.rows]
    return np.asarray(~(near[0] | near[1]))


def away_from_corners(scene: Scene, by_px: int) -> Mask:
    """At the plate's corners windows of five columns see the shadow, or what the right camera does not."""
    x = np.indices(scene.shape)[1]
    near = [np.abs(x - column) <= by_px for column in scene.columns]
    return np.asarray(away_from_horizontal_edges(scene, by_px) | ~(near[0] | near[1]))


@pytest.mark.parametrize("rim_px", [2, 5])
def test_a_lost_rim_goes_to_the_surface_it_shows(rim_px: int) -> None:
    lost = lost_rims(SCENE, rim_px)
    match = extended(SCENE, SCENE.match(lost))
    # The first columns of the left image fall outside the right one.
    seen = ~SCENE.shadow & ~SCENE.hidden & (np.indices(SCENE.shape)[1] > 20)
    rim = np.isnan(lost) & seen & away_from_horizontal_edges(SCENE, 1) & away_from_corners(SCENE, 5)
    error = np.abs(match.disparity_px - SCENE.disparity_px)
    given = np.isfinite(match.disparity_px) & rim
    assert rim.sum() > 250
    assert given.sum() > 0.97 * rim.sum()
    assert (error[given] > 1.0).sum() <= 0.005 * given.sum()
    # A plane is moved by the row where that says more than 0.3 px.
    assert np.median(error[given]) < 0.05
    assert np.isnan(match.signed_mismatch_rad[given]).all()
    assert (match.mismatch_rad[given] < Settings().max_border_misfit + 2 * Settings().image_noise / AMPLITUDE).all()


def test_a_rim_given_to_the_wrong_surface_changes_sides() -> None:
    """What windows that straddle an edge do: the wall carried 4 px into the plate, the plate 4 px onto the wall."""
    y, x = np.indices(SCENE.shape)
    wrong = SCENE.disparity_px.copy()
    left, top = SCENE.columns[0], SCENE.rows[0]
    carried = SCENE.plate & (x < left + 4)
    wrong[carried] = SCENE.wall(x.astype(float), y.astype(float))[carried]
    bled = ~SCENE.plate & (y >= top - 4) & (y < top) & (x >= 110) & (x < 150)
    wrong[bled] = SCENE.plate_px
    wrong[SCENE.hidden | SCENE.shadow] = np.nan
    match = extended(SCENE, SCENE.match(wrong))
    off = ~(np.abs(match.disparity_px - SCENE.disparity_px) <= 1.0)
    for part, rows_px in ((carried, fit.RIM_PX + 1), (bled, 1)):
        judged = part & away_from_horizontal_edges(SCENE, rows_px)
        assert judged.sum() > 80
        assert off[judged].mean() < 0.05


def narrow(scene: Scene, strip_px: int) -> Array:
    """True disparities, but of the plate only a strip is known and what is right of it was given to the wall."""
    disparity = lost_rims(scene, 3)
    disparity[scene.plate] = np.nan
    y, x = np.indices(scene.shape)
    start = scene.columns[0] + 6
    disparity[scene.plate & (x >= start) & (x < start + strip_px)] = scene.plate_px
    taken = scene.plate & (x >= start + strip_px) & (x < start + strip_px + 3)
    disparity[taken] = scene.wall(x.astype(float), y.astype(float))[taken]
    return disparity


def test_a_strip_too_narrow_to_be_trusted_offers_itself() -> None:
    """A pole at whose middle alone the order is right; four columns can be no accident, three can."""
    scene = replace(SCENE, columns=(90, 104), shadow_px=0)
    middle = scene.plate & away_from_horizontal_edges(scene, depth_narrow.UPRIGHT_PX + fit.RIM_PX)
    for strip_px, least, most in ((depth_narrow.LEAST_RUN_PX, 0.9, 1.0), (depth_narrow.LEAST_RUN_PX - 1, 0.0, 0.05)):
        match = scene.match(narrow(scene, strip_px))
        assert not looked(match.disparity_px).trust[scene.plate].any()
        around = middle & ~(np.abs(match.disparity_px - scene.disparity_px) < 1.0)
        found = extended(scene, match)
        right = np.abs(found.disparity_px - scene.disparity_px) < 1.0
        assert least <= right[around].mean() <= most


@pytest.mark.parametrize("strip_px", [3, 4, 6, 7])
def test_offers_of_strips_are_those_of_the_slow_loop(strip_px: int) -> None:
    scene = replace(SMALL_SCENE, columns=(55, 75), rows=(8, 26))
    match = scene.match(narrow(scene, strip_px))
    found, expected = images(extended(scene, match)), slow_extend(scene.views(), match, 2)
    same = np.isclose(found, expected, rtol=1e-3, atol=2e-3, equal_nan=True)
    changed = np.isfinite(expected[0]) & np.isnan(match.disparity_px)
    assert changed.sum() > 100
    # As above; above and below the plate the wall's planes are alike and their sigma is the first's.
    assert (~same[0]).sum() <= 0.01 * changed.sum()
    assert (~same.all(axis=0) & scene.plate).sum() <= 0.01 * changed.sum()


def test_what_one_camera_sees_alone_stays_unknown() -> None:
    match = extended(SCENE, SCENE.match(lost_rims(SCENE, 3)))
    # The plate's border falls between two right pixels.
    hidden = cv2.erode(SCENE.hidden.astype(np.uint8), np.ones((3, 3), dtype=np.uint8)).astype(bool)
    hidden &= np.indices(SCENE.shape)[1] > 20
    assert hidden.sum() > 200
    assert np.isnan(match.disparity_px[hidden]).all()


def test_a_shadow_gets_nothing() -> None:
    """Not even where the fringes of wall or plate would be dark: they are not as dark as a shadow."""
    match = extended(SCENE, SCENE.match(lost_rims(SCENE, 3)))
    y, x = np.indices(SCENE.shape, dtype=float)
    lit = np.zeros(SCENE.shape, dtype=bool)
    for disparity in (SCENE.disparity_px, np.full(SCENE.shape, SCENE.plate_px)):
        trough = SCENE.grey(y, x, disparity, lit) < BACKGROUND - 0.9 * AMPLITUDE
        assert (SCENE.shadow & trough).sum() > 50
    assert SCENE.shadow.sum() > 500
    assert not (SCENE.shadow & np.isfinite(match.disparity_px)).any()


@pytest.mark.parametrize("seed", [5, 6])
def test_trusted_pixels_stay_bit_for_bit(seed: int) -> None:
    match = SCENE.match(spoilt(SCENE, seed))
    trust = looked(match.disparity_px).trust.astype(bool)
    before = images(match)
    after = images(extended(SCENE, match))
    assert 0.5 < trust.mean() < 0.95
    np.testing.assert_array_equal(after[:, trust], before[:, trust])


@pytest.mark.parametrize("fill", [np.nan, 12.0])
def test_nothing_trusted_or_nothing_doubtful_changes_nothing(fill: float) -> None:
    match = SCENE.match(np.full(SCENE.shape, fill))
    np.testing.assert_array_equal(images(extended(SCENE, match)), images(match))
