"""Disparity of the chosen order, measured by all three views as the rig's geometry and the noise favour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.angles import NAN_SAFE, wrap
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap, disparity_of_phase, phase_of_disparity
from moire_sensor.right_view import right_phase
from moire_sensor.settings import Settings
from moire_sensor.shot import UNKNOWN_ORDER

ITERATIONS = 2
# Phases are nearly straight over so short a step: a second one would hardly move it.
SETTLED_PX = 0.1


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

    @classmethod
    def of(cls, disparity_px: Float32, sigma_px: Float32, signed_mismatch_rad: Float32) -> Match:
        """Match with the absolute mismatch filled in."""
        return cls(disparity_px, sigma_px, signed_mismatch_rad, np.abs(signed_mismatch_rad))


def refine(
    label: npt.NDArray[np.int8],
    phases: tuple[PhaseImage, PhaseImage],
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
    settings: Settings,
) -> Match:
    """Generalised least squares of both phases against the projector's, systematic errors included.

    The covariance is [[sL^2 + g^2, g^2], [g^2, sR^2 + a^2 + g^2]]: noise of each camera, an error g common to both
    (gamma, motion) and the misalignment a of the rectified pair. So a rig whose projector stands between the cameras
    measures left against right, where g cancels; one whose projector stands far outside measures against it. The
    predicted sigma is that of the noise alone.
    """
    shape = label.shape
    result = np.full((3, *shape), np.nan, dtype=np.float32)
    left, right = phases
    solve_disparity(
        label, orders.first, left.offset_rad, right.offset_rad, left.sigma_rad, right.sigma_rad,
        carriers[0].phase_rad, carriers[1].phase_rad, projector.packed(), settings.common_error_rad,
        settings.alignment_px, result,
    )  # fmt: skip
    return Match.of(result[0], result[1], result[2])


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def solve_disparity(  # type: ignore[no-untyped-def]
    label, first, left, right, left_sigma, right_sigma, left_rad, right_rad, map_, common, alignment, result
):
    """Fill ``result`` (3, H, W): disparity, sigma, signed mismatch."""
    height, width = label.shape
    for y in prange(height):
        for x in range(width):
            if label[y, x] < 0:
                continue
            phase = left_rad[y, x] + left[y, x] + 2.0 * np.pi * (first + label[y, x])
            disparity = disparity_of_phase(map_, x, y, phase)
            column = x - disparity
            if column < -0.5 or column > width - 0.5:
                continue
            seen, _ = right_phase(right, right_rad, y, column)
            if np.isnan(seen):
                continue
            result[2, y, x] = wrap(np.float32(phase - seen))
            at = min(max(int(column + 0.5), 0), width - 1)
            g2 = common * common
            v1 = left_sigma[y, x] ** 2 + 1e-10
            v2 = right_sigma[y, at] ** 2 + 1e-10
            a2 = (alignment * (right_rad[y, 1] - right_rad[y, 0])) ** 2
            w11, w22, w12 = v2 + a2 + g2, v1 + g2, -g2
            sigma = np.float64(np.nan)
            for _ in range(ITERATIONS):
                expected, slope1 = phase_of_disparity(map_, x, y, disparity)
                seen, along = right_phase(right, right_rad, y, x - disparity)
                if np.isnan(seen):
                    break
                slope2 = slope1 + along
                gain1, gain2 = w11 * slope1 + w12 * slope2, w12 * slope1 + w22 * slope2
                norm = gain1 * slope1 + gain2 * slope2
                residual = wrap(np.float32(seen - expected))
                step = (gain1 * (phase - expected) + gain2 * residual) / norm
                disparity += step
                sigma = np.sqrt(gain1 * gain1 * v1 + gain2 * gain2 * v2) / norm
                if abs(step) < SETTLED_PX:
                    break
            if not np.isnan(seen):
                result[0, y, x] = disparity
                result[1, y, x] = sigma


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
