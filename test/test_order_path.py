"""Dynamic programmes against plain Python: a Viterbi, and every path there is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from dense_rigs import Array, Float32, capture, dense_shot

from moire_sensor.order_path import OrderPaths
from moire_sensor.order_tiles import LANES, UInt8
from moire_sensor.order_weigh import UNITS

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


def random_costs(seed: int, height: int, width: int, labels: int) -> tuple[UInt8, Float32]:
    rng = np.random.default_rng(seed)
    cost = rng.integers(0, int(UNITS), (height, labels, width), endpoint=True).astype(np.uint8)
    offset = rng.uniform(-np.pi, np.pi, (height, width)).astype(np.float32)
    offset[rng.uniform(size=offset.shape) < 0.15] = np.nan
    return cost, offset


def paths(cost: UInt8, jump: float = JUMP) -> OrderPaths:
    height, labels, width = cost.shape
    solver = OrderPaths(height, width, labels, jump)
    put(cost, solver)
    return solver


def put(cost: UInt8, solver: OrderPaths) -> None:
    """Put costs (H, labels, W) into their strips."""
    for x in range(cost.shape[2]):
        solver.cost[x // LANES, : cost.shape[0], :, x % LANES] = cost[:, :, x]


def four_programmes(cost: Array, offset: Array) -> Array:
    """Sum of the programmes over (H, labels, W) costs."""
    total = np.zeros(cost.shape)
    for y in range(cost.shape[0]):
        total[y] += viterbi(cost[y].T, offset[y]).T
        total[y, :, ::-1] += viterbi(cost[y, :, ::-1].T, offset[y, ::-1]).T
    for x in range(cost.shape[2]):
        total[:, :, x] += viterbi(cost[:, :, x], offset[:, x])
        total[::-1, :, x] += viterbi(cost[::-1, :, x], offset[::-1, x])
    return total


# One block, blocks and stripes that overlap or end early, images smaller than any, one label.
@pytest.mark.parametrize("shape", [(9, 70, 5), (135, 20, 3), (6, 700, 4), (1, 1, 2), (3, 5, 9), (8, 16, 1)])
def test_orders_are_those_of_four_viterbi_programmes(shape: tuple[int, int, int]) -> None:
    height, width, labels = shape
    cost, offset = random_costs(1, height, width, labels)
    label, runner_up, margin = paths(cost).solve(offset)
    # In whole units all sums are exact: 0.8 of 85 is 68.
    total = np.round(four_programmes(cost / float(UNITS), offset) * float(UNITS))
    known = np.isfinite(offset)
    assert ((label == -1) == ~known).all()
    ranked = np.sort(total, axis=1)
    at = np.nonzero(known)
    np.testing.assert_array_equal(total[at[0], label[at], at[1]], ranked[:, 0][at])
    if labels == 1:
        assert (runner_up == -1).all()
        return
    np.testing.assert_array_equal(total[at[0], runner_up[at], at[1]], ranked[:, 1][at])
    assert (label != runner_up)[at].all()
    expected = np.where(known, (ranked[:, 1] - ranked[:, 0]) / float(UNITS), 0.0)
    np.testing.assert_allclose(margin, expected, atol=1e-5)


def test_nothing_is_left_of_the_frame_before() -> None:
    first, second = random_costs(3, 40, 50, 4), random_costs(4, 40, 50, 4)
    solver = paths(first[0])
    solver.solve(first[1])
    put(second[0], solver)
    again = [np.copy(result) for result in solver.solve(second[1])]
    for found, expected in zip(again, paths(second[0]).solve(second[1]), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_the_largest_costs_do_not_overflow() -> None:
    cost = np.full((20, 3, 20), 255, dtype=np.uint8)
    cost[:, 1] = 254
    label, runner_up, margin = paths(cost, 10.0).solve(np.zeros((20, 20), dtype=np.float32))
    assert (label == 1).all()
    assert (runner_up == 0).all()
    assert margin.min() > 0.0


def test_programme_finds_the_cheapest_of_all_paths() -> None:
    units, offset = random_costs(2, 1, 6, 3)
    cost, offset = units.transpose(0, 2, 1) / float(UNITS), np.nan_to_num(offset)
    last = viterbi(cost[0], offset[0])[-1] + min_before(cost[0], offset[0])
    steps = [step_of(offset[0, x], offset[0, x - 1]) for x in range(1, 6)]
    for end in range(3):
        ways = (path for path in itertools.product(range(3), repeat=6) if path[-1] == end)
        assert last[end] == pytest.approx(min(price(cost[0], steps, path) for path in ways), abs=1e-6)


def min_before(cost: Array, offset: Array) -> float:
    """What the programme took off along the way: the best cost up to the last pixel but one."""
    along = viterbi(cost, offset)
    return float(sum(along[x].min() for x in range(len(cost) - 1)))


def price(cost: Array, steps: list[int | None], path: tuple[int, ...]) -> float:
    total = float(sum(cost[x, label] for x, label in enumerate(path)))
    jumps = sum(path[x] != path[x + 1] + (steps[x] or 0) for x in range(len(steps)))
    return total + JUMP * jumps


def test_orders_of_a_wrapped_surface_continue() -> None:
    """A phase that runs through three turns: the label falls by one at each wrap, found from one good pixel."""
    phase = np.linspace(-3.0, 16.0, 120)
    turns = np.floor(phase / (2.0 * np.pi) + 0.5).astype(int)
    offset = np.tile((phase - 2.0 * np.pi * turns).astype(np.float32), (5, 1))
    cost = np.zeros((5, 6, 120), dtype=np.uint8)
    cost[:, :, 60] = int(UNITS)
    cost[:, turns[60] + 1, 60] = 0
    label = paths(cost).solve(offset)[0]
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
