"""The result of one reconstruction."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

UNKNOWN_ORDER = -32768


class Status(IntEnum):
    """Why a pixel has, or has not, a depth."""

    OK = 0
    UNLIT = 1
    SATURATED = 2
    OCCLUDED = 3
    AMBIGUOUS = 4
    MOVED = 5
    FROM_SINGLE_SHOT = 6


@dataclass(frozen=True)
class Shot:
    """Images aligned with the rectified left view, all of shape (H, W).

    Attributes
    ----------
    depth_m : float32, z in the left optical frame, metres; NaN where unknown.
    depth_sigma_m : float32, predicted standard deviation of ``depth_m``, metres; NaN where unknown.
    disparity_px : float32, left column minus right column, pixels; NaN where unknown (equation 10).
    fringe_order : int16, projector period that the pixel sees; -32768 where unknown (N of equation 7).
    confidence : float32, 0 (no depth) to 1.
    status : uint8, values of :class:`Status`.
    background : float32, grey levels, the left view with the fringes removed.
    typical_mismatch_rad : float, mean left-right phase mismatch of image patches (upper quartile of them), NaN without
        any depth. Near zero when rig and pattern are right; a wrong period, swapped images or a bad calibration raise
        it.
    """

    depth_m: npt.NDArray[np.float32]
    depth_sigma_m: npt.NDArray[np.float32]
    disparity_px: npt.NDArray[np.float32]
    fringe_order: npt.NDArray[np.int16]
    confidence: npt.NDArray[np.float32]
    status: npt.NDArray[np.uint8]
    background: npt.NDArray[np.float32]
    typical_mismatch_rad: float = float("nan")
