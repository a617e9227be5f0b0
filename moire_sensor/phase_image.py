"""Phase of one camera: what every method hands to the order solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PhaseImage:
    """Per-pixel fringe phase of one camera, arrays of shape (H, W).

    Attributes
    ----------
    offset_rad : float32, absolute phase minus the carrier's, wrapped to -pi..pi; NaN where unknown.
    amplitude : float32, fringe amplitude b in grey levels of 255.
    background : float32, local mean a in grey levels of 255.
    sigma_rad : float32, predicted standard deviation of the phase.
    status : uint8, Status.OK where the phase is known, else UNLIT, SATURATED or MOVED.
    """

    offset_rad: Float32
    amplitude: Float32
    background: Float32
    sigma_rad: Float32
    status: npt.NDArray[np.uint8]
