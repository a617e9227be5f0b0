"""From light on the chip to grey levels: exposure, speckle, photon noise, fixed pattern, gain, read noise, bits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sim.capture import Grey
from moire_sim.exposure import quantised
from moire_sim.optics import Optics

Image = npt.NDArray[np.float32]
# Streams of chance beside the exposures' own, which are (seed, exposure, camera).
FIXED_PATTERN, SPECKLE = 1_000_001, 1_000_002
NOMINAL_EXPOSURE_MS = 10.0


@dataclass(frozen=True, eq=False)
class CameraChip:
    """One camera's chip; ``gains`` and ``offsets`` (H, W) are its fixed pattern, None where there is none."""

    optics: Optics
    noise: float
    bits: int
    gains: Image | None
    offsets: Image | None

    @classmethod
    def of(cls, optics: Optics, noise: float, bits: int, size: tuple[int, int], seed: int, camera: int) -> CameraChip:
        """Draw a chip's fixed pattern: the same for a seed and camera (0 left, 1 right), whatever is exposed."""
        generator = np.random.default_rng((seed, FIXED_PATTERN, camera))
        gains, offsets = (generator.standard_normal((size[1], size[0]), dtype=np.float32) for _ in range(2))
        spread = np.float32(optics.pixel_gain_spread)
        return cls(
            optics,
            noise,
            bits,
            1.0 + spread * gains if optics.pixel_gain_spread else None,
            np.float32(optics.pixel_offset_spread) * offsets if optics.pixel_offset_spread else None,
        )

    def expose(self, light: Image, generator: np.random.Generator) -> Grey:
        """Grey levels (H, W) of light in 8-bit grey levels at gain 1; ``bits`` 8 is uint8, 12 and 16 are uint16."""
        signal = light if self.gains is None else light * self.gains
        electrons = self.optics.electrons_per_grey
        if electrons:
            counts = generator.poisson(np.maximum(signal, 0.0).astype(np.float64) * electrons)
            signal = (counts / electrons).astype(np.float32)
        if self.noise:
            signal = signal + np.float32(self.noise) * generator.standard_normal(signal.shape, dtype=np.float32)
        if self.offsets is not None:
            signal = signal + self.offsets
        return quantised(np.asarray(signal * np.float32(self.optics.gain), dtype=np.float32), self.bits)


def speckle_pattern(optics: Optics, shape: tuple[int, ...], key: tuple[int, ...]) -> Image | None:
    """Factor (H, W) on the projector's light, mean 1, gamma-distributed as of 1 / contrast^2 looks (Goodman 2007, 4.5).

    Grains are smaller than a pixel. The pattern is that of ``key``: of seed, camera, and where everything stands.
    """
    if not optics.speckle:
        return None
    looks = 1.0 / optics.speckle**2
    generator = np.random.default_rng((SPECKLE, *key))
    return np.asarray(generator.standard_gamma(looks, shape, dtype=np.float32) / looks, dtype=np.float32)


def lamp(optics: Optics, time_s: float, exposure_ms: float) -> float:
    """Brightness of the swinging ambient light, mean 1, averaged over an exposure in the middle of which is a time."""
    if not optics.flicker:
        return 1.0
    half_turn = math.pi * optics.lamp_hz * exposure_ms * 1e-3
    blur = math.sin(half_turn) / half_turn if half_turn else 1.0
    return 1.0 + optics.flicker * blur * math.sin(2.0 * math.pi * optics.lamp_hz * time_s)
