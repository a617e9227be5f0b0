"""How the numbers of every order of every pixel lie in memory: strips of 64 columns, in each line by line, all labels.

Loops over the 64 lanes of a strip have a length that the compiler knows, and what one step of a programme reads and
writes lies together. The rows of one strip fit into a core's cache.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.apart import LEAF

UInt8 = npt.NDArray[np.uint8]
LANES = 64


def strips_of(width: int) -> int:
    """Number of strips that an image is wide."""
    return -(-width // LANES)


def tiles_for(rows: int, width: int, labels: int) -> UInt8:
    """Zeros (strips, lines, labels, LANES), lines rounded up to whole strips too; numpy may reread them as words."""
    return np.zeros((strips_of(width), LANES * strips_of(rows), labels, LANES), dtype=np.uint8)


def as_rows(tiles: UInt8, rows: int, width: int) -> UInt8:
    """A copy in the usual order, (rows, labels, columns)."""
    plain = tiles.transpose(1, 2, 0, 3).reshape(tiles.shape[1], tiles.shape[2], -1)
    return np.ascontiguousarray(plain[:rows, :, :width])


@njit(**LEAF)
def put_line(values, tiles):  # type: ignore[no-untyped-def]
    """Put one line of ``values`` (labels, strips, LANES) into its place in every strip, (strips, labels, LANES)."""
    for strip in range(tiles.shape[0]):
        for label in range(tiles.shape[1]):
            source, target = values[label, strip], tiles[strip, label]
            for lane in range(LANES):
                target[lane] = source[lane]
