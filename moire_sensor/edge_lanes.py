"""Bands of rows: each is worked through by one thread, with row buffers of its own, from top to bottom."""

from __future__ import annotations

import numpy as np
from numba import njit

LANES = 8
# Rows that one vector of the processor takes at once.
ABREAST = 8


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
