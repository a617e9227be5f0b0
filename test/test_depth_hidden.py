"""What the right camera cannot see has no depth: pixels behind a nearer surface, but for those at its rim."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import Array, Float32

from moire_sensor.depth_hidden import BESIDE_PX, NEARER_PX, drop_hidden

WIDTH, WALL_PX, POST_PX = 200, 10.0, 60.0
POST = slice(120, 150)


def scene(post_px: float = POST_PX) -> Float32:
    """Rows of a wall with a post before it; the wall is given everywhere, also where the right camera cannot see it."""
    line = np.full((4, WIDTH), WALL_PX, dtype=np.float32)
    line[:, POST] = post_px
    return line


def slow_hidden(line: Array) -> Array:
    """Pixels in whose right column, and five on either side, something two pixels nearer is seen."""
    shown = np.full(WIDTH, -np.inf)
    for x, disparity in enumerate(line):
        if np.isfinite(disparity):
            for column in {int(np.floor(x - disparity)), int(np.floor(x - disparity)) + 1}:
                if 0 <= column < WIDTH:
                    shown[column] = max(shown[column], disparity)
    hidden = np.zeros(WIDTH, dtype=bool)
    for x, disparity in enumerate(line):
        if np.isfinite(disparity):
            column = int(np.floor(x - disparity + 0.5))
            around = range(column - BESIDE_PX, column + BESIDE_PX + 1)
            if all(0 <= at < WIDTH and shown[at] > disparity + NEARER_PX for at in around):
                hidden[x] = True
    return hidden


def test_the_wall_behind_a_post_is_dropped_but_at_the_rim() -> None:
    """The post fills the right columns 60 to 89, which show the wall of the left columns 70 to 99 without it."""
    found = scene()
    drop_hidden(found)
    gone = np.flatnonzero(np.isnan(found[0]))
    np.testing.assert_array_equal(gone, np.arange(70 + BESIDE_PX, 101 - BESIDE_PX))
    kept = np.isfinite(found)
    np.testing.assert_array_equal(found[kept], scene()[kept])


@pytest.mark.parametrize("post_px", [WALL_PX + 1.5, WALL_PX - 5.0])
def test_what_is_hardly_nearer_or_farther_hides_nothing(post_px: float) -> None:
    found = scene(post_px)
    drop_hidden(found)
    np.testing.assert_array_equal(found, scene(post_px))


def test_random_rows_are_those_of_the_slow_loop() -> None:
    rng = np.random.default_rng(2)
    lines = np.repeat(rng.uniform(-20.0, 150.0, (30, WIDTH // 10)), 10, axis=1).astype(np.float32)
    lines += rng.uniform(0.0, 0.3, lines.shape).astype(np.float32)
    lines[rng.uniform(size=lines.shape) < 0.1] = np.nan
    found = lines.copy()
    drop_hidden(found)
    expected = np.stack([slow_hidden(line) for line in lines])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(lines) | expected)
    assert 0 < expected.sum() < 0.5 * expected.size


def test_rows_of_slopes_posts_and_holes_are_those_of_the_slow_loop() -> None:
    """Rows without anything hidden are skipped by their runs: runs of every length, slope and order."""
    rng = np.random.default_rng(3)
    lines = np.empty((60, WIDTH), dtype=np.float32)
    for line in lines:
        start = 0
        while start < WIDTH:
            end = start + int(rng.choice([1, 2, 3, 5, 8, 14, 40, 90]))
            x = np.arange(start, min(end, WIDTH)) - start
            line[start:end] = rng.choice([10.0, 11.0, 13.0, 30.0, 60.0]) + rng.choice([0.0, 0.1, -0.3, 0.9]) * x
            start = end
    lines[rng.uniform(size=lines.shape) < rng.choice([0.0, 0.05], size=(len(lines), 1))] = np.nan
    found = lines.copy()
    drop_hidden(found)
    hidden = np.stack([slow_hidden(line) for line in lines])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(lines) | hidden)
    assert 0.2 < hidden.any(axis=1).mean() < 0.8
