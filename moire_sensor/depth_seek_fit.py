"""How well a piece of row, seen by both cameras, is a shaded piece of the projector's fringes at some disparity.

Pieces are half a fringe wide, too short to know background and amplitude of their own: the ratio of the two is the
image's, and only the shade, which may change along the piece, is fitted. What the cameras differ by is judged apart,
since shading does not touch it: it tells much better.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import wrap
from moire_sensor.apart import BARE, LEAF_FAST
from moire_sensor.depth_offer import cos
from moire_sensor.projector_map import phase_of_disparity

# Pixels of a piece on either side of its middle, and in all.
HALF_PX = 4
PIECE_PX = 2 * HALF_PX + 1
ZERO, HALF, ONE, TWO, EIGHT = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0), np.float32(8.0)
# What does not fit at all.
NO_FIT = np.float32(9.0)


@njit(**LEAF_FAST)
def fill_differences(left, piece, limit, apart, least):  # type: ignore[no-untyped-def]
    """Fill ``apart`` (n,) with the squared differences of ``piece`` and each piece of ``left`` (n + PIECE_PX - 1,).

    ``least`` (n,) uint8 marks the inner ones that are less than those beside them, if the least between pixels is at
    most ``limit`` (:func:`least_between`).
    """
    for i in range(apart.size):
        total = ZERO
        for k in range(PIECE_PX):
            difference = left[i + k] - piece[k]
            total += difference * difference
        apart[i] = total
    least[0] = least[apart.size - 1] = 0
    for i in range(1, apart.size - 1):
        before, here, after = apart[i - 1], apart[i], apart[i + 1]
        slope, bend = before - after, before - TWO * here + after
        small = EIGHT * bend * (here - limit) <= slope * slope
        least[i] = (here <= before) & (here < after) & small


@njit(forceinline=True, **BARE)
def least_between(apart, i):  # type: ignore[no-untyped-def]
    """Place of the least squared difference about i, where i is marked: that of a parabola through its neighbours."""
    before, here, after = apart[i - 1], apart[i], apart[i + 1]
    return HALF * (before - after) / (before - TWO * here + after)


@njit(**BARE)
def fit_both(left, right, map_, share, x, y, disparity):  # type: ignore[no-untyped-def]
    """Differences between the views and from the fringes, and the shade, of a left piece about x at a disparity.

    Root mean squares in units of the fringe amplitude, ``share`` of the shade; the shade is in grey levels.
    """
    seen = np.float32(x) - disparity
    base = np.int64(np.floor(seen))
    part, first = seen - np.float32(base), base - HALF_PX
    if x < HALF_PX or x + HALF_PX >= left.size or first < 0 or first + PIECE_PX >= right.size:
        return NO_FIT, NO_FIT, ZERO
    start, step = phases(map_, x, y, disparity)
    sums, squares, apart = (ZERO, ZERO, ZERO, ZERO, ZERO), ZERO, ZERO
    for k in range(PIECE_PX):
        level = left[x - HALF_PX + k]
        other = right[first + k] + part * (right[first + k + 1] - right[first + k])
        apart += (level - other) * (level - other)
        level = HALF * (level + other)
        squares += level * level
        sums = added(sums, level, share, start + step * np.float32(k), k)
    misfit, shade = solved(sums, squares, share)
    return np.sqrt(apart / np.float32(PIECE_PX)) / (shade * share) if shade > ONE else NO_FIT, misfit, shade


@njit(**BARE)
def fit_one(row, map_, share, at, x, y, disparity):  # type: ignore[no-untyped-def]
    """Difference from the fringes of a piece of one view's row about ``at``, if it shows what left pixel x does."""
    if at < HALF_PX or at + HALF_PX >= row.size:
        return NO_FIT
    start, step = phases(map_, x, y, disparity)
    sums, squares = (ZERO, ZERO, ZERO, ZERO, ZERO), ZERO
    for k in range(PIECE_PX):
        level = row[at - HALF_PX + k]
        squares += level * level
        sums = added(sums, level, share, start + step * np.float32(k), k)
    return solved(sums, squares, share)[0]


@njit(forceinline=True, **BARE)
def phases(map_, x, y, disparity):  # type: ignore[no-untyped-def]
    """Phase at the begin of a piece, and its step from pixel to pixel."""
    first, _ = phase_of_disparity(map_, x - HALF_PX, y, disparity)
    last, _ = phase_of_disparity(map_, x + HALF_PX, y, disparity)
    return wrap(np.float32(first)), np.float32(last - first) / np.float32(PIECE_PX - 1)


@njit(forceinline=True, **BARE)
def added(sums, level, share, phase, k):  # type: ignore[no-untyped-def]
    """Normal equations of the shade and its change along the piece, with pixel k of it."""
    light = ONE + share * cos(wrap(phase))
    turned = light * (np.float32(k - HALF_PX) / np.float32(HALF_PX))
    return (
        sums[0] + light * light, sums[1] + light * turned, sums[2] + turned * turned, sums[3] + light * level,
        sums[4] + turned * level,
    )  # fmt: skip


@njit(forceinline=True, **BARE)
def solved(sums, squares, share):  # type: ignore[no-untyped-def]
    """What the fit leaves over, in amplitudes, and the shade; ``NO_FIT`` for a shade that is dark or falls to zero."""
    whole = sums[0] * sums[2] - sums[1] * sums[1]
    shade = (sums[3] * sums[2] - sums[4] * sums[1]) / whole
    change = (sums[0] * sums[4] - sums[1] * sums[3]) / whole
    if not shade > ONE or abs(change) > shade:
        return NO_FIT, ZERO
    left_over = max(squares - shade * sums[3] - change * sums[4], ZERO)
    return np.sqrt(left_over / np.float32(PIECE_PX)) / (shade * share), shade
