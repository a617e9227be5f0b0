"""What the right image shows at a fractional column."""

from __future__ import annotations

import numpy as np
from numba import njit

REACH_PX = 4


@njit(inline="always", fastmath=False)
def difference(left, right, y, x, column, reach):  # type: ignore[no-untyped-def]
    """Mean absolute difference of grey levels between left pixels around x and right pixels around a column."""
    width = left.shape[1]
    base = int(np.floor(column))
    part = np.float32(column - base)
    total = np.float32(0.0)
    count = 0
    for shift in range(-reach, reach + 1, 2):
        at = base + shift
        if 0 <= x + shift < width and 0 <= at < width - 1:
            seen = right[y, at] + part * (right[y, at + 1] - right[y, at])
            total += abs(left[y, x + shift] - seen)
            count += 1
    return total / np.float32(count) if count > 1 else np.float32(np.inf)
