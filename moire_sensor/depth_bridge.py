"""Narrow gaps between two surfaces that nearly meet: the tread of a stair seen at a grazing angle, the face of a ledge.

Such a face is too dim, too narrow or too oblique for a phase. But a plane from the edge of one surface to the edge of
the other has a disparity that runs straight from the one to the other, and the grey levels of both views tell whether
that plane is there. Wide gaps and high steps are left alone: what lies in them is guesswork.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE
from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Float32
from moire_sensor.settings import Settings

# The longest gap, and the highest step across it.
LENGTH_PX, STEP_PX = 8, np.float32(12.0)
# Pixels of each surface that must lie beside the gap.
EDGE_PX = 3
# A pixel with fringes of less than this share of its neighbour's shows something else too.
MIXED_SHARE = np.float32(0.9)
# Of the misfit allowed to single pixels beside an edge, a face may have this share: a plane is asked for, not a pixel.
MISFIT_SHARE = 0.25
# Half of the row of grey levels that speaks for a pixel.
HALF_ROW_PX = 3


def bridge(match: Match, greys: tuple[Float32, Float32], amplitude: Float32, settings: Settings) -> None:
    """Fill narrow gaps in place, along columns and then along rows.

    Parameters
    ----------
    match : disparities, NaN where unknown; a bridged pixel has as mismatch the difference of grey levels in fringe
        amplitudes, as sigma what a pixel of doubt about the gap's ends makes of its slope, and no signed mismatch.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    amplitude : fringe amplitude of the left image (H, W).
    """
    limits = np.array([2.0 * settings.image_noise, MISFIT_SHARE * settings.max_border_misfit], dtype=np.float32)
    columns = tuple(image.T for image in match.images())
    bridge_lines(*columns, *greys, amplitude, limits, True)
    bridge_lines(*match.images(), *greys, amplitude, limits, False)


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def bridge_lines(  # type: ignore[no-untyped-def]
    disparity, sigma, signed, mismatch, left, right, amplitude, limits, upright
):
    """Fill the gaps of every line of the first four images, which are transposed if ``upright``."""
    lines, length = disparity.shape
    for number in prange(lines):
        line = np.int64(number)
        here = disparity[line]
        bright = amplitude[:, line] if upright else amplitude[line]
        last = -1
        for at in range(length):
            if here[at] != here[at]:
                continue
            if last >= 0 and 1 < at - last <= LENGTH_PX + 1 and meet(here, last, at):
                first, end = firm_ends(bright, last, at)
                begin = here[first]
                slope = (here[end] - begin) / np.float32(end - first)
                for x in range(first + 1, end):
                    found = begin + slope * np.float32(x - first)
                    row, column = (x, line) if upright else (line, x)
                    along = np.float32(0.0) if upright else slope
                    apart = row_difference(left, right, row, column, found, along)
                    if apart < limits[0] + limits[1] * bright[x]:
                        here[x], sigma[line, x] = found, sigma[line, first] + abs(slope)
                        signed[line, x] = np.float32(np.nan)
                        mismatch[line, x] = apart / max(bright[x], np.float32(1.0))
            last = at


@njit(inline="always", fastmath=False)
def firm_ends(bright, last, at):  # type: ignore[no-untyped-def]
    """The ends of a gap, each a pixel further out where its fringes are dim beside those behind it: a mixed pixel."""
    first = last - 1 if bright[last] < MIXED_SHARE * bright[last - 1] else last
    return first, at + 1 if bright[at] < MIXED_SHARE * bright[at + 1] else at


@njit(inline="always", fastmath=False)
def meet(line, last, at):  # type: ignore[no-untyped-def]
    """Whether the surfaces that end at ``last`` and begin at ``at`` nearly meet; NaN compares as false."""
    if last < EDGE_PX - 1 or at + EDGE_PX > line.size or not abs(line[at] - line[last]) <= STEP_PX:
        return False
    for more in range(1, EDGE_PX):
        if not abs(line[last - more] - line[last]) <= STEP_PX or not abs(line[at + more] - line[at]) <= STEP_PX:
            return False
    return True


@njit(inline="always", fastmath=False)
def row_difference(left, right, y, x, disparity, along):  # type: ignore[no-untyped-def]
    """Mean difference of the two views along the row about a pixel; infinite where the right view ends."""
    first, last = max(x - HALF_ROW_PX, 0), min(x + HALF_ROW_PX, left.shape[1] - 1)
    total = np.float32(0.0)
    for column in range(first, last + 1):
        seen = np.float32(column) - (disparity + along * np.float32(column - x))
        if not np.float32(0.0) <= seen < np.float32(left.shape[1] - 1):
            return np.float32(np.inf)
        base = int(seen)
        part = seen - np.float32(base)
        total += abs(left[y, column] - (right[y, base] + part * (right[y, base + 1] - right[y, base])))
    return total / np.float32(last - first + 1)
