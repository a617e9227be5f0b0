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
    room = np.empty((7, carrier_rad.size), dtype=np.float32)
    real, imaginary, before, after, even, odd, brightest = (
        room[0], room[1], room[0:2], room[2:4], room[4], room[5], room[6]
    )  # fmt: skip
    see_light(frames, y, filters, background, real, imaginary, brightest)
    polar(real, imaginary, carrier_rad, offset, amplitude)
    if bend.any():
        twice(real, imaginary, amplitude, even, odd)
    residues = 3 + 2 * moments
    if residues == filters.shape[0]:
        squares[:] = 0.0
    for index in range(residues, filters.shape[0]):
        filtered(frames, y, filters[index], real)
        share = bend[index - residues]
        if share != 0.0:
            take_away(even, odd, share.real, share.imag, real)
        if index == residues:
            square(real, squares)
        else:
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
    mark_saturated(brightest, status)


@njit(**FAST)
def see_light(frames, y, filters, background, real, imaginary, brightest):  # type: ignore[no-untyped-def]
    """Background, fringe and brightest level of row y, the first five frames at once."""
    count, last = frames.shape[0], frames.shape[0] - 1
    light_of_five(
        frames[0, y], frames[min(1, last), y], frames[min(2, last), y], frames[min(3, last), y],
        frames[min(4, last), y], filters[0], filters[1], filters[2], background, real, imaginary, brightest,
    )  # fmt: skip
    add_later(frames, y, filters[0], background)
    add_later(frames, y, filters[1], real)
    add_later(frames, y, filters[2], imaginary)
    for frame in range(5, count):
        brighter(frames[frame, y], brightest)


@njit(**FAST)
def light_of_five(a, b, c, d, e, mean, cos, sin, background, real, imaginary, brightest):  # type: ignore[no-untyped-def]
    """Weighted sums of five rows by three filters, and their greatest values."""
    mean_a, mean_b, mean_c, mean_d, mean_e = mean[0], mean[1], mean[2], mean[3], mean[4]
    cos_a, cos_b, cos_c, cos_d, cos_e = cos[0], cos[1], cos[2], cos[3], cos[4]
    sin_a, sin_b, sin_c, sin_d, sin_e = sin[0], sin[1], sin[2], sin[3], sin[4]
    for x in range(background.size):
        background[x] = mean_a * a[x] + mean_b * b[x] + mean_c * c[x] + mean_d * d[x] + mean_e * e[x]
        real[x] = cos_a * a[x] + cos_b * b[x] + cos_c * c[x] + cos_d * d[x] + cos_e * e[x]
        imaginary[x] = sin_a * a[x] + sin_b * b[x] + sin_c * c[x] + sin_d * d[x] + sin_e * e[x]
        brightest[x] = max(max(max(a[x], b[x]), max(c[x], d[x])), e[x])


@njit(**FAST)
def filtered(frames, y, weights, target):  # type: ignore[no-untyped-def]
    """Weighted sum of row y of the frames (n, H, W), five at a time; ``weights`` go on with zeros to whole fives."""
    target[:] = 0.0
    add_frames(frames, y, weights, 0, target)
    add_later(frames, y, weights, target)


@njit(**FAST)
def add_later(frames, y, weights, target):  # type: ignore[no-untyped-def]
    """Add the frames behind the first five."""
    for first in range(5, frames.shape[0], 5):
        add_frames(frames, y, weights, first, target)


@njit(**FAST)
def add_frames(frames, y, weights, first, target):  # type: ignore[no-untyped-def]
    """Add five frames."""
    last = frames.shape[0] - 1
    add_five(
        frames[first, y], frames[min(first + 1, last), y], frames[min(first + 2, last), y],
        frames[min(first + 3, last), y], frames[min(first + 4, last), y], weights[first], weights[first + 1],
        weights[first + 2], weights[first + 3], weights[first + 4], target,
    )  # fmt: skip


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
def square(values, target):  # type: ignore[no-untyped-def]
    """target = values^2."""
    for x in range(target.size):
        target[x] = values[x] * values[x]


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
def mark_saturated(brightest, status):  # type: ignore[no-untyped-def]
    """SATURATED where any frame is, else OK."""
    for x in range(status.size):
        status[x] = FULL if brightest[x] >= SATURATED else OK


@njit(**FAST)
def brighter(values, brightest):  # type: ignore[no-untyped-def]
    """The brightest so far."""
    for x in range(values.size):
        brightest[x] = max(brightest[x], values[x])


@njit(parallel=True, cache=True, **FAST)
def judge_steps(  # type: ignore[no-untyped-def]
    moments, amplitude, variance, freedom, cross, along, gain2, min_amplitude, max_motion_rad, offset, sigma, status
):
    """Fill sigma and status from the blurred sums, and take the phase away where the status says so.

    ``variance`` is that of the noise times ``freedom``. With two moments a fast drift is overrated: tan of it is
    tan(e) / cos(e) for a drift e and four steps.
    """
    for row in prange(amplitude.shape[0]):
        y = np.int64(row)
        mark_dark(amplitude[y], min_amplitude, status[y])
        if moments > 1:
            mark_moved(cross[y], along[y], max_motion_rad, status[y])
        noise_row(amplitude[y], variance[y], freedom, gain2, sigma[y])
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
def noise_row(amplitude, variance, freedom, gain2, sigma):  # type: ignore[no-untyped-def]
    """Standard deviation of the phase; running sums of the blur may leave a variance a little below zero."""
    for x in range(sigma.size):
        own = max(variance[x], np.float32(0.0)) / freedom
        sigma[x] = np.sqrt(own * gain2) / max(amplitude[x], TINY)


@njit(fastmath=NAN_SAFE)
def hide_row(status, offset):  # type: ignore[no-untyped-def]
    """NaN where the status tells that there is no phase."""
    for x in range(offset.size):
        offset[x] = offset[x] if status[x] == OK else NAN
