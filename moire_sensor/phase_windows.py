"""Which window a pixel takes, of the fifteen around it (symmetric multiple windows), and what follows for its phase."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE, wrap
from moire_sensor.phase_fit import (
    ALONG,
    AMPLITUDE,
    BACKGROUND,
    CARRIED,
    DOWN,
    FAST,
    OFFSET,
    UNUSABLE,
    VARIANCE,
    slopes,
)
from moire_sensor.shot import Status

# A shifted window is taken only when it fits clearly better: the variance of a fit over 85 samples scatters by 16 %.
SHIFT_PENALTY = (1.0, 1.5, 2.0)
PLAIN, NEAR, FAR = (np.float32(penalty) for penalty in SHIFT_PENALTY)
SATURATED = np.float32(254.5)
OK, DARK, FULL = (np.uint8(status) for status in (Status.OK, Status.UNLIT, Status.SATURATED))
NAN, TINY = np.float32(np.nan), np.float32(1e-9)
# The four lowest bits of a variance, one part in 500,000, give way to the number of its window.
NUMBERS = np.int32(15)
CENTRED = 7
LAST_KEY = np.int32((UNUSABLE.view(np.int32) & ~NUMBERS) | CENTRED)


@njit(parallel=True, cache=True, **FAST)
def slopes_down(planes, pad_y, step):  # type: ignore[no-untyped-def]
    """Fill the plane DOWN, derivative of the offset along y, from windows one and two steps above and below."""
    offset, variance = planes[OFFSET], planes[VARIANCE]
    for row in prange(planes.shape[1] - 2 * pad_y):
        y = np.int64(row) + pad_y
        slopes(
            offset[y - 2 * step], offset[y - step], offset[y], offset[y + step], offset[y + 2 * step],
            variance[y - 2 * step], variance[y - step], variance[y], variance[y + step], variance[y + 2 * step],
            np.float32(0.5 / step), planes[DOWN, y],
        )  # fmt: skip


@njit(parallel=True, cache=True, **FAST)
def pick_windows(  # type: ignore[no-untyped-def]
    image, planes, pad_y, pad_x, shift_y, shift_x, good, step_rad, smallest, ratio, samples,
    offset, background, amplitude, sigma, status,
):  # fmt: skip
    """Fill offset, background, amplitude, sigma and status (H, W) from the window around each pixel that fits best.

    Of the windows whose centres lie ``shift_y`` (3,) and ``shift_x`` (5,) away the one that fits best is taken. One
    centred on the pixel whose variance is below ``good`` needs no rival.
    """
    height, width = image.shape
    for row in prange(height):
        y = np.int64(row)
        at, end = y + pad_y, pad_x + width
        offset[y] = planes[CARRIED, at][pad_x:end]
        background[y] = planes[BACKGROUND, at][pad_x:end]
        amplitude[y] = planes[AMPLITUDE, at][pad_x:end]
        variance = planes[VARIANCE, at][pad_x:end].copy()
        number = np.empty(width, dtype=np.int32)
        best_numbers(planes[VARIANCE], at, pad_x, shift_y, shift_x, number)
        take_shifted(
            planes, at, pad_x, shift_y, shift_x, number, good, offset[y], background[y], amplitude[y], variance
        )  # fmt: skip
        judge(image[y], amplitude[y], variance, smallest, ratio, status[y])
        phase_noise(amplitude[y], variance, np.float32(np.sqrt(2.0 / samples)), sigma[y])
        known(offset[y], step_rad, status[y])


@njit(**FAST)
def best_numbers(variance, y, pad_x, shift_y, shift_x, number):  # type: ignore[no-untyped-def]
    """Number 0 to 14, row by row, of the window that fits best."""
    number[:] = LAST_KEY
    for j in range(3):
        row = variance[y + shift_y[j]]
        centre = PLAIN if j == 1 else NEAR
        challenge(
            row[pad_x + shift_x[0] :], row[pad_x + shift_x[1] :], row[pad_x:], row[pad_x + shift_x[3] :],
            row[pad_x + shift_x[4] :], centre, np.int32(5 * j), number,
        )  # fmt: skip
    for x in range(number.size):
        number[x] &= NUMBERS


@njit(**FAST)
def challenge(far_left, left, here, right, far_right, centre, first, key):  # type: ignore[no-untyped-def]
    """Smallest key so far and of five windows of one row: bits of the penalised variance, its lowest four the number.

    The bits of positive floats are ordered as the floats are.
    """
    for x in range(key.size):
        key_0 = (np.float32(FAR * far_left[x]).view(np.int32) & ~NUMBERS) | first
        key_1 = (np.float32(NEAR * left[x]).view(np.int32) & ~NUMBERS) | (first + np.int32(1))
        key_2 = (np.float32(centre * here[x]).view(np.int32) & ~NUMBERS) | (first + np.int32(2))
        key_3 = (np.float32(NEAR * right[x]).view(np.int32) & ~NUMBERS) | (first + np.int32(3))
        key_4 = (np.float32(FAR * far_right[x]).view(np.int32) & ~NUMBERS) | (first + np.int32(4))
        key[x] = min(key[x], min(min(key_0, key_1), min(key_2, min(key_3, key_4))))


@njit(**FAST)
def take_shifted(planes, y, pad_x, shift_y, shift_x, number, good, offset, background, amplitude, variance):  # type: ignore[no-untyped-def]
    """Where the centred window does not fit, carry the phase of the best one to the pixel along its slopes."""
    for x in range(number.size):
        if variance[x] > good and number[x] != CENTRED:
            down, along = shift_y[number[x] // 5], shift_x[number[x] % 5]
            at_y, at_x = y + down, pad_x + x + along
            offset[x] = (
                planes[CARRIED, at_y, at_x]
                - np.float32(along) * planes[ALONG, at_y, at_x]
                - np.float32(down) * planes[DOWN, at_y, at_x]
            )
            background[x] = planes[BACKGROUND, at_y, at_x]
            amplitude[x] = planes[AMPLITUDE, at_y, at_x]
            variance[x] = planes[VARIANCE, at_y, at_x]


@njit(**FAST)
def judge(image, amplitude, variance, smallest, ratio, status):  # type: ignore[no-untyped-def]
    """Status of each pixel: dark or saturated where the amplitude is small beside the noise."""
    for x in range(status.size):
        limit = max(smallest, ratio * np.sqrt(variance[x]))
        unlit = FULL if image[x] >= SATURATED else DARK
        status[x] = OK if amplitude[x] > limit else unlit


@njit(**FAST)
def phase_noise(amplitude, variance, factor, sigma):  # type: ignore[no-untyped-def]
    """Standard deviation of the phase from the variance of the residual."""
    for x in range(sigma.size):
        sigma[x] = np.sqrt(variance[x]) * factor / max(amplitude[x], TINY)


@njit(fastmath=NAN_SAFE)
def known(offset, step_rad, status):  # type: ignore[no-untyped-def]
    """Offset less the step's phase, wrapped; NaN where the status tells that there is none."""
    for x in range(offset.size):
        folded = wrap(offset[x] - step_rad)
        offset[x] = folded if status[x] == OK else NAN
