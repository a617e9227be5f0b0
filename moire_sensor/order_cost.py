"""Candidate fringe orders of every left pixel and how well the right camera agrees with each.

A pixel's phase fixes its depth up to a whole number of periods (equation 7). Each order in the depth range is one
candidate (equation 11); projected into the other camera (equation 12) it must meet the same phase there. Where several
do, the grey levels tell them apart. All is done for a row and a label at a time, so that the loops run over columns.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import get_num_threads, njit, prange

from moire_sensor.angles import TWO_PI
from moire_sensor.apart import LEAF, UNCOUNTED
from moire_sensor.order_grey import CHUNK, add_greys, join, list_chunks, prepare
from moire_sensor.order_place import place
from moire_sensor.order_range import OrderRange
from moire_sensor.order_tiles import LANES, UInt8, put_line, strips_of
from moire_sensor.order_weigh import ENTRIES, PARTS, UNMATCHED, Slopes, copy_seen, find_rivals, look_up, weigh
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap

# Rows that differ by less than this, relative to the largest number, are one and the same.
SAME = 1e-6


class OrderCosts:
    """Cost of every candidate order; owns the memory it needs.

    Parameters
    ----------
    carriers, projector : the carriers of both cameras and the map that fixes disparities.
    orders : the candidates.
    """

    def __init__(self, carriers: tuple[Carrier, Carrier], projector: ProjectorMap, orders: OrderRange) -> None:
        workers, strips = get_num_threads(), strips_of(carriers[0].phase_rad.shape[1])
        width = LANES * strips
        self._right_rad = carriers[1].phase_rad
        self._left_rad = unique_rows(carriers[0].phase_rad)
        self._px_per_part = padded(unique_rows(TWO_PI / PARTS / carriers[1].rad_per_px), width)
        self._map = projector.packed()
        self._first = orders.first
        self._limits_px = np.array(orders.limits_px, dtype=np.float32)
        self._columns = np.zeros((workers, orders.count, width), dtype=np.float32)
        self._mismatches = np.full((workers, orders.count, width), UNMATCHED, dtype=np.int16)
        self._rivals, self._costs = np.zeros((2, workers, orders.count, width), dtype=np.uint8)
        self._floats = np.zeros((workers, 4, width), dtype=np.float32)
        self._parts = np.zeros((workers, 4, width + ENTRIES), dtype=np.int16)
        self._found = np.zeros((workers, width), dtype=np.int16)
        self._nearest = np.zeros((workers, width), dtype=np.int32)
        self._pairs = np.zeros((workers, 2, width + 1), dtype=np.uint32)
        self._chunks = np.zeros((workers, width // CHUNK + 1), dtype=np.int64)

    def fill(
        self,
        phases: tuple[PhaseImage, PhaseImage],
        greys: tuple[Float32, Float32],
        shading_rad: float,
        cost: UInt8,
    ) -> None:
        """Fill ``cost`` (strips, >= n lines, labels, LANES), see :mod:`moire_sensor.order_tiles`, in units of 1/85.

        0 to 1 by the phases, up to 1 more where grey levels decide between orders; 0.6 where the right camera sees no
        phase, 3 outside the depth range; all the same where the left phase is unknown.

        Parameters
        ----------
        phases, greys : of the left and right camera, (n, W), whose costs are wanted, and (H, W).
        shading_rad : mismatch up to which the cost hardly rises.
        """
        fill_costs(
            phases[0].offset_rad, phases[1].offset_rad, phases[0].amplitude, greys[0], greys[1], self._left_rad,
            self._right_rad, self._px_per_part, self._map, self._first, phases[0].rows, self._limits_px,
            Slopes.of(shading_rad), self._floats, self._parts, self._found, self._found.view(np.uint64), self._nearest,
            self._pairs, self._chunks, self._columns, self._mismatches, self._rivals, self._rivals.view(np.uint64),
            self._costs, cost,
        )  # fmt: skip


def unique_rows(values: npt.NDArray[np.float32]) -> Float32:
    """One row where all are the same, else all."""
    same = np.ptp(values, axis=0).max() <= SAME * np.abs(values).max()
    return np.ascontiguousarray(values[:1] if same else values, dtype=np.float32)


def padded(values: Float32, width: int) -> Float32:
    """Rows that go on with zeros."""
    return np.ascontiguousarray(np.pad(values, ((0, 0), (0, width - values.shape[1]))))


@njit(parallel=True, cache=True, error_model="numpy")
def fill_costs(  # type: ignore[no-untyped-def]
    left, right, amplitude, left_i, right_i, left_rad, right_rad, px_per_part, map_, first, rows, limits, slopes,
    floats, parts, found, found_words, nearest, pairs, chunks, columns, mismatches, rivals, rival_words, costs, cost,
):  # fmt: skip
    """Fill ``cost`` of the phases' rows, each worker some that follow each other, with memory of its own."""
    width, workers, labels = left.shape[1], floats.shape[0], columns.shape[1]
    strips = cost.shape[0]
    for number in prange(workers):
        worker = np.int64(number)
        line, seen = floats[worker], parts[worker, 0, : width + ENTRIES]
        part = parts[worker, 1, :width]
        for index in range(worker * rows.size // workers, (worker + 1) * rows.size // workers):
            y = rows[index]
            add_offset(left_rad[min(y, left_rad.shape[0] - 1)], left[index], line[0])
            copy_seen(right[index], seen)
            for label in range(labels):
                column, mismatch = columns[worker, label, :width], mismatches[worker, label, :width]
                place(
                    line[0, :width], map_, y, first + label, right_rad[y], limits, column, nearest[worker, :width], part
                )  # fmt: skip
                look_up(seen.view(np.uint16), nearest[worker], found_words[worker])
                weigh(found[worker, :width], part, slopes, mismatch, costs[worker, label])
            find_rivals(
                mismatches[worker], parts[worker, 2, : LANES * strips], parts[worker, 3, : LANES * strips],
                rivals[worker],
            )  # fmt: skip
            prepare(left_i[y], right_i[y], amplitude[index], line[2], line[3], pairs[worker, 0])
            join(pairs[worker, 0], pairs[worker, 0, 1:], pairs[worker, 1, :width])
            among_rivals(
                columns[worker], mismatches[worker], px_per_part[min(y, px_per_part.shape[0] - 1)], rivals[worker],
                rival_words[worker], line[2], line[3], pairs[worker, 1], np.float32(width - 1), chunks[worker],
                costs[worker],
            )  # fmt: skip
            put_line(costs[worker].reshape(labels, strips, LANES), cost[:, index])


@njit(**LEAF)
def add_offset(carrier, offset, phase):  # type: ignore[no-untyped-def]
    """Fill a row of absolute phases."""
    for x in range(offset.size):
        phase[x] = carrier[x] + offset[x]


@njit(**UNCOUNTED)
def among_rivals(  # type: ignore[no-untyped-def]
    columns, mismatches, px_per_part, rivals, words, greys, scale, pairs, last, chunks, costs
):
    """Add to the costs of rivals what grey levels tell."""
    labels = columns.shape[0]
    shape = columns.shape[1] // CHUNK, CHUNK
    speed, greys, scale = px_per_part.reshape(shape), greys.reshape(shape), scale.reshape(shape)
    for label in range(labels):
        column, mismatch = columns[label].reshape(shape), mismatches[label].reshape(shape)
        rival, cost = rivals[label].reshape(shape), costs[label].reshape(shape)
        for number in range(list_chunks(words[label].reshape(shape[0], CHUNK // 8), chunks)):
            at = chunks[number]
            add_greys(
                column[at], mismatch[at], speed[at], rival[at], greys[at], scale[at], pairs, last, cost[at]
            )  # fmt: skip
