"""Transposition of squares of 64 by 64 bytes: a programme along rows then advances 64 of them at once.

Eight rows, as words of eight bytes, are turned in squares of 8 by 8 bytes by exchanging quarters, then quarters of
quarters, then bytes; one such step does all squares of the eight rows. Then the squares change places.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import LEAF

HALF, QUARTER, EIGHTH = np.uint64(32), np.uint64(16), np.uint64(8)
LOW_HALF, LOW_QUARTERS = np.uint64(0x00000000FFFFFFFF), np.uint64(0x0000FFFF0000FFFF)
LOW_EIGHTHS = np.uint64(0x00FF00FF00FF00FF)
WORDS = 8


@njit(**LEAF)
def transpose(source, room, target):  # type: ignore[no-untyped-def]
    """Fill ``target[x, label, y]`` with ``source[y, label, x]``, bytes.

    All are words of eight bytes along the last axis: both (64, labels, 8), and ``room`` (8, 8, 8) to work in.
    """
    for label in range(source.shape[1]):
        for group in range(WORDS):
            y = WORDS * group
            words = room[group]
            turn_squares(
                source[y, label], source[y + 1, label], source[y + 2, label], source[y + 3, label],
                source[y + 4, label], source[y + 5, label], source[y + 6, label], source[y + 7, label],
                words[0], words[1], words[2], words[3], words[4], words[5], words[6], words[7],
            )  # fmt: skip
        place_squares(room, target[:, label])


@njit(**LEAF)
def turn_squares(a, b, c, d, e, f, g, h, to_a, to_b, to_c, to_d, to_e, to_f, to_g, to_h):  # type: ignore[no-untyped-def]
    """Turn the eight squares of eight rows: word w of row k becomes column 8 w + k."""
    for word in range(WORDS):
        to_a[word], to_b[word], to_c[word], to_d[word], to_e[word], to_f[word], to_g[word], to_h[word] = turned(
            a[word], b[word], c[word], d[word], e[word], f[word], g[word], h[word]
        )


@njit(inline="always")
def turned(a, b, c, d, e, f, g, h):  # type: ignore[no-untyped-def]
    """One square of 8 by 8 bytes turned."""
    a, e = swap(a, e, HALF, LOW_HALF)
    b, f = swap(b, f, HALF, LOW_HALF)
    c, g = swap(c, g, HALF, LOW_HALF)
    d, h = swap(d, h, HALF, LOW_HALF)
    a, c = swap(a, c, QUARTER, LOW_QUARTERS)
    b, d = swap(b, d, QUARTER, LOW_QUARTERS)
    e, g = swap(e, g, QUARTER, LOW_QUARTERS)
    f, h = swap(f, h, QUARTER, LOW_QUARTERS)
    a, b = swap(a, b, EIGHTH, LOW_EIGHTHS)
    c, d = swap(c, d, EIGHTH, LOW_EIGHTHS)
    e, f = swap(e, f, EIGHTH, LOW_EIGHTHS)
    g, h = swap(g, h, EIGHTH, LOW_EIGHTHS)
    return a, b, c, d, e, f, g, h


@njit(inline="always")
def swap(upper, lower, shift, mask):  # type: ignore[no-untyped-def]
    """Exchange the parts of the upper word above the shift with those of the lower word below it."""
    moved = ((upper >> shift) ^ lower) & mask
    return upper ^ (moved << shift), lower ^ moved


@njit(**LEAF)
def place_squares(room, target):  # type: ignore[no-untyped-def]
    """Put word w of turned row k of every group into row 8 w + k of the target."""
    for word in range(WORDS):
        for k in range(WORDS):
            row = target[WORDS * word + k]
            for group in range(WORDS):
                row[group] = room[group, k, word]
