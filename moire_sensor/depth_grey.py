"""Disparity measured by grey levels: both cameras see the same shaded, curved, textured piece of fringe.

A phase fitted to a one-period window takes a shading for a phase, and a mean over a window flattens curvature. The
other image knows both: moved along the surface that the phases give, it differs from this one by what the surface is
off (Lucas and Kanade 1981), whatever background, albedo, amplitude or waveform.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit, prange

from moire_sensor.apart import ROW, ROW_FAST
from moire_sensor.box_sums import box_sum
from moire_sensor.depth_refine import Match
from moire_sensor.depth_surface import along_surface
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

# Two rounds settle what has no texture, but for 1 % of the pixels, beside edges. Where more still move far, texture has
# misled the phases, and there are more rounds.
ROUNDS, ROUNDS_ON_TEXTURE = 2, 5
FAR_STEP_PX, MOVING_SHARE = np.float32(0.2), 0.014
LARGEST_STEP_PX = np.float32(0.7)
# Pixels that differ by more than this share of the fringe amplitude, noise apart, do not show one point.
FOREIGN_SHARE = np.float32(0.35)
# What a window needs to measure: squared slopes that place it to a tenth of a pixel.
SURE_PX = 0.1
SAMPLE_PX = 7
# Standard deviation by mean magnitude, of a normal distribution.
SIGMA_OF_MEAN = np.float32(np.sqrt(np.pi / 2.0))
# What the disparities of the former round add, averaged along the surface: 1.23 to 1.42 on the analytic scenes.
ROUNDS_SIGMA = np.float32(1.3)
# Windows, columns and rows, in which two views may not look different: phase steps resolve single rows.
MISFIT_WINDOW, ROW_WINDOW = (5, 3), (5, 1)


def measures_by_stereo(carrier: Carrier, projector: ProjectorMap) -> bool:
    """True where a pixel of disparity turns the phase more between the cameras than against the projector."""
    height, width = carrier.phase_rad.shape
    column, row = np.array(width / 2.0), np.array(height / 2.0)
    step = projector.phase_rad_at(column, row, 1.0) - projector.phase_rad_at(column, row, 0.0)
    return bool(np.median(np.abs(carrier.rad_per_px)) > np.abs(step))


def right_as_left(right: Float32, disparity_px: Float32, phases: tuple[PhaseImage, PhaseImage]) -> Float32:
    """Right image (H, W) with the gain and shift that turn its grey levels into left ones, from matched fringes."""
    rows, columns = (SAMPLE_PX * part for part in np.nonzero(np.isfinite(disparity_px[::SAMPLE_PX, ::SAMPLE_PX])))
    if rows.size < 100:
        return right
    seen = np.clip(np.rint(columns - disparity_px[rows, columns]), 0, right.shape[1] - 1).astype(np.int64)
    left_phase, right_phase = phases
    gain = np.median(left_phase.amplitude[rows, columns] / np.maximum(right_phase.amplitude[rows, seen], 1.0))
    shift = np.median(left_phase.background[rows, columns] - gain * right_phase.background[rows, seen])
    return np.asarray(cv2.addWeighted(right, float(gain), right, 0.0, float(shift)))


def match_greys(
    match: Match, greys: tuple[Float32, Float32], amplitude: Float32, half_width: int, settings: Settings
) -> Match:
    """Measure every disparity by the grey levels of a window one period wide.

    Parameters
    ----------
    match : disparities within a few pixels of the truth.
    greys : left, and right with the grey levels of the left (:func:`right_as_left`), (H, W) float32.
    amplitude : fringe amplitude of the left image (H, W).
    half_width : half of a period, pixels.

    Returns
    -------
    Match
        NaN where the two views look different.
    """
    noise = np.float32(settings.image_noise)
    enough = np.float32((settings.image_noise / SURE_PX) ** 2)
    window = (2 * half_width + 1, 2 * settings.half_height_grey_px + 1)
    disparity = match.disparity_px
    power, met, apart = (np.empty_like(amplitude) for _ in range(3))
    known = np.count_nonzero(disparity == disparity)
    for number in range(1, ROUNDS_ON_TEXTURE + 1):
        smooth = along_surface(disparity, half_width, settings.half_height_grey_px)
        compare(*greys, smooth, amplitude, noise, power, met, apart)
        power_sum = box_sum(power, window)
        disparity = np.empty_like(smooth)
        moving = move(smooth, power_sum, box_sum(met, window), enough, disparity)
        if number == ROUNDS and moving <= MOVING_SHARE * known:
            break
    sigma = sigma_of(apart, power_sum, window, float(enough))
    drop_foreign(disparity, least_difference(apart, MISFIT_WINDOW), amplitude, settings)
    return Match(disparity, sigma, match.signed_mismatch_rad, match.mismatch_rad)


def sigma_of(apart: Float32, power_sum: Float32, window: tuple[int, int], enough: float) -> Float32:
    """Predicted standard deviation (H, W) of a disparity, pixels, from what the window leaves unexplained."""
    known, sigma = np.empty_like(apart), np.empty_like(apart)
    cv2.threshold(apart, 0.0, 1.0, cv2.THRESH_BINARY, dst=known)
    fill_sigma(box_sum(apart, window), box_sum(known, window), power_sum, np.float32(enough), sigma)
    return sigma


@njit(parallel=True, cache=True)
def fill_sigma(apart, known, power, enough, sigma):  # type: ignore[no-untyped-def]
    """Fill ``sigma`` (H, W) from sums over windows: differences, pixels that have one, and squared slopes."""
    for y in prange(sigma.shape[0]):
        sigma_row(apart[y], known[y], power[y], enough, sigma[y])


@njit(**ROW_FAST)
def sigma_row(apart, known, power, enough, sigma):  # type: ignore[no-untyped-def]
    """One row of :func:`fill_sigma`."""
    for x in range(sigma.size):
        noise = SIGMA_OF_MEAN * apart[x] / max(known[x], np.float32(1.0))
        sigma[x] = ROUNDS_SIGMA * noise / np.sqrt(max(power[x], enough))


def check_greys(match: Match, greys: tuple[Float32, Float32], amplitude: Float32, settings: Settings) -> None:
    """Set in place to NaN the disparities where the two views look different; parameters of :func:`match_greys`."""
    power, met, apart = (np.empty_like(amplitude) for _ in range(3))
    compare(*greys, match.disparity_px, amplitude, np.float32(settings.image_noise), power, met, apart)
    drop_foreign(match.disparity_px, least_difference(apart, ROW_WINDOW), amplitude, settings)


def least_difference(apart: Float32, window: tuple[int, int]) -> Float32:
    """Mean difference (H, W) of the best window (columns, rows) that holds the pixel: some lie on one surface."""
    return np.asarray(cv2.erode(cv2.blur(apart, window), np.ones(window[::-1], dtype=np.uint8)))


def drop_foreign(disparity_px: Float32, apart: Float32, amplitude: Float32, settings: Settings) -> None:
    """Set in place to NaN the disparities whose views differ by more than noise and the allowed misfit."""
    limits = np.array([2.0 * settings.image_noise, settings.max_misfit], dtype=np.float32)
    clear_foreign(disparity_px, apart, amplitude, limits)


@njit(parallel=True, cache=True)
def clear_foreign(disparity, apart, amplitude, limits):  # type: ignore[no-untyped-def]
    """Kernel of :func:`drop_foreign`."""
    for y in prange(disparity.shape[0]):
        clear_foreign_row(disparity[y], apart[y], amplitude[y], limits[0], limits[1])


@njit(**ROW)
def clear_foreign_row(disparity, apart, amplitude, noise, share):  # type: ignore[no-untyped-def]
    """One row of :func:`clear_foreign`."""
    for x in range(disparity.size):
        disparity[x] = np.float32(np.nan) if apart[x] > noise + share * amplitude[x] else disparity[x]


@njit(parallel=True, cache=True)
def compare(left, right, disparity, amplitude, noise, power, met, apart):  # type: ignore[no-untyped-def]
    """Fill slope times slope, slope times difference, and difference (each (H, W)) of left and moved right image.

    The right image is read by cubic interpolation. One slope is the left image's, one the right's: the noise of an
    interpolated value has to do with that of its own slope, and the square of it would draw disparities to whole
    pixels. Pixels that the right image does not show have no slope and no difference, those too different to show one
    point no slope.
    """
    for y in prange(left.shape[0]):
        compare_row(left[y], right[y], disparity[y], amplitude[y], noise, power[y], met[y], apart[y])


@njit(**ROW)
def compare_row(left, right, disparity, amplitude, noise, power, met, apart):  # type: ignore[no-untyped-def]
    """One row of :func:`compare`."""
    half, last = np.float32(0.5), left.size - 1
    power[0] = left[min(1, last)] - left[0]
    power[last] = left[last] - left[max(last - 1, 0)]
    for x in range(1, last):
        power[x] = left[x + 1] - left[x - 1]
    lowest, highest = np.float32(1.0), np.float32(last - 2)
    for x in range(left.size):
        seen = np.float32(np.int32(x)) - disparity[x]
        known = (lowest <= seen) & (seen <= highest)
        column = seen if known else lowest
        base = np.uint32(np.int32(column))
        t = column - np.float32(np.int32(base))
        p0, p1, p2, p3 = right[base - 1], right[base], right[base + 1], right[base + 2]
        c1 = half * (p2 - p0)
        c2 = p0 - np.float32(2.5) * p1 + np.float32(2.0) * p2 - half * p3
        c3 = half * (p3 - p0) + np.float32(1.5) * (p1 - p2)
        slope = c1 + t * (np.float32(2.0) * c2 + np.float32(3.0) * t * c3)
        difference = left[x] - (p1 + t * (c1 + t * (c2 + t * c3)))
        distance = abs(difference)
        same = known & (distance < FOREIGN_SHARE * amplitude[x] + np.float32(3.0) * noise)
        own = half * power[x]
        power[x] = own * slope if same else np.float32(0.0)
        met[x] = -own * difference if same else np.float32(0.0)
        apart[x] = distance if known else np.float32(0.0)


@njit(parallel=True, cache=True)
def move(disparity, power, met, enough, moved):  # type: ignore[no-untyped-def]
    """Fill ``moved`` (H, W) with the disparity that removes the difference of the window.

    Returns how many pixels with a disparity it moves far.
    """
    far = np.int64(0)
    for y in prange(disparity.shape[0]):
        far += move_row(disparity[y], power[y], met[y], enough, moved[y])
    return far


@njit(**ROW)
def move_row(disparity, power, met, enough, moved):  # type: ignore[no-untyped-def]
    """One row of :func:`move`."""
    far = np.int32(0)
    for x in range(disparity.size):
        step = met[x] / max(power[x], enough)
        step = min(max(step, -LARGEST_STEP_PX), LARGEST_STEP_PX)
        step = step if power[x] > enough else np.float32(0.0)
        moved[x] = disparity[x] + step
        far += np.int32((abs(step) > FAR_STEP_PX) & (disparity[x] == disparity[x]))
    return far
