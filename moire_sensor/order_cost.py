"""Candidate fringe orders of every left pixel and how well the right camera agrees with each.

A pixel's phase fixes its depth up to a whole number of periods (equation 7). Each order in the depth range is one
candidate (equation 11); projected into the other camera (equation 12) it must meet the same phase there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE, TWO_PI, wrap
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import PLAIN, ProjectorMap, disparity_of_phase

# A mismatch of 90 degrees is as bad as any: orders that are off land 34 to 163 degrees away in the paper's rig.
FULL_MISMATCH_RAD = np.float32(np.pi / 2.0)
FLAT_COST = np.float32(0.15)
RIVAL_RAD = np.float32(0.7)
REACH_PX = 4
SEARCH_PX = np.float32(1.2)
GREY_WEIGHT = np.float32(1.0)
UNSEEN_COST = np.float32(0.6)
BLOCKED_COST = np.float32(3.0)
RANGE_MARGIN_PX = 0.5


@dataclass(frozen=True, eq=False)
class OrderRange:
    """Orders relative to the carrier that the depth range admits: absolute offset = offset + 2 pi (first + label).

    Attributes
    ----------
    first, count : the first relative order and the number of labels.
    min_disparity_px, max_disparity_px : the depth range as disparities.
    """

    first: int
    count: int
    min_disparity_px: float
    max_disparity_px: float

    @classmethod
    def build(cls, projector: ProjectorMap, carrier: Carrier, disparities_px: tuple[float, float]) -> OrderRange:
        """Orders between two disparities over the whole image."""
        height, width = carrier.phase_rad.shape
        columns, rows = np.meshgrid(np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 13))
        reference = projector.phase_rad_at(columns, rows, 0.5 * (disparities_px[0] + disparities_px[1]))
        ends = [projector.phase_rad_at(columns, rows, disparity) - reference for disparity in disparities_px]
        turns = np.stack(ends) / (2.0 * np.pi)
        first, last = int(np.floor(turns.min() + 0.5)), int(np.ceil(turns.max() - 0.5))
        return cls(first, last - first + 1, min(disparities_px), max(disparities_px))


def order_costs(
    left: PhaseImage,
    right: PhaseImage,
    images: tuple[Float32, Float32],
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
    shading_rad: float,
) -> Float32:
    """Cost of every candidate order, (H, W, labels) float32.

    0 to 1 by the phases, up to 2 where grey levels decide between orders; 3 outside the depth range, 0 where the phase
    is unknown.
    """
    cost = np.empty((*left.offset_rad.shape, orders.count), dtype=np.float32)
    limits = (orders.min_disparity_px - RANGE_MARGIN_PX, orders.max_disparity_px + RANGE_MARGIN_PX)
    fill_costs(
        left.offset_rad, right.offset_rad, left.amplitude, images[0], images[1], carriers[0].phase_rad,
        carriers[1].phase_rad, projector.packed(), orders.first, np.float32(limits[0]), np.float32(limits[1]),
        np.float32(shading_rad), cost,
    )  # fmt: skip
    return cost


@njit(inline="always", fastmath=False)
def right_phase(offset, carrier_rad, y, column):  # type: ignore[no-untyped-def]
    """Absolute right phase at a fractional column and its slope; nearest pixel across an edge; NaN where unknown."""
    left = min(int(max(column, np.float32(0.0))), offset.shape[1] - 2)
    part = np.float32(column - left)
    carrier_step = carrier_rad[y, left + 1] - carrier_rad[y, left]
    carrier = carrier_rad[y, left] + part * carrier_step
    near, far = offset[y, left], offset[y, left + 1]
    step = wrap(far - near)
    if np.isnan(step) or abs(step) > np.float32(0.5):
        return carrier + (near if part < np.float32(0.5) else far), carrier_step
    return carrier + near + part * step, carrier_step + step


@njit(inline="always", fastmath=False)
def difference(left, right, y, x, column, reach):  # type: ignore[no-untyped-def]
    """Mean absolute difference of grey levels between left pixels around x and right pixels around a column."""
    width = left.shape[1]
    base = int(np.floor(column))
    part = np.float32(column - base)
    total = np.float32(0.0)
    count = 0
    for shift in range(-reach, reach + 1, 2):
        at = base + shift
        if 0 <= x + shift < width and 0 <= at < width - 1:
            seen = right[y, at] + part * (right[y, at + 1] - right[y, at])
            total += abs(left[y, x + shift] - seen)
            count += 1
    return total / np.float32(count) if count > 1 else np.float32(np.inf)


@njit(inline="always", fastmath=False)
def smallest_difference(left, right, y, x, column, reach):  # type: ignore[no-untyped-def]
    """Difference at the best of three columns: shading moves the match of two phases by a pixel or so."""
    here = difference(left, right, y, x, column, reach)
    before = difference(left, right, y, x, column - SEARCH_PX, reach)
    after = difference(left, right, y, x, column + SEARCH_PX, reach)
    return min(here, min(before, after))


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def fill_costs(left, right, left_b, left_i, right_i, left_rad, right_rad, map_, first, low, high, flat, cost):  # type: ignore[no-untyped-def]
    """Fill ``cost`` (H, W, labels)."""
    height, width, labels = cost.shape
    for row in prange(height):
        y = np.int64(row)
        matched = np.empty(labels, dtype=np.float32)
        apart = np.empty(labels, dtype=np.float32)
        disparity = np.empty(labels, dtype=np.float32)
        for x in range(width):
            if np.isnan(left[y, x]):
                cost[y, x, :] = np.float32(0.0)
                continue
            phase = left_rad[y, x] + left[y, x]
            candidates(phase, x, y, map_, first, disparity)
            add_phases(phase, right, right_rad, y, x, disparity, first, low, high, flat, cost[y, x], matched, apart)
            add_greys(left_i, right_i, left_b[y, x], y, x, cost[y, x], matched, apart)


@njit(inline="always", fastmath=False)
def candidates(phase, x, y, map_, first, disparity):  # type: ignore[no-untyped-def]
    """Fill the disparities of one pixel's orders; evenly spaced where the projector stands in the cameras' plane."""
    start = phase + TWO_PI * np.float32(first)
    disparity[0] = disparity_of_phase(map_, x, y, start)
    if map_[7] == 0.0 and map_.shape[0] == PLAIN:
        below = map_[4] + map_[5] * x + map_[6] * y
        step = np.float32(2.0 * np.pi / (map_[8] * map_[3]) * below)
        for label in range(1, disparity.size):
            disparity[label] = disparity[0] + np.float32(label) * step
    else:
        for label in range(1, disparity.size):
            disparity[label] = disparity_of_phase(map_, x, y, start + TWO_PI * np.float32(label))


@njit(inline="always", fastmath=False)
def add_phases(phase, right, right_rad, y, x, disparity, first, low, high, flat, cost, matched, apart):  # type: ignore[no-untyped-def]
    """Fill one pixel's costs by phase, the right columns where the phases match (NaN: none), and the mismatches."""
    width = right.shape[1]
    for label in range(cost.size):
        matched[label] = np.float32(np.nan)
        if not (low <= disparity[label] <= high):
            cost[label] = BLOCKED_COST
            continue
        cost[label] = UNSEEN_COST
        column = np.float32(x) - disparity[label]
        if column < np.float32(-0.5) or column > np.float32(width) - np.float32(0.5):
            continue
        seen, slope = right_phase(right, right_rad, y, column)
        if not np.isnan(seen):
            mismatch = wrap(phase + TWO_PI * np.float32(first + label) - seen)
            apart[label] = abs(mismatch)
            cost[label] = phase_cost(apart[label], flat)
            matched[label] = column + mismatch / slope


@njit(inline="always", fastmath=False)
def add_greys(left_i, right_i, amplitude, y, x, cost, matched, apart):  # type: ignore[no-untyped-def]
    """Add to the costs of one pixel what grey levels say, where several orders match about as well by phase."""
    closest = FULL_MISMATCH_RAD
    for label in range(cost.size):
        if not np.isnan(matched[label]):
            closest = min(closest, apart[label])
    rivals = 0
    for label in range(cost.size):
        if not np.isnan(matched[label]) and apart[label] < closest + RIVAL_RAD:
            rivals += 1
    if rivals > 1:
        for label in range(cost.size):
            if not np.isnan(matched[label]) and apart[label] < closest + RIVAL_RAD:
                grey = smallest_difference(left_i, right_i, y, x, matched[label], REACH_PX)
                grey *= GREY_WEIGHT / max(amplitude, np.float32(1.0))
                cost[label] += min(grey, np.float32(1.0))


@njit(inline="always", fastmath=False)
def phase_cost(mismatch, flat):  # type: ignore[no-untyped-def]
    """Nearly flat up to the mismatch that shading can put into a phase, 1 from a quarter turn on."""
    if mismatch < flat:
        return FLAT_COST * mismatch / flat
    rest = (mismatch - flat) / (FULL_MISMATCH_RAD - flat)
    return min(FLAT_COST + (np.float32(1.0) - FLAT_COST) * rest, np.float32(1.0))
