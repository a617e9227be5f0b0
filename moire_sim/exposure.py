"""From ideal grey levels to a camera's picture: lens blur, noise, quantisation; and the projector's waveform."""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.pattern import FringePattern

Image = npt.NDArray[np.float32]
# As many as a number of 16 random bits can tell apart.
QUANTILES = 1 << 16


def projected_signal(
    pattern: FringePattern, column_px: npt.NDArray[np.float64], step: int, gamma: float, footprint_px: float = 1.0
) -> npt.NDArray[np.float64]:
    """Projector output in -1..1 at device columns (any shape).

    ``gamma`` bends the projector's response (1 is linear). A square wave is averaged over ``footprint_px`` device
    columns, the width that one sample stands for, so that its edges do not alias.
    """
    if pattern.waveform == "square":
        phase = pattern.phase_at(column_px, step)
        edge_distance_rad = np.arcsin(np.cos(phase))
        half_footprint_rad = math.pi * footprint_px / pattern.period_px
        wave = np.clip(edge_distance_rad / half_footprint_rad, -1.0, 1.0)
    else:
        wave = pattern.signal(column_px, step)
    return bent_response(wave, gamma)


def bent_response(wave: npt.NDArray[np.float64], gamma: float) -> npt.NDArray[np.float64]:
    """Brightness in -1..1 that a projector of this ``gamma`` makes of a signal in -1..1; 1 is linear."""
    return wave if gamma == 1.0 else 2.0 * np.power((1.0 + wave) / 2.0, gamma) - 1.0


def lens_blur(image: Image, blur_px: float) -> Image:
    """Gaussian point spread of standard deviation ``blur_px``; 0 leaves the image as it is."""
    if blur_px <= 0.0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def noise_generator(seed: int, exposure_index: int, camera: int) -> np.random.Generator:
    """Return the noise source of one camera (0 left, 1 right) in one exposure."""
    return np.random.default_rng((seed, exposure_index, camera))


def exposed(
    image: Image, noise: float, generator: np.random.Generator, bits: int = 8
) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """Add Gaussian noise of ``noise`` 8-bit grey levels and round to ``bits``, see :func:`quantised`."""
    noisy = image if noise <= 0.0 else image + noise * generator.standard_normal(image.shape, dtype=np.float32)
    return quantised(noisy, bits)


@cache
def normal_quantiles() -> Image:
    """Middles of QUANTILES equally likely parts of the normal distribution, in order: deviation 1, none beyond 4.4."""
    normal = NormalDist()
    return np.array([normal.inv_cdf((part + 0.5) / QUANTILES) for part in range(QUANTILES)], dtype=np.float32)


def quick_noise(levels: Image, shape: tuple[int, ...], generator: np.random.Generator) -> Image:
    """Noise of any ``shape``: of the QUANTILES ``levels`` each as often as another, in a fifth of a normal draw's time.

    ``levels`` : :func:`normal_quantiles` times the noise wanted.
    """
    count = math.prod(shape)
    words = generator.bit_generator.random_raw(-(-count // 4))
    return np.take(levels, words.view(np.uint16)[:count], mode="clip").reshape(shape)


def quantised(image: Image, bits: int) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """Round 8-bit grey levels (H, W) to ``bits``: 8 gives uint8, 12 and 16 give uint16, white at 4095 and 65535."""
    if bits == 8:
        return np.asarray(cv2.convertScaleAbs(np.maximum(image, 0.0)), dtype=np.uint8)
    white = 2.0**bits - 1.0
    return np.asarray(np.clip(image * (white / 255.0) + 0.5, 0.0, white), dtype=np.uint16)
