"""Least squares over the window around every pixel, and what follows from the fits of one row alone.

With theta the carrier's phase less that of the window's centre, a window's fit is a + C cos theta + D sin theta. Its
sums of I, I^2, I cos, I sin move row by row down a band and grow by doubling along the row; they are then turned into
the phase of the centre, where the normal matrix hardly changes from pixel to pixel. Every loop runs over a whole row
and has no branch, so that the compiler makes vectors of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from moire_sensor.angles import fast_atan2
from moire_sensor.apart import FAST, LEAF_FAST
from moire_sensor.phase_planes import AMPLITUDE, BACKGROUND, OFFSET, PLANES, UNUSABLE, VARIANCE, finish_row
from moire_sensor.phase_sums import MIDDLE, ONE, SUM_ROOM, TWO, ZERO, add_row, move_rows, sum_windows
from moire_sensor.phase_table import FREE_COS, FREE_SIN, LIMIT, RIPPLE, SIN_COS_RAMP, SIN_RAMP

Float32 = npt.NDArray[np.float32]
TINY = np.float32(1e-9)


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
    room: Float32
    sums: Float32
    constants: Float32
    bend: Float32


@njit(**FAST)
def fit_work(carrier):  # type: ignore[no-untyped-def]
    """Empty rows for the fits of one band."""
    width = carrier.cos.shape[1]
    columns, room = np.zeros((4, width), dtype=np.float32), np.zeros((SUM_ROOM, width), dtype=np.float32)
    sums = np.zeros((6, width - 2 * carrier.half_width), dtype=np.float32)
    return FitWork(columns, room, sums, carrier.table[0].copy(), np.zeros((2, width), dtype=np.float32))


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
def next_columns(image, carrier, y, work):  # type: ignore[no-untyped-def]
    """Sums down the columns around row y, the one after the last, or the one that the columns were started for."""
    below, above = y + carrier.half_height, y - carrier.half_height - 1
    if y < carrier.half_height or below >= image.shape[0]:
        return
    if above < 0:
        add_row(work.columns, image[below], cos_of(carrier, below), sin_of(carrier, below))
    else:
        move_rows(
            work.columns, image[below], cos_of(carrier, below), sin_of(carrier, below), image[above],
            cos_of(carrier, above), sin_of(carrier, above),
        )  # fmt: skip


@njit(**LEAF_FAST)
def fit_next(image, carrier, y, work, planes):  # type: ignore[no-untyped-def]
    """Fit the windows centred on row y, whose columns are summed."""
    rows = planes.shape[1]
    if y < carrier.half_height or y >= image.shape[0] - carrier.half_height:
        planes[VARIANCE, y % rows] = UNUSABLE
        planes[AMPLITUDE, y % rows] = ZERO
        return
    samples = (2 * carrier.half_width + 1) * (2 * carrier.half_height + 1)
    start = margin(carrier.half_width) + carrier.half_width
    sum_windows(work.columns, 2 * carrier.half_width + 1, work.room, work.sums)
    if carrier.table_rows.size > 1:
        between_rows(carrier.table_rows, carrier.table, y, work.constants)
    row, half = y % rows, carrier.half_width
    fit_row(
        work.sums, cos_of(carrier, y)[half:], sin_of(carrier, y)[half:], work.constants, np.float32(half),
        ONE / np.float32(samples - 4), planes[OFFSET, row][start:], planes[BACKGROUND, row][start:],
        planes[AMPLITUDE, row][start:], planes[VARIANCE, row][start:], work.bend[0],
    )  # fmt: skip
    finish_row(work.constants[LIMIT], half, samples, work.bend, planes, row, start)


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
def fit_row(  # type: ignore[no-untyped-def]
    sums, cos, sin, constants, half_width, share, offset, background, amplitude, variance, bend
):
    """Fit every window of a row; ``bend`` is the phase that one radian per pixel of slope adds."""
    for x in range(sums.shape[1]):
        ones, in_cos, in_sin = sums[0, x], sums[2, x], sums[3, x]
        # Sums with cos, sin of the carrier become sums with cos, sin of theta, and k times becomes t times.
        ramp_cos, ramp_sin = turned(sums[4, x] - half_width * in_cos, sums[5, x] - half_width * in_sin, cos[x], sin[x])
        in_cos, in_sin = turned(in_cos, in_sin, cos[x], sin[x])
        # The inverse normal matrix times the sums.
        mean = constants[0, x] * ones + constants[1, x] * in_cos + constants[2, x] * in_sin
        real = constants[1, x] * ones + constants[3, x] * in_cos + constants[4, x] * in_sin
        imaginary = constants[2, x] * ones + constants[4, x] * in_cos + constants[5, x] * in_sin
        left_over = sums[1, x] - (mean * ones + real * in_cos + imaginary * in_sin)
        # Product of the residual with t (D cos theta - C sin theta), what a slightly other frequency would add.
        along_c = ramp_sin - mean * constants[SIN_RAMP, x] - real * constants[SIN_COS_RAMP, x]
        met = imaginary * (ramp_cos - imaginary * constants[SIN_COS_RAMP, x]) - real * along_c
        real2, imaginary2 = real * real, imaginary * imaginary
        free = real2 * constants[FREE_COS, x] + imaginary2 * constants[FREE_SIN, x]
        variance[x] = max(left_over - met * met / max(free, ONE), ZERO) * share
        # Phase of the fit at the centre, angle of C - i D, less that of the carrier.
        up = -imaginary * cos[x] - real * sin[x]
        offset[x] = fast_atan2(up, real * cos[x] - imaginary * sin[x])
        background[x] = mean + MIDDLE
        amplitude[x] = np.sqrt(real2 + imaginary2)
        # -ripple sin(2 phase) = ripple 2 C D / b^2.
        bend[x] = constants[RIPPLE, x] * TWO * real * imaginary / max(real2 + imaginary2, TINY)


@njit(inline="always", **FAST)
def turned(along_cos, along_sin, cos, sin):  # type: ignore[no-untyped-def]
    """Sums with cos and sin of an angle less that of ``cos``, ``sin``."""
    return along_cos * cos + along_sin * sin, along_sin * cos - along_cos * sin
