"""Orders of rows between the solved ones, against a slow loop."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sensor.order_rows import fill_rows, solved_rows

LABELS = 5


def continued(here: float, before: float, label: int) -> int:
    """Label on the surface of the pixel before, -1 where there is none."""
    turns = (here - before) / (2.0 * np.pi)
    if np.isnan(turns) or label < 0:
        return -1
    value = label - int(np.floor(turns + 0.5))
    return value if 0 <= value < LABELS else -1


@pytest.mark.parametrize(("height", "step"), [(11, 3), (12, 3), (13, 3), (9, 2), (8, 4), (5, 1)])
def test_rows_between_continue_the_solved_ones(height: int, step: int) -> None:
    rng = np.random.default_rng(height)
    rows = solved_rows(height, step)
    width, some = 37, rows.size
    offset = rng.uniform(-np.pi, np.pi, (height, width)).astype(np.float32)
    offset[rng.uniform(size=offset.shape) < 0.2] = np.nan
    solved = np.where(np.isnan(offset[rows]), -1, rng.integers(0, LABELS, (some, width))).astype(np.int8)
    runner_up = np.where(solved < 0, -1, (solved + 1 + rng.integers(0, LABELS - 1, solved.shape)) % LABELS)
    runner_up = runner_up.astype(np.int8)
    above = np.where(solved < 0, 0.0, rng.uniform(0.1, 3.0, solved.shape)).astype(np.float32)
    label, second = np.zeros((2, height, width), dtype=np.int8)
    margin = np.zeros((height, width), dtype=np.float32)
    fill_rows(offset, rows, LABELS, solved, runner_up, above, label, second, margin)
    for y, x in np.ndindex(height, width):
        pair = [int(np.flatnonzero(rows <= max(y, rows[0]))[-1]), int(np.flatnonzero(rows >= min(y, rows[-1]))[0])]
        near, far = sorted(pair, key=lambda row: abs(int(rows[row]) - y))
        one, other = (continued(offset[y, x], offset[rows[row], x], solved[row, x]) for row in (near, far))
        if one >= 0 and other >= 0 and one != other:
            expected = one, other, 0.0
        elif one < 0 and other < 0:
            expected = -1, -1, 0.0
        else:
            row = near if one >= 0 else far
            next_ = continued(offset[y, x], offset[rows[row], x], runner_up[row, x])
            least = above[near, x] if other < 0 else above[far, x] if one < 0 else min(above[near, x], above[far, x])
            expected = one if one >= 0 else other, next_, float(least)
        assert (label[y, x], second[y, x], margin[y, x]) == expected, (y, x)


def test_solved_rows_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    offset = rng.uniform(-np.pi, np.pi, (7, 20)).astype(np.float32)
    solved, runner_up = np.full((3, 20), 2, dtype=np.int8), np.ones((3, 20), dtype=np.int8)
    label, second = np.zeros((2, 7, 20), dtype=np.int8)
    margin, above = np.zeros((7, 20), dtype=np.float32), np.ones((3, 20), dtype=np.float32)
    fill_rows(offset, solved_rows(7, 3), LABELS, solved, runner_up, above, label, second, margin)
    assert (label[::3] == 2).all()
    assert (second[::3] == 1).all()
    assert (margin[::3] == 1.0).all()


def test_solved_rows_are_the_same_upside_down() -> None:
    for height, step in ((480, 3), (481, 3), (480, 1), (37, 5)):
        rows = solved_rows(height, step)
        assert abs((height - 1 - rows[-1]) - rows[0]) <= 1
        assert (np.diff(rows) == step).all()
    np.testing.assert_array_equal(solved_rows(480, 3), 479 - solved_rows(480, 3)[::-1])
