"""Sub-pixel phase from one exposure: least squares over windows one period wide that avoid edges.

Every pixel has one fit of ``a + b cos(carrier + offset)`` over the window centred on it. A pixel then takes the fit of
whichever window that contains it fits best (symmetric multiple windows, reference [15] of the paper), so that no window
straddles a depth or shadow edge, and carries that phase to itself along the local slope. Fits and choice go down a band
of rows together, so that the fits never leave the cache. Where only some rows are asked for, only the windows are
fitted that they choose from.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from moire_sensor.apart import FAST
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_fit import CarrierRows, empty_planes, fit_next, fit_work, next_columns, start_columns
from moire_sensor.phase_image import PhaseImage, solved_rows
from moire_sensor.phase_planes import VARIANCE, slope_down
from moire_sensor.phase_windows import Choice, pick_row, room_for
from moire_sensor.settings import Settings

# Rows above and below a band are fitted twice: few bands, but enough for four threads.
BAND_ROWS = 120
GOOD_SHARE = 1.3
# Enough windows for the median of their variances: one in so many rows and columns.
SAMPLED_ROWS, SAMPLED_COLUMNS = 32, 4


def phase_from_single(
    image: Float32,
    carrier: Carrier,
    step_rad: float,
    settings: Settings,
    buffer: Float32 | None = None,
    row_step: int = 1,
) -> PhaseImage:
    """Phase of every pixel of one fringe image, or of one row in so many.

    Parameters
    ----------
    image : (H, W) float32, grey levels scaled to 255 at saturation.
    carrier : the camera's carrier.
    step_rad : phase that the projector adds in this exposure.
    buffer : (3, n, W) float32 for offset, amplitude and sigma of the result, which last until its next use.
    row_step : rows from one that is wanted to the next.

    Returns
    -------
    PhaseImage
        NaN phase where the fringe amplitude is below ``settings.min_amplitude`` or the window is saturated.
    """
    first, count = solved_rows(image.shape[0], row_step)
    shape = count, image.shape[1]
    offset, amplitude, sigma = np.empty((3, *shape), dtype=np.float32) if buffer is None else buffer
    background, status = np.empty_like(offset), np.empty(shape, dtype=np.uint8)
    rows, choice = carrier_rows(carrier), choice_of(carrier, step_rad, settings)
    fit_step = math.gcd(row_step, max(carrier.half_height_px, 1))
    sample = np.zeros((image.shape[0] // SAMPLED_ROWS + 1, image.shape[1]), dtype=np.float32)
    phase_bands(
        image, rows, choice, sample, first, row_step, fit_step, offset, background, amplitude, sigma, status
    )  # fmt: skip
    return PhaseImage(offset, amplitude, background, sigma, status, first, row_step)


def carrier_rows(carrier: Carrier) -> CarrierRows:
    """What the kernels read of a carrier."""
    table = carrier.table
    cos, sin = carrier.rows
    return CarrierRows(
        cos, sin, table.rows, table.entries, carrier.half_width_px, carrier.half_height_px
    )  # fmt: skip


def choice_of(carrier: Carrier, step_rad: float, settings: Settings) -> Choice:
    """How the pixels of an image choose their windows."""
    half, quarter, half_height = carrier.half_width_px, (carrier.half_width_px + 1) // 2, carrier.half_height_px
    samples = (2 * half + 1) * (2 * half_height + 1)
    return Choice(
        rows=np.repeat(half_height * np.array([-1, 0, 1]), 5),
        columns=np.tile(np.array([-half, -quarter, 0, quarter, half]), 3),
        step_rad=np.float32(step_rad),
        min_amplitude=np.float32(settings.min_amplitude),
        min_amplitude_to_noise=np.float32(settings.min_amplitude_to_noise),
        sigma_factor=np.float32(np.sqrt(2.0 / samples)),
    )


@njit(parallel=True, cache=True, **FAST)
def phase_bands(  # type: ignore[no-untyped-def]
    image, carrier, choice, sample, first_row, row_step, fit_step, offset, background, amplitude, sigma, status
):
    """Fill offset, background, amplitude, sigma and status (n, W) of every ``row_step``-th row from ``first_row`` on.

    Windows are fitted in every ``fit_step``-th row, which has to divide ``row_step`` and half a window's height.
    What a good fit is, the median over windows all over the image tells: those of every ``SAMPLED_ROWS``-th row, whose
    variances ``sample`` (n, W) takes.
    """
    height, width = image.shape
    for index in prange(sample.shape[0]):
        y = min(carrier.half_height + np.int64(index) * SAMPLED_ROWS, height - 1 - carrier.half_height)
        variances_of_row(image, carrier, y, sample[index])
    windows = sample[:, carrier.half_width : width - carrier.half_width : SAMPLED_COLUMNS].copy()
    good = np.float32(GOOD_SHARE * np.median(windows))
    for band in prange((height + BAND_ROWS - 1) // BAND_ROWS):
        first = np.int64(band) * BAND_ROWS
        phase_band(
            image, carrier, choice, good, first, first_row, row_step, fit_step, offset, background, amplitude, sigma,
            status,
        )  # fmt: skip


@njit(**FAST)
def variances_of_row(image, carrier, y, variances):  # type: ignore[no-untyped-def]
    """Variances of the windows centred on one row."""
    work, planes = fit_work(carrier), empty_planes(carrier, 1)
    start_columns(image, carrier, y, work)
    next_columns(image, carrier, y, work)
    fit_next(image, carrier, y, work, planes)
    first = (planes.shape[2] - variances.size) // 2
    variances[:] = planes[VARIANCE, 0][first : first + variances.size]


@njit(**FAST)
def phase_band(  # type: ignore[no-untyped-def]
    image, carrier, choice, good, first, first_row, row_step, fit_step, offset, background, amplitude, sigma, status
):
    """Phase of the rows of one band: fits run ahead of slopes, slopes ahead of the choice of windows."""
    last = min(first + BAND_ROWS, image.shape[0])
    step = max(carrier.half_height, 1)
    ahead = 2 * step + carrier.half_height
    work, planes = fit_work(carrier), empty_planes(carrier, 4 * step + 1)
    room = room_for(image.shape[1])
    start_columns(image, carrier, max(first - ahead, carrier.half_height), work)
    for y in range(first - ahead, last + ahead):
        next_columns(image, carrier, y, work)
        if (y - first_row) % fit_step == 0:
            fit_next(image, carrier, y, work, planes)
            slope_down(planes, y - 2 * step, step)
        at = y - ahead
        if at >= first and (at - first_row) % row_step == 0:
            index = (at - first_row) // row_step
            pick_row(
                image[at], planes, at, choice, room, good, offset[index], background[index], amplitude[index],
                sigma[index], status[index],
            )  # fmt: skip
