"""Direct match of grey levels where shading or curvature spoils the phase of a one-period window.

Both cameras see the same shaded, curved, textured piece of fringe, so a short patch of one image is the best model of
the other: no background, amplitude or waveform is assumed. Only pixels whose two phases disagree with the projector
are matched again, from the disparity that the fringe order gave them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

ITERATIONS = 5
LARGEST_MOVE_PX = 4.0
HALF_HEIGHT = 2


def rematch(
    match: Match,
    images: tuple[Float32, Float32],
    phases: tuple[PhaseImage, PhaseImage],
    carrier: Carrier,
    projector: ProjectorMap,
    settings: Settings,
) -> tuple[Match, Float32]:
    """Match again all pixels whose mismatch exceeds the doubt, in rigs that measure left against right.

    Returns
    -------
    match : the match with those disparities replaced; NaN where no patch fits.
    misfit : (H, W) float32, left over of the patch beyond noise relative to the fringe amplitude; 0 where the phase was kept.
    """
    misfit = np.zeros_like(match.disparity_px)
    if not measures_by_stereo(carrier, projector):
        return match, misfit
    doubtful = match.mismatch_rad > settings.doubt_rad
    gain, shift = grey_relation(match.disparity_px, phases, ~doubtful)
    disparity, sigma = match.disparity_px.copy(), match.sigma_px.copy()
    half_width = max(carrier.half_width_px // 2, 2)
    right = images[1] * np.float32(gain) + np.float32(shift)
    match_patches(
        images[0], right, doubtful, phases[0].amplitude, half_width, settings.image_noise, disparity, sigma, misfit
    )
    return Match(disparity, sigma, match.mismatch_rad), misfit


def measures_by_stereo(carrier: Carrier, projector: ProjectorMap) -> bool:
    """True where a pixel of disparity turns the phase more between the cameras than against the projector."""
    height, width = carrier.phase_rad.shape
    column, row = np.array(width / 2.0), np.array(height / 2.0)
    step = projector.phase_rad_at(column, row, 1.0) - projector.phase_rad_at(column, row, 0.0)
    return bool(np.median(np.abs(carrier.rad_per_px)) > np.abs(step))


def grey_relation(
    disparity_px: Float32, phases: tuple[PhaseImage, PhaseImage], trusted: npt.NDArray[np.bool_]
) -> tuple[float, float]:
    """Gain and shift that turn right grey levels into left ones, from the fringes of trusted matches."""
    rows, columns = np.nonzero(trusted & np.isfinite(disparity_px))
    if rows.size < 100:
        return 1.0, 0.0
    rows, columns = rows[:: rows.size // 5000 + 1], columns[:: rows.size // 5000 + 1]
    seen = np.clip(np.rint(columns - disparity_px[rows, columns]), 0, disparity_px.shape[1] - 1).astype(np.int64)
    left, right = phases
    gain = float(np.median(left.amplitude[rows, columns] / np.maximum(right.amplitude[rows, seen], 1.0)))
    shift = float(np.median(left.background[rows, columns] - gain * right.background[rows, seen]))
    return gain, shift


@njit(parallel=True, cache=True)
def match_patches(left, right, doubtful, amplitude, half_width, noise, disparity, sigma, misfit):  # type: ignore[no-untyped-def]
    """Replace disparity, sigma and misfit of doubtful pixels by those of the best of three patches."""
    height, width = left.shape
    for row in prange(height):
        y = np.int64(row)
        top, bottom = max(y - HALF_HEIGHT, 0), min(y + HALF_HEIGHT, height - 1)
        for x in range(width):
            if not doubtful[y, x] or np.isnan(disparity[y, x]):
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
            misfit[y, x] = max(np.sqrt(best_error) - 2.0 * noise, 0.0) / max(amplitude[y, x], np.float32(1.0))
            sigma[y, x] = np.sqrt(best_error / max(best_power, np.float32(1e-6)))
            disparity[y, x] = best if best_error < np.inf else np.float32(np.nan)


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
