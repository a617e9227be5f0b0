"""What the right image shows at a fractional column."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import wrap

REACH_PX = 4


@njit(inline="always", fastmath=False)
def right_phase(offset, carrier_rad, y, column):  # type: ignore[no-untyped-def]
    """Absolute right phase at a fractional column and its slope; nearest pixel across an edge; NaN where unknown."""
    left = min(int(max(column, np.float32(0.0))), offset.shape[1] - 2)
    part = np.float32(column - left)
    carrier_step = carrier_rad[y, left + 1] - carrier_rad[y, left]
    carrier = carrier_rad[y, left] + part * carrier_step
    near, far = offset[y, left], offset[y, left + 1]
    step = wrap(far - near)
    if np.isnan(step) or abs(step) > np.float32(0.5):
        return carrier + (near if part < np.float32(0.5) else far), carrier_step
    return carrier + near + part * step, carrier_step + step


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
