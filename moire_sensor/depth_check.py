"""Rejection of disparities that use a right pixel twice."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import BARE, ROW, UNCOUNTED
from moire_sensor.depth_runs import TASKS, list_marked, marks_for
from moire_sensor.depth_specks import SAME_SURFACE_PX
from moire_sensor.phase_carrier import Float32
from moire_sensor.right_view import REACH_PX, difference

MISMATCH_WEIGHT = np.float32(0.5)


def drop_rivals(
    disparity_px: Float32,
    mismatch_rad: Float32,
    amplitude: Float32,
    images: tuple[Float32, Float32],
    rows: npt.NDArray[np.int64],
) -> None:
    """Set in place to NaN the disparities whose right pixel a better match of another surface claims.

    Disparities, mismatches and amplitudes (n, W) are those of some ``rows`` (n,) of the images (H, W).
    """
    keep_unique(disparity_px, mismatch_rad, amplitude, *images, rows)


@njit(parallel=True, cache=True)
def keep_unique(disparity, mismatch, amplitude, left, right, rows):  # type: ignore[no-untyped-def]
    """Of the left pixels that claim one right pixel from different surfaces only the one that looks like it stays."""
    height, width = disparity.shape
    for task in prange(TASKS):
        # The last place is for what the right image does not show.
        whole, parts = np.empty((4, width + 1), dtype=np.int32), np.empty((2, width + 1), dtype=np.float32)
        column, winner, places, others, claim, misfit = whole[0], whole[1], whole[2], whole[3], parts[0], parts[1]
        marks = marks_for(width)
        for y in range(np.int64(task), height, TASKS):
            fill_columns(disparity[y], column)
            # From the right, so that the first claim holds.
            for x in range(width - 1, -1, -1):
                claim[np.uint32(column[x])] = disparity[y, x]
            mark_others(disparity[y], column, claim, marks)
            count = list_marked(marks, others)
            if count > 0:
                count = list_shared(others[:count], disparity[y], column, claim, winner, places)
                fill_misfits(places[:count], disparity[y], mismatch[y], amplitude[y], left, right, rows[y], misfit)
                clear_beaten(places[:count], misfit, column, winner, disparity[y])


@njit(**ROW)
def fill_columns(disparity, column):  # type: ignore[no-untyped-def]
    """Fill the right columns that the pixels of a row claim, W where there is none; these become NaN."""
    width = np.float32(disparity.size)
    for x in range(disparity.size):
        at = np.floor(np.float32(np.int32(x)) - disparity[x] + np.float32(0.5))
        seen = (at >= np.float32(0.0)) & (at < width)
        column[x] = np.int32(at if seen else width)
        disparity[x] = disparity[x] if seen else np.float32(np.nan)


@njit(**ROW)
def mark_others(disparity, column, claim, marks):  # type: ignore[no-untyped-def]
    """Mark the pixels whose column a surface other than theirs claimed first."""
    for x in range(disparity.size):
        marks[x] = abs(claim[np.uint32(column[x])] - disparity[x]) > SAME_SURFACE_PX


@njit(**BARE)
def list_shared(others, disparity, column, claim, winner, places):  # type: ignore[no-untyped-def]
    """List the pixels of columns that several surfaces claim; return how many.

    ``others`` are those that did not claim first. The ``winner`` (W + 1,) of a column is -1, nobody yet, and -2 where
    only one surface claims it.
    """
    count, first = 0, disparity.size
    for x in range(winner.size):
        winner[x] = -2
    for number in range(others.size):
        at = np.uint32(column[np.uint32(others[number])])
        winner[at] = -1
        first = min(first, int(np.float32(at) + claim[at]))
    # Columns are rounded.
    for x in range(max(first - 1, 0), others[others.size - 1] + 1):
        places[np.uint32(count)] = x
        count += winner[np.uint32(column[x])] == -1
    return count


@njit(**BARE)
def clear_beaten(places, misfit, column, winner, disparity):  # type: ignore[no-untyped-def]
    """Set to NaN the listed pixels that do not lie on the surface of their column's winner."""
    for number in range(places.size):
        at, here = np.uint32(column[np.uint32(places[number])]), disparity[np.uint32(places[number])]
        held = winner[at]
        if held < 0 or (abs(disparity[places[held]] - here) > SAME_SURFACE_PX and misfit[number] < misfit[held]):
            winner[at] = number
    for number in range(places.size):
        x = np.uint32(places[number])
        # That of the winner stays.
        if abs(disparity[places[winner[np.uint32(column[x])]]] - disparity[x]) > SAME_SURFACE_PX:
            disparity[x] = np.float32(np.nan)


@njit(**UNCOUNTED)
def fill_misfits(places, disparity, mismatch, amplitude, left, right, y, misfit):  # type: ignore[no-untyped-def]
    """Fill how badly the listed matches fit: grey levels over three rows, in fringe amplitudes, and phases."""
    first, last = max(y - 1, 0), min(y + 1, left.shape[0] - 1)
    for number in range(places.size):
        x = np.int64(places[number])
        column, total = x - disparity[x], np.float32(0.0)
        base = np.int64(np.floor(column))
        inside = min(x, base) >= REACH_PX and max(x, base + 1) + REACH_PX < disparity.size
        for row in range(first, last + 1):
            if inside:
                total += difference_inside(left[row], right[row], x, base, np.float32(column - base))
            else:
                total += difference(left, right, row, x, column, REACH_PX)
        grey = total / np.float32(last - first + 1) / max(amplitude[x], np.float32(1.0))
        misfit[number] = grey + MISMATCH_WEIGHT * mismatch[x]


@njit(forceinline=True, **UNCOUNTED)
def difference_inside(left, right, x, base, part):  # type: ignore[no-untyped-def]
    """As :func:`moire_sensor.right_view.difference`, about column ``base + part``, where no pixel lies outside."""
    total = np.float32(0.0)
    for step in range(REACH_PX + 1):
        shift = np.int64(2 * step - REACH_PX)
        at = np.uint64(base + shift)
        seen = right[at] + part * (right[np.uint64(base + shift + 1)] - right[at])
        total += abs(left[np.uint64(x + shift)] - seen)
    return total / np.float32(REACH_PX + 1)
