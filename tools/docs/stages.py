"""What each stage of method ``dense`` makes of one exposure, for docs/method.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moire_sensor import Reconstructor, Shot
from moire_sensor.depth_refine import refine
from moire_sensor.order_cost import OrderCosts
from moire_sensor.order_range import OrderRange
from moire_sensor.order_solver import OrderSolver
from moire_sensor.order_tiles import as_rows, tiles_for
from moire_sensor.order_weigh import UNITS
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.phase_pipeline import SHADING_SINGLE_RAD
from moire_sensor.phase_single import phase_from_single
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig
from moire_sensor.settings import Settings
from moire_sim import VirtualHead
from moire_sim.capture import HeadCapture

SCENE = "cylinder_and_box"
DEPTH_RANGE_M = (0.5, 2.0)


@dataclass(frozen=True, eq=False)
class Stages:
    """What the stages hand on, images (H, W) of the left view.

    Attributes
    ----------
    capture : one exposure, with the truth.
    phase_rad : the left camera's phase, wrapped to -pi..pi; NaN where no fringes are seen.
    amplitude : of the fringes, grey levels.
    orders : absolute fringe order of candidate 0 of each pixel, and their number.
    cost : (H, K, W) of every candidate, in units of a full mismatch; 3 outside the depth range.
    depth_of_label_m : (K, W), depth of every candidate along ``row``.
    alone, agreed : number of the cheapest candidate, each pixel by itself and with its neighbours; NaN unknown.
    by_phases_m : depth from the phases alone, before grey levels decide.
    shot : the result.
    row : the row that is shown as a section.
    """

    capture: HeadCapture
    phase_rad: Float32
    amplitude: Float32
    cost: Float32
    depth_of_label_m: Float32
    alone: Float32
    agreed: Float32
    by_phases_m: Float32
    shot: Shot
    row: int


def measure(rig: StereoRig | None = None, seed: int = 0) -> Stages:
    """Take one exposure of the virtual head and follow it through the stages."""
    pattern = paper_pattern()
    with VirtualHead(SCENE, seed=seed, rig=rig) as head:
        capture = head.capture(pattern)
    rig, settings = capture.rig, Settings()
    projector = ProjectorMap.build(rig, pattern)
    far_px, near_px = (float(rig.disparity_px(depth)) for depth in reversed(DEPTH_RANGE_M))
    middle = 0.5 * (far_px + near_px)
    carriers = (
        Carrier.left(projector, rig.image_size, middle, settings.half_height_px),
        Carrier.right(projector, rig.image_size, middle, settings.half_height_px),
    )
    greys = (capture.left.astype(np.float32), capture.right.astype(np.float32))
    phases = (
        phase_from_single(greys[0], carriers[0], 0.0, settings),
        phase_from_single(greys[1], carriers[1], 0.0, settings),
    )
    orders = OrderRange.build(projector, carriers[0], (far_px, near_px))
    cost = candidate_costs(carriers, projector, orders, phases, greys)
    solver = OrderSolver(carriers, projector, orders, settings.jump_cost)
    label, _ = solver.solve(phases, greys, SHADING_SINGLE_RAD)
    known = np.isfinite(phases[0].offset_rad)
    match = refine(label, phases, carriers, projector, orders, settings, settings.max_mismatch_rad)
    row = rig.image_size[1] // 2
    shot = Reconstructor(rig, pattern, DEPTH_RANGE_M).reconstruct(capture.left, capture.right)
    return Stages(
        capture=capture,
        phase_rad=np.angle(np.exp(1j * (carriers[0].phase_rad + phases[0].offset_rad))).astype(np.float32),
        amplitude=phases[0].amplitude,
        cost=cost,
        depth_of_label_m=depths_along(row, rig, projector, carriers[0], phases[0], orders),
        alone=np.where(known, np.argmin(cost, axis=1), np.nan).astype(np.float32),
        agreed=np.where(label >= 0, label, np.nan).astype(np.float32),
        by_phases_m=np.asarray(rig.depth_m(match.disparity_px), dtype=np.float32),
        shot=shot,
        row=row,
    )


def candidate_costs(
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
    phases: tuple[PhaseImage, PhaseImage],
    greys: tuple[Float32, Float32],
) -> Float32:
    """Return the cost (H, K, W) of every candidate, in units of a full mismatch."""
    height, width = greys[0].shape
    tiles = tiles_for(height, width, orders.count)
    OrderCosts(carriers, projector, orders).fill(phases, greys, SHADING_SINGLE_RAD, tiles)
    return as_rows(tiles, height, width).astype(np.float32) / np.float32(UNITS)


def depths_along(
    row: int, rig: StereoRig, projector: ProjectorMap, carrier: Carrier, phase: PhaseImage, orders: OrderRange
) -> Float32:
    """Return where ray and light sheet meet (equation 11) for every candidate (K, W) of a row, metres."""
    columns = np.arange(float(rig.image_size[0]))
    turns = np.arange(orders.first, orders.first + orders.count)[:, None]
    absolute = carrier.phase_rad[row] + phase.offset_rad[row] + 2.0 * np.pi * turns
    disparity = projector.disparity_px_at(columns[None, :], np.full_like(columns, row)[None, :], absolute)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.asarray(rig.depth_m(disparity), dtype=np.float32)
    return np.where((depth >= DEPTH_RANGE_M[0]) & (depth <= DEPTH_RANGE_M[1]), depth, np.float32(np.nan))
