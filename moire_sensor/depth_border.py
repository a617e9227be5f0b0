"""Borders of surfaces: which of the surfaces around it a pixel beside a depth jump, a shadow or a hole belongs to.

Windows that straddle an edge see two surfaces. Pixels further from any edge than the window's doubtful rim are trusted;
the others are offered the planes of the trusted pixels left, right, above and below, and take the one whose grey levels
fit in a window of a few pixels, if the right camera can see it there and the projector lights it so.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE, wrap
from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap, phase_of_disparity
from moire_sensor.settings import Settings

# Trusted pixels have no jump and no hole within so many pixels.
RIM_PX = 3
JUMP_PX = np.float32(1.0)
# What the first round gives to a surface lets the second trust its neighbours.
ROUNDS = 2
# Only pixels so near to a trusted one are looked at; along the row a plane is carried further, across a shadow.
REACH_PX, ROW_REACH_PX = 14, 48
SAME_SURFACE_PX = np.float32(1.5)
# A small window counts from so many of its fifteen pixels on.
LEAST_SEEN = 8
NO_CLAIM = np.float32(-1e9)
# The row beside the pixel must carry fringes of this share of the power of the plane's own.
LEAST_POWER = np.float32(0.2)
ROW_SPAN_PX = 10
# A plane is moved by what the row says if that is more than noise, and given up beyond the largest move.
MOVE_PX, LARGEST_MOVE_PX = np.float32(0.3), np.float32(0.8)
# Light that the plane promises may be missing by this share of the fringe amplitude; a shadow lacks more.
DIM_SHARE = np.float32(0.7)
GLARE_SHARE = np.float32(0.4)
# A pixel leaves its surface only for one that fits better by this share of the amplitude.
BETTER_SHARE = np.float32(0.03)


def extend(
    match: Match, greys: tuple[Float32, Float32], phase: PhaseImage, projector: ProjectorMap, settings: Settings
) -> Match:
    """Give the pixels beside edges to the surface they show, or to none.

    Parameters
    ----------
    match : disparities, NaN where unknown.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    phase : the left phase, whose amplitude and background tell how bright a surface is.

    Returns
    -------
    Match
        Pixels given to another surface have the sigma of their row's match and, as mismatch, the difference of grey
        levels in fringe amplitudes; their signed mismatch is NaN.
    """
    trust = trusted(match.disparity_px)
    fresh = trust
    for _ in range(ROUNDS):
        result = Match(*(image.copy() for image in match.images()))
        assign(
            match.disparity_px, trust, near(fresh), claims(match.disparity_px, trust), *greys, phase.background,
            phase.amplitude, projector.packed(), np.float32(settings.image_noise),
            np.float32(settings.max_border_misfit), *result.images(),
        )  # fmt: skip
        match, before = result, trust
        trust = trusted(match.disparity_px)
        fresh = trust & ~before
    return match


def near(trust: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) within ``REACH_PX`` of a trusted one in both directions."""
    reach = np.ones((2 * REACH_PX + 1, 2 * REACH_PX + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate(trust.view(np.uint8), reach)).view(np.bool_)


def trusted(disparity_px: Float32) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) with a disparity and neither jump nor hole within ``RIM_PX``."""
    jumps = np.empty(disparity_px.shape, dtype=np.uint8)
    mark_jumps(disparity_px, jumps)
    rim = np.ones((2 * RIM_PX + 1, 2 * RIM_PX + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate(jumps, rim) == 0)


def claims(disparity_px: Float32, trust: npt.NDArray[np.bool_]) -> Float32:
    """Disparity of the nearest trusted surface that each right pixel shows, (H, W), ``NO_CLAIM`` where none."""
    claim = np.empty(disparity_px.shape, dtype=np.float32)
    fill_claims(disparity_px, trust, claim)
    return claim


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def mark_jumps(disparity, jumps):  # type: ignore[no-untyped-def]
    """Fill ``jumps`` (H, W): 1 where a pixel or its right or lower neighbour is unknown or lies on another surface."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        below = disparity[min(y + 1, height - 1)]
        for x in range(width - 1):
            here = disparity[y, x]
            near = abs(disparity[y, x + 1] - here) <= JUMP_PX and abs(below[x] - here) <= JUMP_PX
            jumps[y, x] = 0 if near else 1
        jumps[y, width - 1] = 0 if abs(below[width - 1] - disparity[y, width - 1]) <= JUMP_PX else 1


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def fill_claims(disparity, trust, claim):  # type: ignore[no-untyped-def]
    """Fill ``claim`` (H, W): trusted pixels claim the two right pixels they fall between."""
    height, width = disparity.shape
    for y in prange(height):
        claim[y, :] = NO_CLAIM
        for x in range(width):
            if trust[y, x]:
                left = int(np.floor(np.float32(x) - disparity[y, x]))
                for column in (left, left + 1):
                    if 0 <= column < width and claim[y, column] < disparity[y, x]:
                        claim[y, column] = disparity[y, x]


@njit(inline="always", fastmath=False)
def taken(claim, y, x, disparity):  # type: ignore[no-untyped-def]
    """Whether the right pixel lies outside the image or shows another surface."""
    column = int(np.floor(np.float32(x) - disparity + np.float32(0.5)))
    if column < 0 or column >= claim.shape[1]:
        return True
    return claim[y, column] > NO_CLAIM and abs(claim[y, column] - disparity) > SAME_SURFACE_PX


@njit(inline="always", fastmath=False)
def small_difference(left, right, y, x, disparity, along, across, largest):  # type: ignore[no-untyped-def]
    """Lowest mean difference of three windows of 5 columns and 3 rows that hold the pixel, on a plane."""
    height, width = left.shape
    before, middle, after = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    seen_before, seen_middle, seen_after = 0, 0, 0
    for aside in range(max(-4, -x), min(4, width - 1 - x) + 1):
        total, count = np.float32(0.0), 0
        for down in range(-min(1, y), min(1, height - 1 - y) + 1):
            column = np.float32(x + aside) - (disparity + across * np.float32(down) + along * np.float32(aside))
            if np.float32(0.0) <= column < np.float32(width - 1):
                base = int(column)
                seen = right[y + down, base]
                seen += (column - np.float32(base)) * (right[y + down, base + 1] - seen)
                total += min(abs(left[y + down, x + aside] - seen), largest)
                count += 1
        if aside <= 0:
            before += total
            seen_before += count
        if abs(aside) <= 2:
            middle += total
            seen_middle += count
        if aside >= 0:
            after += total
            seen_after += count
    best = before / np.float32(seen_before) if seen_before >= LEAST_SEEN else np.float32(np.inf)
    if seen_middle >= LEAST_SEEN:
        best = min(best, middle / np.float32(seen_middle))
    return min(best, after / np.float32(seen_after)) if seen_after >= LEAST_SEEN else best


@njit(inline="always", fastmath=False)
def row_match(left, right, y, x, disparity, along, first, last):  # type: ignore[no-untyped-def]
    """Shift that matches columns ``first`` to ``last`` of the row best, mean squared slope, variance of the shift."""
    width = left.shape[1]
    met, power, squares, count = np.float32(0.0), np.float32(1e-3), np.float32(0.0), 0
    for at in range(max(first, 0), min(last, width - 1) + 1):
        column = np.float32(at) - (disparity + along * np.float32(at - x))
        if column < np.float32(1.0) or column >= np.float32(width - 2):
            continue
        base = int(column)
        part = column - np.float32(base)
        before, near, far, after = right[y, base - 1], right[y, base], right[y, base + 1], right[y, base + 2]
        slope = np.float32(0.5) * (far - before + part * (after - near - far + before))
        difference = left[y, at] - near - part * (far - near)
        met += slope * difference
        power += slope * slope
        squares += difference * difference
        count += 1
    if count < ROW_SPAN_PX // 2:
        return np.float32(0.0), np.float32(0.0), np.float32(np.inf)
    left_over = max(squares - met * met / power, np.float32(0.0)) / np.float32(count)
    return -met / power, power / np.float32(count), left_over / power


@njit(inline="always", fastmath=False)
def plane_offered(disparity, y, x, y0, x0):  # type: ignore[no-untyped-def]
    """Disparity at (y, x) of the plane around trusted pixel (y0, x0), and its slopes along x and y."""
    span = np.float32(2 * RIM_PX)
    along = (disparity[y0, x0 + RIM_PX] - disparity[y0, x0 - RIM_PX]) / span
    across = (disparity[y0 + RIM_PX, x0] - disparity[y0 - RIM_PX, x0]) / span
    return disparity[y0, x0] + along * np.float32(x - x0) + across * np.float32(y - y0), along, across


@njit(inline="always", fastmath=False)
def nearest_in_row(trust, before, after):  # type: ignore[no-untyped-def]
    """Fill the column of the nearest trusted pixel left and right of every pixel of a row, -1 where there is none."""
    width = trust.size
    last = -1
    for x in range(width):
        before[x] = last
        last = x if trust[x] else last
    last = -1
    for x in range(width - 1, -1, -1):
        after[x] = last
        last = x if trust[x] else last


@njit(inline="always", fastmath=False)
def nearest_in_column(trust, y, x, down):  # type: ignore[no-untyped-def]
    """Row of the nearest trusted pixel above (down = -1) or below, -1 where there is none in reach."""
    for away in range(1, REACH_PX + 1):
        at = y + down * away
        if at < 0 or at >= trust.shape[0]:
            return -1
        if trust[at, x]:
            return at
    return -1


@njit(inline="always", fastmath=False)
def fits(offer, y, x, y0, x0, left, right, background, amplitude, map_, claim, noise):  # type: ignore[no-untyped-def]
    """Disparity of an offered plane as the row moves it, its difference in amplitudes (inf: refused), its variance."""
    disparity, along, across = offer
    refused = np.float32(np.inf)
    bright = amplitude[y0, x0]
    phase, _ = phase_of_disparity(map_, x, y, disparity)
    lacks = background[y0, x0] + bright * np.cos(wrap(np.float32(phase))) - left[y, x]
    if lacks > DIM_SHARE * bright + np.float32(3.0) * noise or -lacks > GLARE_SHARE * bright + np.float32(3.0) * noise:
        return disparity, refused, refused
    aside = ROW_SPAN_PX if x0 > x else ROW_SPAN_PX // 2 if x0 == x else 0
    first = x + aside - ROW_SPAN_PX
    shift, power, variance = row_match(left, right, y, x, disparity, along, first, first + ROW_SPAN_PX)
    fringe_slope = bright * np.float32(map_[8])
    if power < LEAST_POWER * np.float32(0.5) * fringe_slope * fringe_slope or abs(shift) > LARGEST_MOVE_PX:
        return disparity, refused, variance
    if abs(shift) > MOVE_PX:
        disparity += shift
    if taken(claim, y, x, disparity):
        return disparity, refused, variance
    return disparity, small_difference(left, right, y, x, disparity, along, across, bright) / bright, variance


@njit(inline="always", fastmath=False)
def neighbour(trust, y, x, side, before, after):  # type: ignore[no-untyped-def]
    """Trusted pixel left (side 0), right (1), above (2) or below (3), row -1 where none lies in reach."""
    y0, x0 = y, x
    if side == 0:
        x0 = before[x]
    elif side == 1:
        x0 = after[x]
    else:
        y0 = nearest_in_column(trust, y, x, 2 * side - 5)
    height, width = trust.shape
    inside = RIM_PX <= x0 < width - RIM_PX and RIM_PX <= y0 < height - RIM_PX
    return (y0, x0) if inside and abs(x0 - x) <= ROW_REACH_PX else (-1, -1)


@njit(inline="always", fastmath=False)
def best_offer(  # type: ignore[no-untyped-def]
    disparity, trust, y, x, before, after, left, right, background, amplitude, map_, claim, noise
):
    """Of the four planes offered, the one that fits best: difference (inf: none), disparity, variance, amplitude."""
    best, chosen = np.float32(np.inf), np.float32(np.nan)
    variance, bright = np.float32(0.0), np.float32(1.0)
    for side in range(4):
        y0, x0 = neighbour(trust, y, x, side, before, after)
        if y0 < 0:
            continue
        offer = plane_offered(disparity, y, x, y0, x0)
        if abs(offer[0] - disparity[y, x]) < JUMP_PX:
            continue
        moved, difference, doubt = fits(offer, y, x, y0, x0, left, right, background, amplitude, map_, claim, noise)
        if difference < best:
            best, chosen, variance, bright = difference, moved, doubt, amplitude[y0, x0]
    return best, chosen, variance, bright


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def assign(  # type: ignore[no-untyped-def]
    disparity, trust, todo, claim, left, right, background, amplitude, map_, noise, misfit,
    new_disparity, new_sigma, new_signed, new_mismatch,
):
    """Write the new images (H, W; as Match) where a pixel to do that is not trusted changes or loses its surface."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        before, after = np.empty(width, dtype=np.int64), np.empty(width, dtype=np.int64)
        nearest_in_row(trust[y], before, after)
        for x in range(width):
            if trust[y, x] or not todo[y, x]:
                continue
            best, chosen, variance, bright = best_offer(
                disparity, trust, y, x, before, after, left, right, background, amplitude, map_, claim, noise
            )
            own, here = np.float32(np.inf), disparity[y, x]
            if best == np.float32(np.inf):
                if np.isnan(here):
                    continue
                bright = max(amplitude[y, x], np.float32(1.0))
            allowed = np.float32(2.0) * noise / bright + misfit
            if not np.isnan(here) and not taken(claim, y, x, here):
                own = small_difference(left, right, y, x, here, np.float32(0.0), np.float32(0.0), bright) / bright
            if best < allowed and best < own - BETTER_SHARE:
                new_disparity[y, x], new_sigma[y, x] = chosen, np.sqrt(variance)
                new_signed[y, x], new_mismatch[y, x] = np.float32(np.nan), best
            elif own > allowed:
                new_disparity[y, x] = np.float32(np.nan)
