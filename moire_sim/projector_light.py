"""The projector's light as a real lens throws it: blurred with distance, weaker far away and in the corners."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from moire_sensor.pattern import FringePattern
from moire_sim.device_view import DeviceView, dot
from moire_sim.exposure import projected_signal
from moire_sim.optics import Optics

Array = npt.NDArray[np.float64]
PHASES = 1024
# Harmonics below this share of the amplitude are a hundredth of a grey level.
FAINTEST = 1e-4
MOST_HARMONICS = 41
# The standard deviation of a uniform disc is a quarter of its diameter.
DISC_DEVIATION = 0.25


@lru_cache(maxsize=64)
def harmonics(waveform: str, period_px: float, gamma: float) -> tuple[float, ...]:
    """Coefficients c_k of ``c_0 + sum c_k cos(k phase)`` of what the projector shows, up to the last that counts."""
    pattern = FringePattern(period_px, waveform="square" if waveform == "square" else "sine")
    wave = projected_signal(pattern, np.arange(PHASES) * period_px / PHASES, 0, gamma)
    coefficients = np.fft.rfft(wave).real[:MOST_HARMONICS] * 2.0 / PHASES
    coefficients[0] /= 2.0
    last = int(np.flatnonzero(np.abs(coefficients) > FAINTEST)[-1])
    return tuple(coefficients[: last + 1].tolist())


def blurred_signal(pattern: FringePattern, step: int, gamma: float, column_px: Array, blur_px: npt.ArrayLike) -> Array:
    """Projector output in -1..1 at device columns, blurred by a Gaussian of ``blur_px`` (both any common shape).

    A Gaussian weakens the harmonic k of a wave of period p by ``exp(-2 (pi k blur / p)^2)``, exactly.
    """
    phase = pattern.phase_at(column_px, step)
    first = np.cos(phase)
    loss = np.exp(-2.0 * np.square(np.pi / pattern.period_px * np.asarray(blur_px)))
    coefficients = harmonics(pattern.waveform, pattern.period_px, gamma)
    before, current = np.ones_like(first), first
    signal = np.full(first.shape, coefficients[0])
    for k, coefficient in enumerate(coefficients[1:], start=1):
        if coefficient:
            signal += coefficient * current * loss ** (k * k)
        before, current = current, 2.0 * first * current - before
    return signal


def defocus_px(optics: Optics, projector: DeviceView, points_m: Array) -> Array:
    """Blur (...) of the projector on points (..., 3), in its pixels, standard deviation."""
    away = np.maximum(projector.to_device(points_m)[..., 2], 1e-3)
    focal_px = float(projector.intrinsic[0, 0])
    disc_px = optics.projector_aperture_mm * 1e-3 * focal_px * np.abs(1.0 / away - 1.0 / optics.projector_focus_m)
    return np.asarray(np.hypot(DISC_DEVIATION * disc_px, optics.projector_blur_px))


def strength(optics: Optics, projector: DeviceView, points_m: Array, device_px: Array) -> Array:
    """Share (...) of the stated light that reaches points (..., 3): fall-off with distance, and vignetting."""
    share = np.ones(points_m.shape[:-1])
    if optics.fall_off_m:
        away = points_m - projector.centre_m
        share = optics.fall_off_m**2 / np.maximum(dot(away, away), 1e-6)
    if optics.projector_vignetting:
        share = share * corner_loss(device_px, projector.size, optics.projector_vignetting)
    return np.asarray(share)


def corner_loss(pixels: Array, size: tuple[int, int], vignetting: float) -> Array:
    """Share (...) of the light left at pixels (..., 2): less by the square of the way to a corner from the middle."""
    middle = (np.asarray(size, dtype=np.float64) - 1.0) / 2.0
    squared = np.square(pixels - middle).sum(axis=-1) / float(middle @ middle)
    return np.asarray(np.clip(1.0 - vignetting * squared, 0.0, 1.0))


def gloss(planes: Array, points_m: Array, light_m: Array, camera_m: Array, shininess: Array) -> Array:
    """Blinn's lobe (...): cosine between normal and halfway direction, to the power ``shininess`` (Blinn 1977)."""
    to_light, to_camera = light_m - points_m, camera_m - points_m
    halfway = to_light / norm(to_light) + to_camera / norm(to_camera)
    normal = -planes / norm(planes)
    cosine = dot(normal, halfway) / norm(halfway)[..., 0]
    return np.asarray(np.power(np.clip(cosine, 0.0, 1.0), shininess))


def norm(vectors: Array) -> Array:
    """Lengths (..., 1) of vectors (..., 3), never 0."""
    return np.asarray(np.sqrt(dot(vectors, vectors))[..., None] + math.ulp(1.0))
