"""How well the right camera's phase agrees with a candidate order, in whole numbers.

Phases are counted in 1/65536 of a turn, so that 16 bits wrap where the phase does, and 32 of them make a vector.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from moire_sensor.angles import TURNS_PER_RAD
from moire_sensor.apart import LEAF, UNCOUNTED

PARTS = np.float32(65536.0)
# Costs are whole numbers of 1/85, so that the largest, 3, fits into a byte.
UNITS = np.float32(85.0)
# A mismatch of 90 degrees is as bad as any: orders that are off land 34 to 163 degrees away in the paper's rig.
FULL_MISMATCH_RAD = np.float32(np.pi / 2.0)
FLAT_COST = np.float32(0.15)
# Phases alone do not tell orders apart that match this much worse than the best.
RIVAL_RAD = np.float32(0.7)
UNSEEN_COST = np.float32(0.6)
BLOCKED_COST = np.float32(3.0)
FULL, RIVAL = np.int16(FULL_MISMATCH_RAD * TURNS_PER_RAD * PARTS), np.int16(RIVAL_RAD * TURNS_PER_RAD * PARTS)
# The two lowest bits of a right phase tell that there is none: as none is seen, or none could be.
FLAGS, PHASE, NEAREST = np.int32(3), np.int32(-4), np.int32(2)
UNSEEN, BLOCKED = np.int16(1), np.int16(3)
UNSEEN_UNITS, MORE_UNITS = np.int16(UNSEEN_COST * UNITS), np.int16((BLOCKED_COST - UNSEEN_COST) * UNITS)
UNMATCHED = np.int16(32767)
# Costs per mismatch are kept in 1/64 units per 65536 parts, and so are their sums before they are rounded.
FINE_BITS = np.int16(6)
FINE, HALF_UNIT = np.float32(64.0), np.int16(32)
ENTRIES = 3
BITS = np.uint64(16)


class Slopes(NamedTuple):
    """The cost of a mismatch: nearly flat up to what shading explains, and a full one from a quarter turn on."""

    flat: np.int16
    gentle: np.uint16
    steep: np.uint16
    start: np.int16

    @classmethod
    def of(cls, shading_rad: float) -> Slopes:
        """Slopes for mismatches that shading explains up to some angle, at least 0.02 and less than 1.2 radians."""
        flat = float(np.int16(shading_rad * float(TURNS_PER_RAD * PARTS)))
        units = float(UNITS * FINE)
        steep = (1.0 - float(FLAT_COST)) * units / (float(FULL) - flat)
        start = float(FLAT_COST) * units - steep * flat + float(HALF_UNIT)
        gentle, steep = float(FLAT_COST) * units * float(PARTS) / flat, steep * float(PARTS)
        return cls(np.int16(flat), np.uint16(gentle), np.uint16(steep), np.int16(round(start)))


@njit(**LEAF)
def copy_seen(offset, seen):  # type: ignore[no-untyped-def]
    """Fill the table (W + 3,) of right phases, counted from 1; before and behind them, and where unknown, UNSEEN.

    The last entry is for columns outside the depth range.
    """
    width = offset.size
    inside = seen[1 : width + 1]
    for x in range(width):
        known = offset[x] == offset[x]
        part = np.int32((offset[x] if known else np.float32(0.0)) * (TURNS_PER_RAD * PARTS))
        inside[x] = np.int16(np.int32((part + NEAREST) & PHASE)) if known else UNSEEN
    seen[0], seen[width + 1], seen[width + 2] = UNSEEN, UNSEEN, BLOCKED


@njit(**UNCOUNTED)
def look_up(seen, nearest, found):  # type: ignore[no-untyped-def]
    """Fetch the right phases (4 n,) as words (n,) of four.

    One by one and stored together, which is faster than the processor's own gathering.
    """
    for word in range(found.size):
        x = 4 * word
        a, b = np.uint64(seen[np.uint32(nearest[x])]), np.uint64(seen[np.uint32(nearest[x + 1])])
        c, d = np.uint64(seen[np.uint32(nearest[x + 2])]), np.uint64(seen[np.uint32(nearest[x + 3])])
        found[word] = (a | (b << BITS)) | ((c | (d << BITS)) << (BITS + BITS))


@njit(**LEAF)
def weigh(found, parts, slopes, mismatch, cost):  # type: ignore[no-untyped-def]
    """Fill costs by phase, and mismatches, UNMATCHED where no phase is seen or the depth is out of range."""
    flat, gentle, steep, start = slopes.flat, slopes.gentle, slopes.steep, slopes.start
    for x in range(found.size):
        seen = np.int32(found[x])
        flag = np.int16(np.int32(seen & FLAGS))
        angle = np.int16(np.int32(np.int32(parts[x]) - np.int32(seen & PHASE)))
        angle = angle if angle > np.int16(-32767) else np.int16(-32767)
        size = np.int16(abs(angle))
        size = size if size < FULL else FULL
        slope = gentle if size < flat else steep
        base = HALF_UNIT if size < flat else start
        fine = np.int16(np.uint16(np.uint32(np.uint32(np.uint16(size)) * np.uint32(slope)) >> np.uint32(16)))
        value = np.int16(np.int16(fine + base) >> FINE_BITS)
        unmatched = np.int16(UNSEEN_UNITS + np.int16(np.int16(flag >> np.int16(1)) * MORE_UNITS))
        cost[x] = np.uint8(value if flag == 0 else unmatched)
        mismatch[x] = angle if flag == 0 else UNMATCHED


@njit(**LEAF)
def find_rivals(mismatch, bound, runner_up, rivals):  # type: ignore[no-untyped-def]
    """Fill ``rivals`` (labels, W) with 1 where an order rivals the best of its pixel or is the best and has rivals."""
    for x in range(bound.size):
        bound[x] = UNMATCHED
        runner_up[x] = UNMATCHED
    for label in range(mismatch.shape[0]):
        line = mismatch[label]
        for x in range(bound.size):
            size, low, next_ = np.int16(abs(line[x])), bound[x], runner_up[x]
            worse = size if size > low else low
            bound[x] = size if size < low else low
            runner_up[x] = worse if worse < next_ else next_
    for x in range(bound.size):
        best = bound[x] if bound[x] < FULL else FULL
        most = np.int16(best + RIVAL)
        bound[x] = most if runner_up[x] < most else np.int16(0)
    for label in range(mismatch.shape[0]):
        line, rival = mismatch[label], rivals[label]
        for x in range(bound.size):
            rival[x] = np.uint8(1) if np.int16(abs(line[x])) < bound[x] else np.uint8(0)
