"""Narrow gaps between two surfaces that nearly meet: the tread of a stair seen at a grazing angle, the face of a ledge.

Such a face is too dim, too narrow or too oblique for a phase. But a plane from the edge of one surface to the edge of
the other has a disparity that runs straight from the one to the other, and the grey levels of both views tell whether
that plane is there. Wide gaps and high steps are left alone: what lies in them is guesswork.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE, ROW
from moire_sensor.depth_gap import fill_face, fill_gap, is_face_aside
from moire_sensor.depth_refine import Match
from moire_sensor.depth_runs import TASKS, list_edges, marks_for
from moire_sensor.phase_carrier import Float32
from moire_sensor.settings import Settings

# The longest gap, and the highest step across it.
LENGTH_PX, STEP_PX = 8, np.float32(16.0)
# Along a row any step may lie within a run: gaps are looked for.
ANY_STEP_PX = np.float32(np.inf)
# Columns that one task follows from row to row, and a row long before the first.
BLOCK_PX, NEVER = 160, -100
# Pixels of each surface that must lie beside the gap.
EDGE_PX = 3
# Of the misfit allowed to single pixels beside an edge, a face may have this share: a plane is asked for, not a pixel.
MISFIT_SHARE = 0.25


def bridge(
    match: Match, greys: tuple[Float32, Float32], amplitude: Float32, rad_per_px: float, settings: Settings
) -> None:
    """Fill narrow gaps in place, along columns and then along rows.

    Parameters
    ----------
    match : disparities, NaN where unknown; a bridged pixel has as mismatch the difference of grey levels in fringe
        amplitudes of the gap's ends, as sigma what their doubt makes of its slope, and no signed mismatch.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    amplitude : fringe amplitude of the left image (H, W).
    rad_per_px : how fast the left phase runs along a row, without its sign.
    """
    limits = np.array(
        [2.0 * settings.image_noise, MISFIT_SHARE * settings.max_border_misfit, rad_per_px], dtype=np.float32
    )
    bridge_columns(*match.images(), *greys, amplitude, limits)
    bridge_rows(*match.images(), *greys, amplitude, limits)


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def bridge_rows(disparity, sigma, signed, mismatch, left, right, amplitude, limits):  # type: ignore[no-untyped-def]
    """Fill the gaps of every row of the first four images."""
    height, width = disparity.shape
    for task in prange(TASKS):
        marks, edges = marks_for(width), np.empty(width + 1, dtype=np.int32)
        for y in range(np.int64(task), height, TASKS):
            here = disparity[y]
            for number in range(1, list_edges(here, ANY_STEP_PX, marks, edges) - 1):
                last, at = np.int64(edges[number] - 1), np.int64(edges[number + 1])
                if at - last > LENGTH_PX + 1 or here[last + 1] == here[last + 1] or not meet(here, last, at):
                    continue
                images = here, sigma[y], signed[y], mismatch[y]
                if is_face_aside(here, left[y], amplitude[y], limits, last, at):
                    fill_face(images, last, at)
                else:
                    fill_gap(images, left, right, amplitude, limits, y, last, at, False)


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def bridge_columns(disparity, sigma, signed, mismatch, left, right, amplitude, limits):  # type: ignore[no-untyped-def]
    """Fill the gaps of every column of the first four images; a block of columns goes down row by row."""
    height, width = disparity.shape
    for block in prange((width + BLOCK_PX - 1) // BLOCK_PX):
        first, end = np.int64(block) * BLOCK_PX, min((np.int64(block) + 1) * BLOCK_PX, width)
        last = np.full(end - first, NEVER, dtype=np.int32)
        ends = np.empty(end - first, dtype=np.int32)
        for y in range(height):
            if mark_ends(disparity[y, first:end], y, last, ends) == 0:
                continue
            for x in range(first, end):
                before = np.int64(ends[x - first])
                here = disparity[:, x]
                if before >= 0 and meet(here, before, y):
                    images = here, sigma[:, x], signed[:, x], mismatch[:, x]
                    fill_gap(images, left, right, amplitude, limits, x, before, y, True)


@njit(**ROW)
def mark_ends(line, y, last, ends):  # type: ignore[no-untyped-def]
    """Fill where the gaps began that end in row y, -1 where none does, and return how many do.

    ``last`` are the last rows with a known pixel, which may be this one then.
    """
    row, longest, count = np.int32(y), np.int32(LENGTH_PX + 1), np.int32(0)
    for x in range(line.size):
        known, away = line[x] == line[x], row - last[x]
        closed = known & (away > np.int32(1)) & (away <= longest)
        ends[x] = last[x] if closed else np.int32(-1)
        last[x] = row if known else last[x]
        count += np.int32(closed)
    return count


@njit(inline="always", fastmath=False)
def meet(line, last, at):  # type: ignore[no-untyped-def]
    """Whether the surfaces that end at ``last`` and begin at ``at`` nearly meet; NaN compares as false."""
    if last < EDGE_PX - 1 or at + EDGE_PX > line.size or not abs(line[at] - line[last]) <= STEP_PX:
        return False
    for more in range(1, EDGE_PX):
        if not abs(line[last - more] - line[last]) <= STEP_PX or not abs(line[at + more] - line[at]) <= STEP_PX:
            return False
    return True
