"""Dynamic programmes against plain Python: a Viterbi, and every path there is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from dense_rigs import Array, Float32, capture, dense_shot

from moire_sensor.order_path import best_orders, next_orders, path_costs

JUMP = 0.8


def step_of(here: float, before: float) -> int | None:
    """Label of the neighbour minus the label here on one surface; None where a phase is unknown."""
    turns = (here - before) / (2.0 * np.pi)
    return None if np.isnan(turns) else int(np.floor(turns + 0.5))


def viterbi(cost: Array, offset: Array) -> Array:
    """Of one line (n, labels): the cost of the best path to every label, above the best at the pixel before."""
    n, labels = cost.shape
    best = np.zeros((n, labels))
    out = np.zeros((n, labels))
    for x in range(n):
        step = step_of(offset[x], offset[x - 1]) if x else None
        for label in range(labels):
            before = best[x - 1] if x else np.zeros(labels)
            reach = [float(min(before)) + (JUMP if step is not None else 0.0)]
            if step is not None and 0 <= label + step < labels:
                reach.append(float(before[label + step]))
            best[x, label] = cost[x, label] + min(reach)
            out[x, label] = best[x, label] - min(before)
    return out


def random_lines(seed: int, height: int, width: int, labels: int) -> tuple[Float32, Float32]:
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0, 1, (height, width, labels)).astype(np.float32)
    offset = rng.uniform(-np.pi, np.pi, (height, width)).astype(np.float32)
    offset[rng.uniform(size=offset.shape) < 0.15] = np.nan
    return cost, offset


def test_path_costs_are_four_viterbi_programmes() -> None:
    cost, offset = random_lines(1, 9, 70, 5)
    expected = np.zeros(cost.shape)
    for y in range(cost.shape[0]):
        expected[y] += viterbi(cost[y], offset[y])
        expected[y, ::-1] += viterbi(cost[y, ::-1], offset[y, ::-1])
    for x in range(cost.shape[1]):
        expected[:, x] += viterbi(cost[:, x], offset[:, x])
        expected[::-1, x] += viterbi(cost[::-1, x], offset[::-1, x])
    # Four float32 sums of about 70 terms.
    np.testing.assert_allclose(path_costs(cost, offset, JUMP), expected, atol=1e-4)


def test_programme_finds_the_cheapest_of_all_paths() -> None:
    cost, offset = random_lines(2, 1, 6, 3)
    offset = np.nan_to_num(offset)
    last = viterbi(cost[0], offset[0])[-1] + min_before(cost[0], offset[0])
    steps = [step_of(offset[0, x], offset[0, x - 1]) for x in range(1, 6)]
    for end in range(3):
        paths = (path for path in itertools.product(range(3), repeat=6) if path[-1] == end)
        assert last[end] == pytest.approx(min(price(cost[0], steps, path) for path in paths), abs=1e-6)


def min_before(cost: Array, offset: Array) -> float:
    """What the programme took off along the way: the best cost up to the last pixel but one."""
    along = viterbi(cost, offset)
    return float(sum(along[x].min() for x in range(len(cost) - 1)))


def price(cost: Array, steps: list[int | None], path: tuple[int, ...]) -> float:
    total = float(sum(cost[x, label] for x, label in enumerate(path)))
    jumps = sum(path[x] != path[x + 1] + (steps[x] or 0) for x in range(len(steps)))
    return total + JUMP * jumps


def test_best_and_next_orders() -> None:
    cost, offset = random_lines(3, 12, 30, 6)
    label, margin = best_orders(cost, offset)
    known = np.isfinite(offset)
    np.testing.assert_array_equal(label, np.where(known, cost.argmin(axis=2), -1))
    ranked = np.sort(cost, axis=2)
    np.testing.assert_array_equal(margin, np.where(known, ranked[..., 1] - ranked[..., 0], 0.0))
    refused = np.random.default_rng(4).uniform(size=offset.shape) < 0.5
    second = np.argsort(cost, axis=2)[..., 1]
    np.testing.assert_array_equal(next_orders(cost, label, refused), np.where(known & refused, second, -1))


def test_orders_of_a_wrapped_surface_continue() -> None:
    """A phase that runs through three turns: the label falls by one at each wrap, found from one good pixel."""
    phase = np.linspace(-3.0, 16.0, 120)
    turns = np.floor(phase / (2.0 * np.pi) + 0.5).astype(int)
    offset = np.tile((phase - 2.0 * np.pi * turns).astype(np.float32), (5, 1))
    cost = np.zeros((5, 120, 6), dtype=np.float32)
    cost[:, 60] = 1.0
    cost[:, 60, turns[60] + 1] = 0.0
    label, _ = best_orders(path_costs(cost, offset, JUMP), offset)
    np.testing.assert_array_equal(label, np.tile(turns + 1, (5, 1)))


def test_order_is_monotone_along_a_tilted_plane() -> None:
    """Along a row of a plane the projector's column, and so the order, only grows."""
    shot, seen = dense_shot("tilt_0.5"), capture("tilt_0.5")
    known = np.isfinite(shot.depth_m) & seen.covisible
    for row in range(5, 480, 19):
        orders = shot.fringe_order[row, known[row]].astype(int)
        assert orders.size > 300
        # At a border between two periods noise may toggle the order; it never falls by more than that.
        assert (np.maximum.accumulate(orders) - orders).max() <= 1
        assert (np.diff(orders) < 0).sum() <= 12
