"""Choice of the fringe order: dynamic programmes along rows and columns over the few candidates.

The paper's row programme (section 3.4) sees one epipolar line and needs order along it, which thin things before a far
background break. Here four programmes, left, right, up and down, charge every depth jump once and are added up, so a
pixel's order is also decided by the rows above and below, and no ordering is assumed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE, TURNS_PER_RAD
from moire_sensor.phase_carrier import Float32

NEVER = np.float32(1e9)
STRIPE_COLUMNS = 64


def path_costs(cost: Float32, offset_rad: Float32, jump_cost: float) -> Float32:
    """Cost of every candidate with what its row and column say, (H, W, labels) float32.

    Parameters
    ----------
    cost : (H, W, labels) float32.
    offset_rad : (H, W) float32 wrapped phase offset, NaN where unknown; tells which labels of neighbours continue
        one surface.
    jump_cost : cost of leaving the surface.
    """
    total = np.zeros_like(cost)
    jump = np.float32(jump_cost)
    add_row_paths(cost, offset_rad, jump, total)
    add_column_paths(cost, offset_rad, jump, total)
    return total


def best_orders(total: Float32, offset_rad: Float32) -> tuple[npt.NDArray[np.int8], Float32]:
    """Return the cheapest label (H, W) int8, -1 where the phase is unknown, and its margin over the second (H, W)."""
    label = np.empty(offset_rad.shape, dtype=np.int8)
    margin = np.empty(offset_rad.shape, dtype=np.float32)
    take_best(total, offset_rad, label, margin)
    return label, margin


def next_orders(total: Float32, label: npt.NDArray[np.int8], refused: npt.NDArray[np.bool_]) -> npt.NDArray[np.int8]:
    """Return the second cheapest label where the first was refused, -1 elsewhere and where there is no second."""
    following = np.full(label.shape, -1, dtype=np.int8)
    take_next(total, label, refused, following)
    return following


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def take_next(total, label, refused, following):  # type: ignore[no-untyped-def]
    """Fill ``following`` (H, W) at refused pixels that have a label."""
    height, width, labels = total.shape
    for y in prange(height):
        for x in range(width):
            if refused[y, x] and label[y, x] >= 0:
                best = np.float32(np.inf)
                for candidate in range(labels):
                    if candidate != label[y, x] and total[y, x, candidate] < best:
                        best = total[y, x, candidate]
                        following[y, x] = candidate


@njit(inline="always", fastmath=False)
def advance(previous, current, cost, total, step, jump):  # type: ignore[no-untyped-def]
    """One step of a programme: ``current`` from ``previous`` whose label + step continues the surface.

    Both states hold one cell more than labels at either end, never the cheapest.
    """
    labels = cost.size
    lowest = previous[1]
    for label in range(2, labels + 1):
        lowest = min(lowest, previous[label])
    for label in range(labels):
        best = min(previous[label + 1 + step] - lowest, jump)
        current[label + 1] = cost[label] + best
        total[label] += current[label + 1]


@njit(inline="always", fastmath=False)
def begin(current, cost, total):  # type: ignore[no-untyped-def]
    """First step of a programme, and the first after a pixel without phase."""
    for label in range(cost.size):
        current[label + 1] = cost[label]
        total[label] += cost[label]


@njit(inline="always", fastmath=False)
def label_step(here, before):  # type: ignore[no-untyped-def]
    """Label of the neighbour minus label here on one surface, -1 to 1."""
    return int(np.floor((here - before) * TURNS_PER_RAD + np.float32(0.5)))


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def add_row_paths(cost, offset, jump, total):  # type: ignore[no-untyped-def]
    """Add the programmes from the left and from the right."""
    height, width, labels = cost.shape
    for y in prange(height):
        state = np.full((2, labels + 2), NEVER, dtype=np.float32)
        for direction in (1, -1):
            start = 0 if direction == 1 else width - 1
            before = np.float32(np.nan)
            for index in range(width):
                x = start + direction * index
                here = offset[y, x]
                old, new = state[index % 2], state[(index + 1) % 2]
                if np.isnan(here - before):
                    begin(new, cost[y, x], total[y, x])
                else:
                    advance(old, new, cost[y, x], total[y, x], label_step(here, before), jump)
                before = here


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def add_column_paths(cost, offset, jump, total):  # type: ignore[no-untyped-def]
    """Add the programmes from above and from below, a stripe of columns at a time."""
    height, width, labels = cost.shape
    for stripe in prange((width + STRIPE_COLUMNS - 1) // STRIPE_COLUMNS):
        first = stripe * STRIPE_COLUMNS
        last = min(first + STRIPE_COLUMNS, width)
        state = np.full((2, last - first, labels + 2), NEVER, dtype=np.float32)
        for direction in (1, -1):
            start = 0 if direction == 1 else height - 1
            for index in range(height):
                y = start + direction * index
                for x in range(first, last):
                    here = offset[y, x]
                    before = offset[y - direction, x] if index > 0 else np.float32(np.nan)
                    old, new = state[index % 2, x - first], state[(index + 1) % 2, x - first]
                    if np.isnan(here - before):
                        begin(new, cost[y, x], total[y, x])
                    else:
                        advance(old, new, cost[y, x], total[y, x], label_step(here, before), jump)


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def take_best(total, offset, label, margin):  # type: ignore[no-untyped-def]
    """Lowest label per pixel and how far the second lies above it."""
    height, width, labels = total.shape
    for y in prange(height):
        for x in range(width):
            best = np.float32(np.inf)
            second = np.float32(np.inf)
            chosen = -1
            for candidate in range(labels):
                value = total[y, x, candidate]
                if value < best:
                    second = best
                    best = value
                    chosen = candidate
                elif value < second:
                    second = value
            known = not np.isnan(offset[y, x])
            label[y, x] = chosen if known else -1
            margin[y, x] = second - best if known else np.float32(0.0)
