"""Runs and gaps of a row against a slow loop, uncompiled: the stages that use them run them compiled."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sensor import depth_runs as runs

NAN = np.float32(np.nan)


@pytest.fixture(autouse=True)
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("mark_edges", "list_marked"):
        monkeypatch.setattr(runs, name, getattr(runs, name).py_func)


def edges_of(line: list[float], limit: float) -> list[int]:
    row = np.array(line, dtype=np.float32)
    marks = runs.marks_for.py_func(row.size)
    edges = np.empty(row.size + 1, dtype=np.int32)
    count = runs.list_edges.py_func(row, np.float32(limit), marks, edges)
    assert edges[count] == row.size
    return edges[:count].tolist()


def test_runs_end_at_steps_and_gaps() -> None:
    assert edges_of([5.0, 5.5, 7.0, NAN, NAN, 7.0, 6.0], 1.0) == [0, 2, 3, 5]
    assert edges_of([NAN, NAN, 1.0], 1.0) == [0, 2]
    assert edges_of([NAN], 1.0) == [0]


def test_without_a_limit_only_gaps_end_them() -> None:
    assert edges_of([5.0, 90.0, NAN, 7.0, -60.0], np.inf) == [0, 2, 3]


@pytest.mark.parametrize("width", [7, 8, 9, 64, 101])
def test_random_rows_are_those_of_the_slow_loop(width: int) -> None:
    rng = np.random.default_rng(width)
    line = np.float32(np.cumsum(rng.normal(0.0, 1.0, width)))
    line[rng.uniform(size=width) < 0.2] = NAN
    expected = [0]
    for x in range(1, width):
        both, neither = np.isfinite(line[x - 1 : x + 1]).all(), np.isnan(line[x - 1 : x + 1]).all()
        if not neither and not (both and abs(line[x] - line[x - 1]) <= 1.0):
            expected.append(x)
    assert edges_of(line.tolist(), 1.0) == expected
