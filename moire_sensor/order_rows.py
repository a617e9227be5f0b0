"""Orders of the rows between those that were solved: each pixel continues the surface above it or below it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import ROW
from moire_sensor.order_step import ANEW, label_step

NONE = np.int8(-1)


def solved_rows(height: int, step: int) -> npt.NDArray[np.int64]:
    """Every ``step``-th row (n,) of an image, as far from its first row as from its last."""
    return np.arange((height - 1) % step // 2, height, step, dtype=np.int64)


@njit(parallel=True, cache=True)
def fill_rows(  # type: ignore[no-untyped-def]
    offset, rows, labels, some_label, some_second, some_margin, label, second, margin
):
    """Fill label, second and margin (H, W) from those of the solved ``rows``.

    Where the surfaces above and below disagree, the nearer one is the first choice and the other the second, without
    any margin.
    """
    for row in prange(offset.shape[0]):
        y = np.int64(row)
        above = max((y - rows[0]) // (rows[1] - rows[0]), 0) if rows.size > 1 else 0
        below = min(above + 1, rows.size - 1) if rows[above] < y else above
        near, far = (above, below) if y - rows[above] <= rows[below] - y else (below, above)
        between(
            offset[y], offset[rows[near]], offset[rows[far]], np.int8(labels), some_label[near],
            some_label[far], some_second[near], some_second[far], some_margin[near], some_margin[far],
            label[y], second[y], margin[y],
        )  # fmt: skip


@njit(**ROW)
def between(  # type: ignore[no-untyped-def]
    here, near, far, labels, near_label, far_label, near_second, far_second, near_margin, far_margin,
    label, second, margin,
):  # fmt: skip
    """One row of :func:`fill_rows`, between a nearer and a farther one; on a solved row both are the row itself."""
    for x in range(label.size):
        one = continued(here[x], near[x], near_label[x], labels)
        other = continued(here[x], far[x], far_label[x], labels)
        one_second = continued(here[x], near[x], near_second[x], labels)
        other_second = continued(here[x], far[x], far_second[x], labels)
        differ = (one >= 0) & (other >= 0) & (one != other)
        label[x] = one if one >= 0 else other
        next_ = one_second if one >= 0 else other_second
        second[x] = other if differ else next_ if label[x] >= 0 else NONE
        less = near_margin[x] if near_margin[x] < far_margin[x] else far_margin[x]
        known = less if (one >= 0) & (other >= 0) else near_margin[x] if one >= 0 else far_margin[x]
        margin[x] = np.float32(0.0) if differ | ((one < 0) & (other < 0)) else known


@njit(inline="always")
def continued(here, before, label, labels):  # type: ignore[no-untyped-def]
    """Label that continues the surface of a pixel above or below, NONE where there is none."""
    step = label_step(here, before)
    value = np.int8(label - step)
    valid = (step != ANEW) & (label >= 0) & (value >= 0) & (value < labels)
    return value if valid else NONE
