"""Phase shifting: exact without motion, the predicted residual with it, the predicted noise, and what is marked."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moire_sensor.errors import PatternError
from moire_sensor.paper_rig import PERIOD_PX, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_carrier import Carrier
from moire_sensor.phase_light import common_offsets, second_harmonic
from moire_sensor.phase_steps import StepFilter, phase_from_steps
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig
from moire_sensor.settings import Settings
from moire_sensor.shot import Status

Array = npt.NDArray[np.float64]
SHAPE = (40, 160)
UNEQUAL = (0.0, 1.3, 2.9, 4.4)
SETTINGS = Settings()
PHASES = np.linspace(-np.pi, np.pi, 720, endpoint=False)


def equal(count: int, direction: int = 1) -> tuple[float, ...]:
    return tuple(direction * 2.0 * math.pi * step / count for step in range(count))


@pytest.fixture(scope="module")
def carrier() -> Carrier:
    paper = paper_rig()
    rig = StereoRig.from_projections(paper.P_left, paper.P_right, paper.P_projector, SHAPE[::-1])
    return Carrier.left(ProjectorMap.build(rig, FringePattern(PERIOD_PX)), SHAPE[::-1], 100.0, 2)


def frames_of(
    phase: Array, steps_rad: tuple[float, ...], first_step: int, count: int, drift: float = 0.0, amplitude: float = 60.0
) -> Array:
    """Frames (n, ...) of a fringe that drifts, with the given phase at the middle of their time."""
    times = np.arange(count) - (count - 1) / 2.0
    return np.stack([
        120.0 + amplitude * np.cos(phase + steps_rad[(first_step + i) % len(steps_rad)] + drift * time)
        for i, time in enumerate(times)
    ])  # fmt: skip


def phase_error(steps_rad: tuple[float, ...], first_step: int, count: int, drift: float) -> Array:
    steps = StepFilter.build(steps_rad, first_step, count)
    _, real, imaginary = steps.weights @ frames_of(PHASES, steps_rad, first_step, count, drift)
    return np.asarray(np.angle((real + 1j * imaginary) * np.exp(-1j * PHASES)))


@pytest.mark.parametrize("steps_rad", [equal(3), equal(4), equal(4, -1), equal(5), equal(8), UNEQUAL])
@pytest.mark.parametrize("more", [0, 1, 2, 4])
def test_no_motion_no_error(steps_rad: tuple[float, ...], more: int) -> None:
    for first_step in (0, 1, 7):
        assert np.abs(phase_error(steps_rad, first_step, len(steps_rad) + more, 0.0)).max() < 1e-12


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(3, 9), st.integers(0, 5), st.sampled_from([-1, 1]), st.floats(-0.4, 0.4), st.integers(0, 8))
def test_motion_leaves_what_theory_says(count: int, more: int, direction: int, drift: float, first_step: int) -> None:
    """The mirror image's share of one run is sin(e/2) / sin(s + e/2); each further frame multiplies by it again.

    For drift e a frame and step s: the sum of exp(i e j) over a run is sin(N e/2) / sin(e/2), that of
    exp(-i (2 s + e) j) is the same over sin(s + e/2). Four steps: tan(e/2)^(extra frames + 1).
    """
    steps_rad = equal(count, direction)
    share = abs(math.sin(drift / 2.0) / math.sin(steps_rad[1] + drift / 2.0))
    error = phase_error(steps_rad, first_step, count + more, drift)
    # 720 phases sample the ripple's crest to 1e-5 of it
    assert np.abs(error).max() == pytest.approx(math.asin(share ** (more + 1)), rel=2e-4, abs=1e-12)
    assert abs(error.mean()) < 1e-12, "the phase is that of the middle of the frames' time"


def test_four_steps_have_the_binomial_weights_of_the_paper() -> None:
    plain = [StepFilter.build(equal(4), first, 4).weights for first in range(3)]
    expected = np.zeros((3, 6))
    for run, (share, weights) in enumerate(zip((0.25, 0.5, 0.25), plain, strict=True)):
        expected[:, run : run + 4] += share * weights
    np.testing.assert_allclose(StepFilter.build(equal(4), 0, 6).weights, expected, atol=1e-15)


def test_more_frames_help_unequal_steps_too() -> None:
    errors = [np.abs(phase_error(UNEQUAL, 0, count, 0.1)).max() for count in (4, 5, 6)]
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.5 * errors[0]


@pytest.mark.parametrize(("count", "more"), [(3, 0), (3, 2), (4, 0), (4, 1), (5, 2), (8, 1)])
def test_images_give_their_phase_and_the_noise_in_it(carrier: Carrier, count: int, more: int) -> None:
    rng = np.random.default_rng(count)
    # All phases everywhere, but smooth along the rows: nothing that a lamp could be taken for.
    offset = np.pi * np.sin(np.arange(SHAPE[1]) / 25.0 + rng.uniform(-np.pi, np.pi, (SHAPE[0], 1)))
    noise = 2.0
    frames = frames_of(carrier.phase_rad.astype(np.float64) + offset, equal(count), 2, count + more)
    noisy = (frames + rng.normal(0.0, noise, frames.shape)).astype(np.float32)
    steps = StepFilter.build(equal(count), 2, count + more)
    clean = phase_from_steps(frames.astype(np.float32), carrier, steps, SETTINGS)
    assert not clean.status.any()
    # float32 of a carrier phase up to 700 rad is known to 3e-5
    assert np.abs(np.angle(np.exp(1j * (clean.offset_rad - offset)))).max() < 1e-4
    np.testing.assert_allclose(clean.amplitude, 60.0, atol=1e-3)
    np.testing.assert_allclose(clean.background, 120.0, atol=1e-3)
    seen = phase_from_steps(noisy, carrier, steps, Settings(image_noise=noise))
    error = np.angle(np.exp(1j * (seen.offset_rad - offset)))
    # 6400 pixels tell a standard deviation to 0.9 %, the noise estimate of 49 pixels and 1 to 3 more frames is
    # skewed by up to 1 %: five standard deviations in all
    assert float(np.sqrt(np.mean(seen.sigma_rad.astype(np.float64) ** 2))) == pytest.approx(error.std(), rel=0.05)


def frame_noise(frames: Array, carrier: Carrier, steps: StepFilter, settings: Settings = SETTINGS) -> Array:
    """Noise of one frame that the sigma of the phase speaks of."""
    found = phase_from_steps(frames.astype(np.float32), carrier, steps, settings)
    gain = np.sqrt(0.5 * (steps.weights[1:] ** 2).sum())
    return np.asarray(found.sigma_rad.astype(np.float64) * found.amplitude / gain)


@pytest.mark.parametrize(
    ("steps_rad", "count"), [(equal(4), 4), (equal(4), 5), (equal(3), 5), (equal(5), 9), (UNEQUAL, 6)]
)
def test_noise_is_read_from_what_the_fit_leaves_over(
    carrier: Carrier, steps_rad: tuple[float, ...], count: int
) -> None:
    rng = np.random.default_rng(0)
    frames = frames_of(rng.uniform(-3, 3, SHAPE), steps_rad, 0, count)
    frames += rng.normal(0.0, 1.5, frames.shape)
    noise = frame_noise(frames, carrier, StepFilter.build(steps_rad, 0, count))
    # 6400 pixels: 0.9 % for a single degree of freedom, times five
    assert float(np.sqrt(np.mean(noise**2))) == pytest.approx(1.5, rel=0.045)


@pytest.mark.parametrize(("steps_rad", "count"), [(equal(4), 4), (equal(4), 5), (equal(3), 5), (UNEQUAL, 7)])
def test_residues_are_the_residual(steps_rad: tuple[float, ...], count: int) -> None:
    steps = StepFilter.build(steps_rad, 1, count)
    frames = np.random.default_rng(2).normal(100.0, 30.0, (count, 50))
    residual = frames - steps.design @ (steps.weights @ frames)
    assert steps.residues.shape == (count - 3, count)
    np.testing.assert_allclose(((steps.residues @ frames) ** 2).sum(axis=0), (residual**2).sum(axis=0), rtol=1e-9)


@pytest.mark.parametrize("count", [3, 4, 5, 6, 9, 11])
def test_the_kernels_are_the_filters(carrier: Carrier, count: int) -> None:
    """Frames of pure noise: every pixel is the filters' product, in numpy."""
    frames = np.random.default_rng(count).uniform(0.0, 250.0, (count, *SHAPE)).astype(np.float32)
    steps = StepFilter.build(equal(3), 0, count)
    found = phase_from_steps(frames, carrier, steps, Settings(max_motion_rad=3.0))
    # So much noise looks like some flicker, even in the mean over an image.
    blind = steps.blind_to(common_offsets(frames, steps.weights[0], 2 * carrier.half_width_px + 1))
    background, real, imaginary = np.tensordot(blind.weights, frames.astype(np.float64), axes=1)
    # float32 sums of up to eleven numbers of 250
    np.testing.assert_allclose(found.background, background, atol=1e-3)
    np.testing.assert_allclose(found.amplitude, np.hypot(real, imaginary), atol=1e-3)
    off = np.angle(np.exp(1j * (found.offset_rad - (np.arctan2(imaginary, real) - carrier.phase_rad))))
    seen = (found.status == Status.OK) & (found.amplitude > 20.0)
    assert seen.sum() > 1000
    assert np.abs(off[seen]).max() < 2e-4
    np.testing.assert_array_equal(found.status == Status.UNLIT, found.amplitude <= SETTINGS.min_amplitude)


@pytest.mark.parametrize("count", [4, 5])
def test_flicker_and_gamma_are_taken_away_and_nothing_else(carrier: Carrier, count: int) -> None:
    rng = np.random.default_rng(9)
    phase = carrier.phase_rad.astype(np.float64) + 0.8
    frames = frames_of(phase, equal(4), 1, count)
    steps = np.array([equal(4)[(1 + frame) % 4] for frame in range(count)])[:, None, None]
    frames += 9.0 * np.cos(2.0 * (phase + steps)) + rng.normal(0.0, 1.5, frames.shape)
    lamp = 0.2 * np.sin(1.0 + 2.1 * np.arange(count))
    flickering = (frames + 120.0 * lamp[:, None, None]).astype(np.float32)
    filters = StepFilter.build(equal(4), 1, count)
    found = phase_from_steps(flickering, carrier, filters, SETTINGS)
    error = np.angle(np.exp(1j * (found.offset_rad[:, 20:-20] - 0.8)))
    # 1.5 of noise on 60 of amplitude; 6400 pixels.
    sigma = 1.5 / 60.0 * np.sqrt(0.5 * (filters.weights[1:] ** 2).sum())
    assert error.std() == pytest.approx(sigma, rel=0.1)
    assert float(np.sqrt(np.mean(found.sigma_rad**2))) == pytest.approx(sigma, rel=0.1)
    # A hundredth of what the lamp would do: a share of 0.2 of 120 grey levels on fringes of 60.
    assert abs(error.mean()) < 0.004


def test_steady_light_and_linear_fringes_are_left_alone(carrier: Carrier) -> None:
    rng = np.random.default_rng(10)
    steps = StepFilter.build(equal(4), 0, 5)
    frames = frames_of(carrier.phase_rad + 0.3, equal(4), 0, 5) + rng.normal(0.0, 1.5, (5, *SHAPE))
    assert not common_offsets(frames.astype(np.float32), steps.weights[0], 2 * carrier.half_width_px + 1).any()
    share = second_harmonic(frames.astype(np.float32), steps.weights[1:], steps.residues, steps.harmonic, 6.0)
    assert share == 0.0


def test_buffer_is_used_again(carrier: Carrier) -> None:
    buffer = np.empty((6, *SHAPE), dtype=np.float32)
    steps = StepFilter.build(equal(4), 0, 5)
    first = frames_of(carrier.phase_rad + 0.3, equal(4), 0, 5).astype(np.float32)
    second = frames_of(carrier.phase_rad - 1.0, equal(4), 0, 5, amplitude=20.0).astype(np.float32)
    before = phase_from_steps(first, carrier, steps, SETTINGS, buffer)
    kept = before.background.copy()
    again, alone = (phase_from_steps(second, carrier, steps, SETTINGS, used) for used in (buffer, None))
    assert np.shares_memory(again.offset_rad, buffer)
    for name in ("offset_rad", "amplitude", "background", "sigma_rad", "status"):
        np.testing.assert_array_equal(getattr(again, name), getattr(alone, name))
    np.testing.assert_array_equal(before.background, kept)


def test_noise_of_perfect_frames_beside_bad_ones_is_never_nan(carrier: Carrier) -> None:
    frames = np.zeros((5, *SHAPE))
    frames[0, :, ::23] = 255.0
    frames[1, 5] = 3.7e4
    noise = frame_noise(frames, carrier, StepFilter.build(equal(4), 0, 5))
    assert np.isfinite(noise).all()
    assert (noise >= 0.0).all()


def test_three_frames_take_the_noise_that_was_set(carrier: Carrier) -> None:
    frames = frames_of(carrier.phase_rad + 1.0, equal(3), 0, 3)
    noise = frame_noise(frames, carrier, StepFilter.build(equal(3), 0, 3), Settings(image_noise=2.5))
    np.testing.assert_allclose(noise, 2.5, rtol=1e-5)


def test_pixels_without_a_phase_are_marked_and_unknown(carrier: Carrier) -> None:
    count, steps = 8, StepFilter.build(equal(4), 0, 8)
    base = carrier.phase_rad.astype(np.float64)
    frames = frames_of(base, equal(4), 0, count)
    frames[:, :10] = frames_of(base[:10], equal(4), 0, count, amplitude=SETTINGS.min_amplitude * 0.8)
    frames[5, 12:20, :80] = 255.0
    # 1 rad a frame over four frames between the runs would look like 0.57 if only the ends were compared
    frames[:, 22:30] = frames_of(base[22:30], equal(4), 0, count, drift=1.0)
    frames[:, 32:] = frames_of(base[32:], equal(4), 0, count, drift=0.5)
    found = phase_from_steps(frames.astype(np.float32), carrier, steps, SETTINGS)
    expected = np.zeros(SHAPE, dtype=np.uint8)
    expected[:10] = Status.UNLIT
    expected[12:20, :80] = Status.SATURATED
    expected[22:30] = Status.MOVED
    np.testing.assert_array_equal(found.status, expected)
    np.testing.assert_array_equal(np.isnan(found.offset_rad), expected != 0)


def share_moved(frames: Array, carrier: Carrier, limit_rad: float) -> float:
    """Share of pixels, away from the borders, whose drift is over a limit."""
    steps = StepFilter.build(equal(4), 1, frames.shape[0])
    found = phase_from_steps(frames.astype(np.float32), carrier, steps, Settings(max_motion_rad=limit_rad))
    return float(np.mean(found.status[:, 10:-10] == Status.MOVED))


@pytest.mark.parametrize("count", [5, 6, 8])
@pytest.mark.parametrize("drift", [0.05, -0.3, 0.9])
def test_drift_is_measured(carrier: Carrier, drift: float, count: int) -> None:
    period_px = 2 * carrier.half_width_px + 1
    phase = np.tile(2.0 * np.pi * np.arange(SHAPE[1]) / period_px + 0.3, (SHAPE[0], 1))
    frames = frames_of(phase, equal(4), 1, count, drift)
    # The mirror image in two moments, share r = tan(e/2), adds -r^2 exp(-i e) to exp(i e) when it alternates between
    # them; cancelled once, +-r^4 or less is left.
    share = math.tan(drift / 2.0) ** 2
    overrated = math.atan2(math.sin(abs(drift)) * (1.0 + share), math.cos(drift) * (1.0 - share))
    expected, margin = (overrated, 1e-4 * overrated) if count == 5 else (abs(drift), 2.0 * share**2)
    assert share_moved(frames, carrier, expected + margin + 1e-5) == 0.0
    assert share_moved(frames, carrier, expected - margin - 1e-5) == 1.0


def test_one_run_shows_no_drift(carrier: Carrier) -> None:
    assert share_moved(frames_of(np.zeros(SHAPE), equal(4), 1, 4, 0.5), carrier, 0.0) == 0.0


@pytest.mark.parametrize(
    ("steps_rad", "count", "message"),
    [
        ((0.0,), 1, "the pattern has 1 steps; phase shifting needs 3"),
        (equal(4), 3, "3 frames came for 4 steps; give at least 4"),
        ((0.0, 0.0, math.pi), 3, "do not determine a phase; spread three or more over a turn"),
        ((0.0, math.pi, 2.0 * math.pi), 3, "do not determine a phase"),
    ],
)
def test_steps_that_give_no_phase_are_refused(steps_rad: tuple[float, ...], count: int, message: str) -> None:
    with pytest.raises(PatternError, match=message):
        StepFilter.build(steps_rad, 0, count)
