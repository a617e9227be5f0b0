"""The rows between those that were solved: they continue a surface that both neighbours of them show.

The paper's own way to be faster (its conclusion). Where they show different surfaces, or one shows none, nothing
is said: that is beside an edge, where borders are looked for anyway (:mod:`moire_sensor.depth_border`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import ROW
from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import PhaseImage

# Disparities that differ by more than this a row do not lie on one surface; a floor's do by baseline / height.
STEEPEST_PX = np.float32(1.0)


@dataclass(frozen=True, eq=False)
class Seen:
    """What the left camera sees at every pixel, arrays (H, W).

    Attributes
    ----------
    amplitude, background, status : as of :class:`moire_sensor.phase_image.PhaseImage`.
    """

    amplitude: Float32
    background: Float32
    status: npt.NDArray[np.uint8]


def all_rows(match: Match, margin: Float32, phase: PhaseImage, buffer: Float32) -> tuple[Match, Float32, Seen]:
    """Match, margin of the orders and light of all rows of an image from those of the solved ones.

    Parameters
    ----------
    match, margin, phase : of the solved rows, (n, W) each.
    buffer : (6, H, W) float32 for all but background and status, which last until its next use.

    Returns
    -------
    tuple
        As given where all rows were solved. Else the sigma of the match is not filled.
    """
    if phase.row_step == 1:
        return match, margin, Seen(phase.amplitude, phase.background, phase.status)
    disparity, sigma, signed, mismatch, margins, amplitude = buffer
    background, status = np.empty_like(amplitude), np.empty(amplitude.shape, dtype=np.uint8)
    fill_all(
        np.int64(phase.first_row), np.int64(phase.row_step), match.disparity_px, match.signed_mismatch_rad, margin,
        phase.amplitude, phase.background, phase.status, disparity, signed, mismatch, margins, amplitude, background,
        status,
    )  # fmt: skip
    return Match(disparity, sigma, signed, mismatch), margins, Seen(amplitude, background, status)


@njit(parallel=True, cache=True)
def fill_all(  # type: ignore[no-untyped-def]
    first, step, some_disparity, some_signed, some_margin, some_amplitude, some_background, some_status, disparity,
    signed, mismatch, margin, amplitude, background, status,
):  # fmt: skip
    """Fill the last seven (H, W) from those before (n, W), rows ``step`` apart from ``first`` on."""
    most, last = np.float32(step) * STEEPEST_PX, some_disparity.shape[0] - 1
    for row in prange(disparity.shape[0]):
        y = np.int64(row)
        above = min(max((y - first) // step, 0), last)
        away = y - first - step * above
        below = min(above + 1, last) if away > 0 else above
        part = np.float32(away) / np.float32(step)
        fill_match(
            some_disparity[above], some_disparity[below], some_signed[above], some_signed[below], some_margin[above],
            some_margin[below], part, most, disparity[y], signed[y], mismatch[y], margin[y],
        )  # fmt: skip
        fill_light(
            some_amplitude[above], some_amplitude[below], some_background[above], some_background[below],
            some_status[below if 2 * away > step else above], part, amplitude[y], background[y], status[y],
        )  # fmt: skip


@njit(**ROW)
def fill_match(  # type: ignore[no-untyped-def]
    disparity_0, disparity_1, signed_0, signed_1, margin_0, margin_1, part, most, disparity, signed, mismatch, margin
):
    """Match of a row between two others, ``part`` of the way to the second."""
    for x in range(disparity.size):
        step = disparity_1[x] - disparity_0[x]
        disparity[x] = disparity_0[x] + part * step if abs(step) <= most else np.float32(np.nan)
        signed[x] = signed_0[x] + part * (signed_1[x] - signed_0[x])
        mismatch[x] = abs(signed[x])
        margin[x] = margin_0[x] if margin_0[x] < margin_1[x] else margin_1[x]


@njit(**ROW)
def fill_light(  # type: ignore[no-untyped-def]
    amplitude_0, amplitude_1, background_0, background_1, near_status, part, amplitude, background, status
):
    """Light of a row between two others, ``part`` of the way to the second; the status of the nearer one."""
    for x in range(status.size):
        amplitude[x] = amplitude_0[x] + part * (amplitude_1[x] - amplitude_0[x])
        background[x] = background_0[x] + part * (background_1[x] - background_0[x])
        status[x] = near_status[x]
