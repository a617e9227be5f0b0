"""The rig of the paper (section 4, equation 13), the default of the simulator and the tests."""

from __future__ import annotations

import numpy as np

from moire_sensor.pattern import FringePattern
from moire_sensor.rig import Array, StereoRig

IMAGE_SIZE = (640, 480)
PROJECTOR_SIZE = (960, 480)
FX_PX, FY_PX = 1249.89117, 1254.91338
CX_PX, CY_PX = 323.54041, 221.62866
PROJECTOR_CX_PX = 483.54041
PROJECTOR_X_M, RIGHT_X_M = 0.053, 0.094
REFERENCE_DEPTH_M, REFERENCE_FRINGE_M = 1.5, 0.020
PERIOD_PX = REFERENCE_FRINGE_M * FX_PX / REFERENCE_DEPTH_M


def parallel_projection(cx_px: float, x_m: float) -> Array:
    """Projection (3, 4) of a device at ``x_m`` on the x axis with the paper's focal lengths."""
    return np.array(
        [[FX_PX, 0.0, cx_px, -FX_PX * x_m], [0.0, FY_PX, CY_PX, 0.0], [0.0, 0.0, 1.0, 0.0]], dtype=np.float64
    )


def paper_rig() -> StereoRig:
    """Left camera at the origin, projector at 53 mm, right camera at 94 mm, axes parallel."""
    return StereoRig.from_projections(
        parallel_projection(CX_PX, 0.0),
        parallel_projection(CX_PX, RIGHT_X_M),
        parallel_projection(PROJECTOR_CX_PX, PROJECTOR_X_M),
        IMAGE_SIZE,
        projector_size=PROJECTOR_SIZE,
    )


def paper_pattern(step_count: int = 1) -> FringePattern:
    """Sine fringes of 20 mm on the reference plane at 1500 mm: 16.6652 projector columns."""
    return FringePattern(period_px=PERIOD_PX).with_equal_steps(step_count)
