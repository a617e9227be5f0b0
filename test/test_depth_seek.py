"""Narrow posts: found where they are lost, or taken for the wall behind, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from border_scene import AMPLITUDE, BACKGROUND, NOISE, PROJECTOR
from dense_rigs import Array, Float32

from moire_sensor import Reconstructor
from moire_sensor.depth_refine import Match
from moire_sensor.depth_seek import seek
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_image import PhaseImage
from moire_sensor.settings import Settings
from moire_sensor.shot import Status
from moire_sim.score import score
from tools.bench.accuracy import DEPTH_RANGE_M, nearer_than, photograph, truth_of
from tools.bench.conditions import DEFAULT
from tools.bench.posts import scene_of

ROWS, WIDTH = 63, 320
WALL_PX = 62.0
HALF_FRINGE_PX = 8
X = np.arange(float(WIDTH))
# Disparities so far apart have the same phase in the left image.
ALIAS_PX = 2.0 * np.pi / abs(float(PROJECTOR.phase_rad_at(np.array(150.0), np.array(0.0), 80.0)
                                   - PROJECTOR.phase_rad_at(np.array(150.0), np.array(0.0), 79.0)))  # fmt: skip


def columns_px(x: Array, disparity_px: Array | float) -> Array:
    return PROJECTOR.column_px(x, np.zeros_like(x), disparity_px)


class Post:
    """Images and depth of an upright post, columns ``first`` to ``end`` of the left view, before a wall."""

    def __init__(self, disparity_px: float, first: int = 200, columns: int = 14, rows: slice = slice(0, ROWS)) -> None:
        self.disparity_px, self.columns, self.rows = disparity_px, slice(first, first + columns), rows
        self.lit_px = columns_px(np.array([first - 0.5, first + columns - 0.5]), disparity_px)
        on_post = (self.columns.start <= X) & (self.columns.stop > X)
        seen = X + disparity_px
        right_on_post = (self.columns.start - 0.5 <= seen) & (seen < self.columns.stop - 0.5)
        self.left = self.view(X, X, on_post)
        self.right = self.view(seen, X + WALL_PX, right_on_post)
        truth = np.where(on_post, disparity_px, WALL_PX)
        hidden = np.roll(right_on_post, round(WALL_PX))
        self.truth = np.where(~on_post & (self.shadow(X) | hidden), np.nan, truth)

    def shadow(self, x: Array) -> Array:
        """Whether the wall, at left columns ``x``, lies in the post's shadow."""
        u = columns_px(x, WALL_PX)
        return (self.lit_px[0] <= u) & (u < self.lit_px[1])

    def view(self, on_post: Array, on_wall: Array, is_post: Array) -> Array:
        """Grey levels of a row whose pixels show a left column of the post or of the wall."""
        disparity, x = np.where(is_post, self.disparity_px, WALL_PX), np.where(is_post, on_post, on_wall)
        lit = BACKGROUND + AMPLITUDE * np.cos(PROJECTOR.phase_rad_at(x, np.zeros(WIDTH), disparity))
        return np.where(~is_post & self.shadow(on_wall), 15.0, lit)

    def greys(self) -> tuple[Float32, Float32]:
        """Left and right image; the post stands in some rows only."""
        rng = np.random.default_rng(3)
        bare = [BACKGROUND + AMPLITUDE * np.cos(PROJECTOR.phase_rad_at(x, np.zeros(WIDTH), np.full(WIDTH, WALL_PX)))
                for x in (X, X + WALL_PX)]  # fmt: skip
        images = []
        for plain, row in zip(bare, (self.left, self.right), strict=True):
            image = np.tile(plain, (ROWS, 1))
            image[self.rows] = row
            images.append(np.float32(image + rng.normal(0.0, NOISE, image.shape)))
        return images[0], images[1]

    def known(self, post: float) -> Array:
        """Disparities (H, W): the wall where both views see it lit, ``post`` where the post is."""
        row = np.where(np.isnan(self.truth), np.nan, WALL_PX)
        row[self.columns] = post
        known = np.full((ROWS, WIDTH), WALL_PX)
        known[self.rows] = row
        return known


def sought(
    known: Array, greys: tuple[Float32, Float32], half_width_px: int = HALF_FRINGE_PX, amplitude: float = AMPLITUDE
) -> Float32:
    flat = np.zeros((ROWS, WIDTH), dtype=np.float32)
    match = Match(known.astype(np.float32), flat, flat.copy(), flat.copy())
    status = np.full(flat.shape, Status.OK if amplitude > 0.0 else Status.UNLIT, dtype=np.uint8)
    phase = PhaseImage(flat, flat + np.float32(amplitude), flat + np.float32(BACKGROUND), flat, status)
    orders = OrderRange(0, 1, 58.0, 236.0)
    seek(match, greys, phase, PROJECTOR, orders, half_width_px, Settings(image_noise=NOISE))
    return match.disparity_px


def assert_found(found: Float32, post: Post) -> None:
    """All but the last pixels of the post are there, and nothing else has changed."""
    inner = slice(post.columns.start + 2, post.columns.stop - 2)
    np.testing.assert_allclose(found[:, inner], post.disparity_px, atol=0.3)
    away = np.delete(np.arange(WIDTH), np.r_[post.columns.start - 2 : post.columns.stop + 2])
    np.testing.assert_array_equal(found[:, away], post.known(np.nan).astype(np.float32)[:, away])


@pytest.mark.parametrize(("turns", "columns"), [(0.25, 14), (0.25, 18), (0.6, 12), (0.6, 18), (1.5, 12), (1.5, 16)])
def test_a_lost_post_is_found(turns: float, columns: int) -> None:
    post = Post(WALL_PX + turns * ALIAS_PX, columns=columns)
    assert_found(sought(post.known(np.nan), post.greys()), post)


@pytest.mark.parametrize("columns", [14, 18])
def test_a_post_taken_for_the_wall_is_found_by_what_the_right_view_shows(columns: int) -> None:
    """Its fringes are the wall's on the left, but not on the right, where nobody claims its pixels."""
    post = Post(WALL_PX + ALIAS_PX, columns=columns)
    assert_found(sought(post.known(WALL_PX), post.greys()), post)


def test_where_its_shadow_would_fall_a_wall_is_lit_and_no_post_stands() -> None:
    post = Post(WALL_PX + ALIAS_PX)
    known = post.known(WALL_PX)
    known[:, post.shadow(X)] = WALL_PX
    np.testing.assert_array_equal(sought(known, post.greys()), known.astype(np.float32))


def test_what_is_lost_of_a_wall_is_a_wall() -> None:
    post = Post(WALL_PX + ALIAS_PX, rows=slice(0, 0))
    known = post.known(WALL_PX)
    known[:, 150:180] = np.nan
    found = sought(known, post.greys())
    seen = np.isfinite(found)
    assert seen[:, 154:176].all()
    np.testing.assert_allclose(found[seen], WALL_PX, atol=0.3)


def test_what_does_not_go_on_from_row_to_row_is_none() -> None:
    post = Post(WALL_PX + 0.6 * ALIAS_PX, rows=slice(20, 28))
    known = post.known(np.nan)
    np.testing.assert_array_equal(sought(known, post.greys()), known.astype(np.float32))


def test_wide_fringes_and_dark_images_are_left_alone() -> None:
    post = Post(WALL_PX + 0.6 * ALIAS_PX)
    known = post.known(np.nan)
    for found in (sought(known, post.greys(), half_width_px=15), sought(known, post.greys(), amplitude=0.0)):
        np.testing.assert_array_equal(found, known.astype(np.float32))


def test_posts_at_random_places() -> None:
    """Posts of 14, 16 and 19 pixels, one a whole fringe before the wall: 1 % is right without the step."""
    scene, wall_m = scene_of(4)
    truth = truth_of(scene)
    left, right = photograph(scene, truth.pattern, DEFAULT, seed=4)
    shot = Reconstructor(truth.rig, truth.pattern, depth_range_m=DEPTH_RANGE_M).reconstruct(left, right)
    posts = score(shot, nearer_than(truth, wall_m - 0.07))
    assert posts.right_share > 0.9
    assert posts.outlier_share < 0.05


def test_fringes_that_a_gamma_bends_are_left_alone() -> None:
    """Pieces of them look like pieces of cosines elsewhere."""
    post = Post(WALL_PX + 0.6 * ALIAS_PX)
    left, right = (np.float32(160.0 * (np.maximum(view, 0.0) / 160.0) ** 2.2) for view in post.greys())
    known = post.known(np.nan)
    np.testing.assert_array_equal(sought(known, (left, right)), known.astype(np.float32))
