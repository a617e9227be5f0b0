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

from moire_sensor.angles import fast_atan2
from moire_sensor.apart import FAST, LEAF_FAST
from moire_sensor.phase_planes import AMPLITUDE, OFFSET, PLANES, UNUSABLE, VARIANCE, finish_row
from moire_sensor.phase_sums import ONE, ZERO, add_row, move_rows, sum_windows

Float32 = npt.NDArray[np.float32]


class CarrierRows(NamedTuple):
    """What the kernels read of a carrier; see :class:`moire_sensor.phase_carrier.Carrier`, one row or all."""

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


@njit(inline="always")
def cos_of(carrier, y):  # type: ignore[no-untyped-def]
    """Row of the carrier's cosine."""
    return carrier.cos[min(y, carrier.cos.shape[0] - 1)]


@njit(inline="always")
def sin_of(carrier, y):  # type: ignore[no-untyped-def]
    """Row of the carrier's sine."""
    return carrier.sin[min(y, carrier.sin.shape[0] - 1)]


@njit(**LEAF_FAST)
def margin(half_width):  # type: ignore[no-untyped-def]
    """Columns that a plane has left and right of the image: half a window, made even."""
    return 2 * ((half_width + 1) // 2)


@njit(**LEAF_FAST)
def start_columns(image, carrier, y, work):  # type: ignore[no-untyped-def]
    """Sums down the columns for the windows centred on the row above y, without the rows that the image has not."""
    work.columns[:] = ZERO
    for row in range(max(y - carrier.half_height - 1, 0), min(y + carrier.half_height, image.shape[0])):
        add_row(work.columns, image[row], cos_of(carrier, row), sin_of(carrier, row))


@njit(**LEAF_FAST)
def fit_next(image, carrier, y, work, planes):  # type: ignore[no-untyped-def]
    """Fit the windows centred on row y, the one after the last, or the one that the columns were started for."""
    rows = planes.shape[1]
    if y < carrier.half_height or y >= image.shape[0] - carrier.half_height:
        planes[VARIANCE, y % rows] = UNUSABLE
        planes[AMPLITUDE, y % rows] = ZERO
        return
    below, above = y + carrier.half_height, y - carrier.half_height - 1
    samples = (2 * carrier.half_width + 1) * (2 * carrier.half_height + 1)
    start = margin(carrier.half_width) + carrier.half_width
    if above < 0:
        add_row(work.columns, image[below], cos_of(carrier, below), sin_of(carrier, below))
    else:
        move_rows(
            work.columns, image[below], cos_of(carrier, below), sin_of(carrier, below), image[above],
            cos_of(carrier, above), sin_of(carrier, above),
        )  # fmt: skip
    sum_windows(work.columns, 2 * carrier.half_width + 1, work.sums)
    if carrier.table_rows.size > 1:
        between_rows(carrier.table_rows, carrier.table, y, work.constants)
    cos, sin = cos_of(carrier, y), sin_of(carrier, y)
    fit_row(work.sums, cos, sin, work.constants, carrier.half_width, samples, work.fits, planes, y % rows, start)
    finish_row(work.constants, carrier.half_width, samples, work.fits, planes, y % rows, start)


@njit(**LEAF_FAST)
def between_rows(table_rows, table, y, constants):  # type: ignore[no-untyped-def]
    """Constants of row y, linear between two rows of the table."""
    step = table_rows[1] - table_rows[0]
    at = min((y - table_rows[0]) // step, table_rows.size - 2)
    part = np.float32(y - table_rows[at]) / np.float32(table_rows[at + 1] - table_rows[at])
    for entry in range(constants.shape[0]):
        above, below, between = table[at, entry], table[at + 1, entry], constants[entry]
        for x in range(between.size):
            between[x] = above[x] + part * (below[x] - above[x])


@njit(**LEAF_FAST)
def fit_row(sums, cos, sin, constants, half_width, samples, fits, planes, y, start):  # type: ignore[no-untyped-def]
    """Fit every window of a row: its mean, C and D into ``fits``, offset and residual variance into the planes."""
    width = cos.size
    count = width - 2 * half_width
    cos, sin = cos[half_width : width - half_width], sin[half_width : width - half_width]
    ones, squares = sums[0][:count], sums[0][width : width + count]
    in_cos, in_sin = sums[0][2 * width : 2 * width + count], sums[0][3 * width : 3 * width + count]
    ramp_cos, ramp_sin = sums[1][2 * width : 2 * width + count], sums[1][3 * width : 3 * width + count]
    mean, real, imaginary, met = fits[0], fits[1], fits[2], fits[3]
    turn(in_cos, in_sin, cos, sin)
    turn(ramp_cos, ramp_sin, cos, sin)
    combine(constants[0], constants[1], constants[2], ones, in_cos, in_sin, mean)
    combine(constants[1], constants[3], constants[4], ones, in_cos, in_sin, real)
    combine(constants[2], constants[4], constants[5], ones, in_cos, in_sin, imaginary)
    for x in range(count):
        squares[x] -= mean[x] * ones[x] + real[x] * in_cos[x] + imaginary[x] * in_sin[x]
    meet_detuned(mean, real, imaginary, ramp_cos, ramp_sin, constants[6], constants[7], met)
    share = ONE / np.float32(samples - 4)
    variance_without(squares, met, real, imaginary, constants[8], constants[9], share, planes[VARIANCE, y][start:])
    offsets(real, imaginary, cos, sin, planes[OFFSET, y][start:])


@njit(**LEAF_FAST)
def turn(first, second, cos, sin):  # type: ignore[no-untyped-def]
    """Sums with cos, sin of the carrier become sums with cos, sin of theta."""
    for x in range(cos.size):
        turned = first[x] * cos[x] + second[x] * sin[x]
        second[x] = second[x] * cos[x] - first[x] * sin[x]
        first[x] = turned


@njit(**LEAF_FAST)
def combine(weight_1, weight_c, weight_s, ones, in_cos, in_sin, target):  # type: ignore[no-untyped-def]
    """One row of the inverse normal matrix times the sums."""
    for x in range(target.size):
        target[x] = weight_1[x] * ones[x] + weight_c[x] * in_cos[x] + weight_s[x] * in_sin[x]


@njit(**LEAF_FAST)
def meet_detuned(mean, real, imaginary, ramp_cos, ramp_sin, sin_ramp, sin_cos_ramp, met):  # type: ignore[no-untyped-def]
    """Product of the residual with t (D cos theta - C sin theta), what a slightly other frequency would add."""
    for x in range(met.size):
        along_c = ramp_sin[x] - mean[x] * sin_ramp[x] - real[x] * sin_cos_ramp[x]
        met[x] = imaginary[x] * (ramp_cos[x] - imaginary[x] * sin_cos_ramp[x]) - real[x] * along_c


@njit(**LEAF_FAST)
def variance_without(squares, met, real, imaginary, free_cos, free_sin, share, variance):  # type: ignore[no-untyped-def]
    """Variance of the residual less what a slightly other frequency explains of it."""
    for x in range(met.size):
        free = real[x] * real[x] * free_cos[x] + imaginary[x] * imaginary[x] * free_sin[x]
        variance[x] = max(squares[x] - met[x] * met[x] / max(free, ONE), ZERO) * share


@njit(**LEAF_FAST)
def offsets(real, imaginary, cos, sin, offset):  # type: ignore[no-untyped-def]
    """Phase of the fit at the centre, angle of C - i D, less that of the carrier."""
    for x in range(cos.size):
        up = -imaginary[x] * cos[x] - real[x] * sin[x]
        offset[x] = fast_atan2(up, real[x] * cos[x] - imaginary[x] * sin[x])
