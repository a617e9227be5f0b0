"""Rows of edges side by side, so that the dynamic programme takes one step in all of them at once.

They are rows next to each other: edge i of one lies near edge i of the next, and their matches in much the same band.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.apart import ROW, UNCOUNTED
from moire_sensor.edge_lanes import ABREAST

NAN, ENDLESS_PX = np.float32(np.nan), np.float32(np.inf)


class Abreast(NamedTuple):
    """Edges of one image in some rows, one such block a thread: (threads, E, rows); edges that a row lacks lie nowhere.

    Attributes
    ----------
    x_px : float32, column, negative where the edge goes down; NaN where there is none.
    behind : int64, what an occlusion behind the edge adds to J if none follows: 0 behind the last.
    least, most : (threads, E) float32, ends of the columns of edges i in all rows.
    """

    x_px: npt.NDArray[np.float32]
    behind: npt.NDArray[np.int64]
    least: npt.NDArray[np.float32]
    most: npt.NDArray[np.float32]


class Band(NamedTuple):
    """Left edges ``low`` to ``high`` that lie in the depth range of right edge j in any row, (threads, E) int64.

    ``cell`` + i is the place of (j, i) in the table of the programme; place 0 is none's.
    """

    low: npt.NDArray[np.int64]
    high: npt.NDArray[np.int64]
    cell: npt.NDArray[np.int64]


@njit(**UNCOUNTED)
def line_up(x_px, side, number, rows, lambda_oc, to_x, behind, least, most):  # type: ignore[no-untyped-def]
    """Lay the edges of rows (n,) side by side; the most edges of one."""
    count = np.int64(0)
    for y in rows:
        count = max(count, number[y])
    fill(to_x[:count], NAN)
    fill(behind[:count], lambda_oc)
    least[:count], most[:count] = ENDLESS_PX, -ENDLESS_PX
    for r in range(rows.size):
        y, n = rows[r], number[rows[r]]
        lay(x_px[y, :n], side[y], to_x[:, r])
        widen(x_px[y, :n], least, most)
        if n > 0:
            behind[n - 1, r] = 0
    return count


@njit(**ROW)
def fill(rows, value):  # type: ignore[no-untyped-def]
    """Set all numbers of rows abreast."""
    numbers = rows.reshape(rows.size)
    for place in range(numbers.size):
        numbers[place] = value


@njit(**ROW)
def lay(x_px, side, to_x):  # type: ignore[no-untyped-def]
    """Put a row into its place among those abreast."""
    for i in range(np.uint64(x_px.size)):
        to_x[i] = x_px[i] if side[i] > 0 else -x_px[i]


@njit(**ROW)
def widen(x_px, least, most):  # type: ignore[no-untyped-def]
    """Take a row into the ends of the columns."""
    for i in range(x_px.size):
        least[i] = x_px[i] if x_px[i] < least[i] else least[i]
    for i in range(x_px.size):
        most[i] = x_px[i] if x_px[i] > most[i] else most[i]


@njit(**UNCOUNTED)
def find_band(n, m, left_least, left_most, right_least, right_most, rules, low, high, cell):  # type: ignore[no-untyped-def]
    """Fill the band (constraint 1) of right edges 0 to m and left edges 0 to n; the cells it takes."""
    nearest, farthest = np.float32(rules.nearest), np.float32(rules.farthest)
    begin, end, cells = np.int64(0), np.int64(0), np.int64(1)
    for j in range(m):
        while end < n and left_least[end] - right_most[j] <= nearest:
            end += 1
        while begin < end and left_most[begin] - right_least[j] < farthest:
            begin += 1
        low[j], high[j], cell[j] = begin, end, cells - begin
        cells += end - begin
    return cells


def rows_abreast(shape: tuple[int, ...]) -> Abreast:
    """Memory for edges (threads, E) in as many rows as go abreast."""
    abreast = (*shape, ABREAST)
    return Abreast(
        np.empty(abreast, dtype=np.float32), np.empty(abreast, dtype=np.int64), np.empty(shape, dtype=np.float32),
        np.empty(shape, dtype=np.float32),
    )  # fmt: skip
