"""Candidates against the paper's lines and projections in space."""

from __future__ import annotations

import numpy as np
import pytest
from edge_rigs import edge_rows, random_edges, rigs_under_test

from moire_sensor.edge_candidates import RANGE_MARGIN_PX, CandidateRays, Candidates, find_candidates
from moire_sensor.edge_find import EdgeRows
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig

RIGS = rigs_under_test()
DEPTHS_M = (0.5, 2.0)


def disparity_range(rig: StereoRig) -> tuple[float, float]:
    return float(rig.disparity_px(DEPTHS_M[1])), float(rig.disparity_px(DEPTHS_M[0]))


def candidates_of(right: EdgeRows, rig: StereoRig) -> Candidates:
    rays = CandidateRays.build(ProjectorMap.build(rig, paper_pattern()), disparity_range(rig), rig.image_size)
    return find_candidates(right, rays)


def slow_candidates(rig: StereoRig, x: float, y: float, side: int, rising: float) -> dict[int, float]:
    """Equations (11) and (12) in space: fringe number to left column, for candidates inside image and range."""
    pattern = paper_pattern()
    least, most = disparity_range(rig)
    found = {}
    for order in range(-200, 260):
        u = (-side * rising * np.pi / 2.0 + 2.0 * np.pi * order - pattern.phase_rad) * pattern.period_px / (2.0 * np.pi)
        # The line of the right pixel is the meet of two planes; the light of a projector column is a third one.
        planes = np.stack(
            [
                rig.P_right[0] - x * rig.P_right[2],
                rig.P_right[1] - y * rig.P_right[2],
                rig.P_projector[0] - u * rig.P_projector[2],
            ]
        )
        point = np.linalg.solve(planes[:, :3], -planes[:, 3])
        left = rig.P_left @ np.append(point, 1.0)
        column = left[0] / left[2]
        seen = point[2] > 0.0 and 0.0 <= column <= rig.image_size[0] - 1.0
        if seen and least - RANGE_MARGIN_PX <= column - x <= most + RANGE_MARGIN_PX:
            found[int(np.floor((-side * rising * 0.5) + 2.0 * order))] = column
    return found


@pytest.mark.parametrize("name", RIGS)
def test_candidates_are_the_intersections_in_space(name: str) -> None:
    rig = RIGS[name]
    generator = np.random.default_rng(11)
    right = edge_rows([random_edges(generator, 0.0, 639.0, 6) for _ in range(8)])
    candidates = candidates_of(right, rig)
    rising = -1.0 if name == "upside_down" else 1.0
    total = 0
    for y in range(8):
        for number in range(6):
            slow = slow_candidates(rig, float(right.x_px[y, number]), float(y), int(right.side[y, number]), rising)
            left_x = candidates.left_x_px[y, :, number]
            half_order = candidates.half_order[y, number] + 2 * np.arange(left_x.size)
            given = {int(k): float(v) for k, v in zip(half_order, left_x, strict=True) if v == v}
            assert given.keys() == slow.keys()
            for order, column in slow.items():
                # float32 of a column up to 640 px.
                assert given[order] == pytest.approx(column, abs=1e-3)
            total += len(slow)
    assert total > 48


def test_the_line_is_that_of_equation_11() -> None:
    """In the paper's rig the candidates' X and Z lie on Z = M(1,1) / (x - M(1,3)) X + M(1,4) / (x - M(1,3))."""
    rig = RIGS["paper"]
    right = edge_rows([[(150.0, 1), (400.3, -1)]])
    candidates = candidates_of(right, rig)
    M = rig.P_right / rig.P_right[2, 2]
    for number in range(2):
        x = float(right.x_px[0, number])
        left_x = candidates.left_x_px[0, :, number].astype(np.float64)
        left_x = left_x[np.isfinite(left_x)]
        assert left_x.size >= 4
        Z = rig.depth_m(left_x - x)
        X = (left_x - rig.P_left[0, 2]) / rig.P_left[0, 0] * Z
        # Columns are float32, 3e-5 px of a disparity of 59 or more: 1e-6 of the depth.
        np.testing.assert_allclose(M[0, 0] / (x - M[0, 2]) * X + M[0, 3] / (x - M[0, 2]), Z, rtol=1e-5)


def test_orders_are_half_a_period_apart_for_the_two_sides() -> None:
    """physics.md: candidates k orders off lie 38.2 px apart, off phase by 105 degrees a step."""
    rig = RIGS["paper"]
    candidates = candidates_of(edge_rows([[(300.0, 1)]]), rig)
    left_x = candidates.left_x_px[0, :, 0]
    steps = np.abs(np.diff(left_x[np.isfinite(left_x)]))
    np.testing.assert_allclose(steps, paper_pattern().period_px * 94.0 / 41.0, atol=1e-3)
    turns = steps[0] / paper_pattern().period_px
    assert np.degrees(2.0 * np.pi * (turns - round(turns))) == pytest.approx(105.0, abs=1.0)


def test_a_row_without_edges_has_no_candidates() -> None:
    rig = RIGS["paper"]
    right = edge_rows([[], [(300.0, 1)]])
    rays = CandidateRays.build(ProjectorMap.build(rig, paper_pattern()), disparity_range(rig), rig.image_size)
    room = rays.room(right)
    room.left_x_px[:] = -5.0
    candidates = find_candidates(right, rays, room=room)
    assert np.all(candidates.left_x_px[0] == -5.0)
    assert np.isfinite(candidates.left_x_px[1, :, 0]).sum() >= 4
