"""The solver as the pipeline uses it: true orders first, the second choice where the first is refused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from dense_rigs import capture

from moire_sensor.order_range import OrderRange
from moire_sensor.order_solver import OrderSolver
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage, solved_rows
from moire_sensor.projector_map import ProjectorMap

RANGE_PX = 58.7, 235.0
MIDDLE_PX = sum(RANGE_PX) / 2.0
SIZE = (640, 480)


@cache
def parts() -> tuple[ProjectorMap, tuple[Carrier, Carrier], OrderRange]:
    projector = ProjectorMap.build(paper_rig(), paper_pattern())
    carriers = Carrier.left(projector, SIZE, MIDDLE_PX, 2), Carrier.right(projector, SIZE, MIDDLE_PX, 2)
    return projector, carriers, OrderRange.build(projector, carriers[0], RANGE_PX)


def offset(absolute_rad: Float32, carrier: Carrier) -> PhaseImage:
    """Exact phases as a camera would measure them."""
    turned = np.angle(np.exp(1j * (absolute_rad - carrier.phase_rad.astype(float)))).astype(np.float32)
    one = np.ones_like(turned)
    return PhaseImage(turned, 70 * one, 100 * one, 0.01 * one, np.zeros(turned.shape, dtype=np.uint8))


def plane_phases(depth_m: float) -> tuple[PhaseImage, PhaseImage]:
    """Both views of a fronto-parallel plane, by geometry; the left one does not know a patch."""
    projector, carriers, _ = parts()
    disparity_px = float(paper_rig().disparity_px(depth_m))
    x, y = np.meshgrid(np.arange(640.0), np.arange(480.0))
    left = projector.phase_rad_at(x, y, disparity_px)
    right = projector.phase_rad_at(x + disparity_px, y, disparity_px)
    left[100:120, 200:230] = np.nan
    return offset(left, carriers[0]), offset(right, carriers[1])


def some_rows(phase: PhaseImage, step: int) -> PhaseImage:
    """One row in so many."""
    first, _ = solved_rows(phase.offset_rad.shape[0], step)
    images = (phase.offset_rad, phase.amplitude, phase.background, phase.sigma_rad)
    some = (np.ascontiguousarray(image[first::step]) for image in images)
    return PhaseImage(*some, phase.status[first::step], first, step)


def true_labels(phases: tuple[PhaseImage, PhaseImage], depth_m: float) -> Float32:
    projector, carriers, orders = parts()
    x, y = np.meshgrid(np.arange(640.0), np.arange(480.0))
    phase = projector.phase_rad_at(x, y, float(paper_rig().disparity_px(depth_m)))
    turns = (phase - carriers[0].phase_rad - phases[0].offset_rad) / (2.0 * np.pi)
    return np.asarray(np.round(turns) - orders.first, dtype=np.float32)


@pytest.mark.parametrize("row_step", [1, 3])
def test_planes_get_their_orders_and_refused_ones_another(row_step: int) -> None:
    """Planes at three depths, one after the other by the same solver; the last one as the first again."""
    projector, carriers, orders = parts()
    solver = OrderSolver(carriers, projector, orders, 0.8)
    for depth_m, name in ((0.6, "plane_600"), (1.5, "plane_1500"), (1.0, "plane_1000"), (0.6, "plane_600")):
        seen = capture(name)
        whole = plane_phases(depth_m)
        phases = some_rows(whole[0], row_step), some_rows(whole[1], row_step)
        rows = phases[0].rows
        greys = seen.left.astype(np.float32), seen.right.astype(np.float32)
        label, margin = solver.solve(phases, greys, 0.6)
        known = np.isfinite(phases[0].offset_rad)
        assert (label[~known] == -1).all()
        covisible = known & seen.covisible[rows]
        # A phase on the border between two turns has a label on either side.
        aside = covisible & (np.abs(phases[0].offset_rad) < np.pi - 1e-3)
        np.testing.assert_array_equal(label[aside], true_labels(whole, depth_m)[rows][aside])
        assert np.quantile(margin[aside], 0.01) > 0.5
        refused = known & (np.indices(known.shape).sum(axis=0) % 3 == 0)
        second = solver.second(label, np.where(refused, np.nan, 1.0).astype(np.float32))
        assert (second[~refused] == -1).all()
        assert (second[refused] >= 0).all()
        assert (second != label)[refused].all()
