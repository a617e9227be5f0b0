"""Candidate orders and their costs against a loop in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from core_rigs import rotation
from dense_rigs import SMALL, Float32, outside_rig, small_carriers, small_map, small_rig

from moire_sensor.order_cost import OrderCosts
from moire_sensor.order_grey import GREY_COST, GREY_WEIGHT
from moire_sensor.order_range import RANGE_MARGIN_PX, OrderRange
from moire_sensor.order_tiles import as_rows, tiles_for
from moire_sensor.order_weigh import BLOCKED_COST, FLAT_COST, FULL_MISMATCH_RAD, RIVAL_RAD, UNITS, UNSEEN_COST
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.phase_carrier import Carrier
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig

LENS = (-0.05, 0.02, 0.001, -0.0005)


def phase_image(offset: Float32, seed: int) -> PhaseImage:
    shape = offset.shape
    amplitude = np.random.default_rng(seed).uniform(20, 70, shape).astype(np.float32)
    flat = np.full(shape, 100.0, dtype=np.float32)
    return PhaseImage(offset, amplitude, flat, np.full(shape, 0.01, dtype=np.float32), np.zeros(shape, dtype=np.uint8))


def random_phases(seed: int) -> tuple[Float32, Float32]:
    """Random offsets that vary slowly, with some unknown."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : SMALL[1], 0 : SMALL[0]]
    images = []
    for _ in range(2):
        offset = rng.uniform(-2, 2) + 0.7 * np.sin(x / rng.uniform(9, 20)) + 0.3 * np.cos(y / 7.0)
        offset[rng.uniform(size=offset.shape) < 0.1] = np.nan
        images.append(offset.astype(np.float32))
    return images[0], images[1]


def folded(angle: float) -> float:
    return float(np.angle(np.exp(1j * angle)))


def slow_grey(left: Float32, right: Float32, y: int, x: int, column: float) -> float:
    """Difference of grey levels, as interpolation by numpy gives it."""
    return abs(float(left[y, x]) - float(np.interp(column, np.arange(right.shape[1]), right[y])))


def phase_cost(mismatch: float, flat: float) -> float:
    if mismatch < flat:
        return float(FLAT_COST) * mismatch / flat
    steep = (1.0 - float(FLAT_COST)) / (float(FULL_MISMATCH_RAD) - flat)
    return min(float(FLAT_COST) + steep * (mismatch - flat), 1.0)


def slow_costs(
    phases: tuple[PhaseImage, PhaseImage],
    images: tuple[Float32, Float32],
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
    flat: float,
) -> Float32:
    height, width = images[0].shape
    cost = np.zeros((height, orders.count, width), dtype=np.float32)
    low, high = orders.min_disparity_px - RANGE_MARGIN_PX, orders.max_disparity_px + RANGE_MARGIN_PX
    for y, x in np.argwhere(np.isfinite(phases[0].offset_rad)):
        apart, matched = {}, {}
        for label in range(orders.count):
            phase = float(carriers[0].phase_rad[y, x] + phases[0].offset_rad[y, x]) + 2 * np.pi * (orders.first + label)
            column = x - float(projector.disparity_px_at(np.array(float(x)), np.array(float(y)), phase))
            cost[y, label, x] = UNSEEN_COST
            if not low <= x - column <= high:
                cost[y, label, x] = BLOCKED_COST
                continue
            near = int(np.floor(column + 0.5))
            if not 0 <= near < width or np.isnan(phases[1].offset_rad[y, near]):
                continue
            carrier = np.interp(column, np.arange(width), carriers[1].phase_rad[y])
            mismatch = folded(phase - carrier - phases[1].offset_rad[y, near])
            cost[y, label, x] = phase_cost(abs(mismatch), flat)
            apart[label], matched[label] = abs(mismatch), column + mismatch / float(carriers[1].rad_per_px[y, x])
        closest = min([float(FULL_MISMATCH_RAD), *apart.values()])
        rivals = [label for label in apart if apart[label] < closest + RIVAL_RAD]
        for label in rivals if len(rivals) > 1 else []:
            grey = slow_grey(*images, y, x, matched[label]) * GREY_WEIGHT / max(phases[0].amplitude[y, x], 1.0)
            cost[y, label, x] += min(grey, GREY_COST)
    return cost


def turned_rig() -> StereoRig:
    """The small rig with its projector turned by 8 degrees, tilted and a little nearer to the scene."""
    plain = small_rig()
    turn = rotation(3.0, 8.0, -2.0)
    projector = plain.P_projector.copy()
    projector[:, :3] = projector[:, :3] @ turn
    projector[:, 3] += np.array([0.0, 0.0, 0.02])
    return StereoRig.from_projections(plain.P_left, plain.P_right, projector, SMALL, projector_size=(960, 480))


RIGS = {"straight": small_rig(), "turned": turned_rig(), "lens": small_rig(LENS)}


@pytest.mark.parametrize("name", RIGS)
def test_order_costs_equal_the_slow_loop(name: str) -> None:
    projector = small_map(RIGS[name])
    carriers = small_carriers(projector, 30.0)
    orders = OrderRange.build(projector, carriers[0], (-20.0, 60.0))
    offsets = random_phases(7)
    phases = phase_image(offsets[0], 1), phase_image(offsets[1], 2)
    rng = np.random.default_rng(8)
    # Grey levels near each other, so that they often decide without reaching their limit.
    pair = rng.uniform(90, 130, SMALL[::-1]).astype(np.float32), rng.uniform(90, 130, SMALL[::-1]).astype(np.float32)
    tiles = tiles_for(SMALL[1], SMALL[0], orders.count)
    OrderCosts(carriers, projector, orders).fill(phases, pair, 0.6, tiles)
    cost = as_rows(tiles, SMALL[1], SMALL[0])
    slow = slow_costs(phases, pair, carriers, projector, orders, 0.6)
    unknown = np.isnan(offsets[0])
    assert (np.ptp(cost, axis=1)[unknown] == 0).all()
    cost, slow = (values.transpose(0, 2, 1)[~unknown] for values in (cost, slow))
    assert {UNSEEN_COST, BLOCKED_COST} <= set(np.unique(slow))
    # Two sums are rounded to whole units. Where the nearest pixel, a rival or the border is decided by rounding of a
    # float32 phase (3e-5 rad) the costs may jump.
    differs = np.abs(cost / UNITS - slow) > 1.05 / UNITS
    assert differs.mean() < 2e-3


def test_order_range_covers_every_pixel_and_no_more() -> None:
    """Labels are those that some pixel reaches between the two depths, counted by brute force over all pixels."""
    for rig in (paper_rig(), outside_rig()):
        projector = ProjectorMap.build(rig, paper_pattern())
        disparities = float(rig.disparity_px(2.0)), float(rig.disparity_px(0.5))
        carrier = Carrier.left(projector, rig.image_size, sum(disparities) / 2, 2)
        orders = OrderRange.build(projector, carrier, disparities)
        y, x = np.mgrid[0:480:8, 0:640:8].astype(float)
        reference = projector.phase_rad_at(x, y, sum(disparities) / 2)
        between = np.linspace(*disparities, 200)
        turns = np.stack([projector.phase_rad_at(x, y, d) - reference for d in between]) / (2 * np.pi)
        assert orders.first == np.floor(turns.min() + 0.5)
        assert orders.first + orders.count - 1 == np.ceil(turns.max() - 0.5)


def test_paper_rig_has_six_candidates_a_pixel() -> None:
    """The count of physics.md: 6 for the default rig over 0.5 to 2 m, within the labels that whole orders need."""
    projector = ProjectorMap.build(paper_rig(), paper_pattern())
    near, far = (float(paper_rig().disparity_px(z)) for z in (0.5, 2.0))
    turns = np.ptp([projector.phase_rad_at(np.array(320.0), np.array(240.0), d) for d in (near, far)]) / (2 * np.pi)
    assert 5.0 < turns < 6.0
