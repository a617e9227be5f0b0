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

from moire_sensor.angles import NAN_SAFE
from moire_sensor.depth_offer import NO_CLAIM, RIM_PX, fits, plane_offered, small_difference, taken
from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

JUMP_PX = np.float32(1.0)
# What the first round gives to a surface lets the second trust its neighbours.
ROUNDS = 2
# Only pixels so near to a trusted one are looked at; along the row a plane is carried further, across a shadow.
REACH_PX, ROW_REACH_PX = 14, 80
# A pixel leaves its surface only for one that fits better by this share of the amplitude.
BETTER_SHARE = np.float32(0.03)


def extend(
    match: Match,
    greys: tuple[Float32, Float32],
    phase: PhaseImage,
    projector: ProjectorMap,
    rad_per_px: float,
    settings: Settings,
) -> Match:
    """Give the pixels beside edges to the surface they show, or to none.

    Parameters
    ----------
    match : disparities, NaN where unknown.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    phase : the left phase, whose amplitude and background tell how bright a surface is.
    rad_per_px : how fast the left phase runs along a row, without its sign.

    Returns
    -------
    Match
        Pixels given to another surface have the sigma of their row's match and, as mismatch, the difference of grey
        levels in fringe amplitudes; their signed mismatch is NaN.
    """
    before = np.zeros(match.disparity_px.shape, dtype=np.bool_)
    for _ in range(ROUNDS):
        trust = trusted(match.disparity_px)
        result = Match(*(image.copy() for image in match.images()))
        assign(
            match.disparity_px, trust, near(trust & ~before), claims(match.disparity_px, trust), *greys,
            phase.background, phase.amplitude, projector.packed(), np.float32(rad_per_px),
            np.float32(settings.image_noise), np.float32(settings.max_border_misfit), *result.images(),
        )  # fmt: skip
        match, before = result, trust
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
    disparity, trust, y, x, before, after, left, right, background, amplitude, map_, rad_per_px, claim, noise
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
        moved, difference, doubt = fits(
            offer, y, x, y0, x0, left, right, background, amplitude, map_, rad_per_px, claim, noise
        )
        if difference < best:
            best, chosen, variance, bright = difference, moved, doubt, amplitude[y0, x0]
    return best, chosen, variance, bright


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def assign(  # type: ignore[no-untyped-def]
    disparity, trust, todo, claim, left, right, background, amplitude, map_, rad_per_px, noise, misfit,
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
                disparity, trust, y, x, before, after, left, right, background, amplitude, map_, rad_per_px, claim,
                noise,
            )  # fmt: skip
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
