"""The plane of a trusted pixel, offered to a pixel beside an edge, and how well its grey levels speak for it."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import wrap
from moire_sensor.apart import BARE
from moire_sensor.depth_window import ROW_SPAN_PX, row_match, small_difference
from moire_sensor.projector_map import phase_of_disparity

# Trusted pixels have no jump and no hole within so many pixels.
RIM_PX = 3
SAME_CLAIM_PX = np.float32(1.5)
NO_CLAIM = np.float32(-1e9)
# The row beside the pixel must carry fringes of this share of the power of the plane's own.
LEAST_POWER = np.float32(0.2)
# A plane is moved by what the row says if that is more than noise, and given up beyond the largest move.
MOVE_PX, LARGEST_MOVE_PX = np.float32(0.3), np.float32(0.8)
# What a move adds to the difference, amplitudes a pixel: of two surfaces whole fringes apart, the unmoved one wins.
MOVE_COST = np.float32(0.03)
# A plane carried further along the row than this must be matched to a seventh of a pixel.
NEAR_PX, FAR_VARIANCE = 14, np.float32(0.02)
# Light that the plane promises may be missing by this share of the fringe amplitude; a shadow lacks more.
DIM_SHARE = np.float32(0.7)
GLARE_SHARE = np.float32(0.4)
# Of the light that a plane promises to a piece of row, a lit one has this share, within three sigmas of its sum.
LIT_PX, LIT_SHARE, LIT_DOUBT = 5, np.float32(0.65), np.float32(3.0 * 5.0**0.5)
# Minimax polynomial of cos x in x^2, x from -pi to pi, to 8e-7.
COS = tuple(np.float32(c) for c in (0.99999921, -0.49999421, 4.1659778e-2, -1.3858790e-3, 2.4202941e-5, -2.1972964e-7))


@njit(**BARE)
def taken(claim, y, x, disparity):  # type: ignore[no-untyped-def]
    """Whether the right pixel lies outside the image or shows another surface."""
    column = int(np.floor(np.float32(x) - disparity + np.float32(0.5)))
    if column < 0 or column >= claim.shape[1]:
        return True
    held = claim[np.uint64(y), np.uint64(column)]
    return held > NO_CLAIM and abs(held - disparity) > SAME_CLAIM_PX


@njit(**BARE)
def taken_however_moved(claim, y, x, disparity):  # type: ignore[no-untyped-def]
    """Whether :func:`taken` holds wherever the row may move a plane, which spares its match."""
    column = int(np.floor(np.float32(x) - disparity + np.float32(0.5)))
    for at in range(max(column - 1, 0), min(column + 2, claim.shape[1])):
        held = claim[np.uint64(y), np.uint64(at)]
        if held == NO_CLAIM or abs(held - disparity) <= SAME_CLAIM_PX + LARGEST_MOVE_PX:
            return False
    return True


@njit(**BARE)
def plane_offered(disparity, y, x, y0, x0):  # type: ignore[no-untyped-def]
    """Disparity at (y, x) of the plane around trusted pixel (y0, x0), and its slopes along x and y."""
    row, column, rim = np.uint64(y0), np.uint64(x0), np.uint64(RIM_PX)
    span = np.float32(2 * RIM_PX)
    along = (disparity[row, column + rim] - disparity[row, column - rim]) / span
    across = (disparity[row + rim, column] - disparity[row - rim, column]) / span
    return disparity[row, column] + along * np.float32(x - x0) + across * np.float32(y - y0), along, across


@njit(**BARE)
def lit_so(grey, background, bright, map_, x, y, disparity, noise):  # type: ignore[no-untyped-def]
    """Whether a grey level is what the projector puts on the plane, but for a shade or a glare."""
    lacks = background + bright * fringe_cos(map_, x, y, disparity) - grey
    doubt = np.float32(3.0) * noise
    return -(GLARE_SHARE * bright + doubt) <= lacks <= DIM_SHARE * bright + doubt


@njit(forceinline=True, **BARE)
def fringe_cos(map_, x, y, disparity):  # type: ignore[no-untyped-def]
    """Cosine of the fringes' phase on a left pixel of a disparity."""
    phase, _ = phase_of_disparity(map_, x, y, disparity)
    return cos(wrap(np.float32(phase)))


@njit(forceinline=True, **BARE)
def cos(angle):  # type: ignore[no-untyped-def]
    """Cosine of a float32 angle within -pi..pi."""
    square = angle * angle
    result = COS[5]
    result = result * square + COS[4]
    result = result * square + COS[3]
    result = result * square + COS[2]
    result = result * square + COS[1]
    return result * square + COS[0]


@njit(**BARE)
def fits(  # type: ignore[no-untyped-def]
    offer, y, x, x0, bright, background, left, right, map_, claim, limits, limit, sums
):
    """Disparity of an offered plane as the row moves it, its difference in amplitudes (inf: refused), its variance.

    ``bright`` and ``background`` are those of the trusted pixel in column ``x0``. What cannot get below ``limit`` is
    refused, and light is looked at only where the difference is less.
    """
    disparity, along, across = offer
    refused = np.float32(np.inf)
    if taken_however_moved(claim, y, x, disparity):
        return disparity, refused, refused
    if not lit_so(left[np.uint64(y), np.uint64(x)], background, bright, map_, x, y, disparity, limits[1]):
        return disparity, refused, refused
    # A move takes off what fringes so steep all over the window would, at most.
    difference = small_difference(left, right, y, x, disparity, along, across, bright, sums)
    if difference > (limit + LARGEST_MOVE_PX * limits[0]) * bright:
        return disparity, refused, refused
    aside = ROW_SPAN_PX if x0 > x else ROW_SPAN_PX // 2 if x0 == x else 0
    shift, power, variance = row_match(left, right, y, x, disparity, along, x + aside - ROW_SPAN_PX)
    fringe_slope = bright * limits[0]
    if power < LEAST_POWER * np.float32(0.5) * fringe_slope * fringe_slope or abs(shift) > LARGEST_MOVE_PX:
        return disparity, refused, variance
    if abs(x - x0) > NEAR_PX and variance > FAR_VARIANCE:
        return disparity, refused, variance
    moved = shift if abs(shift) > MOVE_PX else np.float32(0.0)
    disparity += moved
    if taken(claim, y, x, disparity):
        return disparity, refused, variance
    if moved != np.float32(0.0):
        difference = small_difference(left, right, y, x, disparity, along, across, bright, sums)
    if difference < limit * bright and not is_lit(left, background, bright, map_, y, x, disparity, along, limits[1]):
        return disparity, refused, variance
    return disparity, difference / bright + MOVE_COST * abs(moved), variance


@njit(**BARE)
def is_lit(left, background, bright, map_, y, x, disparity, along, noise):  # type: ignore[no-untyped-def]
    """Whether one of three pieces of row that hold the pixel is nearly as bright as its plane promises.

    Two views of a shadow are alike wherever a plane's fringe is dark, too. But the dark of a fringe is not that of a
    shadow.
    """
    width = left.shape[1]
    for first in (x - LIT_PX // 2, x - LIT_PX + 1, x):
        promised, found = np.float32(0.0), np.float32(0.0)
        for column in range(max(first, 0), min(first + LIT_PX, width)):
            here = disparity + along * np.float32(column - x)
            promised += background + bright * fringe_cos(map_, column, y, here)
            found += left[np.uint64(y), np.uint64(column)]
        if found > LIT_SHARE * promised - LIT_DOUBT * noise:
            return True
    return False
