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
from moire_sensor.depth_narrow import STEP_PX
from moire_sensor.depth_refine import Match
from moire_sensor.depth_seek_chain import (
    APART,
    HIGHEST,
    LIGHT,
    LOWEST,
    SAME_PX,
    VIEWS_SHARE,
    chained,
    chosen,
    weight_of,
)
from moire_sensor.depth_seek_fit import HALF_PX, PIECE_PX, ZERO, fill_differences, least_between
from moire_sensor.depth_seek_row import fill_claims, fill_left_over, fill_mean, fill_sides, fill_sure, is_bright, lower
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings
from moire_sensor.shot import Status

# One row in so many is looked at, as the mean of so many, and one right column in so many.
ROWS_PX, MEAN_PX, COLUMNS_PX = 8, 7, 1
# Of the two rows looked at above and the two below so many must show the same.
LOOK_ROWS, LEAST_ROWS = 2, 2
# Most disparities kept of a row, by its columns.
KEPT = 4
# A thing that stands alone is wider than the middles of the pieces that fit it, by so much on either side; it is not
# alone where its surface is known so near.
OUTWARD_PX, ALONE_PX = 3, 16
# What counts as lit is brighter than this share of what fringes are at most; sigmas of noise that views may differ by;
# the brightest grey level.
LIT_SHARE, NOISE_SIGMAS, BRIGHTEST = 0.35, 2.5, 255.0
# One pixel in so many, along either direction, tells what the fringes are like; at least so many must be lit.
SAMPLE_PX, LEAST_SAMPLES = 7, 100
# How well a disparity found so is known.
SIGMA_PX, MISMATCH_RAD = np.float32(0.15), np.float32(0.2)


def seek(
    match: Match,
    greys: tuple[Float32, Float32],
    phase: PhaseImage,
    projector: ProjectorMap,
    orders: OrderRange,
    half_width_px: int,
    settings: Settings,
) -> None:
    """Write the disparities of what is found into the match, in place.

    Parameters
    ----------
    match : disparities, NaN where unknown.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    phase : the left phase, whose amplitude and background tell what lit surfaces look like.
    half_width_px : half of a fringe. Of fringes wider than about two pieces a piece says too little.
    """
    height, width = match.disparity_px.shape
    limits = limits_of(phase, orders, settings)
    if height < MEAN_PX + ROWS_PX or half_width_px > PIECE_PX + 1 or limits is None:
        return
    found = np.empty(((height - MEAN_PX) // ROWS_PX + 1, width), dtype=np.float32)
    if seek_rows(match.disparity_px, *greys, projector.packed(), limits, 2 * half_width_px + 1, found):
        write(found, *match.images())


def limits_of(phase: PhaseImage, orders: OrderRange, settings: Settings) -> Float32 | None:
    """Limits as in :mod:`depth_seek_chain`, None in an image without light."""
    every = np.s_[::SAMPLE_PX, ::SAMPLE_PX]
    lit = phase.status[every] == Status.OK
    if np.count_nonzero(lit) < LEAST_SAMPLES:
        return None
    amplitude, background = phase.amplitude[every][lit], phase.background[every][lit]
    share, light = float(np.median(amplitude / background)), float(np.median(amplitude + background))
    noise = NOISE_SIGMAS * np.sqrt(2.0 / MEAN_PX) * settings.image_noise
    apart = PIECE_PX * (noise + VIEWS_SHARE * share * BRIGHTEST) ** 2
    lowest, highest = np.floor(orders.min_disparity_px), np.ceil(orders.max_disparity_px)
    return np.array([lowest, highest, share, LIT_SHARE * light, noise, apart], dtype=np.float32)


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def seek_rows(disparity, left, right, map_, limits, least_px, found):  # type: ignore[no-untyped-def]
    """Fill ``found`` (n, W) with the disparities of the rows looked at, NaN where nothing is; return how many."""
    width, count = disparity.shape[1], np.int64(0)
    for number in prange(found.shape[0]):
        first = np.int64(number) * ROWS_PX
        y, line = first + MEAN_PX // 2, found[number]
        line[:] = np.float32(np.nan)
        room, places = np.empty((9, width), dtype=np.float32), np.empty(width, dtype=np.int64)
        sure, claims = room[2], room[5]
        fill_sure(disparity[y], least_px, sure)
        fill_claims(sure, claims)
        fill_sides(claims, room[6], room[7])
        over = fill_left_over(sure, claims, room[6], room[7], COLUMNS_PX, places)
        if over == 0:
            continue
        fill_mean(left, first, first + MEAN_PX, room[0])
        fill_mean(right, first, first + MEAN_PX, room[1])
        fill_sides(sure, room[3], room[4])
        rows = room[0], room[1], sure, room[3], room[4], room[6], room[7]
        seen = seek_row(rows, places[:over], map_, limits, least_px, y, room[8], line)
        if seen > 0:
            close_holes(line)
            reach_out(line, rows, room[8])
        count += seen
    return count


@njit(fastmath=NAN_SAFE, error_model="numpy")
def seek_row(rows, places, map_, limits, least_px, y, best, line):  # type: ignore[no-untyped-def]
    """Write into a row the disparities of the chains through right columns ``places``; return how many.

    ``best`` (W,) is memory for the weights of those written.
    """
    left, right, before, after = rows[0], rows[1], rows[5], rows[6]
    width = left.size
    disparities, chain_of = np.empty(KEPT * width, dtype=np.float32), np.empty(KEPT * width, dtype=np.int64)
    chains, begins = np.empty((3, KEPT * width), dtype=np.float32), np.empty(places.size + 1, dtype=np.int64)
    apart = np.empty(int(limits[HIGHEST] - limits[LOWEST]) + 3, dtype=np.float32)
    marked = np.empty(apart.size, dtype=np.uint8)
    count, chain_count = 0, 0
    for number in range(places.size):
        column = places[number]
        begins[number] = count
        goes_on = number > 0 and column - places[number - 1] == COLUMNS_PX
        begin, end = (begins[number - 1] if goes_on else count), count
        if not is_bright(right, column, least_px // 2, limits[LIGHT]):
            continue
        far = lower(before[column], after[column])
        lowest = int(limits[LOWEST] if np.isnan(far) else max(limits[LOWEST], far - STEP_PX))
        lowest = max(lowest, HALF_PX - column)
        size = min(int(limits[HIGHEST]) - lowest + 1, width - HALF_PX - column - lowest)
        if size < 3:
            continue
        start = column + lowest - HALF_PX
        fill_differences(
            left[start : start + size + PIECE_PX - 1], right[column - HALF_PX : column + HALF_PX + 1], apart[:size],
            marked[:size],
        )  # fmt: skip
        for i in range(1, size - 1):
            if not marked[i]:
                continue
            aside, least = least_between(apart, i)
            if least > limits[APART] or count == disparities.size:
                continue
            disparity = np.float32(lowest + i) + aside
            weight, wall = weight_of(rows, map_, limits, y, column, column + lowest + i, disparity)
            if weight > ZERO:
                chain = chained(disparity, weight, wall, begin, end, disparities, chain_of, chains, chain_count)
                chain_count += chain == chain_count
                disparities[count], chain_of[count] = disparity, chain
                count += 1
    begins[places.size] = count
    return keep_chosen(places, begins, disparities, chain_of, chains, best, line)


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


@njit(**BARE)
def close_holes(line):  # type: ignore[no-untyped-def]
    """Fill straight the holes of up to ``COLUMNS_PX`` pixels of a row between those of one surface."""
    last = -1
    for x in range(line.size):
        if np.isnan(line[x]):
            continue
        if last >= 0 and 1 < x - last <= COLUMNS_PX + 1 and abs(line[x] - line[last]) < SAME_PX:
            for at in range(last + 1, x):
                line[at] = line[last] + (line[x] - line[last]) * np.float32(at - last) / np.float32(x - last)
        last = x


@njit(**BARE)
def reach_out(line, rows, before):  # type: ignore[no-untyped-def]
    """Widen what stands alone before the wall by ``OUTWARD_PX`` on either side; ``before`` (W,) is memory."""
    sure, wall_before, wall_after = rows[2], rows[3], rows[4]
    width = line.size
    for x in range(width):
        before[x] = line[x]
    for x in range(width):
        if not np.isnan(line[x]):
            continue
        value = np.float32(np.nan)
        for away in range(1, OUTWARD_PX + 1):
            for at in (x - away, x + away):
                if np.isnan(value) and 0 <= at < width:
                    value = before[at]
        alone = lower(wall_before[x], wall_after[x]) < value - STEP_PX
        for at in range(max(x - ALONE_PX, 0), min(x + ALONE_PX + 1, width) if alone else 0):
            alone &= not abs(sure[at] - value) < STEP_PX
        if alone:
            line[x] = value


@njit(**BARE)
def goes_on(found, number, x):  # type: ignore[no-untyped-def]
    """Whether enough of the rows looked at nearby show the same at a column or beside it."""
    rows = 0
    for other in range(max(number - LOOK_ROWS, 0), min(number + LOOK_ROWS + 1, found.shape[0])):
        same = False
        for at in range(max(x - 1, 0), min(x + 2, found.shape[1])):
            same |= abs(found[other, at] - found[number, x]) < SAME_PX
        rows += same and other != number
    return rows >= LEAST_ROWS


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def write(found, disparity, sigma, signed, mismatch):  # type: ignore[no-untyped-def]
    """Write what two neighbouring rows looked at have in common into the rows between, and beyond the outermost."""
    height, last = disparity.shape[0], found.shape[0] - 2
    for number in prange(found.shape[0] - 1):
        upper, lower_ = found[number], found[number + 1]
        first = np.int64(number) * ROWS_PX + MEAN_PX // 2
        begin, end = (0 if number == 0 else first), (height if number == last else first + ROWS_PX)
        for x in range(upper.size):
            step = lower_[x] - upper[x]
            if not abs(step) < SAME_PX or not goes_on(found, number, x) or not goes_on(found, number + 1, x):
                continue
            for y in range(begin, end):
                part = min(max(np.float32(y - first) / np.float32(ROWS_PX), ZERO), np.float32(1.0))
                value = upper[x] + part * step
                if not abs(disparity[y, x] - value) < SAME_PX:
                    disparity[y, x], sigma[y, x] = value, SIGMA_PX
                    signed[y, x], mismatch[y, x] = np.float32(np.nan), MISMATCH_RAD
