"""The dynamic programme against an exhaustive search, the paper's constraints, and what it cannot do."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from edge_rigs import edge_rows, random_edges

from moire_sensor.edge_candidates import Candidates
from moire_sensor.edge_cost import NEAR, TIE_BREAK, matching_rules
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_lanes import whole_vectors
from moire_sensor.edge_match import EdgeMatch, match_edges
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.edge_spread import drop_loners

RANGE_PX = (50.0, 150.0)
PERIOD_PX = 16.6652
SAME_SIDE_PX = 0.072 * PERIOD_PX


def candidates_at(columns: list[list[list[float]]], orders: list[list[int]] | None = None) -> Candidates:
    """Candidates given row by row, edge by edge."""
    most = max([1, *(len(edge) for row in columns for edge in row)])
    room = whole_vectors(max([1, *(len(row) for row in columns)]))
    left_x = np.full((len(columns), most, room), np.nan, dtype=np.float32)
    half_order = np.zeros(left_x[:, 0].shape, dtype=np.int32)
    for y, row in enumerate(columns):
        for number, edge in enumerate(row):
            left_x[y, : len(edge), number] = edge
            if orders is not None:
                half_order[y, number] = orders[y][number]
    return Candidates(left_x, half_order)


Edges = list[tuple[float, int]]


def matched(left: EdgeRows, right: EdgeRows, candidates: Candidates, settings: EdgeSettings | None = None) -> EdgeMatch:
    settings = settings or EdgeSettings()
    match = match_edges(left, right, candidates, matching_rules(RANGE_PX, PERIOD_PX, settings))
    return EdgeMatch(*(numbers[:, : left.number.max()] for numbers in match))


def slow_unlike(left: tuple[float, int], right: tuple[float, int], candidates: list[float], s: EdgeSettings) -> float:
    """Dissimilarity, straight from section 3.4, the penalty without end; 0 with tie break and what distance adds."""
    inside = RANGE_PX[0] - 1.0 <= left[0] - right[0] <= RANGE_PX[1] + 1.0
    if left[1] != right[1] or not inside:
        return np.inf
    off = min(abs(c - left[0]) for c in candidates) / SAME_SIDE_PX
    return TIE_BREAK * off + s.lambda_off * min(off / NEAR, 1.0) ** 2 if off <= 1.0 else s.lambda_mat


def slow_best(
    left: Edges, right: Edges, candidates: list[list[float]], s: EdgeSettings
) -> tuple[float, list[tuple[int, int]]]:
    """Least J over every set of matches that keeps constraints 2 and 3."""
    n, m = len(left), len(right)
    best: tuple[float, list[tuple[int, int]]] = (cost_of([], left, right, candidates, s), [])
    for size in range(1, min(n, m) + 1):
        for chosen in itertools.product(itertools.combinations(range(n), size), itertools.combinations(range(m), size)):
            pairs = list(zip(*chosen, strict=True))
            cost = cost_of(pairs, left, right, candidates, s)
            if cost < best[0] - 1e-9:
                best = (cost, pairs)
    return best


def cost_of(
    pairs: list[tuple[int, int]], left: Edges, right: Edges, candidates: list[list[float]], s: EdgeSettings
) -> float:
    """J of a set of matches."""
    n, m = len(left), len(right)
    if not pairs:
        return s.lambda_oc * ((n > 0) + (m > 0))
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(pairs)]
    if any(i > 1 and j > 1 for i, j in steps):
        return np.inf
    ends = [pairs[0][0] > 0, pairs[0][1] > 0, pairs[-1][0] < n - 1, pairs[-1][1] < m - 1]
    occlusions = sum(ends) + sum(i > 1 or j > 1 for i, j in steps)
    unlike = sum(slow_unlike(left[i], right[j], candidates[j], s) for i, j in pairs)
    return occlusions * s.lambda_oc - len(pairs) * s.lambda_r + unlike


@pytest.mark.parametrize("lambda_off", [0.0, 0.4])
def test_matches_are_those_of_an_exhaustive_search(lambda_off: float) -> None:
    """Rows of up to five edges, of different numbers."""
    generator = np.random.default_rng(5)
    settings = EdgeSettings(lambda_oc=0.9, lambda_off=lambda_off)
    lefts = [random_edges(generator, 95.0, 150.0, int(generator.integers(0, 6))) for _ in range(150)]
    rights = [random_edges(generator, 0.0, 50.0, int(generator.integers(0, 6))) for _ in range(150)]
    # Two candidates lie beside left edges, most within the tolerance.
    columns = [
        [[float(generator.choice([x for x, _ in left] or [150.0]) + generator.normal(0, 0.8)) for _ in range(2)]
         for _ in right]
        for left, right in zip(lefts, rights, strict=True)
    ]  # fmt: skip
    match = matched(edge_rows(lefts), edge_rows(rights), candidates_at(columns), settings)
    total = 0
    for y, (left, right, row) in enumerate(zip(lefts, rights, columns, strict=True)):
        _, pairs = slow_best(left, right, row, settings)
        expected = [-1] * len(left)
        for i, j in pairs:
            if slow_unlike(left[i], right[j], row[j], settings) < settings.lambda_mat:
                expected[i] = j
        assert match.partner[y, : len(left)].tolist() == expected, (y, left, right, row, pairs)
        total += sum(partner >= 0 for partner in expected)
    assert total > 50


def even_edges(start: float, count: int, side: int = 1, pitch: float = 8.3) -> list[tuple[float, int]]:
    return [(start + pitch * k, side if k % 2 == 0 else -side) for k in range(count)]


def test_an_occluded_stretch_costs_one_occlusion_and_is_bridged() -> None:
    left = even_edges(200.0, 20)
    right = [(x - 100.0, side) for x, side in left[:8]] + [(x - 100.0, side) for x, side in left[12:]]
    candidates = candidates_at([[[x + 100.0] for x, _ in right]])
    match = matched(edge_rows([left]), edge_rows([right]), candidates)
    assert match.partner[0].tolist() == [*range(8), -1, -1, -1, -1, *range(8, 16)]


def test_matches_never_cross_so_a_thin_thing_in_front_costs_the_background_or_itself() -> None:
    """Constraint 2 fails on thin things: right of the background's edges on the left, left of them on the right."""
    left = [*even_edges(200.0, 4), *even_edges(240.0, 2), *even_edges(262.0, 4)]
    disparity = [60.0] * 4 + [100.0] * 2 + [60.0] * 4
    seen = sorted((x - d, side, x) for (x, side), d in zip(left, disparity, strict=True))
    right, truth = [(x, side) for x, side, _ in seen], [[at] for *_, at in seen]
    match = matched(edge_rows([left]), edge_rows([right]), candidates_at([truth]))
    partners = match.partner[0][match.partner[0] >= 0]
    assert np.all(np.diff(partners) > 0)
    assert match.partner[0, 4] == match.partner[0, 5] == -1
    assert (match.partner[0] >= 0).sum() == 8


def test_an_edge_of_the_other_side_or_of_another_height_is_no_correspondence() -> None:
    candidates = candidates_at([[[200.0], [208.3]]])
    right = edge_rows([even_edges(100.0, 2)])
    assert matched(edge_rows([even_edges(200.0, 2)]), right, candidates).partner.tolist() == [[0, 1]]
    assert matched(edge_rows([even_edges(200.0, 2, -1)]), right, candidates).partner.tolist() == [[-1, -1]]
    dark = edge_rows([even_edges(200.0, 2)], height=30.0)
    assert matched(dark, right, candidates).partner.tolist() == [[-1, -1]]
    shifted = edge_rows([even_edges(201.3, 2)])
    assert matched(shifted, right, candidates).partner.tolist() == [[-1, -1]]


def test_company_asks_for_neighbours_of_the_next_fringe_edge() -> None:
    left = edge_rows([even_edges(200.0, 5)])
    right = edge_rows([even_edges(100.0, 5)])
    orders = [[4, 5, 6, 9, 10]]
    candidates = candidates_at([[[x] for x, _ in even_edges(200.0, 5)]], orders)
    match = matched(left, right, candidates)

    def kept(min_run: int) -> list[bool]:
        partner = match.partner[0].copy()
        drop_loners(partner, match.candidate[0], candidates.half_order[0], min_run, *np.empty((2, 5), dtype=np.int32))
        return [bool(number >= 0) for number in partner]

    assert kept(1) == [True] * 5
    assert kept(2) == [True] * 5
    assert kept(3) == [True, True, True, False, False]
    match.partner[0, 1] = -1
    assert kept(2) == [False, False, False, True, True]


def test_rows_between_follow_edges_that_drift_and_stop_where_they_end() -> None:
    settings = EdgeSettings(rows=5)
    rows_l = [[(x + 0.7 * y, side) for x, side in even_edges(200.0, 6)] for y in range(10)]
    rows_r = [[(x - 100.0, side) for x, side in row] for row in rows_l]
    rows_l[9] = rows_l[9][:3]
    truth = candidates_at([[[x + 100.0] for x, _ in row] for row in rows_r])
    left, right = edge_rows(rows_l), edge_rows(rows_r)
    match = matched(left, right, truth, settings)
    assert match.partner[:9].tolist() == [list(range(6))] * 9
    assert match.partner[9, :3].tolist() == [0, 1, 2]
    assert np.all(match.partner[9, 3:] == -1)


def test_a_followed_edge_must_confirm_the_same_fringe() -> None:
    settings = EdgeSettings(rows=2)
    row = even_edges(200.0, 3)
    left = edge_rows([row, row])
    right = edge_rows([[(x - 100.0, side) for x, side in row]] * 2)
    columns = [[[x] for x, _ in row]] * 2
    candidates = candidates_at(columns, [[0, 3, 2], [0, 1, 2]])
    match = matched(left, right, candidates, settings)
    assert match.partner.tolist() == [[0, -1, 2], [0, 1, 2]]
