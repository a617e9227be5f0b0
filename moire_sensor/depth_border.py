"""Borders of surfaces: which of the surfaces around it a pixel beside a depth jump, a shadow or a hole belongs to.

Windows that straddle an edge see two surfaces. Pixels further from any edge than the window's doubtful rim are trusted;
the others are offered the planes of the trusted pixels left, right, above and below, and the surfaces of known runs
beside them, and take the one whose grey levels fit in a window of a few pixels, if the right camera can see it there
and the projector lights it so.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import BARE, NAN_SAFE, ROW
from moire_sensor.depth_around import SIDES, dimmest, last_of, neighbour, next_of
from moire_sensor.depth_narrow import NO_RUN, has_narrow_run, run_offered
from moire_sensor.depth_offer import fits, plane_offered, taken
from moire_sensor.depth_refine import Match
from moire_sensor.depth_runs import TASKS, list_marked, marks_for
from moire_sensor.depth_trust import JUMP_PX, Trust
from moire_sensor.depth_window import LANES, small_difference
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import Light
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

# What the first round gives to a surface lets the second trust its neighbours.
ROUNDS = 2
# Planes are offered from all sides, runs from left and right.
OFFERS = SIDES + 2
NOTHING = (np.float32(np.nan), np.float32(0.0), np.float32(0.0))
# A pixel leaves its surface only for one that fits better by this share of the amplitude.
BETTER_SHARE = np.float32(0.03)
# No surface is believed to fit better than with this share of the noise.
LEAST_NOISE = np.float32(0.5)


def extend(
    match: Match,
    greys: tuple[Float32, Float32],
    light: Light,
    projector: ProjectorMap,
    rad_per_px: float,
    settings: Settings,
    row_step: int,
) -> None:
    """Give the pixels beside edges to the surface they show, or to none, in place.

    Parameters
    ----------
    match : disparities, NaN where unknown. Pixels given to another surface get the sigma of their row's match and, as
        mismatch, the difference of grey levels in fringe amplitudes; their signed mismatch is NaN.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    light : amplitude and background of the left view, which tell how bright a surface is.
    rad_per_px : how fast the left phase runs along a row, without its sign.
    row_step : one row in so many was solved. About as far apart, rows are looked at whole.
    """
    room = Trust.of(match.disparity_px.shape)
    limits = np.array([rad_per_px, settings.image_noise, settings.max_border_misfit], dtype=np.float32)
    first_rows = 1 << (row_step.bit_length() - 1)
    for _ in range(ROUNDS):
        room.look(match.disparity_px)
        assign(
            first_rows, room.trust, room.near, room.disparity, room.above, room.below, room.claim, *greys,
            light.background, light.amplitude, projector.packed(), limits, *match.images(),
        )  # fmt: skip


@njit(forceinline=True, **BARE)
def offer_of(disparity, above, below, y, x, number, before, after, alone, narrow):  # type: ignore[no-untyped-def]
    """Pixel (-1, -1: none) that makes one of the ``OFFERS``, and the disparity and slopes that it offers to (y, x)."""
    if number < SIDES:
        y0, x0 = neighbour(above, below, y, x, number, before, after)
        return (y0, x0, plane_offered(disparity, y, x, y0, x0)) if y0 >= 0 else (-1, -1, NOTHING)
    step, trusted = (-1, before) if number == SIDES else (1, after)
    x0, offered, along = run_offered(disparity, y, x, step, trusted, alone, narrow)
    return (y, x0, (offered, along, np.float32(0.0))) if x0 != NO_RUN else (-1, -1, NOTHING)


@njit(forceinline=True, **BARE)
def allowed(limits, bright):  # type: ignore[no-untyped-def]
    """Largest difference in amplitudes that is believed."""
    return np.float32(2.0) * limits[1] / bright + limits[2]


@njit(forceinline=True, **BARE)
def best_offer(  # type: ignore[no-untyped-def]
    disparity, above, below, claim, y, x, before, after, left, right, background, amplitude, map_, limits, own, sums,
    narrow,
):
    """Of the surfaces offered, the one that fits best: difference (inf: none), disparity, variance, amplitude.

    Those that are not allowed, or not better than ``own`` grey levels, are refused, but for none if ``own`` is NaN.
    """
    best, chosen = np.float32(np.inf), np.float32(np.nan)
    variance, bright = np.float32(0.0), max(amplitude[y, x], np.float32(1.0))
    here = disparity[np.uint64(y), np.uint64(x)]
    for number in range(OFFERS):
        alone = best == np.float32(np.inf)
        y0, x0, offer = offer_of(disparity, above, below, y, x, number, before, after, alone, narrow)
        if y0 < 0 or abs(offer[0] - here) < JUMP_PX:
            continue
        shine, dark = amplitude[np.uint64(y0), np.uint64(x0)], background[np.uint64(y0), np.uint64(x0)]
        limit = best
        if not np.isnan(own):
            limit = min(limit, allowed(limits, shine), own / shine - BETTER_SHARE)
        moved, difference, doubt = fits(offer, y, x, x0, shine, dark, left, right, map_, claim, limits, limit, sums)
        if difference < best:
            best, chosen, variance, bright = difference, moved, doubt, shine
    return best, chosen, variance, bright


@njit(forceinline=True, **BARE)
def own_difference(left, right, claim, y, x, here, largest, sums):  # type: ignore[no-untyped-def]
    """Difference in grey levels of a pixel where it is, infinite where unknown or another surface is seen there."""
    if np.isnan(here) or taken(claim, y, x, here):
        return np.float32(np.inf)
    return small_difference(left, right, y, x, here, np.float32(0.0), np.float32(0.0), largest, sums)


@njit(forceinline=True, **BARE)
def judge(  # type: ignore[no-untyped-def]
    disparity, above, below, claim, y, x, before, after, left, right, background, amplitude, map_, limits, sums, narrow,
    new_disparity, new_sigma, new_signed, new_mismatch,
):  # fmt: skip
    """Let a pixel keep, change or lose its surface.

    One that fits better than any other can, or as well as noise lets any, whichever gives the scale, is left alone.
    Only where an offer decides by its amplitude whether the pixel is lost must the best of the bad ones be known.
    """
    here, endless = disparity[y, x], np.float32(np.inf)
    own = own_difference(left, right, claim, y, x, here, endless, sums)
    unknown, judged, bearable = own == endless, own, endless
    if not unknown:
        dim = dimmest(amplitude, above, below, y, x, before, after)
        bearable = allowed(limits, dim) * dim
        if own <= min(bearable, BETTER_SHARE * dim + LEAST_NOISE * limits[1]):
            return
        judged = own if own <= bearable else np.float32(np.nan)
    best, chosen, variance, bright = best_offer(
        disparity, above, below, claim, y, x, before, after, left, right, background, amplitude, map_, limits, judged,
        sums, narrow,
    )  # fmt: skip
    if not unknown and (best < endless or own > bearable):
        own = own_difference(left, right, claim, y, x, here, bright, sums)
    own /= bright
    if best < allowed(limits, bright) and best < own - BETTER_SHARE:
        new_disparity[y, x], new_sigma[y, x] = chosen, np.sqrt(variance)
        new_signed[y, x], new_mismatch[y, x] = np.float32(np.nan), best
    elif own > allowed(limits, bright):
        new_disparity[y, x] = np.float32(np.nan)


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def assign(  # type: ignore[no-untyped-def]
    first_rows, trust, near, disparity, above, below, claim, left, right, background, amplitude, map_, limits,
    new_disparity, new_sigma, new_signed, new_mismatch,
):  # fmt: skip
    """Write the new images (H, W; as Match) where a pixel nearby that is not trusted changes or loses its surface.

    One row in ``first_rows``, a power of two, first, then the one in the middle between two, and so on; of those only
    pixels that are not like both rows beside them then are.
    """
    height, width = trust.shape
    away = first_rows
    while away > 0:
        # Of the first rows all; later those between.
        first, step = (0, away) if away == first_rows else (away, 2 * away)
        for task in prange(TASKS):
            marks, places = marks_for(width), np.empty(width, dtype=np.int64)
            sums = np.empty(LANES, dtype=np.float32)
            for y in range(first + step * np.int64(task), height, step * TASKS):
                mark_doubtful(trust[y], near[y], disparity[y], marks)
                if away < first_rows and y + away < height:
                    unmark_between(disparity[y], new_disparity[y - away], new_disparity[y + away], marks)
                judge_row(
                    places[: list_marked(marks, places)], trust[y], disparity, above, below, claim, y, left, right,
                    background, amplitude, map_, limits, sums, new_disparity, new_sigma, new_signed, new_mismatch,
                )  # fmt: skip
        away //= 2


@njit(**BARE)
def judge_row(  # type: ignore[no-untyped-def]
    places, trust, disparity, above, below, claim, y, left, right, background, amplitude, map_, limits, sums,
    new_disparity, new_sigma, new_signed, new_mismatch,
):  # fmt: skip
    """Judge some pixels of a row, in order."""
    width = trust.size
    start, end, narrow = 0, -1, False
    for x in places:
        if x >= end:
            start, end = last_of(trust, x) + 1, next_of(trust, x)
            narrow = has_narrow_run(disparity, y, start, end)
        judge(
            disparity, above, below, claim, y, x, start - 1, end if end < width else -1, left, right, background,
            amplitude, map_, limits, sums, narrow, new_disparity, new_sigma, new_signed, new_mismatch,
        )  # fmt: skip


@njit(**ROW)
def mark_doubtful(trust, near, disparity, marks):  # type: ignore[no-untyped-def]
    """Mark the pixels of a row that are not trusted and near enough to one that is."""
    for x in range(disparity.size):
        unknown = disparity[x] != disparity[x]
        marks[x] = (trust[x] == 0) & ((near[x] > 1) | ((near[x] == 1) & unknown))


@njit(**ROW)
def unmark_between(disparity, before, after, marks):  # type: ignore[no-untyped-def]
    """Take the marks from pixels that lie on the surface which the row ``before`` and the one ``after`` show.

    And from unknown ones where both show nothing.
    """
    for x in range(disparity.size):
        alike = (abs(disparity[x] - before[x]) <= JUMP_PX) & (abs(disparity[x] - after[x]) <= JUMP_PX)
        alike |= (disparity[x] != disparity[x]) & (before[x] != before[x]) & (after[x] != after[x])
        marks[x] = marks[x] & (not alike)
