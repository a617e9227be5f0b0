"""Least squares over the window around every pixel, and what follows from the fits of one row alone.

With theta the carrier's phase less that of the window's centre, a window's fit is a + C cos theta + D sin theta. Its
sums of I, I^2, I cos, I sin move row by row down a band and grow by doubling along the row; they are then turned into
the phase of the centre, where the normal matrix hardly changes from pixel to pixel. Every loop runs over whole rows of
few arrays and has no branch, so that the compiler makes vectors of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.angles import fast_atan2, wrap

Float32 = npt.NDArray[np.float32]
FAST = {"fastmath": True, "error_model": "numpy"}
UNUSABLE = np.float32(1e30)
# Grey levels are taken less this, so that their squares lose less in float32.
MIDDLE = np.float32(128.0)
# Squared second differences below this many variances of a fit are noise: 6 for independent fits, twice that, twice.
NOISE_SHARE = np.float32(32.0)
ONE, TWO, ZERO = np.float32(1.0), np.float32(2.0), np.float32(0.0)
# Planes of the fits: offset of the window's centre, the same without ripple and curvature, mean, amplitude, variance of
# the residual, slope of the offset along the row and down the column.
OFFSET, CARRIED, BACKGROUND, AMPLITUDE, VARIANCE, ALONG, DOWN, PLANES = range(8)


class CarrierRows(NamedTuple):
    """What the kernels read of a carrier; see :class:`moire_sensor.phase_carrier.Carrier`."""

    cos: Float32
    sin: Float32
    table_rows: npt.NDArray[np.int64]
    table: Float32
    half_width: int
    half_height: int


class FitWork(NamedTuple):
    """Rows that the fits of a band use over and over."""

    columns: Float32
    sums: Float32
    fits: Float32
    constants: Float32


@njit(**FAST)
def fit_work(carrier):  # type: ignore[no-untyped-def]
    """Empty rows for the fits of one band."""
    width = carrier.cos.shape[1]
    columns = np.zeros((4, width), dtype=np.float32)
    sums = np.zeros((4, 4 * width), dtype=np.float32)
    fits = np.zeros((5, width - 2 * carrier.half_width), dtype=np.float32)
    return FitWork(columns, sums, fits, carrier.table[0].copy())


@njit(**FAST)
def empty_planes(carrier, rows):  # type: ignore[no-untyped-def]
    """Planes (7, rows, W + 2 margin) without any fit; image row y has row y mod ``rows``.

    The margin, like windows that leave the image, keeps the variance ``UNUSABLE``: no kernel asks for the border.
    """
    width = carrier.cos.shape[1] + 2 * margin(carrier.half_width)
    planes = np.zeros((PLANES, rows, width), dtype=np.float32)
    planes[VARIANCE] = UNUSABLE
    return planes


@njit(**FAST)
def margin(half_width):  # type: ignore[no-untyped-def]
    """Columns that a plane has left and right of the image: half a window, made even."""
    return 2 * ((half_width + 1) // 2)


@njit(**FAST)
def start_columns(image, carrier, y, work):  # type: ignore[no-untyped-def]
    """Sums down the columns, ready for the windows centred on row y."""
    work.columns[:] = ZERO
    for row in range(y - carrier.half_height, min(y + carrier.half_height, image.shape[0])):
        add_row(work.columns, image[row], carrier.cos[row], carrier.sin[row], ONE)


@njit(**FAST)
def fit_next(image, carrier, y, work, planes):  # type: ignore[no-untyped-def]
    """Fit the windows centred on row y, the one after the last, or the one that the columns were started for."""
    rows = planes.shape[1]
    if y < carrier.half_height or y >= image.shape[0] - carrier.half_height:
        planes[VARIANCE, y % rows] = UNUSABLE
        planes[AMPLITUDE, y % rows] = ZERO
        return
    below, above = y + carrier.half_height, y - carrier.half_height
    samples = (2 * carrier.half_width + 1) * (2 * carrier.half_height + 1)
    start = margin(carrier.half_width) + carrier.half_width
    add_row(work.columns, image[below], carrier.cos[below], carrier.sin[below], ONE)
    sum_windows(work.columns, 2 * carrier.half_width + 1, work.sums)
    if carrier.table_rows.size > 1:
        between_rows(carrier.table_rows, carrier.table, y, work.constants)
    cos, sin = carrier.cos[y], carrier.sin[y]
    fit_row(work.sums, cos, sin, work.constants, carrier.half_width, samples, work.fits, planes, y % rows, start)
    finish_row(work.constants, carrier.half_width, samples, work.fits, planes, y % rows, start)
    add_row(work.columns, image[above], carrier.cos[above], carrier.sin[above], -ONE)


@njit(**FAST)
def slope_down(planes, y, step):  # type: ignore[no-untyped-def]
    """Fill row y of the plane DOWN, derivative of the offset along y, from windows one and two steps away."""
    offset, variance, rows = planes[OFFSET], planes[VARIANCE], planes.shape[1]
    far, near, here = (y - 2 * step) % rows, (y - step) % rows, y % rows
    after, farther = (y + step) % rows, (y + 2 * step) % rows
    slopes(
        offset[far], offset[near], offset[here], offset[after], offset[farther],
        variance[far], variance[near], variance[here], variance[after], variance[farther],
        np.float32(0.5 / step), planes[DOWN, here],
    )  # fmt: skip


@njit(**FAST)
def add_row(columns, values, cos, sin, sign):  # type: ignore[no-untyped-def]
    """Add one image row to the sums of I, I^2, I cos, I sin down each column."""
    ones, squares, in_cos, in_sin = columns[0], columns[1], columns[2], columns[3]
    for x in range(values.size):
        value = values[x] - MIDDLE
        ones[x] += sign * value
        squares[x] += sign * value * value
    for x in range(values.size):
        in_cos[x] += sign * (values[x] - MIDDLE) * cos[x]
    for x in range(values.size):
        in_sin[x] += sign * (values[x] - MIDDLE) * sin[x]


@njit(**FAST)
def between_rows(table_rows, table, y, constants):  # type: ignore[no-untyped-def]
    """Constants of row y, linear between two rows of the table."""
    step = table_rows[1] - table_rows[0]
    at = min((y - table_rows[0]) // step, table_rows.size - 2)
    part = np.float32(y - table_rows[at]) / np.float32(table_rows[at + 1] - table_rows[at])
    for entry in range(constants.shape[0]):
        above, below, between = table[at, entry], table[at + 1, entry], constants[entry]
        for x in range(between.size):
            between[x] = above[x] + part * (below[x] - above[x])


@njit(**FAST)
def sum_windows(columns, size, sums):  # type: ignore[no-untyped-def]
    """Sums over ``size`` columns from each on: ``sums[0]`` of all four, ``sums[1, 2 W:]`` of t I cos and t I sin.

    The four rows lie behind each other, so a window that leaves its row holds what nobody reads. A sum over 2 n columns
    is S[x] + S[x + n], that of k times the k-th is T[x] + T[x + n] + n S[x + n]; an odd size adds one column.
    """
    values = columns.reshape(columns.size)
    source, target = values, values
    half = values.size // 2
    ramp, ramp_target = sums[3][:half], sums[3][:half]
    ramp[:] = ZERO
    bits = 0
    while size >> (bits + 1):
        bits += 1
    have = 1
    for bit in range(bits - 1, -1, -1):
        target, ramp_target = (sums[0], sums[1][half:]) if bit % 2 == 0 else (sums[2], sums[1][:half])
        grow_ramp(source[half:], source[half + have :], ramp, ramp[have:], np.float32(have), ramp_target)
        grow(source, source[have:], target)
        have *= 2
        if (size >> bit) & 1:
            add_scaled(values[half + have :], np.float32(have), ramp_target)
            add_scaled(values[have:], ONE, target)
            have += 1
        source, ramp = target, ramp_target
    add_scaled(source[half:], -np.float32(size // 2), ramp)


@njit(**FAST)
def grow(source, ahead, target):  # type: ignore[no-untyped-def]
    """Sums over twice the columns."""
    for x in range(ahead.size):
        target[x] = source[x] + ahead[x]


@njit(**FAST)
def grow_ramp(source, ahead, ramp, ramp_ahead, columns, target):  # type: ignore[no-untyped-def]
    """Sums of k times the k-th over twice the columns."""
    for x in range(ahead.size):
        target[x] = ramp[x] + ramp_ahead[x] + columns * ahead[x]


@njit(**FAST)
def add_scaled(values, scale, target):  # type: ignore[no-untyped-def]
    """target += scale * values."""
    for x in range(values.size):
        target[x] += scale * values[x]


@njit(**FAST)
def fit_row(sums, cos, sin, constants, half_width, samples, fits, planes, y, start):  # type: ignore[no-untyped-def]
    """Fit every window of a row: its mean, C and D into ``fits``, offset and residual variance into the planes."""
    width = cos.size
    count = width - 2 * half_width
    cos, sin = cos[half_width : width - half_width], sin[half_width : width - half_width]
    ones, squares, in_cos, in_sin = sums[0][:width], sums[0][width:], sums[0][2 * width :], sums[0][3 * width :]
    ramp_cos, ramp_sin = sums[1][2 * width :], sums[1][3 * width :]
    mean, real, imaginary, met = fits[0], fits[1], fits[2], fits[3]
    turn(in_cos, in_sin, cos, sin)
    turn(ramp_cos, ramp_sin, cos, sin)
    combine(constants[0], constants[1], constants[2], ones, in_cos, in_sin, mean)
    combine(constants[1], constants[3], constants[4], ones, in_cos, in_sin, real)
    combine(constants[2], constants[4], constants[5], ones, in_cos, in_sin, imaginary)
    for x in range(count):
        squares[x] -= mean[x] * ones[x] + real[x] * in_cos[x] + imaginary[x] * in_sin[x]
    meet_detuned(fits, ramp_cos, ramp_sin, constants[6], constants[7], met)
    share = ONE / np.float32(samples - 4)
    variance_without(squares, met, real, imaginary, constants[8], constants[9], share, planes[VARIANCE, y][start:])
    offsets(real, imaginary, cos, sin, planes[OFFSET, y][start:])


@njit(**FAST)
def turn(first, second, cos, sin):  # type: ignore[no-untyped-def]
    """Sums with cos, sin of the carrier become sums with cos, sin of theta."""
    for x in range(cos.size):
        turned = first[x] * cos[x] + second[x] * sin[x]
        second[x] = second[x] * cos[x] - first[x] * sin[x]
        first[x] = turned


@njit(**FAST)
def combine(weight_1, weight_c, weight_s, ones, in_cos, in_sin, target):  # type: ignore[no-untyped-def]
    """One row of the inverse normal matrix times the sums."""
    for x in range(target.size):
        target[x] = weight_1[x] * ones[x] + weight_c[x] * in_cos[x] + weight_s[x] * in_sin[x]


@njit(**FAST)
def meet_detuned(fits, ramp_cos, ramp_sin, sin_ramp, sin_cos_ramp, met):  # type: ignore[no-untyped-def]
    """Product of the residual with t (D cos theta - C sin theta), what a slightly other frequency would add."""
    mean, real, imaginary = fits[0], fits[1], fits[2]
    for x in range(met.size):
        along_c = ramp_sin[x] - mean[x] * sin_ramp[x] - real[x] * sin_cos_ramp[x]
        met[x] = imaginary[x] * (ramp_cos[x] - imaginary[x] * sin_cos_ramp[x]) - real[x] * along_c


@njit(**FAST)
def variance_without(squares, met, real, imaginary, free_cos, free_sin, share, variance):  # type: ignore[no-untyped-def]
    """Variance of the residual less what a slightly other frequency explains of it."""
    for x in range(met.size):
        free = real[x] * real[x] * free_cos[x] + imaginary[x] * imaginary[x] * free_sin[x]
        variance[x] = max(squares[x] - met[x] * met[x] / max(free, ONE), ZERO) * share


@njit(**FAST)
def offsets(real, imaginary, cos, sin, offset):  # type: ignore[no-untyped-def]
    """Phase of the fit at the centre, angle of C - i D, less that of the carrier."""
    for x in range(cos.size):
        up = -imaginary[x] * cos[x] - real[x] * sin[x]
        offset[x] = fast_atan2(up, real[x] * cos[x] - imaginary[x] * sin[x])


@njit(**FAST)
def finish_row(constants, half_width, samples, fits, planes, y, start):  # type: ignore[no-untyped-def]
    """Mean, amplitude, slope along the row, and the offset without ripple and curvature, into the planes."""
    mean, real, imaginary, bend, bias = fits[0], fits[1], fits[2], fits[3], fits[4]
    end = start + mean.size
    background, amplitude = planes[BACKGROUND, y][start:end], planes[AMPLITUDE, y][start:end]
    for x in range(mean.size):
        background[x] = mean[x] + MIDDLE
    shapes(real, imaginary, constants[10], amplitude, bend)
    offset, variance, along = planes[OFFSET, y], planes[VARIANCE, y], planes[ALONG, y][start:end]
    row_slopes(offset, variance, start, (half_width + 1) // 2, along)
    limit, smooth, offset = constants[11], mean, offset[start:end]
    for x in range(along.size):
        along[x] = min(max(along[x], -limit[x]), limit[x])
    for x in range(along.size):
        smooth[x] = offset[x] + along[x] * bend[x]
    size = 2 * half_width + 1
    share = np.float32((size * size - 1) / (24.0 * half_width * half_width))
    row_bias(smooth, variance[start:end], half_width, share, bias)
    noise_share = NOISE_SHARE * share * share / np.float32(samples)
    without_bias(smooth, bias, variance[start:end], amplitude, noise_share, planes[CARRIED, y][start:end])


@njit(**FAST)
def shapes(real, imaginary, ripple, amplitude, bend):  # type: ignore[no-untyped-def]
    """Amplitude, and the phase that one radian per pixel of slope adds: -ripple sin(2 phase) = ripple 2 C D / b^2."""
    for x in range(bend.size):
        square = real[x] * real[x] + imaginary[x] * imaginary[x]
        amplitude[x] = np.sqrt(square)
        bend[x] = ripple[x] * TWO * real[x] * imaginary[x] / max(square, np.float32(1e-9))


@njit(**FAST)
def row_slopes(offset, variance, start, quarter, along):  # type: ignore[no-untyped-def]
    """Slope of the offset along a padded row, over half a period, where the ripple of a detuned fit cancels."""
    far, near = start - 2 * quarter, start - quarter
    after, farther = start + quarter, start + 2 * quarter
    slopes(
        offset[far:], offset[near:], offset[start:], offset[after:], offset[farther:],
        variance[far:], variance[near:], variance[start:], variance[after:], variance[farther:],
        np.float32(0.5 / quarter), along,
    )  # fmt: skip


@njit(**FAST)
def slopes(before2, before, here, after, after2, var_b2, var_b, var_h, var_a, var_a2, per_px, slope):  # type: ignore[no-untyped-def]
    """Phase per pixel from the pair of windows whose worse fit is best, around, before or after; 0 if none fits."""
    for x in range(slope.size):
        far, near, middle, next_, farther = before2[x], before[x], here[x], after[x], after2[x]
        centred = max(var_b[x], var_a[x])
        left = np.float32(1.5) * max(var_b2[x], var_h[x])
        right = np.float32(1.5) * max(var_h[x], var_a2[x])
        best = min(centred, min(left, right))
        first, last = (far, middle) if left <= right else (middle, farther)
        first, last = (near, next_) if best == centred else (first, last)
        along = wrap(last - first) * per_px
        slope[x] = along if best <= np.float32(4.0) * var_h[x] + np.float32(4.0) else ZERO


@njit(**FAST)
def row_bias(smooth, variance, half_width, share, bias):  # type: ignore[no-untyped-def]
    """Bias that curvature gives a mean over the window, 0 where it cannot be told.

    A phase with second derivative k reads k <t^2> / 2 too high. The second difference of three fits half a window
    apart tells k, where all three fit equally well.
    """
    bias[:half_width] = ZERO
    bias[bias.size - half_width :] = ZERO
    curvatures(
        smooth, smooth[half_width:], smooth[2 * half_width :], variance, variance[half_width:],
        variance[2 * half_width :], share, bias[half_width:],
    )  # fmt: skip


@njit(**FAST)
def curvatures(before, here, after, var_b, var_h, var_a, share, bias):  # type: ignore[no-untyped-def]
    """Share of the second difference, 0 where the outer windows fit worse."""
    for x in range(after.size):
        second = wrap(after[x] - here[x]) - wrap(here[x] - before[x])
        worst = max(var_b[x], var_a[x])
        bias[x] = share * second if worst <= np.float32(4.0) * var_h[x] + np.float32(4.0) else ZERO


@njit(**FAST)
def without_bias(smooth, bias, variance, amplitude, noise_share, carried):  # type: ignore[no-untyped-def]
    """Offset less the part of the bias that noise alone would not give."""
    for x in range(bias.size):
        noise = noise_share * variance[x] / (amplitude[x] * amplitude[x] + ONE)
        power = bias[x] * bias[x]
        carried[x] = smooth[x] - bias[x] * max(power - noise, ZERO) / max(power, np.float32(1e-12))
