"""Grey levels tell orders apart whose phases match nearly as well; few pixels need it, so it is done in chunks."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import LEAF
from moire_sensor.order_weigh import UNITS

GREY_WEIGHT = np.float32(1.0)
GREY_COST = np.float32(1.0)
CHUNK = 32
# A pair of neighbouring right grey levels in one word of 32 bits, each in 1/256 below 256.
PARTS, MOST = np.float32(256.0), np.float32(255.996)
LOW, BITS = np.uint32(0xFFFF), np.uint32(16)
FULL_UNITS = GREY_COST * UNITS


@njit(**LEAF)
def prepare(left, right, amplitude, greys, scale, pairs):  # type: ignore[no-untyped-def]
    """Fill a row's left grey levels in 1/256, the cost of 1/256 in units, and pairs (W + 1,) of right grey levels."""
    for x in range(left.size):
        greys[x] = left[x] * PARTS
        scale[x] = GREY_WEIGHT * UNITS / PARTS / (amplitude[x] if amplitude[x] > np.float32(1.0) else np.float32(1.0))
    for x in range(left.size):
        pairs[x] = fine(right[x])
    pairs[left.size] = pairs[left.size - 1]


@njit(**LEAF)
def join(levels, following, pairs):  # type: ignore[no-untyped-def]
    """Fill pairs of each level and the following one."""
    for x in range(pairs.size):
        pairs[x] = levels[x] | (following[x] << BITS)


@njit(inline="always")
def fine(level):  # type: ignore[no-untyped-def]
    """Grey level in 1/256."""
    level = level if level < MOST else MOST
    level = level if level > np.float32(0.0) else np.float32(0.0)
    return np.uint32(np.int32(level * PARTS))


@njit(**LEAF)
def list_chunks(rivals, chunks):  # type: ignore[no-untyped-def]
    """Fill the numbers of the chunks that hold rivals, bytes (chunks, 4) as words, and return how many there are."""
    count = 0
    for chunk in range(rivals.shape[0]):
        words = rivals[chunk]
        chunks[count] = chunk
        count += 1 if (words[0] | words[1] | words[2] | words[3]) != 0 else 0
    return count


@njit(**LEAF)
def add_greys(column, mismatch, px_per_part, rival, greys, scale, pairs, last, cost):  # type: ignore[no-untyped-def]
    """Add to a chunk's costs how far grey levels differ where the phases match, in fringe amplitudes.

    Right columns are moved to that place with the carrier's speed at column x, and stay inside the image.
    """
    for lane in range(CHUNK):
        at = column[lane] + np.float32(mismatch[lane]) * px_per_part[lane]
        at = at if at > np.float32(0.0) else np.float32(0.0)
        at = at if at < last else last
        before = np.int32(at)
        pair = pairs[np.uint32(before)]
        low = np.float32(np.int32(pair & LOW))
        step = np.float32(np.int32(pair >> BITS)) - low
        seen = low + (at - np.float32(before)) * step
        differ = scale[lane] * abs(greys[lane] - seen)
        differ = differ if differ < FULL_UNITS else FULL_UNITS
        more = np.uint8(np.int32(differ + np.float32(0.5)))
        cost[lane] = np.uint8(cost[lane] + (more if rival[lane] != 0 else np.uint8(0)))
