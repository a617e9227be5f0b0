"""Angle helpers; the compiled ones inline into the kernels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

TWO_PI = np.float32(2.0 * np.pi)
TURNS_PER_RAD = np.float32(0.5 / np.pi)
PI = np.float32(np.pi)
HALF_PI = np.float32(np.pi / 2.0)
# Odd minimax polynomial of atan on 0..1, largest error 2e-6 rad, far below the phase noise floor of 3e-3 rad.
ATAN = tuple(
    np.float32(c) for c in (0.99997726, -0.33262347, 0.19354346, -0.11643287, 0.05265332, -0.01172120)
)


@njit(inline="always", fastmath=True)
def fast_atan2(y, x):  # type: ignore[no-untyped-def]
    """atan2 of float32 values without branches."""
    absolute_x = abs(x)
    absolute_y = abs(y)
    low = min(absolute_x, absolute_y)
    high = max(absolute_x, absolute_y)
    ratio = low / max(high, np.float32(1e-20))
    square = ratio * ratio
    angle = ATAN[5]
    angle = angle * square + ATAN[4]
    angle = angle * square + ATAN[3]
    angle = angle * square + ATAN[2]
    angle = angle * square + ATAN[1]
    angle = (angle * square + ATAN[0]) * ratio
    angle = HALF_PI - angle if absolute_y > absolute_x else angle
    angle = PI - angle if x < np.float32(0.0) else angle
    return -angle if y < np.float32(0.0) else angle


@njit(inline="always", fastmath=True)
def wrap(angle):  # type: ignore[no-untyped-def]
    """Angle folded to -pi..pi."""
    return angle - TWO_PI * np.floor(angle * TURNS_PER_RAD + np.float32(0.5))


def wrapped(angle_rad: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Angles of any shape folded to -pi..pi."""
    return np.asarray(angle_rad - TWO_PI * np.floor(angle_rad * TURNS_PER_RAD + np.float32(0.5)), dtype=np.float32)
