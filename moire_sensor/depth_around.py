"""The trusted pixels around one beside an edge: left, right, above and below."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import BARE
from moire_sensor.depth_offer import RIM_PX
from moire_sensor.depth_trust import FAR, ROW_REACH_PX

SIDES = 4


@njit(forceinline=True, **BARE)
def neighbour(above, below, y, x, side, before, after):  # type: ignore[no-untyped-def]
    """Trusted pixel left (side 0: column ``before``), right (1: ``after``), above (2) or below (3); row -1: none."""
    height, width = above.shape
    y0, x0 = y, x
    if side < 2:
        x0 = before if side == 0 else after
    else:
        away = (above if side == 2 else below)[np.uint64(y), np.uint64(x)]
        y0 = -1 if away == FAR else y - np.int64(away) if side == 2 else y + np.int64(away)
    inside = RIM_PX <= x0 < width - RIM_PX and RIM_PX <= y0 < height - RIM_PX
    return (y0, x0) if inside and abs(x0 - x) <= ROW_REACH_PX else (-1, -1)


@njit(forceinline=True, **BARE)
def dimmest(amplitude, above, below, y, x, before, after):  # type: ignore[no-untyped-def]
    """Least fringe amplitude of the pixel and the trusted ones around it."""
    bright = max(amplitude[y, x], np.float32(1.0))
    for side in range(SIDES):
        y0, x0 = neighbour(above, below, y, x, side, before, after)
        if y0 >= 0:
            bright = min(bright, amplitude[np.uint64(y0), np.uint64(x0)])
    return bright


@njit(forceinline=True, **BARE)
def next_of(trust, x):  # type: ignore[no-untyped-def]
    """First trusted column from ``x`` on; the row's length where there is none."""
    while x < trust.size and trust[np.uint64(x)] == 0:
        x += 1
    return x


@njit(forceinline=True, **BARE)
def last_of(trust, x):  # type: ignore[no-untyped-def]
    """Last trusted column before ``x``; -1 where there is none."""
    x -= 1
    while x >= 0 and trust[np.uint64(x)] == 0:
        x -= 1
    return x
