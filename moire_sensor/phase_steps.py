"""Per-pixel phase from N shifted exposures, motion between them cancelled to the order that more frames allow.

Each run of N successive frames gives a phase whose motion error alternates from run to run; their mean with binomial
weights cancels it (binomial self-compensation, arXiv 2404.06693). Everything is linear in the frames, so the whole is
one fixed filter along them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.angles import wrapped
from moire_sensor.errors import PatternError
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.settings import Settings
from moire_sensor.shot import Status

Array = npt.NDArray[np.float64]
NOISE_WINDOW_PX = 7


@dataclass(frozen=True, eq=False)
class StepFilter:
    """Linear filters over the frames for one sequence of step phases.

    Attributes
    ----------
    weights : (3, n), frames to background, real and imaginary part of the fringe.
    design : (n, 3), the frames that those three would show without motion.
    drift : (2, 3, n), the same as ``weights`` for the first and the last run of N frames.
    run_count : number of runs of N frames.
    """

    weights: Array
    design: Array
    drift: Array
    run_count: int

    @classmethod
    def build(cls, step_phases_rad: tuple[float, ...], first_step: int, frame_count: int) -> StepFilter:
        """Filter of ``frame_count`` frames, frame i carrying step (first_step + i) mod N.

        Raises
        ------
        PatternError
            Fewer than three steps, fewer frames than steps, or steps that do not determine a phase.
        """
        steps = len(step_phases_rad)
        if steps < 3:
            raise PatternError(f"the pattern has {steps} steps; phase shifting needs at least 3, use with_equal_steps(4)")
        if frame_count < steps:
            raise PatternError(f"{frame_count} frames came for {steps} steps; give at least {steps}")
        phases = np.array([step_phases_rad[(first_step + frame) % steps] for frame in range(frame_count)])
        design = np.stack([np.ones(frame_count), np.cos(phases), -np.sin(phases)], axis=1)
        runs = frame_count - steps + 1
        filters = np.zeros((runs, 3, frame_count))
        for run in range(runs):
            frames = slice(run, run + steps)
            if np.linalg.cond(design[frames]) > 1e3:
                raise PatternError(f"steps {step_phases_rad} rad do not determine a phase; spread them over a turn")
            filters[run, :, frames] = np.linalg.pinv(design[frames])
        binomial = np.array([math.comb(runs - 1, run) for run in range(runs)]) / 2.0 ** (runs - 1)
        return cls(np.tensordot(binomial, filters, axes=1), design, filters[[0, -1]], runs)


def phase_from_steps(frames: Float32, carrier: Carrier, steps: StepFilter, settings: Settings) -> PhaseImage:
    """Phase of every pixel of n shifted fringe images, valid at the middle of their time.

    Parameters
    ----------
    frames : (n, H, W) float32, grey levels scaled to 255 at saturation.
    carrier : the camera's carrier.

    Returns
    -------
    PhaseImage
        NaN phase where dark (UNLIT), saturated in any frame (SATURATED) or moving too fast (MOVED).
    """
    background, real, imaginary = apply_filter(steps.weights, frames)
    amplitude = np.hypot(real, imaginary)
    noise = frame_noise(frames, steps, np.stack([background, real, imaginary]), settings)
    gain = float(np.sqrt(0.5 * (steps.weights[1:] ** 2).sum()))
    status = np.zeros(amplitude.shape, dtype=np.uint8)
    status[drift_rad(frames, steps) > settings.max_motion_rad] = Status.MOVED
    status[~(amplitude > settings.min_amplitude)] = Status.UNLIT
    status[(frames >= 254.5).any(axis=0)] = Status.SATURATED
    offset = wrapped(np.arctan2(imaginary, real) - carrier.phase_rad)
    offset[status != 0] = np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = (noise * gain / amplitude).astype(np.float32)
    return PhaseImage(offset, amplitude, background, sigma, status)


def apply_filter(weights: Array, frames: Float32) -> Float32:
    """Return weights (k, n) times frames (n, H, W) as (k, H, W) float32."""
    return np.asarray(np.tensordot(weights.astype(np.float32), frames, axes=1))


def drift_rad(frames: Float32, steps: StepFilter) -> Float32:
    """Phase drift from frame to frame (H, W), radians, between the first and the last run; 0 with a single run."""
    if steps.run_count < 2:
        return np.zeros(frames.shape[1:], dtype=np.float32)
    first, last = (apply_filter(weights[1:], frames) for weights in steps.drift)
    turned = np.arctan2(last[1] * first[0] - last[0] * first[1], last[0] * first[0] + last[1] * first[1])
    return np.asarray(np.abs(turned) / np.float32(steps.run_count - 1))


def frame_noise(frames: Float32, steps: StepFilter, parts: Float32, settings: Settings) -> Float32:
    """Noise of one frame (H, W), grey levels, from what the fit leaves over; the setting where nothing is left over."""
    freedom = frames.shape[0] - 3
    if freedom == 0:
        return np.full(frames.shape[1:], settings.image_noise, dtype=np.float32)
    squares = np.zeros(frames.shape[1:], dtype=np.float32)
    for frame, row in zip(frames, steps.design.astype(np.float32), strict=True):
        squares += (frame - np.tensordot(row, parts, axes=1)) ** 2
    # The running sums of the blur leave a rounding error that may be below zero.
    mean_square = np.maximum(cv2.blur(squares, (NOISE_WINDOW_PX, NOISE_WINDOW_PX)), 0.0)
    return np.asarray(np.sqrt(mean_square / freedom), dtype=np.float32)
