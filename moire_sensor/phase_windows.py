"""Which window a pixel takes, of the fifteen around it (symmetric multiple windows), and what follows for its phase."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.angles import wrap
from moire_sensor.apart import FAST, LEAF, LEAF_FAST
from moire_sensor.phase_planes import ALONG, AMPLITUDE, BACKGROUND, CARRIED, DOWN, UNUSABLE, VARIANCE
from moire_sensor.phase_sums import copy
from moire_sensor.shot import Status

# A shifted window is taken only when it fits clearly better: the variance of a fit over 85 samples scatters by 16 %.
SHIFT_PENALTY = (1.0, 1.5, 2.0)
PLAIN, NEAR, FAR = (np.float32(penalty) for penalty in SHIFT_PENALTY)
SATURATED = np.float32(254.5)
OK, DARK, FULL = (np.uint8(status) for status in (Status.OK, Status.UNLIT, Status.SATURATED))
NAN, TINY = np.float32(np.nan), np.float32(1e-9)
# The four lowest bits of a variance give way to the number 0 to 14 of its window.
NUMBERS = np.int32(15)
CENTRED = 7
LAST_KEY = np.int32((UNUSABLE.view(np.int32) & ~NUMBERS) | CENTRED).view(np.float32)


class Choice(NamedTuple):
    """How pixels choose their windows: rows and columns (15,) to the centres, and from what amplitude they are lit."""

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    step_rad: np.float32
    min_amplitude: np.float32
    min_amplitude_to_noise: np.float32
    sigma_factor: np.float32


class Room(NamedTuple):
    """Memory for the choice of one row: best variances, numbers of their windows; where windows start and lie."""

    key: npt.NDArray[np.float32]
    number: npt.NDArray[np.uint8]
    starts: npt.NDArray[np.int64]
    away: npt.NDArray[np.float32]


@njit(**FAST)
def room_for(width):  # type: ignore[no-untyped-def]
    """Room for rows of ``width`` pixels."""
    number = np.zeros((width + 7) // 8 * 8, dtype=np.uint8)
    key, starts, away = np.empty(width, dtype=np.float32), np.empty(15, dtype=np.int64), np.empty((2, 15), np.float32)
    return Room(key, number, starts, away)


@njit(**LEAF_FAST)
def pick_row(image, planes, y, choice, room, good, offset, background, amplitude, sigma, status):  # type: ignore[no-untyped-def]
    """Fill one image row of offset, background, amplitude, sigma and status from the window that fits best.

    A window centred on the pixel whose variance is at most ``good`` needs no rival.
    """
    width = image.size
    first = (planes.shape[2] - width) // 2
    key, number = room.key, room.number
    row = y % planes.shape[1]
    copy(planes[CARRIED, row][first:], offset)
    copy(planes[BACKGROUND, row][first:], background)
    copy(planes[AMPLITUDE, row][first:], amplitude)
    copy(planes[VARIANCE, row][first:], sigma)
    best_numbers(planes[VARIANCE], y, first, choice, good, key, number)
    take_shifted(planes, y, first, choice, room.starts, room.away, number, offset, background, amplitude, sigma)
    judge(
        image, amplitude, choice.min_amplitude, choice.min_amplitude_to_noise, choice.sigma_factor, choice.step_rad,
        offset, sigma, status,
    )  # fmt: skip


@njit(**LEAF_FAST)
def best_numbers(variance, y, first, choice, good, key, number):  # type: ignore[no-untyped-def]
    """Number 1 to 15 of the shifted window that fits best, 0 for the centred one; ``key`` is room for a row."""
    key[:] = LAST_KEY
    far_left, left, right, far_right = choice.columns[0], choice.columns[1], choice.columns[3], choice.columns[4]
    for j in range(3):
        row = variance[(y + choice.rows[5 * j]) % variance.shape[0]]
        centre = PLAIN if j == 1 else NEAR
        challenge(
            row[first + far_left :], row[first + left :], row[first:], row[first + right :], row[first + far_right :],
            centre, np.int32(5 * j), key,
        )  # fmt: skip
    own = variance[y % variance.shape[0]][first:]
    for x in range(key.size):
        best = np.float32(key[x]).view(np.int32) & NUMBERS
        number[x] = np.uint8(best ^ CENTRED if own[x] > good else 0)


@njit(inline="always", **FAST)
def numbered(variance, number):  # type: ignore[no-untyped-def]
    """A variance whose lowest four bits say which window it is of: as good to compare, one part in 500,000 aside."""
    return np.int32((np.float32(variance).view(np.int32) & ~NUMBERS) | number).view(np.float32)


@njit(**LEAF_FAST)
def challenge(far_left, left, here, right, far_right, centre, first, key):  # type: ignore[no-untyped-def]
    """Smallest penalised variance so far and of five windows of one row, each numbered."""
    for x in range(key.size):
        key_0 = numbered(FAR * far_left[x], first)
        key_1 = numbered(NEAR * left[x], first + np.int32(1))
        key_2 = numbered(centre * here[x], first + np.int32(2))
        key_3 = numbered(NEAR * right[x], first + np.int32(3))
        key_4 = numbered(FAR * far_right[x], first + np.int32(4))
        key[x] = min(key[x], min(min(key_0, key_1), min(key_2, min(key_3, key_4))))


@njit(**LEAF_FAST)
def take_shifted(  # type: ignore[no-untyped-def]
    planes, y, first, choice, starts, away, number, offset, background, amplitude, variance
):
    """Where a shifted window is chosen, carry its phase to the pixel along its slopes."""
    flat = planes.reshape((planes.shape[0], planes.shape[1] * planes.shape[2]))
    carried, along, down = flat[CARRIED], flat[ALONG], flat[DOWN]
    backgrounds, amplitudes, variances = flat[BACKGROUND], flat[AMPLITUDE], flat[VARIANCE]
    for k in range(15):
        starts[k] = (y + choice.rows[k]) % planes.shape[1] * planes.shape[2] + choice.columns[k] + first
        away[0, k], away[1, k] = np.float32(choice.columns[k]), np.float32(choice.rows[k])
    eights = number.view(np.uint64)
    for eight in range(eights.size):
        if eights[eight] == 0:  # most of them, looked at together
            continue
        for x in range(8 * eight, 8 * eight + 8):
            if number[x] != 0:
                which = np.uint64(number[x] ^ CENTRED)
                at = np.uint64(starts[which] + x)
                offset[x] = carried[at] - away[0, which] * along[at] - away[1, which] * down[at]
                background[x], amplitude[x], variance[x] = backgrounds[at], amplitudes[at], variances[at]


@njit(**LEAF)
def judge(image, amplitude, smallest, ratio, factor, step_rad, offset, sigma, status):  # type: ignore[no-untyped-def]
    """Status of each pixel, dark or saturated where the amplitude is small beside the noise, and what follows.

    The variance of the residual becomes the standard deviation of the phase; the offset loses the step's phase, and is
    NaN where there is none.
    """
    for x in range(status.size):
        noise = np.sqrt(sigma[x])
        lit = amplitude[x] > max(smallest, ratio * noise)
        unlit = FULL if image[x] >= SATURATED else DARK
        status[x] = OK if lit else unlit
        sigma[x] = noise * factor / max(amplitude[x], TINY)
        offset[x] = wrap(offset[x] - step_rad) if lit else NAN
