"""What all pixels share between shifted frames: a lamp that flickers, and a projector whose response is bent.

Both are read from some rows of the image before the frames are demodulated. Neither is corrected for below a limit that
noise does not reach, so that steady light and a linear projector give the same bits as without.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]
# Rows that are looked at, spread over the image, and columns of them where the pixels are.
ROWS = 30
EVERY_COLUMN = 3
# Share of a pixel's light by which a frame must be brighter than the others, and of the fringe that must be harmonic.
LEAST_OFFSET, LEAST_HARMONIC = 0.01, 0.004
# Pixels darker than this, grey levels of 255, tell nothing; fewer than so many pixels tell too little.
DARK, FEWEST = 10.0, 150


def some_rows(frames: Float32) -> Float32:
    """Copy some rows of frames (n, H, W)."""
    every = max(1, frames.shape[1] // ROWS)
    return frames[:, every // 2 :: every].copy()


def common_offsets(frames: Float32, background: Array, width_px: int) -> Array:
    """How much brighter each frame is than the background, as a share of it: (n,) float64, zeros for steady light.

    Means over a fringe period, twice, hold next to nothing of the fringes; their median over the image does not mind
    depth edges and what moves. Where the lamp's light is another share of the whole than at most pixels, in shadows of
    the projector above all, some of the flicker stays.

    Parameters
    ----------
    frames : (n, H, W), grey levels of 255.
    background : (n,) weights that give the background.
    width_px : odd number of columns next to a fringe period.
    """
    count, width = len(frames), frames.shape[2]
    rows = some_rows(frames).reshape(-1, width)
    for _ in range(2):
        cv2.blur(rows, (width_px, 1), dst=rows)
    # Within half a window the means tell nothing new.
    inner = np.ascontiguousarray(rows[:, width_px : width - width_px : width_px // 2 + 1]).reshape(count, -1)
    mean = background.astype(np.float32) @ inner
    lit = np.flatnonzero(mean > DARK)
    if lit.size < FEWEST:
        return np.zeros(count)
    middle = [(lit.size - 1) // 2, lit.size // 2]
    shares = np.partition(inner.take(lit, axis=1) / mean[lit], middle, axis=1)[:, middle]
    offsets = shares.mean(axis=1).astype(np.float64) - 1.0
    offsets -= background @ offsets
    return offsets if np.abs(offsets).max() > LEAST_OFFSET else np.zeros(count)


def second_harmonic(
    frames: Float32, fringe: Array, residues: Array, residues_of_harmonic: npt.NDArray[np.complex128], least: float
) -> float:
    """Amplitude of cos 2 phase over that of cos phase, by which gamma bends the fringes; 0 for a linear projector.

    Parameters
    ----------
    fringe : (2, n), frames to real and imaginary part of the fringe.
    residues : (r, n), frames to what the fit leaves over.
    residues_of_harmonic : (r,), the same of frames that show exp(2 i phase), at phase 0.
    least : smallest amplitude of a lit pixel.
    """
    rows = some_rows(frames)[:, :, ::EVERY_COLUMN].reshape(len(frames), -1)
    real, imaginary = fringe.astype(np.float32) @ rows
    amplitude = np.hypot(real, imaginary)
    lit = np.flatnonzero(amplitude > least)
    if len(residues) == 0 or lit.size < FEWEST:
        return 0.0
    phasor = (real[lit] + 1j * imaginary[lit]) ** 2 / amplitude[lit]
    expected = (residues_of_harmonic[:, None] * phasor).real
    seen = residues.astype(np.float32) @ rows.take(lit, axis=1)
    share = float(np.sum(expected * seen)) / max(float(np.sum(expected**2)), 1e-9)
    return share if abs(share) > LEAST_HARMONIC else 0.0
