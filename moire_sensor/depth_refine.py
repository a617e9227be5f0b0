"""Disparity of the chosen order, measured by all three views as the rig's geometry and the noise favour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE, TWO_PI, wrap
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap, disparity_of_phase, phase_of_disparity
from moire_sensor.right_view import right_phase
from moire_sensor.settings import Settings
from moire_sensor.shot import UNKNOWN_ORDER

ITERATIONS = 2
# Phases are nearly straight over so short a step: a second one would hardly move it.
SETTLED_PX = np.float32(0.1)


@dataclass(frozen=True, eq=False)
class Match:
    """Disparity of every left pixel, arrays (H, W) float32, NaN where there is none.

    Attributes
    ----------
    disparity_px, sigma_px : refined disparity and its predicted standard deviation.
    signed_mismatch_rad : left minus right phase where the left phase and the projector alone place the point.
    mismatch_rad : its absolute value.
    """

    disparity_px: Float32
    sigma_px: Float32
    signed_mismatch_rad: Float32
    mismatch_rad: Float32

    def images(self) -> tuple[Float32, Float32, Float32, Float32]:
        """Return the four arrays in the order of the fields."""
        return self.disparity_px, self.sigma_px, self.signed_mismatch_rad, self.mismatch_rad


def refine(
    label: npt.NDArray[np.int8],
    phases: tuple[PhaseImage, PhaseImage],
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
    settings: Settings,
    max_mismatch_rad: float,
    match: Match | None = None,
) -> Match:
    """Generalised least squares of both phases against the projector's, systematic errors included.

    The covariance is [[sL^2 + g^2, g^2], [g^2, sR^2 + a^2 + g^2]]: noise of each camera, an error g common to both
    (gamma, motion) and the misalignment a of the rectified pair. So a rig whose projector stands between the cameras
    measures left against right, where g cancels; one whose projector stands far outside measures against it. The
    predicted sigma is that of the noise alone.

    Parameters
    ----------
    label : (H, W) int8, the order of every pixel counted from ``orders.first``, negative for none.
    max_mismatch_rad : pixels whose phases disagree by more have no disparity, only a mismatch.
    match : a match to change in place at the pixels with a label; without one, those without a label are NaN.
    """
    left, right = phases
    fresh = match is None
    match = match or Match(*(np.empty(label.shape, dtype=np.float32) for _ in range(4)))
    errors = np.array([settings.common_error_rad, settings.alignment_px, max_mismatch_rad], dtype=np.float32)
    solve_disparity(
        label, orders.first, left.offset_rad, right.offset_rad, left.sigma_rad, right.sigma_rad,
        carriers[0].phase_rad, carriers[1].phase_rad, projector.packed(), errors, fresh, *match.images(),
    )  # fmt: skip
    return match


@njit(inline="always", fastmath=False)
def weigh(left_sigma, right_sigma, misaligned, common):  # type: ignore[no-untyped-def]
    """Inverse covariance of the two phases but for its determinant, and their variances by noise."""
    v1 = left_sigma * left_sigma + np.float32(1e-10)
    v2 = right_sigma * right_sigma + np.float32(1e-10)
    g2 = common * common
    return v2 + misaligned * misaligned + g2, v1 + g2, -g2, v1, v2


@njit(inline="always", fastmath=NAN_SAFE)
def step_of(phase, expected, seen, slope1, slope2, weights):  # type: ignore[no-untyped-def]
    """One step of the least squares: the disparity's change and its sigma by noise."""
    w11, w22, w12, v1, v2 = weights
    gain1, gain2 = w11 * slope1 + w12 * slope2, w12 * slope1 + w22 * slope2
    norm = np.float32(1.0) / (gain1 * slope1 + gain2 * slope2)
    step = (gain1 * (phase - expected) + gain2 * wrap(seen - expected)) * norm
    return step, np.sqrt(gain1 * gain1 * v1 + gain2 * gain2 * v2) * abs(norm)


@njit(inline="always", fastmath=False)
def settle(phase, seen, along, x, y, found, right, right_rad, map_, weights):  # type: ignore[no-untyped-def]
    """Disparity and sigma of one pixel after at most ``ITERATIONS`` steps from where its own phase places it."""
    sigma = np.float32(np.nan)
    for round_ in range(ITERATIONS):
        exact, slope = phase_of_disparity(map_, x, y, found)
        if round_ > 0:
            seen, along = right_phase(right, right_rad, y, np.float32(x) - found)
        slope1 = np.float32(slope)
        step, sigma = step_of(phase, np.float32(exact), seen, slope1, slope1 + along, weights)
        found += step
        if abs(step) < SETTLED_PX:
            break
    return found, sigma


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def solve_disparity(  # type: ignore[no-untyped-def]
    label, first, left, right, left_sigma, right_sigma, left_rad, right_rad, map_, errors, fresh,
    disparity, sigma, signed, mismatch,
):  # fmt: skip
    """Fill disparity, sigma and mismatches (H, W each) at pixels with a label; if ``fresh``, NaN at the others."""
    height, width = label.shape
    for y in prange(height):
        misaligned = errors[1] * (right_rad[y, 1] - right_rad[y, 0])
        for x in range(width):
            if label[y, x] >= 0 or fresh:
                disparity[y, x] = sigma[y, x] = signed[y, x] = mismatch[y, x] = np.float32(np.nan)
            if label[y, x] < 0:
                continue
            phase = left_rad[y, x] + left[y, x] + TWO_PI * np.float32(first + label[y, x])
            found = np.float32(disparity_of_phase(map_, x, y, phase))
            column = np.float32(x) - found
            if column < np.float32(-0.5) or column > np.float32(width) - np.float32(0.5):
                continue
            seen, along = right_phase(right, right_rad, y, column)
            apart = wrap(phase - seen)
            signed[y, x], mismatch[y, x] = apart, abs(apart)
            if abs(apart) <= errors[2]:
                at = min(max(int(column + np.float32(0.5)), 0), width - 1)
                weights = weigh(left_sigma[y, x], right_sigma[y, at], misaligned, errors[0])
                disparity[y, x], sigma[y, x] = settle(
                    phase, seen, along, x, y, found, right, right_rad, map_, weights
                )


def fringe_orders(disparity_px: Float32, projector: ProjectorMap) -> npt.NDArray[np.int16]:
    """Projector period that each left pixel sees at its disparity, (H, W) int16, -32768 where that is NaN."""
    orders = np.empty(disparity_px.shape, dtype=np.int16)
    fill_orders(disparity_px, projector.packed(), orders)
    return orders


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def fill_orders(disparity, map_, orders):  # type: ignore[no-untyped-def]
    """Fill ``orders`` (H, W)."""
    height, width = disparity.shape
    for y in prange(height):
        for x in range(width):
            orders[y, x] = UNKNOWN_ORDER
            if not np.isnan(disparity[y, x]):
                phase, _ = phase_of_disparity(map_, x, y, disparity[y, x])
                orders[y, x] = int(np.floor(phase / (2.0 * np.pi) + 0.5))
