"""Chains: neighbouring right pixels of a row that nobody explains and that fit left ones at the same disparity.

A pixel by itself fits here and there; along a post all do, at one disparity. A post must also not contradict what is
known: its shadow falls where the projector says, and there no lit wall can be seen; a left pixel that shows the wall as
well as the post is the post's only if that shadow is there, and if the right view does not show the wall, too.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import BARE
from moire_sensor.depth_narrow import STEP_PX
from moire_sensor.depth_seek_fit import ONE, ZERO, fit_both, fit_one
from moire_sensor.depth_seek_row import is_bright, lower
from moire_sensor.projector_map import phase_of_disparity

# What the views may differ by beside noise, and from the fringes (on a post the shade bends), in amplitudes.
VIEWS_SHARE, FRINGES_SHARE = np.float32(0.03), np.float32(0.14)
# How much either makes of a pixel's weight of one; a shadow in its place doubles that.
VIEWS_WEIGHT, FRINGES_WEIGHT, SHADOW_WEIGHT = np.float32(0.3), np.float32(0.7), np.float32(2.0)
# A shade of less than this share of what counts as lit is dark; a shadow is darker than that share of it so far around.
DARK_SHARE, SHADOW_SHARE, SHADOW_REACH_PX = np.float32(0.3), np.float32(0.5), 2
# Disparities of one surface; of neighbours in a chain; of different chains.
SAME_PX, LINK_PX, OTHER_PX = np.float32(1.5), np.float32(0.6), np.float32(4.0)
# A chain's least weight, how much of it another through the same pixel may have, and how badly the wall must fit.
LEAST_WEIGHT, RIVAL_SHARE, LEAST_WALL = np.float32(2.0), np.float32(0.5), np.float32(0.09)
MOST_WALL, LEAST_NUMBER = np.float32(0.5), np.float32(3.0)
# Places in the limits: lowest and highest disparity, amplitude by shade, least light of what counts as lit, noise of a
# difference, and the largest squared difference of two pieces.
LOWEST, HIGHEST, SHARE, LIGHT, NOISE, APART = range(6)


@njit(**BARE)
def weight_of(rows, map_, limits, y, column, x, disparity):  # type: ignore[no-untyped-def]
    """Weight of a right pixel at a disparity, 0 if it does not fit or contradicts what is known, and how the wall fits.

    ``rows`` are the means of the left and right rows, what is sure on the left, its sides, and the sides of the claims.
    """
    left, right, sure, before, after, claim_before, claim_after = rows
    # The shadow first, which takes less time than the fit and refuses more.
    other = not np.isnan(sure[x]) and abs(sure[x] - disparity) > SAME_PX
    shadow = shadow_of(left, sure, before, after, map_, limits, y, x, disparity)
    if shadow < 0 or (other and shadow == 0):
        return ZERO, ZERO
    views, fringes, shade = fit_both(left, right, map_, limits[SHARE], x, y, disparity)
    largest = limits[NOISE] / max(shade * limits[SHARE], ONE) + VIEWS_SHARE
    if shade < DARK_SHARE * limits[LIGHT] or views > largest or fringes > FRINGES_SHARE:
        return ZERO, ZERO
    weight = ONE - VIEWS_WEIGHT * (views / largest) ** 2 - FRINGES_WEIGHT * (fringes / FRINGES_SHARE) ** 2
    wall = wall_of(right, True, claim_before[column], claim_after[column], column, map_, limits, y, disparity)
    if other:
        wall = min(wall, fit_one(right, map_, limits[SHARE], column, np.float32(column) + sure[x], y, sure[x]))
    elif wall < MOST_WALL:
        mine = wall_of(left, False, claim_before[column], claim_after[column], x, map_, limits, y, disparity)
        wall = max(wall, mine)
    return (SHADOW_WEIGHT * weight if shadow else weight), wall


@njit(**BARE)
def wall_of(row, on_right, one, other, at, map_, limits, y, disparity):  # type: ignore[no-untyped-def]
    """How well one of two walls at the sides, if they lie behind, fits a row about ``at``."""
    wall = MOST_WALL
    for number in range(2):
        far = one if number == 0 else other
        if not far < disparity - STEP_PX or (number == 1 and abs(far - one) < SAME_PX):
            continue
        place = np.float32(at) + (far if on_right else ZERO)
        wall = min(wall, fit_one(row, map_, limits[SHARE], at, place, y, far))
    return wall


@njit(**BARE)
def shadow_of(left, sure, before, after, map_, limits, y, x, disparity):  # type: ignore[no-untyped-def]
    """Whether the shadow of a left pixel is there (1), lies where a wall is known to be lit (-1), or cannot be told."""
    wall = lower(before[x], after[x]) if np.isnan(sure[x]) else sure[x]
    if not wall < disparity - STEP_PX:
        return 0
    near, _ = phase_of_disparity(map_, x, y, disparity)
    far, _ = phase_of_disparity(map_, x, y, wall)
    beside, _ = phase_of_disparity(map_, x + 1, y, wall)
    at = x + (near - far) / (beside - far)
    if not SHADOW_REACH_PX <= at < left.size - SHADOW_REACH_PX:
        return 0
    column = int(at + 0.5)
    if abs(sure[column] - wall) < SAME_PX:
        return -1
    return 0 if is_bright(left, column, SHADOW_REACH_PX, SHADOW_SHARE * limits[LIGHT]) else 1


@njit(**BARE)
def chained(disparity, weight, wall, begin, end, disparities, chain_of, chains, count):  # type: ignore[no-untyped-def]
    """Number of the chain that a disparity goes on, or of a new one; its sums grow.

    ``disparities[begin:end]`` and ``chain_of`` are those of the pixel before; ``chains`` (3, n) are weight, number of
    pixels and wall of each of the ``count`` chains.
    """
    chain = count
    for old in range(begin, end):
        if abs(disparities[old] - disparity) < LINK_PX:
            chain = chain_of[old]
            break
    if chain == count:
        chains[0, chain] = chains[1, chain] = chains[2, chain] = ZERO
    chains[0, chain] += weight
    chains[1, chain] += ONE
    chains[2, chain] += wall
    return chain


@njit(**BARE)
def chosen(disparities, chain_of, begin, end, chains):  # type: ignore[no-untyped-def]
    """Which of the disparities of a right pixel is that of a chain beyond doubt, -1 if none."""
    best = begin
    for k in range(begin, end):
        if chains[0, chain_of[k]] > chains[0, chain_of[best]]:
            best = k
    weight, number, wall = chains[0, chain_of[best]], chains[1, chain_of[best]], chains[2, chain_of[best]]
    if weight < LEAST_WEIGHT or number < LEAST_NUMBER or wall < LEAST_WALL * number:
        return -1
    for k in range(begin, end):
        if abs(disparities[k] - disparities[best]) > OTHER_PX and chains[0, chain_of[k]] > RIVAL_SHARE * weight:
            return -1
    return best
