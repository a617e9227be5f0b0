"""Disparity of the chosen order, measured by all three views as the rig's geometry and the noise favour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE
from moire_sensor.depth_refine_row import PART, ROWS, refine_row
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap, phase_of_disparity
from moire_sensor.settings import Settings
from moire_sensor.shot import UNKNOWN_ORDER


@dataclass(frozen=True, eq=False)
class Match:
    """Disparity of every left pixel, or of those of some rows, arrays (n, W) float32, NaN where there is none.

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
    buffer: Float32 | None = None,
) -> Match:
    """Generalised least squares of both phases against the projector's, systematic errors included.

    The covariance is [[sL^2 + g^2, g^2], [g^2, sR^2 + a^2 + g^2]]: noise of each camera, an error g common to both
    (gamma, motion) and the misalignment a of the rectified pair. So a rig whose projector stands between the cameras
    measures left against right, where g cancels; one whose projector stands far outside measures against it. The
    predicted sigma is that of the noise alone.

    Parameters
    ----------
    label : (n, W) int8, the order of every pixel counted from ``orders.first``, negative for none.
    max_mismatch_rad : pixels whose phases disagree by more have no disparity, only a mismatch.
    match : a match to change in place at the pixels with a label; without one, those without a label are NaN.
    buffer : (4, n, W) float32 for the arrays of a new match, which last until its next use.
    """
    left, right = phases
    fresh = match is None
    match = match or Match(*(np.empty((4, *label.shape), dtype=np.float32) if buffer is None else buffer))
    errors = np.array([settings.common_error_rad, settings.alignment_px, max_mismatch_rad], dtype=np.float32)
    middle = np.float32(carriers[0].disparity_px)
    solve_disparity(
        label, left.rows, orders.first, left.offset_rad, right.offset_rad, left.sigma_rad, right.sigma_rad,
        carriers[0].phase_rad, carriers[1].phase_rad, projector.packed(), middle, errors, fresh, *match.images(),
    )  # fmt: skip
    return match


@njit(parallel=True, cache=True)
def solve_disparity(  # type: ignore[no-untyped-def]
    label, rows, first, left, right, left_sigma, right_sigma, left_rad, right_rad, map_, middle, errors, fresh,
    disparity, sigma, signed, mismatch,
):  # fmt: skip
    """Fill disparity, sigma and mismatches (n, W) of the rows of the image; if ``fresh``, NaN without a label."""
    height, width = label.shape
    for number in prange(height):
        index = np.int64(number)
        y = rows[index]
        room, parts = np.empty((3, width), dtype=np.float32), np.empty((ROWS, PART), dtype=np.float32)
        refine_row(
            label[index], first, y, left[index], left_sigma[index], left_rad[y], right[index], right_sigma[index],
            right_rad[y], map_, middle, errors, fresh, room, parts, disparity[index], sigma[index], signed[index],
            mismatch[index],
        )  # fmt: skip


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
