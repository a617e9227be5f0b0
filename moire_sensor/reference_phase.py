"""Phase of image rows by the fast Fourier transform, and the general moire of two gratings (equations 1 to 4)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from moire_sensor.rig import Array

ComplexArray = npt.NDArray[np.complex128]
# After six rounds a cut window moves the phase by less than 2e-3 rad, a quarter of what noise does.
ROUNDS = 6


def fringe_signal(image: npt.NDArray[np.floating[Any]], carrier_rad: Array, period_px: float) -> ComplexArray:
    """Complex fringe ``b exp(i delta)`` of image rows (H, W) ``a + b cos(carrier + delta)``, by row FFT.

    The carrier is moved to frequency 0 and a low pass keeps what varies slower than a fringe. Its spatial form is a
    triangle two periods wide (two boxes of one period), which lets nothing of the background a through, nor of the
    fringe's own double frequency. The ends of a row cut the window: there the parts found first are taken off before
    the others are sought again.

    Parameters
    ----------
    carrier_rad : (H, W) phase about which the fringe is sought, any carrier of about ``period_px``.
    """
    carrier = np.exp(1j * carrier_rad)
    fringe = np.zeros(image.shape, dtype=np.complex128)
    for _ in range(ROUNDS):
        background = low_passed(image - (fringe * carrier).real + 0j, period_px).real
        mirrored = np.conj(fringe * carrier)
        fringe = low_passed((2.0 * (image - background) - mirrored) * np.conj(carrier), period_px)
    return fringe


def low_passed(rows: npt.NDArray[Any], period_px: float) -> ComplexArray:
    """Rows (H, W), real or complex, under a triangle two periods wide, by FFT; rescaled at the ends of the row."""
    width = rows.shape[1]
    padded = width + 2 * int(np.ceil(period_px))
    response = np.sinc(np.fft.fftfreq(padded) * period_px) ** 2
    inside = np.fft.ifft(np.fft.fft(np.ones(width), padded) * response)[:width].real
    return np.asarray(np.fft.ifft(np.fft.fft(rows, padded, axis=1) * response, axis=1)[:, :width] / inside)


def grating(phase_rad: Array, c: float) -> Array:
    """Transmittance ``c + c cos(phase)`` of equations (1) and (2), any shape; ``0 < c < 1/2``."""
    return np.asarray(c + c * np.cos(phase_rad))


def superposed(reference: Array, model: Array) -> Array:
    """Sum of the transmittances of two gratings, equation (4)."""
    return np.asarray(reference + model)


def moire_phase_periods(transmittance: Array, reference_rad: Array, c: float, period_px: float) -> Array:
    """Phase psi in periods, -1/2 to 1/2, out of two superposed gratings (H, W), equation (4).

    The band about the carrier holds ``c + c' exp(2 pi i psi)``; for c' = c this is ``2 c cos(pi psi) exp(pi i psi)``,
    the beat and the half phase of equation (4). Taking off the reference's c leaves psi even where the model grating
    is darker than the reference.

    Parameters
    ----------
    transmittance : the superposition, all that the detector sees.
    reference_rad : (H, W) phase ``2 pi x / p`` of the reference grating.
    c : constant of the reference grating.
    """
    beat = fringe_signal(transmittance, reference_rad, period_px)
    return np.asarray(np.angle(beat - c) / (2.0 * np.pi))
