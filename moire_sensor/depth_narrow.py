"""Surfaces too narrow to be trusted, and the last pixel of a trusted one: what a known run along the row offers.

A trusted pixel has ``RIM_PX`` known ones on all sides. A pole of which only a strip is known has none, and on its rim a
plane through trusted pixels further in, where it faces the camera, is not what the rim is like.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import BARE
from moire_sensor.depth_trust import JUMP_PX

# A run of so many pixels, with the same surface so many rows above and below, is no accident; it is looked for so far.
LEAST_RUN_PX, UPRIGHT_PX, LOOK_PX = 4, 10, 8
# Steps smaller than this are noise on one steep surface.
STEP_PX = np.float32(3.0)
NO_RUN = -1


@njit(forceinline=True, **BARE)
def run_offered(disparity, y, x, step, trusted, alone, narrow):  # type: ignore[no-untyped-def]
    """Column of the first pixel of a run that offers its surface, ``NO_RUN`` if none; disparity at (y, x), and slope.

    The nearest known pixel of another surface counts. ``step`` is the side, -1 or 1, ``trusted`` the nearest trusted
    column there. A run that holds it has a plane to offer; where nothing that was offered could be, ``alone``, it is
    offered level to an unknown pixel right beside it. ``narrow``: whether :func:`has_narrow_run`.
    """
    none, level = np.float32(np.nan), np.float32(0.0)
    if not narrow and not (alone and is_beside(disparity, y, x, step)):
        return NO_RUN, none, level
    first = first_of_another(disparity, y, x, step)
    if first == NO_RUN:
        return NO_RUN, none, level
    length, holds_trusted = run_from(disparity, y, first, step, trusted)
    if length < LEAST_RUN_PX or not goes_on_upright(disparity, y, first):
        return NO_RUN, none, level
    here = disparity[y, first]
    if holds_trusted:
        return (first if alone and is_beside(disparity, y, x, step) else NO_RUN), here, level
    reach = step * (LEAST_RUN_PX - 1)
    slope = (disparity[y, first + reach] - here) / np.float32(reach)
    return first, here + slope * np.float32(x - first), slope


@njit(forceinline=True, **BARE)
def is_beside(disparity, y, x, step):  # type: ignore[no-untyped-def]
    """Whether an unknown pixel has a known one right beside it on one side."""
    inside = 0 <= x + step < disparity.shape[1]
    return inside and np.isnan(disparity[y, x]) and not np.isnan(disparity[y, x + step])


@njit(**BARE)
def has_narrow_run(disparity, y, start, end):  # type: ignore[no-untyped-def]
    """Whether the gap between two trusted pixels of a row, from ``start`` to before ``end``, holds a run of its own."""
    width = disparity.shape[1]
    x = start
    while x < end:
        first = x
        x += 1
        while x < width and abs(disparity[y, x] - disparity[y, x - 1]) < STEP_PX:
            if x == end:
                return False
            x += 1
        joined = first == start and start > 0 and abs(disparity[y, start] - disparity[y, start - 1]) < STEP_PX
        if x - first >= LEAST_RUN_PX and not joined:
            return True
    return False


@njit(forceinline=True, **BARE)
def first_of_another(disparity, y, x, step):  # type: ignore[no-untyped-def]
    """Column of the nearest known pixel on one side that does not lie on the surface of (y, x)."""
    width = disparity.shape[1]
    for away in range(1, LOOK_PX + 1):
        column = x + step * away
        if not 0 <= column < width:
            return NO_RUN
        found = disparity[y, column]
        if not np.isnan(found) and not abs(found - disparity[y, x]) < STEP_PX:
            return column
    return NO_RUN


@njit(forceinline=True, **BARE)
def run_from(disparity, y, first, step, trusted):  # type: ignore[no-untyped-def]
    """Length of a run without jumps, counted no further than needed, and whether it holds the trusted column."""
    width = disparity.shape[1]
    length, at, holds = 1, first, first == trusted
    while length < LEAST_RUN_PX or not holds:
        at += step
        if not 0 <= at < width or not abs(disparity[y, at] - disparity[y, at - step]) < STEP_PX:
            break
        holds |= at == trusted
        length += 1
    return length, holds


@njit(forceinline=True, **BARE)
def goes_on_upright(disparity, y, x):  # type: ignore[no-untyped-def]
    """Whether the surface of a known pixel is there ``UPRIGHT_PX`` rows above and below, or at the image's border."""
    above, below = max(y - UPRIGHT_PX, 0), min(y + UPRIGHT_PX, disparity.shape[0] - 1)
    here = disparity[y, x]
    return abs(disparity[above, x] - here) < JUMP_PX and abs(disparity[below, x] - here) < JUMP_PX
