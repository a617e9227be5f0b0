"""A small rig, quick to render."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from moire_sensor.paper_rig import PERIOD_PX, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig
from moire_sim import HeadOptions, VirtualHead, preset

QUARTER_PROJECTOR = (240, 120)


def quarter_rig() -> StereoRig:
    """The paper's rig with a quarter of its pixels along rows and columns: sixteen times quicker to render."""
    paper, scale = paper_rig(), np.diag([0.25, 0.25, 1.0])
    projections = (scale @ P for P in (paper.P_left, paper.P_right, paper.P_projector))
    return StereoRig.from_projections(*projections, (160, 120))


def quarter_pattern(step_count: int = 1) -> FringePattern:
    """The paper's fringes on that rig."""
    return FringePattern(PERIOD_PX / 4.0).with_equal_steps(step_count)


def real_digest() -> str:
    """Digest of realistic exposures, one of them moved."""
    digest = hashlib.sha256()
    with VirtualHead("cylinder_and_box", 5, quarter_rig(), real_options()) as head:
        for step in range(2):
            digest.update(b"".join(image.tobytes() for image in head.expose(quarter_pattern(2), step, step)))
        head.set_head(0.02, 0.0)
        digest.update(head.expose(quarter_pattern())[1].tobytes())
    return digest.hexdigest()


def real_options() -> HeadOptions:
    """The realistic preset for the small rig."""
    return replace(preset("realistic"), projector_size=QUARTER_PROJECTOR)
