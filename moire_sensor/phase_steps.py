"""Per-pixel phase from N shifted exposures, motion between them cancelled to the order that more frames allow.

Each run of N successive frames gives a phase whose motion error turns by a known angle from run to run; their mean with
weights that undo the turn cancels it. For four steps the error alternates and the weights are binomial (binomial
self-compensation, arXiv 2404.06693); for any other number of equal steps they are complex. Everything is linear in the
frames, so the whole is one fixed filter along them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.errors import PatternError
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_demodulate import demodulate, judge_steps
from moire_sensor.phase_image import PhaseImage
from moire_sensor.phase_light import common_offsets, second_harmonic
from moire_sensor.settings import Settings

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
    residues : (n - 3, n), frames to numbers whose squares sum up to what the fit leaves over.
    """

    weights: Array
    design: Array
    moments: Array
    residues: Array

    @cached_property
    def harmonic(self) -> npt.NDArray[np.complex128]:
        """Residues (n - 3,) of frames that show exp(2 i phase), at phase 0: what gamma adds shows in them."""
        step = self.design[:, 1] - 1j * self.design[:, 2]
        return np.asarray(self.residues @ step**2)

    def blind_to(self, offsets: Array) -> StepFilter:
        """Return filters that do not see frames brighter than the background by shares of it, (n,)."""
        background = self.weights[0]
        seen = np.concatenate([np.zeros(1), self.weights[1:] @ offsets])
        return replace(
            self,
            weights=self.weights - seen[:, None] * background,
            moments=self.moments - (self.moments @ offsets)[..., None] * background,
            residues=self.residues - (self.residues @ offsets)[:, None] * background,
        )

    @cached_property
    def freedom(self) -> float:
        """Expected sum of squares that the fit leaves over, for frames of unit noise variance."""
        return float((self.residues**2).sum())

    @cached_property
    def rows(self) -> Float32:
        """All filters, (3 + 2 r + n - 3, n): weights, moments, residues; with zeros to whole fives of columns."""
        frame_count = self.weights.shape[1]
        filters = np.concatenate([self.weights, self.moments.reshape(-1, frame_count), self.residues])
        return np.pad(filters, ((0, 0), (0, -frame_count % 5))).astype(np.float32)

    @classmethod
    @lru_cache(maxsize=64)
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
        weights = np.stack([background, fringe.real, fringe.imag])
        return cls(weights, design, moments, residues_of(weights, design))


def residues_of(weights: Array, design: Array) -> Array:
    """Filters (n - 3, n) whose squared outputs sum up to the squared residual of the frames.

    The residual (1 - design weights) frames has n - 3 dimensions, since the fit of a fit is itself.
    """
    frame_count = design.shape[0]
    _, lengths, directions = np.linalg.svd(np.eye(frame_count) - design @ weights)
    return np.asarray((lengths[:, None] * directions)[: frame_count - design.shape[1]])


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


def phase_from_steps(
    frames: Float32, carrier: Carrier, steps: StepFilter, settings: Settings, buffer: Float32 | None = None
) -> PhaseImage:
    """Phase of every pixel of n shifted fringe images, valid at the middle of their time.

    Parameters
    ----------
    frames : (n, H, W) float32, grey levels scaled to 255 at saturation.
    carrier : the camera's carrier.
    buffer : (6, H, W) float32; offset, amplitude and sigma of the result lie in it and last until its next use.

    Returns
    -------
    PhaseImage
        NaN phase where dark (UNLIT), saturated in any frame (SATURATED) or moving too fast (MOVED). ``sigma_rad`` takes
        what motion leaves over of the fit for noise, but not what a flickering lamp or the projector's gamma do.
    """
    shape = frames.shape[1:]
    planes = np.empty((6, *shape), dtype=np.float32) if buffer is None else buffer
    background, status = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.uint8)
    offset, amplitude, sigma, squares, cross, along = planes
    offsets = common_offsets(frames, steps.weights[0], 2 * carrier.half_width_px + 1)
    steps = steps.blind_to(offsets) if offsets.any() else steps
    share = second_harmonic(frames, steps.weights[1:], steps.residues, steps.harmonic, settings.min_amplitude)
    bend = (share * steps.harmonic).astype(np.complex64)
    demodulate(
        frames, steps.rows, steps.moments.shape[0], bend, carrier.phase_rad, offset, background, amplitude, squares,
        cross, along, status,
    )  # fmt: skip
    freedom = steps.freedom
    if freedom < MIN_FREEDOM:
        squares[:], freedom = settings.image_noise**2, 1.0
    else:
        cv2.blur(squares, (NOISE_WINDOW_PX, NOISE_WINDOW_PX), dst=squares)
    moments = steps.moments.shape[0]
    # Averaged over a fringe period, since what motion error the moments have turns twice in it.
    for part in (cross, along) if moments > 1 else ():
        cv2.blur(part, (2 * carrier.half_width_px + 1, 1), dst=part)
    gain2 = np.float32(0.5 * (steps.weights[1:] ** 2).sum())
    judge_steps(
        moments, amplitude, squares, np.float32(freedom), cross, along, gain2, np.float32(settings.min_amplitude),
        np.float32(settings.max_motion_rad), offset, sigma, status,
    )  # fmt: skip
    return PhaseImage(offset, amplitude, background, sigma, status)
