"""Mixed pixels at the edge of a surface: given to the one that covers more of them, or left unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from border_scene import AMPLITUDE, BACKGROUND, PROJECTOR, Scene
from dense_rigs import Array, Float32

from moire_sensor.depth_refine import Match
from moire_sensor.depth_rim import SIGMA_PX, close_rims
from moire_sensor.phase_image import PhaseImage
from moire_sensor.settings import Settings

SCENE = Scene(shape=(12, 120), rows=(0, 12), columns=(60, 90), shadow_px=0)
LEFT, RIGHT = 59, 90
# Rows away from the image's border.
ROWS = slice(4, 8)


@dataclass(frozen=True)
class Edge:
    """The scene with one column of unknown disparity, its grey level mixed of what lies on either side."""

    column: int
    share_of_plate: float
    noise: float = 0.0

    def promised(self) -> tuple[Array, Array]:
        """Grey levels of plate and wall at the column, (H,)."""
        y, x = np.arange(12.0), np.full(12, float(self.column))
        dark = np.zeros(12, dtype=bool)
        plate = SCENE.grey(y, x, np.full(12, SCENE.plate_px), dark)
        return plate, SCENE.grey(y, x, SCENE.wall(x, y), dark)

    def view(self) -> Float32:
        y, x = np.indices(SCENE.shape, dtype=float)
        grey = SCENE.grey(y, x, SCENE.disparity_px, np.zeros(SCENE.shape, dtype=bool))
        plate, wall = self.promised()
        grey[:, self.column] = self.share_of_plate * plate + (1.0 - self.share_of_plate) * wall
        return np.float32(grey + np.random.default_rng(5).normal(0.0, self.noise, SCENE.shape))

    def closed(self, view: Float32 | None = None, phase: PhaseImage | None = None) -> Match:
        disparity = SCENE.disparity_px
        disparity[:, self.column] = np.nan
        match = SCENE.match(disparity)
        close_rims(match, self.view() if view is None else view, phase or SCENE.phase(), PROJECTOR, Settings())
        return match


def on_plate(match: Match, column: int) -> Array:
    """Which rows of the column were given to the plate (1), to the wall (0), to none (NaN)."""
    found = match.disparity_px[ROWS, column]
    y = np.arange(12.0)[ROWS]
    wall = SCENE.wall(np.full(y.size, float(column)), y)
    plate = np.abs(found - SCENE.plate_px) < 0.1
    # The wall's own slope, carried on by a pixel.
    assert np.all(np.isnan(found) | plate | (np.abs(found - wall) < 0.1))
    return np.where(np.isnan(found), np.nan, plate)


@pytest.mark.parametrize("column", [LEFT, RIGHT])
@pytest.mark.parametrize(("share", "given"), [(0.0, 0.0), (0.25, 0.0), (0.5, np.nan), (0.75, 1.0), (1.0, 1.0)])
def test_the_surface_that_covers_more_takes_the_pixel(column: int, share: float, given: float) -> None:
    edge = Edge(column, share)
    plate, wall = edge.promised()
    assert np.abs(plate - wall)[ROWS].min() > 8.0 * Settings().image_noise
    np.testing.assert_array_equal(on_plate(edge.closed(), column), given)


@pytest.mark.parametrize(("share", "covered"), [(0.2, False), (0.8, True)])
def test_a_mixed_row_goes_to_the_surface_that_covers_more(share: float, covered: bool) -> None:
    """The first row of a plate, where its light and the wall's are far enough apart; elsewhere it stays unknown."""
    scene = Scene(shape=(40, 120), rows=(20, 40), columns=(40, 100), shadow_px=0)
    y, x = np.indices(scene.shape, dtype=float)
    dark = np.zeros(scene.shape, dtype=bool)
    plate = scene.grey(y, x, np.full(scene.shape, scene.plate_px), dark)
    wall = scene.grey(y, x, scene.wall(x, y), dark)
    view = np.float32(scene.grey(y, x, scene.disparity_px, dark))
    view[20] = share * plate[20] + (1.0 - share) * wall[20]
    disparity = scene.disparity_px
    disparity[20] = np.nan
    match = scene.match(disparity)
    close_rims(match, view, scene.phase(), PROJECTOR, Settings())
    inside = slice(45, 95)
    found, apart = match.disparity_px[20, inside], np.abs(plate - wall)[20, inside]
    expected = scene.plate_px if covered else scene.wall(x, y)[20, inside]
    clear = apart > 9.0 * Settings().image_noise
    assert clear.sum() > 20
    np.testing.assert_allclose(found[clear], np.broadcast_to(expected, found.shape)[clear], atol=0.1)
    assert np.isnan(found[apart < 7.0 * Settings().image_noise]).all()


def test_surfaces_that_promise_alike_leave_it_unknown() -> None:
    """Of all columns of the plate the one whose fringes look like the wall's there."""
    apart = [np.abs(np.subtract(*Edge(column, 1.0).promised())).max() for column in range(62, 88)]
    column = 62 + int(np.argmin(apart))
    assert min(apart) < 8.0 * Settings().image_noise
    disparity = SCENE.disparity_px
    y, x = np.indices(SCENE.shape, dtype=float)
    disparity[:, column:RIGHT] = SCENE.wall(x, y)[:, column:RIGHT]
    disparity[:, column] = np.nan
    match = SCENE.match(disparity)
    view = Edge(column, 0.5).view()
    view[:, column + 1 : RIGHT] = SCENE.grey(y, x, SCENE.wall(x, y), y < 0)[:, column + 1 : RIGHT]
    close_rims(match, view, SCENE.phase(), PROJECTOR, Settings())
    assert np.isnan(match.disparity_px[ROWS, column]).all()


@pytest.mark.parametrize(("level", "kept"), [("promised", True), ("shadow", False), ("other", False)])
def test_beside_nothing_a_surface_must_keep_its_promise(level: str, kept: bool) -> None:
    """Right of the wall's end all is unknown; the pixel beside it is lit as the wall would be, or not."""
    column = 52
    y, x = np.indices(SCENE.shape, dtype=float)
    view = Edge(LEFT, 0.0).view()
    promised = SCENE.grey(y, x, SCENE.disparity_px, np.zeros(SCENE.shape, dtype=bool))[:, column]
    assert np.abs(promised - BACKGROUND)[ROWS].max() < 0.6 * AMPLITUDE
    levels = {"promised": promised, "shadow": BACKGROUND - AMPLITUDE, "other": promised + 0.3 * AMPLITUDE}
    view[:, column] = levels[level]
    disparity = SCENE.disparity_px
    disparity[:, column:LEFT] = np.nan
    match = SCENE.match(disparity)
    close_rims(match, view, SCENE.phase(), PROJECTOR, Settings())
    assert (np.isfinite(match.disparity_px[ROWS, column]) == kept).all()
    assert np.isnan(match.disparity_px[ROWS, column + 1 : LEFT - 1]).all()


def test_a_given_pixel_is_told_from_a_measured_one_and_known_ones_stay_bit_for_bit() -> None:
    edge = Edge(LEFT, 0.9, noise=1.5)
    before = SCENE.match(SCENE.disparity_px)
    match = edge.closed()
    given = np.zeros(SCENE.shape, dtype=bool)
    given[:, LEFT] = np.isfinite(match.disparity_px[:, LEFT])
    assert given.any()
    assert (match.sigma_px[given] == SIGMA_PX).all()
    assert np.isnan(match.signed_mismatch_rad[given]).all()
    assert (match.mismatch_rad[given] <= 0.2).all()
    for image, old in zip(match.images(), before.images(), strict=True):
        np.testing.assert_array_equal(image[:, :LEFT], old[:, :LEFT])
        np.testing.assert_array_equal(image[:, LEFT + 1 :], old[:, LEFT + 1 :])


@pytest.mark.parametrize(("sigmas", "told"), [(19.0, False), (22.0, True)])
def test_weak_fringes_tell_nothing(sigmas: float, told: bool) -> None:
    """Brighter fringes of the same scene tell."""
    weak = np.float32(sigmas * Settings().image_noise / AMPLITUDE)
    phase = SCENE.phase()
    phase.amplitude[:] *= weak
    disparity = SCENE.disparity_px
    disparity[:, RIGHT] = np.nan
    match = SCENE.match(disparity)
    view = BACKGROUND + weak * (Edge(RIGHT, 0.0).view() - np.float32(BACKGROUND))
    close_rims(match, np.float32(view), phase, PROJECTOR, Settings())
    assert (np.isfinite(match.disparity_px[ROWS, RIGHT]) == told).all()


@pytest.mark.parametrize("share", [0.1, 0.9])
def test_the_light_is_measured_behind_the_edge(share: float) -> None:
    """The window of the phase may hold a shadow there, which makes amplitude and background too small, one more so."""
    phase = SCENE.phase()
    phase.amplitude[:, RIGHT - 20 : RIGHT + 20] *= np.float32(0.4)
    phase.background[:, RIGHT - 20 : RIGHT + 20] *= np.float32(0.8)
    edge = Edge(RIGHT, share)
    np.testing.assert_array_equal(on_plate(edge.closed(phase=phase), RIGHT), np.round(share))
