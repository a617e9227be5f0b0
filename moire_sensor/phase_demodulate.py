"""Shifted frames into phase, row by row: every quantity is one fixed filter along the frames, or a square of one."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.angles import fast_atan2, wrap
from moire_sensor.apart import FAST, NAN_SAFE
from moire_sensor.phase_windows import DARK, FULL, NAN, OK, SATURATED, TINY
from moire_sensor.shot import Status

MOVED = np.uint8(Status.MOVED)


@njit(parallel=True, cache=True, **FAST)
def demodulate(  # type: ignore[no-untyped-def]
    frames, filters, moments, bend, carrier_rad, offset, background, amplitude, squares, cross, along, status
):
    """Fill all but sigma: squares that the fit leaves over, drift as phasor (along, cross), status if saturated.

    Where there is one moment only, nothing tells of drift, and its phasor is not filled.
    ``bend`` tells what the second harmonic of gamma adds to each residue, per amplitude: it is no noise.
    """
    for row in prange(frames.shape[1]):
        y = np.int64(row)
        demodulate_row(
            frames, y, filters, moments, bend, carrier_rad[y], offset[y], background[y], amplitude[y], squares[y],
            cross[y], along[y], status[y],
        )  # fmt: skip


@njit(**FAST)
def demodulate_row(  # type: ignore[no-untyped-def]
    frames, y, filters, moments, bend, carrier_rad, offset, background, amplitude, squares, cross, along, status
):
    """One row of :func:`demodulate`."""
    room = np.empty((6, carrier_rad.size), dtype=np.float32)
    real, imaginary, before, after, even, odd = room[0], room[1], room[0:2], room[2:4], room[4], room[5]
    filtered(frames, y, filters[0], background)
    filtered(frames, y, filters[1], real)
    filtered(frames, y, filters[2], imaginary)
    polar(real, imaginary, carrier_rad, offset, amplitude)
    if bend.any():
        twice(real, imaginary, amplitude, even, odd)
    squares[:] = 0.0
    for index in range(3 + 2 * moments, filters.shape[0]):
        filtered(frames, y, filters[index], real)
        share = bend[index - 3 - 2 * moments]
        if share != 0.0:
            take_away(even, odd, share.real, share.imag, real)
        add_square(real, squares)
    if moments > 1:
        cross[:] = 0.0
        along[:] = 0.0
        filtered(frames, y, filters[3], before[0])
        filtered(frames, y, filters[4], before[1])
    for index in range(5, 3 + 2 * moments, 2):
        filtered(frames, y, filters[index], after[0])
        filtered(frames, y, filters[index + 1], after[1])
        add_turn(before[0], before[1], after[0], after[1], cross, along)
        before, after = after, before
    mark_saturated(frames, y, real, status)


@njit(**FAST)
def filtered(frames, y, weights, target):  # type: ignore[no-untyped-def]
    """Weighted sum of row y of the frames (n, H, W), five at a time."""
    target[:] = 0.0
    last = frames.shape[0] - 1
    for first in range(0, frames.shape[0], 5):
        second, third, fourth, fifth = first + 1, first + 2, first + 3, first + 4
        add_five(
            frames[first, y], frames[min(second, last), y], frames[min(third, last), y], frames[min(fourth, last), y],
            frames[min(fifth, last), y], weights[first], weight_at(weights, second), weight_at(weights, third),
            weight_at(weights, fourth), weight_at(weights, fifth), target,
        )  # fmt: skip


@njit(**FAST)
def weight_at(weights, index):  # type: ignore[no-untyped-def]
    """A weight, 0 behind the last."""
    return weights[index] if index < weights.size else np.float32(0.0)


@njit(**FAST)
def add_five(a, b, c, d, e, weight_a, weight_b, weight_c, weight_d, weight_e, target):  # type: ignore[no-untyped-def]
    """Add the weighted sum of five rows."""
    for x in range(target.size):
        target[x] += weight_a * a[x] + weight_b * b[x] + weight_c * c[x] + weight_d * d[x] + weight_e * e[x]


@njit(**FAST)
def polar(real, imaginary, carrier_rad, offset, amplitude):  # type: ignore[no-untyped-def]
    """Amplitude of the fringe and its phase less the carrier's."""
    for x in range(offset.size):
        offset[x] = wrap(fast_atan2(imaginary[x], real[x]) - carrier_rad[x])
    for x in range(offset.size):
        amplitude[x] = np.sqrt(real[x] * real[x] + imaginary[x] * imaginary[x])


@njit(**FAST)
def twice(real, imaginary, amplitude, even, odd):  # type: ignore[no-untyped-def]
    """Amplitude of the fringe times the cosine and sine of twice its phase."""
    for x in range(even.size):
        scale = np.float32(1.0) / max(amplitude[x], TINY)
        even[x] = (real[x] * real[x] - imaginary[x] * imaginary[x]) * scale
        odd[x] = np.float32(2.0) * real[x] * imaginary[x] * scale


@njit(**FAST)
def take_away(even, odd, along, across, target):  # type: ignore[no-untyped-def]
    """Take the real part of a complex share of the second harmonic away."""
    for x in range(target.size):
        target[x] -= along * even[x] - across * odd[x]


@njit(**FAST)
def add_square(values, target):  # type: ignore[no-untyped-def]
    """target += values^2."""
    for x in range(target.size):
        target[x] += values[x] * values[x]


@njit(**FAST)
def add_turn(real, imaginary, next_real, next_imaginary, cross, along):  # type: ignore[no-untyped-def]
    """Add the phasor of the turn from one moment to the next."""
    for x in range(cross.size):
        cross[x] += next_imaginary[x] * real[x] - next_real[x] * imaginary[x]
    for x in range(cross.size):
        along[x] += next_real[x] * real[x] + next_imaginary[x] * imaginary[x]


@njit(**FAST)
def mark_saturated(frames, y, brightest, status):  # type: ignore[no-untyped-def]
    """SATURATED where any frame is, else OK."""
    brightest[:] = frames[0, y]
    for frame in range(1, frames.shape[0]):
        brighter(frames[frame, y], brightest)
    for x in range(status.size):
        status[x] = FULL if brightest[x] >= SATURATED else OK


@njit(**FAST)
def brighter(values, brightest):  # type: ignore[no-untyped-def]
    """The brightest so far."""
    for x in range(values.size):
        brightest[x] = max(brightest[x], values[x])


@njit(parallel=True, cache=True, **FAST)
def judge_steps(  # type: ignore[no-untyped-def]
    moments, amplitude, variance, cross, along, gain2, min_amplitude, max_motion_rad, offset, sigma, status
):
    """Fill sigma and status from the blurred sums, and take the phase away where the status says so.

    With two moments a fast drift is overrated: tan of it is tan(e) / cos(e) for a drift e and four steps.
    """
    for row in prange(amplitude.shape[0]):
        y = np.int64(row)
        mark_dark(amplitude[y], min_amplitude, status[y])
        if moments > 1:
            mark_moved(cross[y], along[y], max_motion_rad, status[y])
        noise_row(amplitude[y], variance[y], gain2, sigma[y])
        hide_row(status[y], offset[y])


@njit(**FAST)
def mark_dark(amplitude, min_amplitude, status):  # type: ignore[no-untyped-def]
    """UNLIT where it is dark and not known to be SATURATED."""
    for x in range(status.size):
        found = OK if amplitude[x] > min_amplitude else DARK
        status[x] = FULL if status[x] == FULL else found


@njit(**FAST)
def mark_moved(cross, along, max_motion_rad, status):  # type: ignore[no-untyped-def]
    """MOVED where it drifts too fast and nothing else is known."""
    for x in range(status.size):
        found = MOVED if abs(fast_atan2(cross[x], along[x])) > max_motion_rad else OK
        status[x] = found if status[x] == OK else status[x]


@njit(**FAST)
def noise_row(amplitude, variance, gain2, sigma):  # type: ignore[no-untyped-def]
    """Standard deviation of the phase; running sums of the blur may leave a variance a little below zero."""
    for x in range(sigma.size):
        sigma[x] = np.sqrt(max(variance[x], np.float32(0.0)) * gain2) / max(amplitude[x], TINY)


@njit(fastmath=NAN_SAFE)
def hide_row(status, offset):  # type: ignore[no-untyped-def]
    """NaN where the status tells that there is no phase."""
    for x in range(offset.size):
        offset[x] = offset[x] if status[x] == OK else NAN
