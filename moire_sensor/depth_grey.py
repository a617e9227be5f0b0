"""Disparity measured by grey levels: both cameras see the same shaded, curved, textured piece of fringe.

A phase fitted to a one-period window takes a shading for a phase, and a mean over a window flattens curvature. The
other image knows both: moved along the surface that the phases give, it differs from this one by what the surface is
off (Lucas and Kanade 1981), whatever background, albedo, amplitude or waveform.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import njit, prange

from moire_sensor.depth_foreign import drop_foreign
from moire_sensor.depth_measure import compare_row, fill_sigma, measure
from moire_sensor.depth_refine import Match
from moire_sensor.depth_surface import along_surface
from moire_sensor.median import median
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.scratch import scratch
from moire_sensor.settings import Settings

# Two rounds settle what has no texture, but for 1 % of the pixels, beside edges. Where more still move far, texture has
# misled the phases, and there are more rounds.
ROUNDS_ON_TEXTURE = 5
MOVING_SHARE = 0.014
# What a window needs to measure: squared slopes that place it to a tenth of a pixel.
SURE_PX = 0.1
# So many rows, and every so many pixels of them, tell how bright the views are; fewer matched ones tell nothing.
SAMPLE_ROWS, SAMPLE_PX, FEWEST = 16, 4, 40
# One pixel in so many, both ways, tells the usual noise. Its median magnitude, in standard deviations.
NOISE_SAMPLE_PX, MEDIAN_SIGMAS = 8, 0.6745
# Rows above and below in a window in which two views may not look different; phase steps resolve single rows.
HALF_MISFIT_ROWS = 1


def measures_by_stereo(carrier: Carrier, projector: ProjectorMap) -> bool:
    """True where a pixel of disparity turns the phase more between the cameras than against the projector."""
    height, width = carrier.phase_rad.shape
    column, row = np.array(width / 2.0), np.array(height / 2.0)
    step = projector.phase_rad_at(column, row, 1.0) - projector.phase_rad_at(column, row, 0.0)
    return bool(np.median(np.abs(carrier.rad_per_px)) > np.abs(step))


def right_as_left(right: Float32, disparity_px: Float32, phases: tuple[PhaseImage, PhaseImage]) -> Float32:
    """Right image (H, W) with the gain and shift that turn its grey levels into left ones, from matched fringes.

    It lasts until the next call in this thread.
    """
    every = max(1, right.shape[0] // SAMPLE_ROWS)
    pairs = np.empty((4, disparity_px[every // 2 :: every, ::SAMPLE_PX].size), dtype=np.float32)
    count = fill_pairs(
        disparity_px, *(image for one in phases for image in (one.amplitude, one.background)), every, pairs
    )
    if count < FEWEST:
        return right
    left_amplitude, left_background, right_amplitude, right_background = pairs[:, :count]
    gain = median(left_amplitude / np.maximum(right_amplitude, np.float32(1.0)))
    shift = median(left_background - gain * right_background)
    return np.asarray(cv2.addWeighted(right, float(gain), right, 0.0, float(shift), dst=Room.of(right.shape).right))


@njit(error_model="numpy", cache=True)
def fill_pairs(  # type: ignore[no-untyped-def]
    disparity, left_amplitude, left_background, right_amplitude, right_background, every, pairs
):
    """Fill ``pairs`` (4, n) with what both views show at matched samples, the four images in order; return how many."""
    height, width = disparity.shape
    count = 0
    for y in range(every // 2, height, every):
        for x in range(0, width, SAMPLE_PX):
            if np.isnan(disparity[y, x]):
                continue
            seen = int(min(max(np.rint(x - disparity[y, x]), 0.0), width - 1.0))
            pairs[0, count], pairs[1, count] = left_amplitude[y, x], left_background[y, x]
            pairs[2, count], pairs[3, count] = right_amplitude[y, seen], right_background[y, seen]
            count += 1
    return count


def match_greys(
    match: Match, greys: tuple[Float32, Float32], amplitude: Float32, half_width: int, settings: Settings
) -> Match:
    """Measure every disparity by the grey levels of a window one period wide, after :func:`approach_greys`.

    Parameters
    ----------
    match : disparities within a pixel or so of the truth, but for few.
    greys : left, and right with the grey levels of the left (:func:`right_as_left`), (H, W) float32.
    amplitude : fringe amplitude of the left image (H, W).
    half_width : half of a period, pixels.

    Returns
    -------
    Match
        NaN where the two views look different. Its disparities last until the next call in this thread; its other
        images are those of ``match``, whose sigma is filled anew.
    """
    disparity, room = match.disparity_px, Room.of(amplitude.shape)
    for number in range(ROUNDS_ON_TEXTURE - 1):
        disparity, moving = one_round(disparity, greys, amplitude, half_width, settings.half_height_grey_px, settings)
        if number == 0 and moving <= MOVING_SHARE * np.count_nonzero(disparity == disparity):
            break
    window = 2 * half_width + 1, settings.half_height_grey_px
    fill_sigma(room.apart, room.power, *window, least_power(settings), typical_noise(room.apart), match.sigma_px)
    if number > 0:
        add_moves(match.sigma_px, np.subtract(disparity, room.smooth, out=room.smooth), half_width, window[1])
    drop_foreign(disparity, room.apart, amplitude, HALF_MISFIT_ROWS, settings)
    return replace(match, disparity_px=disparity)


def typical_noise(apart: Float32) -> np.float32:
    """Standard deviation of the differences (H, W) by their median magnitude, which sharp steps do not change."""
    some = apart[::NOISE_SAMPLE_PX, ::NOISE_SAMPLE_PX]
    some = some[some > 0.0]
    return np.float32(median(some) / MEDIAN_SIGMAS if some.size else np.inf)


def add_moves(sigma_px: Float32, moves_px: Float32, half_width: int, half_height: int) -> None:
    """Add in place to ``sigma_px`` (H, W) what the last round still moved, root mean square of the window.

    Texture moves neighbours by different errors, each the same in all rounds, and leaves no difference that tells so.
    """
    known, window = np.isfinite(moves_px), (2 * half_width + 1, 2 * half_height + 1)
    squares = cv2.blur(np.where(known, moves_px * moves_px, np.float32(0.0)), window)
    share = cv2.blur(known.astype(np.float32), window)
    np.hypot(sigma_px, np.sqrt(squares / np.maximum(share, np.float32(1e-6))), out=sigma_px)


def approach_greys(
    match: Match, greys: tuple[Float32, Float32], phase: PhaseImage, half_width: int, settings: Settings
) -> Match:
    """The first round of :func:`match_greys`, for the rows (n, W) of the left ``phase``: match within a few pixels."""
    half_height = -(-settings.half_height_grey_px // phase.row_step)
    rows = phase.first_row, phase.row_step
    found, _ = one_round(match.disparity_px, greys, phase.amplitude, half_width, half_height, settings, rows)
    return replace(match, disparity_px=found)


def one_round(
    disparity_px: Float32,
    greys: tuple[Float32, Float32],
    amplitude: Float32,
    half_width: int,
    half_height: int,
    settings: Settings,
    rows: tuple[int, int] = (0, 1),
) -> tuple[Float32, int]:
    """Disparities (n, W) moved once, which last until the next call, and how many moved far.

    Windows reach ``half_height`` rows up and down; ``rows`` are the first and the step of those of the disparities.
    """
    room = Room.of(amplitude.shape)
    smooth = along_surface(disparity_px, half_width, half_height, (room.apart, room.smooth))
    moving = measure(
        *greys, smooth, amplitude, *rows, 2 * half_width + 1, half_height, np.float32(settings.image_noise),
        least_power(settings), room.apart, room.power, room.found,
    )  # fmt: skip
    return room.found, moving


def least_power(settings: Settings) -> np.float32:
    """Least sum of squared slopes that places a window."""
    return np.float32((settings.image_noise / SURE_PX) ** 2)


@dataclass(frozen=True)
class Room:
    """Work memory for images (H, W): what differs, squared slopes, disparities, their means, the right image."""

    apart: Float32
    power: Float32
    found: Float32
    smooth: Float32
    right: Float32

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> Room:
        """Memory that all calls of a thread share."""
        return scratch(("greys", shape), lambda: cls(*np.empty((5, *shape), dtype=np.float32)))


def check_greys(match: Match, greys: tuple[Float32, Float32], amplitude: Float32, settings: Settings) -> None:
    """Set in place to NaN the disparities where the two views look different; parameters of :func:`match_greys`."""
    power, met, apart = (np.empty_like(amplitude) for _ in range(3))
    compare(*greys, match.disparity_px, amplitude, np.float32(settings.image_noise), power, met, apart)
    drop_foreign(match.disparity_px, apart, amplitude, 0, settings)


@njit(parallel=True, cache=True)
def compare(left, right, disparity, amplitude, noise, power, met, apart):  # type: ignore[no-untyped-def]
    """Compare the rows of images (H, W) as :func:`moire_sensor.depth_measure.compare_row`."""
    for y in prange(left.shape[0]):
        compare_row(left[y], right[y], disparity[y], amplitude[y], noise, power[y], met[y], apart[y])
