"""Per-pixel phase from N shifted exposures, motion between them cancelled to the order that more frames allow.

Each run of N successive frames gives a phase whose motion error turns by a known angle from run to run; their mean with
weights that undo the turn cancels it. For four steps the error alternates and the weights are binomial (binomial
self-compensation, arXiv 2404.06693); for any other number of equal steps they are complex. Everything is linear in the
frames, so the whole is one fixed filter along them.
"""

from __future__ import annotations

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
# Steps that differ by less than this, radians, are equal: rounded in a file, they cancel motion error to a thousandth.
EQUAL_STEPS = 1e-3
MAX_CONDITION = 1e3
MIN_FREEDOM = 1e-6


def needed_frames(step_count: int) -> int:
    """Return the frames of one motion-compensated result: steps + 1, made odd so that one is in the middle."""
    return 1 if step_count == 1 else step_count + 1 + step_count % 2


@dataclass(frozen=True, eq=False)
class StepFilter:
    """Linear filters over the frames for one sequence of step phases.

    Attributes
    ----------
    weights : (3, n), frames to background, real and imaginary part of the fringe.
    design : (n, 3), the frames that those three would show without motion.
    moments : (r, 2, n), frames to real and imaginary part at r successive times, one frame apart: runs of N frames,
        motion error cancelled once where there are three runs or more.
    """

    weights: Array
    design: Array
    moments: Array

    @property
    def freedom(self) -> float:
        """Expected sum of squares that the fit leaves over, for frames of unit noise variance."""
        return float(((np.eye(self.design.shape[0]) - self.design @ self.weights) ** 2).sum())

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
            raise PatternError(f"the pattern has {steps} steps; phase shifting needs 3: use with_equal_steps(4)")
        if frame_count < steps:
            raise PatternError(f"{frame_count} frames came for {steps} steps; give at least {steps}")
        phases = np.array([step_phases_rad[(first_step + frame) % steps] for frame in range(frame_count)])
        design = np.stack([np.ones(frame_count), np.cos(phases), -np.sin(phases)], axis=1)
        filters = run_filters(design, steps)
        runs = filters.shape[0]
        mean = run_weights(step_phases_rad, runs)
        background = np.tensordot(np.abs(mean) / np.abs(mean).sum(), filters[:, 0], axes=1)
        phasors = filters[:, 1] + 1j * filters[:, 2]
        fringe = mean @ phasors
        if runs > 2:
            pair = run_weights(step_phases_rad, 2)
            phasors = pair[0] * phasors[:-1] + pair[1] * phasors[1:]
        moments = np.stack([phasors.real, phasors.imag], axis=1)
        return cls(np.stack([background, fringe.real, fringe.imag]), design, moments)


def run_filters(design: Array, steps: int) -> Array:
    """Least-squares filters (runs, 3, n) of every run of ``steps`` successive frames."""
    frame_count = design.shape[0]
    runs = frame_count - steps + 1
    filters = np.zeros((runs, 3, frame_count))
    for run in range(runs):
        frames = slice(run, run + steps)
        if np.linalg.cond(design[frames]) > MAX_CONDITION:
            raise PatternError("the step phases do not determine a phase; spread three or more over a turn")
        filters[run, :, frames] = np.linalg.pinv(design[frames])
    return filters


def run_weights(step_phases_rad: tuple[float, ...], runs: int) -> npt.NDArray[np.complex128]:
    """Weights (runs,) of successive runs whose sum is 1 and in which the motion error cancels.

    A fringe that drifts puts a share of its mirror image, exp(-i phase), into a run's exp(i phase); from one run to
    the next, s later in the programme, the share turns by -2 s. Each factor (1 - exp(2 i s) z) / (1 - exp(2 i s)) along
    the runs cancels it once, to a higher order in the drift. Steps that are not equal get the binomial weights.
    """
    phases = np.asarray(step_phases_rad)
    turns = np.exp(1j * (np.roll(phases, -1) - phases))
    equal = np.abs(turns - turns[0]).max() < EQUAL_STEPS
    turn = turns[0] ** 2 if equal else -1.0
    weights = np.ones(1, dtype=np.complex128)
    for _ in range(runs - 1):
        weights = np.convolve(weights, np.array([1.0, -turn]) / (1.0 - turn))
    return weights


def phase_from_steps(frames: Float32, carrier: Carrier, steps: StepFilter, settings: Settings) -> PhaseImage:
    """Phase of every pixel of n shifted fringe images, valid at the middle of their time.

    Parameters
    ----------
    frames : (n, H, W) float32, grey levels scaled to 255 at saturation.
    carrier : the camera's carrier.

    Returns
    -------
    PhaseImage
        NaN phase where dark (UNLIT), saturated in any frame (SATURATED) or moving too fast (MOVED). ``sigma_rad`` takes
        what motion leaves over of the fit for noise.
    """
    background, real, imaginary = apply_filter(steps.weights, frames)
    amplitude = np.hypot(real, imaginary)
    noise = frame_noise(frames, steps, np.stack([background, real, imaginary]), settings)
    gain = float(np.sqrt(0.5 * (steps.weights[1:] ** 2).sum()))
    status = np.zeros(amplitude.shape, dtype=np.uint8)
    status[drift_rad(frames, steps, 2 * carrier.half_width_px + 1) > settings.max_motion_rad] = Status.MOVED
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


def drift_rad(frames: Float32, steps: StepFilter, window_px: int) -> Float32:
    """Phase drift from frame to frame (H, W), radians, 0..pi, over ``window_px`` columns; 0 with a single run.

    Averaged over a fringe period, since what motion error the moments have turns twice in it. With two moments a fast
    drift is overrated: tan of the result is tan(e) / cos(e) for a drift e and four steps.
    """
    cross = np.zeros(frames.shape[1:], dtype=np.float32)
    along = np.zeros(frames.shape[1:], dtype=np.float32)
    before = apply_filter(steps.moments[0], frames)
    for weights in steps.moments[1:]:
        after = apply_filter(weights, frames)
        cross += after[1] * before[0] - after[0] * before[1]
        along += after[0] * before[0] + after[1] * before[1]
        before = after
    mean_cross, mean_along = (cv2.blur(part, (window_px, 1)) for part in (cross, along))
    return np.asarray(np.abs(np.arctan2(mean_cross, mean_along)), dtype=np.float32)


def frame_noise(frames: Float32, steps: StepFilter, parts: Float32, settings: Settings) -> Float32:
    """Noise of one frame (H, W), grey levels, from what the fit leaves over; the setting where nothing is left over."""
    if steps.freedom < MIN_FREEDOM:
        return np.full(frames.shape[1:], settings.image_noise, dtype=np.float32)
    squares = np.zeros(frames.shape[1:], dtype=np.float32)
    for frame, row in zip(frames, steps.design.astype(np.float32), strict=True):
        squares += (frame - np.tensordot(row, parts, axes=1)) ** 2
    # The running sums of blur may leave a little less than zero where nothing is left over.
    mean = np.maximum(cv2.blur(squares, (NOISE_WINDOW_PX, NOISE_WINDOW_PX)), 0.0)
    return np.asarray(np.sqrt(mean / steps.freedom), dtype=np.float32)
