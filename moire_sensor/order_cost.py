"""Candidate fringe orders of every left pixel and how well the right camera agrees with each.

A pixel's phase fixes its depth up to a whole number of periods (equation 7). Each order in the depth range is one
candidate (equation 11); projected into the other camera (equation 12) it must meet the same phase there. Where several
do, the grey levels tell them apart. All is done for a row and a label at a time, so that the loops run over columns.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import get_num_threads, njit, prange

from moire_sensor.angles import NAN_SAFE, TURNS_PER_RAD, TWO_PI
from moire_sensor.apart import ROW
from moire_sensor.order_place import place
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap

# Costs are whole numbers of 1/85, so that the largest, 3, fits into a byte.
UNITS = np.float32(85.0)
# A mismatch of 90 degrees is as bad as any: orders that are off land 34 to 163 degrees away in the paper's rig.
FULL_MISMATCH_RAD = np.float32(np.pi / 2.0)
FLAT_COST = np.float32(0.15)
# Phases alone do not tell orders apart that match this much worse than the best.
RIVAL_RAD = np.float32(0.7)
GREY_WEIGHT = np.float32(1.0)
GREY_COST = np.float32(1.0)
UNSEEN_COST = np.float32(0.6)
BLOCKED_COST = np.float32(3.0)
NO_RIVAL = np.float32(-1.0)
UNMATCHED = np.float32(100.0)


class OrderCosts:
    """Cost of every candidate order; owns the memory it needs.

    Parameters
    ----------
    carriers, projector : the carriers of both cameras and the map that fixes disparities.
    orders : the candidates.
    """

    def __init__(self, carriers: tuple[Carrier, Carrier], projector: ProjectorMap, orders: OrderRange) -> None:
        width = carriers[0].phase_rad.shape[1]
        workers = get_num_threads()
        self._carriers = carriers
        self._map = projector.packed()
        self._first = orders.first
        self._limits_px = orders.limits_px
        self._row = np.zeros((workers, 8, width + 2), dtype=np.float32)
        self._nearest = np.zeros((workers, width), dtype=np.int32)
        self._matches = np.zeros((workers, 2, orders.count, width), dtype=np.float32)

    def fill(
        self,
        phases: tuple[PhaseImage, PhaseImage],
        greys: tuple[Float32, Float32],
        shading_rad: float,
        cost: npt.NDArray[np.uint8],
        rows: npt.NDArray[np.int64],
    ) -> None:
        """Fill ``cost`` (>= n, labels, >= W) in units of 1/85.

        0 to 1 by the phases, up to 1 more where grey levels decide between orders; 0.6 where the right camera sees no
        phase, 3 outside the depth range, 0 where the left phase is unknown.

        Parameters
        ----------
        phases, greys : of the left and right camera, (H, W).
        shading_rad : mismatch up to which the cost hardly rises.
        rows : (n,) rows of the image whose costs are wanted.
        """
        left, right = self._carriers
        fill_costs(
            phases[0].offset_rad, phases[1].offset_rad, phases[0].amplitude, greys[0], greys[1], left.phase_rad,
            right.phase_rad, right.rad_per_px, self._map, self._first, rows, self._limits_px,
            np.float32(shading_rad), self._row, self._nearest, self._matches, cost,
        )  # fmt: skip


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def fill_costs(  # type: ignore[no-untyped-def]
    left, right, amplitude, left_i, right_i, left_rad, right_rad, rad_per_px, map_, first, rows, limits, flat,
    lines, nearest, matches, cost,
):  # fmt: skip
    """Fill ``cost`` (n, labels, columns) of the rows, each worker with lines of its own."""
    width = left.shape[1]
    workers = nearest.shape[0]
    for number in prange(workers):
        worker = np.int64(number)
        phase, turns = lines[worker, 0, :width], lines[worker, 1, :width]
        seen, bound, runner_up = lines[worker, 2], lines[worker, 3, :width], lines[worker, 4, :width]
        scale, px_per_rad, beyond = lines[worker, 5, :width], lines[worker, 6, :width], lines[worker, 7, : width + 1]
        columns, mismatches = matches[worker, 0], matches[worker, 1]
        for index in range(worker, rows.size, workers):
            y = rows[index]
            for x in range(width):
                phase[x] = left_rad[y, x] + left[y, x]
            copy_turns(right[y], seen)
            for label in range(cost.shape[1]):
                column, mismatch, line = columns[label], mismatches[label], cost[index, label, :width]
                place(phase, map_, y, first + label, right_rad[y], column, turns)
                fill_nearest(column, nearest[worker])
                subtract_seen(seen, nearest[worker], turns)
                weigh(column, turns, limits, flat, mismatch, line)
            find_rivals(mismatches, bound, runner_up)
            fill_scales(amplitude[y], rad_per_px[y], right_i[y], scale, px_per_rad, beyond)
            for label in range(cost.shape[1]):
                match(columns[label], mismatches[label], px_per_rad)
            add_greys(left_i[y], beyond, scale, columns, mismatches, bound, cost[index])


@njit(**ROW)
def copy_turns(offset, seen):  # type: ignore[no-untyped-def]
    """Right phases as turns between two NaN, which columns outside the image meet."""
    seen[0] = np.float32(np.nan)
    seen[seen.size - 1] = np.float32(np.nan)
    inside = seen[1 : seen.size - 1]
    for x in range(inside.size):
        inside[x] = offset[x] * TURNS_PER_RAD


@njit(**ROW)
def fill_nearest(column, nearest):  # type: ignore[no-untyped-def]
    """Fill nearest right pixels, counted from 1; 0 and W + 1 lie outside. An unknown column counts as outside."""
    beyond = np.float32(nearest.size)
    for x in range(nearest.size):
        at = column[x] if column[x] > np.float32(-1.0) else np.float32(-1.0)
        at = at if at < beyond else beyond
        nearest[x] = np.int32(at + np.float32(1.5))


@njit(**ROW)
def subtract_seen(seen, nearest, turns):  # type: ignore[no-untyped-def]
    """Subtract the right phases: of the nearest pixel, since between the sides of an edge there is none."""
    for x in range(turns.size):
        turns[x] -= seen[np.uint32(nearest[x])]


@njit(**ROW)
def weigh(column, turns, limits, flat, mismatch, cost):  # type: ignore[no-untyped-def]
    """Fill costs by phase, and mismatches in radians, UNMATCHED where no phase is seen or the depth out of range.

    The cost is nearly flat up to the mismatch that shading can put into a phase, and 1 from a quarter turn on.
    """
    gentle = FLAT_COST / flat
    steep = (np.float32(1.0) - FLAT_COST) / (FULL_MISMATCH_RAD - flat)
    least, most = np.float32(limits[0]), np.float32(limits[1])
    for index in range(cost.size):
        excess = turns[index]
        angle = TWO_PI * (excess - np.floor(excess + np.float32(0.5)))
        size = abs(angle)
        value = gentle * size if size < flat else FLAT_COST + steep * (size - flat)
        seen = size == size
        disparity = np.float32(np.int32(index)) - column[index]
        inside = (disparity >= least) & (disparity <= most)
        value = value if value < np.float32(1.0) else np.float32(1.0)
        value = value if seen else UNSEEN_COST
        value = value if inside else BLOCKED_COST
        value = value if column[index] == column[index] else np.float32(0.0)
        mismatch[index] = angle if seen & inside else UNMATCHED
        cost[index] = np.uint8(np.int32(value * UNITS + np.float32(0.5)))


@njit(**ROW)
def find_rivals(mismatch, bound, runner_up):  # type: ignore[no-untyped-def]
    """Fill the mismatch up to which orders rival the best of each pixel, NO_RIVAL where none does."""
    bound[:] = UNMATCHED
    runner_up[:] = UNMATCHED
    for label in range(mismatch.shape[0]):
        line = mismatch[label]
        for x in range(line.size):
            size = abs(line[x])
            worse = size if size > bound[x] else bound[x]
            bound[x] = size if size < bound[x] else bound[x]
            runner_up[x] = worse if worse < runner_up[x] else runner_up[x]
    for x in range(bound.size):
        best = bound[x] if bound[x] < FULL_MISMATCH_RAD else FULL_MISMATCH_RAD
        most = best + RIVAL_RAD
        bound[x] = most if runner_up[x] < most else NO_RIVAL


@njit(**ROW)
def fill_scales(amplitude, rad_per_px, right, scale, px_per_rad, beyond):  # type: ignore[no-untyped-def]
    """Fill cost per grey level and columns per mismatch of a row; copy right grey levels, the last one twice."""
    for x in range(scale.size):
        scale[x] = GREY_WEIGHT / (amplitude[x] if amplitude[x] > np.float32(1.0) else np.float32(1.0))
        px_per_rad[x] = np.float32(1.0) / rad_per_px[x]
        beyond[x] = right[x]
    beyond[scale.size] = right[scale.size - 1]


@njit(**ROW)
def match(column, mismatch, px_per_rad):  # type: ignore[no-untyped-def]
    """Move right columns to where the phases match, inside the image; the carrier's speed is taken at column x."""
    last = np.float32(column.size - 1)
    for x in range(column.size):
        at = column[x] + mismatch[x] * px_per_rad[x]
        at = at if at > np.float32(0.0) else np.float32(0.0)
        column[x] = at if at < last else last


@njit(**ROW)
def add_greys(left, right, scale, matched, mismatch, bound, cost):  # type: ignore[no-untyped-def]
    """Add to the costs of rivals how far grey levels differ where their phases match, in fringe amplitudes."""
    for x in range(bound.size):
        for label in range(mismatch.shape[0] if bound[x] > np.float32(0.0) else 0):
            if abs(mismatch[label, x]) < bound[x]:
                before = np.uint32(matched[label, x])
                part = matched[label, x] - np.float32(before)
                seen = right[before] + part * (right[before + 1] - right[before])
                differ = scale[x] * abs(left[x] - seen)
                differ = differ if differ < GREY_COST else GREY_COST
                cost[label, x] = np.uint8(cost[label, x] + np.uint8(np.int32(differ * UNITS + np.float32(0.5))))
