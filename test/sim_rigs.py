"""A small rig, quick to render."""

from __future__ import annotations

import numpy as np

from moire_sensor.paper_rig import PERIOD_PX, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig

QUARTER_PROJECTOR = (240, 120)


def quarter_rig() -> StereoRig:
    """The paper's rig with a quarter of its pixels along rows and columns: sixteen times quicker to render."""
    paper, scale = paper_rig(), np.diag([0.25, 0.25, 1.0])
    projections = (scale @ P for P in (paper.P_left, paper.P_right, paper.P_projector))
    return StereoRig.from_projections(*projections, (160, 120))


def quarter_pattern(step_count: int = 1) -> FringePattern:
    """The paper's fringes on that rig."""
    return FringePattern(PERIOD_PX / 4.0).with_equal_steps(step_count)
