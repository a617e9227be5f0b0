"""Direct match of grey levels where shading or curvature spoils the phase of a one-period window.

Both cameras see the same shaded, curved, textured piece of fringe, so a short patch of one image is the best model of
the other: no background, amplitude or waveform is assumed. Only pixels whose two phases disagree with the projector
are matched again, from the disparity that the fringe order gave them.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE
from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

ITERATIONS = 3
LARGEST_MOVE_PX = 4.0
HALF_HEIGHT = 1
SAMPLE_PX = 3


def rematch(
    match: Match, images: tuple[Float32, Float32], amplitude: Float32, carrier: Carrier, settings: Settings
) -> None:
    """Match again, in place, all pixels whose mismatch exceeds the doubt; NaN where no patch fits.

    Parameters
    ----------
    match : disparities from the phases.
    images : left, and right with the grey levels of the left (:func:`right_as_left`), (H, W) float32.
    amplitude : fringe amplitude of the left image (H, W), the measure of a fit.
    carrier : the left camera's carrier.
    """
    half_width = max(carrier.half_width_px // 2, 2)
    match_patches(
        *images, match.mismatch_rad, amplitude, half_width, settings.doubt_rad, settings.image_noise,
        settings.max_misfit, match.disparity_px, match.sigma_px,
    )  # fmt: skip


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
    return np.asarray(right * np.float32(gain) + np.float32(shift))


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def match_patches(left, right, mismatch, amplitude, half_width, doubt, noise, max_misfit, disparity, sigma):  # type: ignore[no-untyped-def]
    """Replace disparity and sigma of doubtful pixels by those of the best of three patches, NaN where none fits."""
    height, width = left.shape
    for row in prange(height):
        y = np.int64(row)
        top, bottom = max(y - HALF_HEIGHT, 0), min(y + HALF_HEIGHT, height - 1)
        for x in range(width):
            if np.isnan(disparity[y, x]) or mismatch[y, x] <= doubt:
                continue
            enough = np.float32((3.0 * noise) ** 2)
            best_error = np.float32(np.inf)
            best, best_power = disparity[y, x], np.float32(1.0)
            for shift in (0, -half_width, half_width):
                first, last = max(x + shift - half_width, 0), min(x + shift + half_width, width - 1)
                if last - first < half_width or best_error < enough:
                    continue
                found, error, power = match_patch(left, right, first, last, top, bottom, best)
                error = error if shift == 0 else np.float32(1.5) * error
                if error < best_error:
                    best, best_error, best_power = found, error, power
            sigma[y, x] = np.sqrt(best_error / max(best_power, np.float32(1e-6)))
            allowed = 2.0 * noise + max_misfit * max(amplitude[y, x], np.float32(1.0))
            disparity[y, x] = best if best_error < allowed * allowed else np.float32(np.nan)


@njit(inline="always", fastmath=False)
def match_patch(left, right, first, last, top, bottom, start):  # type: ignore[no-untyped-def]
    """Gauss-Newton shift of one patch: disparity, mean squared difference (inf when it ran away), slope power."""
    width = right.shape[1]
    moved = np.float32(0.0)
    error, power = np.float32(np.inf), np.float32(0.0)
    for _ in range(ITERATIONS):
        gradient = np.float32(0.0)
        power = np.float32(0.0)
        squares = np.float32(0.0)
        count = 0
        shift = start + moved
        base = int(np.floor(-shift))
        part = np.float32(-shift - base)
        for y in range(top, bottom + 1):
            for x in range(max(first, -base + 1), min(last, width - base - 3) + 1):
                near, far = right[y, x + base], right[y, x + base + 1]
                outer, inner = right[y, x + base - 1], right[y, x + base + 2]
                slope = np.float32(0.5) * ((np.float32(1.0) - part) * (far - outer) + part * (inner - near))
                residual = left[y, x] - near - part * (far - near)
                gradient += slope * residual
                power += slope * slope
                squares += residual * residual
                count += 1
        if count < 9 or power < np.float32(1e-3):
            return start, np.float32(np.inf), power
        error = squares / np.float32(count)
        step = -gradient / power
        moved += min(max(step, np.float32(-1.5)), np.float32(1.5))
        if abs(moved) > LARGEST_MOVE_PX:
            return start, np.float32(np.inf), power
        if abs(step) < np.float32(0.02):
            break
    return start + moved, error, power
