"""Depth behind something nearer: what the right camera cannot see, the pair cannot have measured."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import BARE, NAN_SAFE, ROW
from moire_sensor.depth_claims import claim_both
from moire_sensor.depth_runs import TASKS, list_edges, marks_for
from moire_sensor.phase_carrier import Float32

# A pixel is hidden where the right image shows something nearer by so much in its column and so many on either side.
NEARER_PX, BESIDE_PX = np.float32(2.0), 5
# Windows of 2, 4, 8 and 2 BESIDE_PX + 1 pixels, each from two of the one before.
DOUBLING = (1, 2, 4, 3)
# Runs: neighbours in one lie less far apart than a pixel, so that the right image shows them in their order.
STEADY_PX = np.float32(0.5)
# What begins further left than so much before the end of a run may hide its end and all the columns beside it.
DEEP_PX = np.float32(BESIDE_PX - 1.5)
NOTHING = np.float32(-1e9)


def drop_hidden(disparity_px: Float32) -> None:
    """Set in place to NaN the disparities (H, W) of pixels that lie deep behind a nearer surface on the right.

    Near the rim of what hides them pixels are left alone: there a pixel more or less decides who is seen.
    """
    drop_of_rows(disparity_px)


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def drop_of_rows(disparity):  # type: ignore[no-untyped-def]
    """Kernel of :func:`drop_hidden`."""
    height, width = disparity.shape
    for task in prange(TASKS):
        marks, edges = marks_for(width), np.empty(width + 1, dtype=np.int32)
        nearest, seen = np.empty(width, dtype=np.float32), np.empty(width + 2, dtype=np.float32)
        columns = np.empty(width + 2, dtype=np.int32)
        for y in range(np.int64(task), height, TASKS):
            count = list_edges(disparity[y], STEADY_PX, marks, edges)
            if may_hide(disparity[y], edges, count):
                claim_both(disparity[y], disparity[y] == disparity[y], NOTHING, columns, seen, nearest)
                keep_least(nearest)
                clear_behind(nearest, disparity[y])


@njit(**BARE)
def may_hide(line, edges, count):  # type: ignore[no-untyped-def]
    """Whether one run of a row may lie deep behind a later one, which begins on the right well before it ends.

    So far before, since the columns on the left of a hidden pixel are nearer, too. Only beside a nearer run on its left
    may these be that run's: there a later one that begins half a column after it ends may be near enough.
    """
    behind = NOTHING
    for number in range(count):
        first, last = edges[number], edges[number + 1] - 1
        start, end = np.float32(first) - line[first], np.float32(last) - line[last]
        if start < behind:
            return True
        if start == start:
            deep = min(start + np.float32(BESIDE_PX), end + STEADY_PX) if is_beside(line, first, last) else NOTHING
            behind = max(behind, deep, end - DEEP_PX)
    return False


@njit(**BARE)
def is_beside(line, first, last):  # type: ignore[no-untyped-def]
    """Whether something nearer lies right before a run, so that it may hide columns on the left of its first pixels."""
    farthest, nearest = line[first], NOTHING
    for x in range(first, min(first + BESIDE_PX - 1, last + 1)):
        farthest = min(farthest, line[x])
    for x in range(max(first - BESIDE_PX + 1, 0), first):
        nearest = line[x] if line[x] > nearest else nearest
    return nearest > farthest + NEARER_PX


@njit(**ROW)
def keep_least(nearest):  # type: ignore[no-untyped-def]
    """Make each value of a row (W,) the least from it to as far as twice beside, by windows of 2, 4, 8 and 11."""
    for step in DOUBLING:
        for x in range(nearest.size - step):
            nearest[x] = min(nearest[x], nearest[x + step])


@njit(**ROW)
def clear_behind(surely, line):  # type: ignore[no-untyped-def]
    """Set to NaN the disparities whose column is ``surely`` (W,) shown as something nearer on either side, too."""
    last = np.float32(line.size - BESIDE_PX)
    for x in range(line.size):
        column = np.floor(np.float32(np.int32(x)) - line[x] + np.float32(0.5))
        inside = (column >= np.float32(BESIDE_PX)) & (column < last)
        at = np.int32(column - np.float32(BESIDE_PX) if inside else np.float32(0.0))
        nearest = surely[np.uint32(at)]
        line[x] = np.float32(np.nan) if inside & (nearest > line[x] + NEARER_PX) else line[x]
