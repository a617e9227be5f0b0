"""Candidate orders and their costs against a loop in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import SMALL, Float32, outside_rig, small_carriers, small_map, small_rig

from moire_sensor.order_cost import (
    BLOCKED_COST,
    FLAT_COST,
    FULL_MISMATCH_RAD,
    GREY_WEIGHT,
    RANGE_MARGIN_PX,
    REACH_PX,
    RIVAL_RAD,
    SEARCH_PX,
    UNSEEN_COST,
    OrderRange,
    order_costs,
)
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.phase_carrier import Carrier
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap

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


def slow_right_phase(offset: Float32, carrier: Float32, y: int, column: float) -> tuple[float, float]:
    near = min(max(int(np.floor(column)), 0), offset.shape[1] - 2)
    part = column - near
    pair = offset[y, near : near + 2].astype(float)
    along = float(carrier[y, near + 1]) - float(carrier[y, near])
    base = float(carrier[y, near]) + part * along
    step = folded(pair[1] - pair[0])
    if np.isnan(step) or abs(step) > 0.5:
        return base + pair[0 if part < 0.5 else 1], along
    return base + pair[0] + part * step, along + step


def slow_grey(left: Float32, right: Float32, y: int, x: int, column: float) -> float:
    """Smallest of three mean differences, as interpolation by numpy gives them."""
    found = []
    width = left.shape[1]
    for moved in (column, column - float(SEARCH_PX), column + float(SEARCH_PX)):
        shifts = [s for s in range(-REACH_PX, REACH_PX + 1, 2)
                  if 0 <= x + s < width and 0 <= np.floor(moved) + s < width - 1]  # fmt: skip
        seen = np.interp([moved + s for s in shifts], np.arange(width), right[y])
        values = [abs(float(left[y, x + s]) - v) for s, v in zip(shifts, seen, strict=True)]
        found.append(np.mean(values) if len(values) > 1 else np.inf)
    return float(min(found))


def slow_costs(
    phases: tuple[PhaseImage, PhaseImage],
    images: tuple[Float32, Float32],
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
    flat: float,
) -> Float32:
    height, width = images[0].shape
    cost = np.zeros((height, width, orders.count), dtype=np.float32)
    for y, x in np.argwhere(np.isfinite(phases[0].offset_rad)):
        apart, matched = {}, {}
        for label in range(orders.count):
            phase = float(carriers[0].phase_rad[y, x] + phases[0].offset_rad[y, x]) + 2 * np.pi * (orders.first + label)
            disparity = float(projector.disparity_px_at(np.array(float(x)), np.array(float(y)), phase))
            cost[y, x, label] = UNSEEN_COST
            low, high = orders.min_disparity_px - RANGE_MARGIN_PX, orders.max_disparity_px + RANGE_MARGIN_PX
            if not low <= disparity <= high:
                cost[y, x, label] = BLOCKED_COST
                continue
            if not -0.5 <= x - disparity <= width - 0.5:
                continue
            seen, slope = slow_right_phase(phases[1].offset_rad, carriers[1].phase_rad, y, x - disparity)
            if np.isnan(seen):
                continue
            mismatch = folded(phase - seen)
            rising = FLAT_COST * abs(mismatch) / flat
            steep = FLAT_COST + (1 - FLAT_COST) * (abs(mismatch) - flat) / (FULL_MISMATCH_RAD - flat)
            cost[y, x, label] = rising if abs(mismatch) < flat else min(steep, 1.0)
            apart[label], matched[label] = abs(mismatch), x - disparity + mismatch / slope
        closest = min([float(FULL_MISMATCH_RAD), *apart.values()])
        rivals = [label for label in apart if apart[label] < closest + RIVAL_RAD]
        for label in rivals if len(rivals) > 1 else []:
            grey = slow_grey(*images, y, x, matched[label]) * GREY_WEIGHT / max(phases[0].amplitude[y, x], 1.0)
            cost[y, x, label] += min(grey, 1.0)
    return cost


@pytest.mark.parametrize("lens", [(), LENS], ids=["ideal", "lens"])
def test_order_costs_equal_the_slow_loop(lens: tuple[float, ...]) -> None:
    projector = small_map(small_rig(lens))
    carriers = small_carriers(projector, 30.0)
    orders = OrderRange.build(projector, carriers[0], (-20.0, 60.0))
    offsets = random_phases(7)
    phases = phase_image(offsets[0], 1), phase_image(offsets[1], 2)
    rng = np.random.default_rng(8)
    images = tuple(rng.uniform(0, 255, SMALL[::-1]).astype(np.float32) for _ in range(2))
    pair = images[0], images[1]
    fast = order_costs(*phases, pair, carriers, projector, orders, 0.6)
    slow = slow_costs(phases, pair, carriers, projector, orders, 0.6)
    # Where a rival, a neighbour or the border is decided by rounding of a float32 phase (3e-5 rad) the costs may jump.
    differs = np.abs(fast - slow) > 2e-3
    assert differs.mean() < 2e-3
    assert set(np.unique(np.isnan(fast))) == {False}


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
