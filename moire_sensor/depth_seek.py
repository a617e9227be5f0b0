"""Narrow things that the windows of a fringe's width have lost or taken for the wall behind, found again.

From the right view: pixels that nobody explains (:mod:`depth_seek_row`) are compared with the left view at every
disparity, half a fringe at a time (:mod:`depth_seek_fit`), and those that fit are chained along the row
(:mod:`depth_seek_chain`). Only one row in a few is looked at, as the mean of those around it: what is found must go on
from one to the next.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import BARE, NAN_SAFE
from moire_sensor.depth_claims import claim_nearest
from moire_sensor.depth_narrow import STEP_PX
from moire_sensor.depth_refine import Match
from moire_sensor.depth_runs import TASKS, WORD, list_marked, marks_for
from moire_sensor.depth_seek_chain import (
    APART,
    HIGHEST,
    LIGHT,
    LOWEST,
    chained,
    chosen,
    weight_of,
)
from moire_sensor.depth_seek_fit import HALF_PX, PIECE_PX, ZERO, fill_differences, least_between
from moire_sensor.depth_seek_light import are_cosines, limits_of
from moire_sensor.depth_seek_row import fill_left_over, fill_mean, fill_sides, fill_sure, is_bright, lower
from moire_sensor.depth_seek_spread import MEAN_PX, ROWS_PX, close_holes, reach_out, write
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import Light
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

# Most disparities kept of a row, by its columns; fewest that a least one can be found among.
KEPT, LEAST_SIZE = 4, 3


def seek(
    match: Match,
    greys: tuple[Float32, Float32],
    light: Light,
    projector: ProjectorMap,
    orders: OrderRange,
    half_width_px: int,
    settings: Settings,
) -> bool:
    """Write the disparities of what is found into the match, in place; return whether anything was found in a row.

    Parameters
    ----------
    match : disparities, NaN where unknown.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    light : of the left camera, whose amplitude and background tell what lit surfaces look like.
    half_width_px : half of a fringe. Of fringes wider than about two pieces a piece says too little, and nothing is
        sought; nor where what is known does not show the fringes that were projected.
    """
    height, width = match.disparity_px.shape
    limits = limits_of(light, orders, settings)
    if height < MEAN_PX + ROWS_PX or half_width_px > PIECE_PX + 1 or limits is None:
        return False
    if not are_cosines(match.disparity_px, greys, projector, limits):
        return False
    found = np.empty(((height - MEAN_PX) // ROWS_PX + 1, width), dtype=np.float32)
    seek_rows(match.disparity_px, *greys, projector.packed(), limits, 2 * half_width_px + 1, found)
    write(found, *match.images())
    return bool(np.isfinite(found).any())


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def seek_rows(disparity, left, right, map_, limits, least_px, found):  # type: ignore[no-untyped-def]
    """Fill ``found`` (n, W) with the disparities of the rows looked at, NaN where nothing is."""
    width = disparity.shape[1]
    for task in prange(TASKS):
        room, places = np.empty((9, width), dtype=np.float32), np.empty(width, dtype=np.int64)
        sure, claims = room[2], room[5]
        for number in range(np.int64(task), found.shape[0], TASKS):
            first = number * ROWS_PX
            y, line = first + MEAN_PX // 2, found[number]
            line[:] = np.float32(np.nan)
            fill_sure(disparity[y], least_px, sure)
            claims[:] = np.float32(np.nan)
            claim_nearest(sure, claims)
            fill_sides(claims, room[6], room[7])
            over = fill_left_over(sure, claims, room[6], room[7], places)
            if over == 0:
                continue
            fill_mean(left, first, first + MEAN_PX, room[0])
            fill_mean(right, first, first + MEAN_PX, room[1])
            fill_sides(sure, room[3], room[4])
            rows = room[0], room[1], sure, room[3], room[4], room[6], room[7]
            if seek_row(rows, places[:over], map_, limits, least_px, y, room[8], line) > 0:
                close_holes(line)
                reach_out(line, rows, room[8])


@njit(fastmath=NAN_SAFE, error_model="numpy")
def seek_row(rows, places, map_, limits, least_px, y, best, line):  # type: ignore[no-untyped-def]
    """Write into a row the disparities of the chains through right columns ``places``; return how many.

    ``best`` (W,) is memory for the weights of those written.
    """
    most = KEPT * line.size
    disparities, chain_of = np.empty(most, dtype=np.float32), np.empty(most, dtype=np.int64)
    chains, begins = np.empty((3, most), dtype=np.float32), np.empty(places.size + 1, dtype=np.int64)
    reach = int(limits[HIGHEST] - limits[LOWEST]) + 3
    apart, lows = np.empty(reach, dtype=np.float32), np.empty(reach, dtype=np.int64)
    marks = marks_for(reach + WORD)
    count, chain_count = 0, 0
    for number in range(places.size):
        column = places[number]
        begins[number] = count
        beside = number > 0 and column - places[number - 1] == 1
        begin, end = (begins[number - 1] if beside else count), count
        lowest, size = compare(rows, column, limits, least_px, apart, marks)
        low_count = list_marked(marks[: size // WORD * WORD + WORD], lows) if size > 0 else 0
        for i in lows[:low_count]:
            if count == most:
                break
            disparity = np.float32(lowest + i) + least_between(apart, i)
            weight, wall = weight_of(rows, map_, limits, y, column, column + lowest + i, disparity)
            if weight > ZERO:
                chain = chained(disparity, weight, wall, begin, end, disparities, chain_of, chains, chain_count)
                chain_count += chain == chain_count
                disparities[count], chain_of[count] = disparity, chain
                count += 1
    begins[places.size] = count
    return keep_chosen(places, begins, disparities, chain_of, chains, best, line)


@njit(**BARE)
def compare(rows, column, limits, least_px, apart, marks):  # type: ignore[no-untyped-def]
    """Compare a lit right pixel with the left view at all disparities of the range that are not behind the wall.

    Returns
    -------
    The first disparity and how many there are, 0 for none; ``apart`` and ``marks`` hold their differences and where
    these are least, and small enough. Marks beyond them are zero for a word.
    """
    left, right = rows[0], rows[1]
    if not is_bright(right, column, least_px // 2, limits[LIGHT]):
        return 0, 0
    far = lower(rows[5][column], rows[6][column])
    lowest = int(limits[LOWEST] if np.isnan(far) else max(limits[LOWEST], far - STEP_PX))
    lowest = max(lowest, HALF_PX - column)
    size = min(int(limits[HIGHEST]) - lowest + 1, left.size - HALF_PX - column - lowest)
    if size < LEAST_SIZE:
        return 0, 0
    start = column + lowest - HALF_PX
    fill_differences(
        left[start : start + size + PIECE_PX - 1], right[column - HALF_PX : column + HALF_PX + 1], limits[APART],
        apart[:size], marks[:size],
    )  # fmt: skip
    for beyond in range(size, size + WORD):
        marks[beyond] = 0
    return lowest, size


@njit(**BARE)
def keep_chosen(places, begins, disparities, chain_of, chains, best, line):  # type: ignore[no-untyped-def]
    """Write the disparities of right columns that are beyond doubt, the best of those that meet; return how many."""
    seen = 0
    for x in range(line.size):
        best[x] = ZERO
    for number in range(places.size):
        if begins[number] == begins[number + 1]:
            continue
        k = chosen(disparities, chain_of, begins[number], begins[number + 1], chains)
        if k < 0:
            continue
        x = int(np.floor(np.float32(places[number]) + disparities[k] + np.float32(0.5)))
        weight = chains[0, chain_of[k]]
        if weight > best[x]:
            line[x], best[x] = disparities[k], weight
            seen += 1
    return seen
