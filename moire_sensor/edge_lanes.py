"""Bands of rows: each is worked through by one thread, with row buffers of its own, from top to bottom."""

from __future__ import annotations

import numpy as np
from numba import njit

LANES = 8
# Rows that one vector of the processor takes at once, and numbers of a row.
ABREAST, TOGETHER = 8, 16


def whole_vectors(number: int) -> int:
    """Room for so many numbers in whole vectors."""
    return TOGETHER * -(-number // TOGETHER)


@njit(inline="always")
def vectors_of(number):  # type: ignore[no-untyped-def]
    """Vectors that hold so many numbers."""
    return (np.int64(number) + TOGETHER - 1) // TOGETHER


@njit(inline="always")
def lane_rows(lane, height):  # type: ignore[no-untyped-def]
    """First row of a lane, and the first behind it."""
    return np.int64(lane) * height // LANES, (np.int64(lane) + 1) * height // LANES


@njit(inline="always")
def lane_blocks(lane, height, every_row):  # type: ignore[no-untyped-def]
    """First block of a lane, and the first behind it: as many rows as go abreast, and those between them."""
    return lane_rows(lane, (height + ABREAST * every_row - 1) // (ABREAST * every_row))


@njit(inline="always")
def block_rows(block, height, every_row):  # type: ignore[no-untyped-def]
    """First row of a block, and the first behind it."""
    return block * ABREAST * every_row, min((block + 1) * ABREAST * every_row, height)
