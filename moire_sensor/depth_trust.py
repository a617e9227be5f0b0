"""Which pixels can be trusted, which lie near them, and what the right image shows of their surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE
from moire_sensor.depth_claims import claim_both
from moire_sensor.depth_offer import NO_CLAIM, RIM_PX
from moire_sensor.depth_runs import TASKS
from moire_sensor.phase_carrier import Float32
from moire_sensor.scratch import scratch

JUMP_PX = np.float32(1.0)
# Only pixels so near to a trusted one are looked at; along the row a plane is carried further, across a shadow.
REACH_PX, ROW_REACH_PX = 14, 80
# Unknown pixels are looked at so much further along the row.
HOLE_REACH_PX = 6
FAR = np.uint8(REACH_PX + 1)
# Columns that one task follows from row to row.
BLOCK_PX = 64

Flags = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Trust:
    """Work memory of a round, arrays (H, W).

    Attributes
    ----------
    disparity : float32, disparities at the begin of the round, NaN where unknown.
    trust : uint8, 1 for pixels with a disparity and neither jump nor hole within ``RIM_PX``.
    fresh : uint8, 1 for those that were not trusted in the round before.
    near : uint8, 2 within ``REACH_PX`` of a fresh one in both directions, 1 within ``HOLE_REACH_PX`` more of the row.
    above, below : uint8, rows to the nearest trusted pixel of the column, ``FAR`` where none lies in reach.
    claim : float32, disparity of the nearest trusted surface that each right pixel shows, ``NO_CLAIM`` where none.
    """

    disparity: Float32
    trust: Flags
    fresh: Flags
    near: Flags
    above: Flags
    below: Flags
    claim: Float32

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> Trust:
        """Return this thread's work memory, with nothing trusted."""
        room = scratch(("trust", shape), lambda: cls.make(shape))
        room.trust[:] = 0
        return room

    @classmethod
    def make(cls, shape: tuple[int, ...]) -> Trust:
        """Return new work memory."""
        disparity, claim = np.empty((2, *shape), dtype=np.float32)
        trust, fresh, near, above, below = np.zeros((5, *shape), dtype=np.uint8)
        return cls(disparity, trust, fresh, near, above, below, claim)

    def look(self, disparity_px: Float32) -> None:
        """Fill all for the disparities (H, W) of a new round."""
        np.copyto(self.disparity, disparity_px)
        mark_calm(self.disparity, self.above)
        cv2.erode(self.above, square(RIM_PX), dst=self.below)
        np.greater(self.below, self.trust, out=self.fresh.view(np.bool_))
        np.copyto(self.trust, self.below)
        cv2.dilate(self.fresh, square(REACH_PX), dst=self.near)
        cv2.dilate(self.near, np.ones((1, 2 * HOLE_REACH_PX + 1), dtype=np.uint8), dst=self.above)
        np.add(self.near, self.above, out=self.near)
        fill_rows_away(self.trust, self.above, self.below)
        fill_claims(self.disparity, self.trust, self.claim)


def square(reach: int) -> Flags:
    """Window of ``reach`` pixels on all sides of its middle."""
    return np.ones((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def mark_calm(disparity, calm):  # type: ignore[no-untyped-def]
    """Fill ``calm`` (H, W): 1 where a pixel and its right and lower neighbour are known and lie on one surface."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        here, below = disparity[y], disparity[min(y + 1, height - 1)]
        for x in range(width - 1):
            calm[y, x] = (abs(here[x + 1] - here[x]) <= JUMP_PX) & (abs(below[x] - here[x]) <= JUMP_PX)
        calm[y, width - 1] = abs(below[width - 1] - here[width - 1]) <= JUMP_PX


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def fill_rows_away(trust, above, below):  # type: ignore[no-untyped-def]
    """Fill ``above`` and ``below`` (H, W) with the rows to the nearest trusted pixel, at most ``FAR``."""
    height, width = trust.shape
    for block in prange((width + BLOCK_PX - 1) // BLOCK_PX):
        first = np.int64(block) * BLOCK_PX
        part = slice(first, min(first + BLOCK_PX, width))
        above[0, part] = FAR
        for y in range(1, height):
            step_away(trust[y - 1, part], above[y - 1, part], above[y, part])
        below[height - 1, part] = FAR
        for y in range(height - 2, -1, -1):
            step_away(trust[y + 1, part], below[y + 1, part], below[y, part])


@njit(inline="always", fastmath=False)
def step_away(trust, before, away):  # type: ignore[no-untyped-def]
    """Fill the distances of a row from those of the row before."""
    for x in range(trust.size):
        further = np.uint8(before[x] + np.uint8(1))
        further = further if further < FAR else FAR
        away[x] = np.uint8(1) if trust[x] else further


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def fill_claims(disparity, trust, claim):  # type: ignore[no-untyped-def]
    """Fill ``claim`` (H, W): trusted pixels claim the two right pixels they fall between."""
    height, width = disparity.shape
    for task in prange(TASKS):
        columns, seen = np.empty(width + 2, dtype=np.int32), np.empty(width + 2, dtype=np.float32)
        for y in range(np.int64(task), height, TASKS):
            claim_both(disparity[y], trust[y], NO_CLAIM, columns, seen, claim[y])
