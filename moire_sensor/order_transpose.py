"""Transposition of small whole numbers, eight bytes to a word: programmes along rows then advance whole columns."""

from __future__ import annotations

import numpy as np
from numba import njit

HALF, QUARTER, EIGHTH = np.uint64(32), np.uint64(16), np.uint64(8)
LOW_HALF, LOW_QUARTERS = np.uint64(0x00000000FFFFFFFF), np.uint64(0x0000FFFF0000FFFF)
LOW_EIGHTHS = np.uint64(0x00FF00FF00FF00FF)


@njit(inline="always")
def swap(upper, lower, shift, mask):  # type: ignore[no-untyped-def]
    """Exchange the parts of the upper word above the shift with those of the lower word below it."""
    moved = ((upper >> shift) ^ lower) & mask
    return upper ^ (moved << shift), lower ^ moved


@njit(cache=True)
def transpose_bytes(source, first, target):  # type: ignore[no-untyped-def]
    """Fill ``target[x, row]`` with ``source[first + row, x]``, bytes, for as many rows as it holds.

    Both are words of eight bytes along their last axis: ``source`` (rows, width / 8), ``target`` (width, rows / 8).
    Squares of 8 by 8 bytes are turned by exchanging quarters, then quarters of quarters, then bytes.
    """
    for group in range(target.shape[1]):
        row = first + 8 * group
        for word in range(target.shape[0] // 8):
            a, b, c, d = source[row, word], source[row + 1, word], source[row + 2, word], source[row + 3, word]
            e, f, g, h = source[row + 4, word], source[row + 5, word], source[row + 6, word], source[row + 7, word]
            a, e = swap(a, e, HALF, LOW_HALF)
            b, f = swap(b, f, HALF, LOW_HALF)
            c, g = swap(c, g, HALF, LOW_HALF)
            d, h = swap(d, h, HALF, LOW_HALF)
            a, c = swap(a, c, QUARTER, LOW_QUARTERS)
            b, d = swap(b, d, QUARTER, LOW_QUARTERS)
            e, g = swap(e, g, QUARTER, LOW_QUARTERS)
            f, h = swap(f, h, QUARTER, LOW_QUARTERS)
            x = 8 * word
            target[x, group], target[x + 1, group] = swap(a, b, EIGHTH, LOW_EIGHTHS)
            target[x + 2, group], target[x + 3, group] = swap(c, d, EIGHTH, LOW_EIGHTHS)
            target[x + 4, group], target[x + 5, group] = swap(e, f, EIGHTH, LOW_EIGHTHS)
            target[x + 6, group], target[x + 7, group] = swap(g, h, EIGHTH, LOW_EIGHTHS)


@njit(cache=True)
def transpose_back(source, target, first):  # type: ignore[no-untyped-def]
    """Fill ``target[first + row, x]`` with ``source[x, row]``, numbers of two bytes, for as many rows as that holds.

    Both are words of four numbers along their last axis: ``source`` (width, rows / 4), ``target`` (rows, width / 4).
    """
    for group in range(source.shape[1]):
        for word in range(source.shape[0] // 4):
            x = 4 * word
            a, b, c, d = source[x, group], source[x + 1, group], source[x + 2, group], source[x + 3, group]
            a, c = swap(a, c, HALF, LOW_HALF)
            b, d = swap(b, d, HALF, LOW_HALF)
            row = first + 4 * group
            target[row, word], target[row + 1, word] = swap(a, b, QUARTER, LOW_QUARTERS)
            target[row + 2, word], target[row + 3, word] = swap(c, d, QUARTER, LOW_QUARTERS)
