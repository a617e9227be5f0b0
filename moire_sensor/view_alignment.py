"""Two cheap measurements that tell a user what is wrong with a calibration: row offset and fringe period.

Both compare the images with what the measured depth predicts, so the shape of the scene does not disturb them. They
take some milliseconds and are meant for every few seconds, not for every exposure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig

Float = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
ROWS_APART_PX = 8
# Rows further apart than this give no depth at all, so nothing could be measured.
MAX_OFFSET_PX = 4
# Vertical structure longer than this is shading, which does not tell rows apart.
TEXTURE_PX = 15
# Where rows lie apart, edges of texture match badly, and just there depth is missing. Holes of a column are closed if
# so much of a window so high is known, and alike.
HOLE_WINDOW_PX, LEAST_KNOWN, MOST_SPREAD_PX = 31, 0.3, 1.0
# A best offset must correlate as well as this, and better by this than the mean of all; white walls lie below 0.1.
LEAST_CORRELATION, LEAST_GAIN = 0.5, 0.15
LEAST_PIXELS = 2000
# Of noise alone, windows a period apart share a sixth; fringes keep their phase from one to the next.
LEAST_COHERENCE = 0.6


@dataclass(frozen=True)
class Alignment:
    """What two views and the projector's period look like.

    Attributes
    ----------
    row_offset_px : rows by which the right image lies below the left one; NaN where texture is too little to tell,
        since vertical fringes alone show no row.
    period_error : relative excess of the fringe period over the pattern's; NaN where no fringes are seen. Where the
        projector itself measures the depth it agrees with any period near the true one, and nothing is found.
    """

    row_offset_px: float
    period_error: float


def measure_alignment(
    rig: StereoRig,
    pattern: FringePattern,
    left: npt.NDArray[np.generic],
    right: npt.NDArray[np.generic],
    depth_m: Float32,
    depth_range_m: tuple[float, float],
) -> Alignment:
    """Measure row offset and fringe period of one exposure.

    Parameters
    ----------
    rig, pattern : as the depth was measured with.
    left, right : rectified images (H, W), any grey levels.
    depth_m : (H, W) float32, NaN where unknown. Where nearly all is, the middle of ``depth_range_m`` stands in for the
        fringe period, which is then right within some percent only.
    """
    known = np.isfinite(depth_m)
    rad_per_px, period_error = fringe_period(rig, pattern, left, depth_m, depth_range_m)
    if not math.isfinite(rad_per_px):
        return Alignment(math.nan, math.nan)
    disparity_px = rig.disparity_px(np.where(known, depth_m, depth_range_m[1])).astype(np.float32)
    fringe_px = 2.0 * math.pi / (rad_per_px / (1.0 + (0.0 if math.isnan(period_error) else period_error)))
    offset_px = row_offset_px(texture(left, fringe_px), texture(right, fringe_px), *closed(disparity_px, known))
    return Alignment(offset_px, period_error)


def fringe_period(
    rig: StereoRig,
    pattern: FringePattern,
    left: npt.NDArray[np.generic],
    depth_m: Float32,
    depth_range_m: tuple[float, float],
) -> tuple[float, float]:
    """Return the expected phase per pixel (absolute, radians; NaN of none) and the relative error of the period."""
    depth_m = depth_m[::ROWS_APART_PX]
    if np.count_nonzero(np.isfinite(depth_m)) < LEAST_PIXELS // 4:
        middle_m = 2.0 / (1.0 / depth_range_m[0] + 1.0 / depth_range_m[1])
        depth_m = np.full_like(depth_m, middle_m)
    points_m = rig.rays()[::ROWS_APART_PX] * depth_m[..., None]
    phase_rad = pattern.phase_at(rig.projector_pixels(points_m)[..., 0])
    step_rad = np.diff(phase_rad, axis=1)
    step_rad = step_rad[np.isfinite(step_rad)]
    rad_per_px = float(np.median(step_rad)) if step_rad.size else math.nan
    if not 2.0 * math.pi / left.shape[1] < abs(rad_per_px) < math.pi / 2.0:
        return math.nan, math.nan
    slope_rad = phase_slope(left[::ROWS_APART_PX].astype(np.float64), phase_rad, 2.0 * math.pi / abs(rad_per_px))
    return abs(rad_per_px), 1.0 / (1.0 + slope_rad / rad_per_px) - 1.0


def phase_slope(rows: Float, phase_rad: Float, fringe_px: float) -> float:
    """Mean phase per pixel of fringes (n, W) beyond the expected ``phase_rad`` (n, W), NaN where there are none.

    Demodulated in windows of two periods, which hold neither background nor second harmonic.
    """
    known = np.isfinite(phase_rad)
    window = hann(2.0 * fringe_px)
    seen = rows * np.exp(-1j * np.where(known, phase_rad, 0.0)) * known
    wave = cv2.sepFilter2D(seen.real, -1, window, np.ones(1)) + 1j * cv2.sepFilter2D(seen.imag, -1, window, np.ones(1))
    whole = cv2.erode(known.astype(np.uint8), np.ones((1, window.size), np.uint8), borderType=cv2.BORDER_CONSTANT,
                      borderValue=0) > 0  # fmt: skip
    apart = max(round(fringe_px), 1)
    both = whole[:, apart:] & whole[:, :-apart]
    if np.count_nonzero(both) < LEAST_PIXELS // ROWS_APART_PX:
        return math.nan
    turned = (wave[:, apart:] * np.conj(wave[:, :-apart]))[both]
    total = turned.sum()
    if abs(total) < LEAST_COHERENCE * np.abs(turned).sum():
        return math.nan
    return float(np.angle(total)) / apart


def texture(image: npt.NDArray[np.generic], fringe_px: float) -> Float32:
    """Vertical change of the image (H, W) without fringes and without slow shading."""
    grey = np.asarray(cv2.sepFilter2D(image.astype(np.float32), -1, hann(2.0 * fringe_px), np.ones(1)))
    grey = grey - cv2.blur(grey, (1, TEXTURE_PX))
    change = np.zeros(grey.shape, dtype=np.float32)
    change[1:-1] = grey[2:] - grey[:-2]
    return change


def closed(disparity_px: Float32, known: Mask) -> tuple[Float32, Mask]:
    """Disparity (H, W) with its holes in columns closed by the mean of what is known above and below, and what is."""
    window, weight = (1, HOLE_WINDOW_PX), known.astype(np.float32)
    values = np.where(known, disparity_px, np.float32(0.0))
    share = cv2.blur(weight, window)
    weight = np.maximum(share, np.float32(1e-6))
    mean = cv2.blur(values, window) / weight
    alike = cv2.blur(values * values, window) / weight - mean * mean <= MOST_SPREAD_PX**2
    fill = ~known & (share >= LEAST_KNOWN) & alike
    return np.where(fill, mean, disparity_px), known | fill


def row_offset_px(left: Float32, right: Float32, disparity_px: Float32, known: Mask) -> float:
    """Rows by which the right texture (H, W) lies below the left one, to a part of a row; NaN where it is unclear."""
    height, width = left.shape
    columns = np.arange(width, dtype=np.float32)[None] - disparity_px
    rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
    inside = known & (columns >= 0) & (columns <= width - 1)
    inside[: MAX_OFFSET_PX + 1] = inside[height - MAX_OFFSET_PX - 1 :] = False
    if np.count_nonzero(inside) < LEAST_PIXELS:
        return math.nan
    offsets = range(-MAX_OFFSET_PX, MAX_OFFSET_PX + 1)
    wanted = left[inside]
    scores = np.array([
        correlation(wanted, cv2.remap(right, columns, rows + offset, cv2.INTER_LINEAR)[inside]) for offset in offsets
    ])  # fmt: skip
    best = int(scores.argmax())
    if not (0 < best < scores.size - 1 and scores[best] > LEAST_CORRELATION):
        return math.nan
    if scores[best] - scores.mean() < LEAST_GAIN:
        return math.nan
    before, at, after = scores[best - 1 : best + 2]
    return offsets[best] + 0.5 * float(before - after) / float(before - 2.0 * at + after)


def correlation(first: Float32, second: Float32) -> float:
    """Normalised correlation of two lists of values around zero; 0 where one is constant."""
    power = float(first @ first) * float(second @ second)
    return float(first @ second) / math.sqrt(power) if power > 0.0 else 0.0


def hann(length_px: float) -> Float:
    """Smooth window of a length that need not be whole, its sum 1."""
    half = max(int(length_px / 2.0), 1)
    window = 1.0 + np.cos(2.0 * np.pi * np.arange(-half, half + 1) / length_px)
    return np.asarray(window / window.sum())
