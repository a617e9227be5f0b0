"""What the diagnostics say of one result."""

from __future__ import annotations

from typing import Any

import numpy as np

from moire_sensor.reconstructor import Reconstructor
from moire_sensor.shot import Shot, Status

# A depth less sure than this is more likely wrong by a pixel or more than not.
DOUBTFUL = 0.5
# A median over every pixel would take longer than all the rest.
SAMPLE_PX = 8


def shot_facts(sensor: Reconstructor, shot: Shot) -> dict[str, Any]:
    """Return shares of pixels (0 to 1), what the result was made with, and how well left and right phases agree.

    ``ambiguous share`` counts, of the lit pixels, those of status ambiguous and those of confidence below one half.
    ``background`` is the median grey level (of 255) of the left view without fringes.
    """
    known = np.isfinite(shot.depth_m)
    dark, saturated = shot.status == Status.UNLIT, shot.status == Status.SATURATED
    doubtful = (shot.status == Status.AMBIGUOUS) | (known & (shot.confidence < DOUBTFUL))
    lit = int(dark.size - np.count_nonzero(dark) - np.count_nonzero(saturated))
    coarse = shot.background[::SAMPLE_PX, ::SAMPLE_PX]
    grey = coarse[np.isfinite(coarse)]
    near_m, far_m = sensor.depth_range_m
    return {
        "unknown share": 1.0 - float(known.mean()),
        "ambiguous share": np.count_nonzero(doubtful) / lit if lit else 0.0,
        "saturated share": float(saturated.mean()),
        "dark share": float(dark.mean()),
        "background": float(np.median(grey)) if grey.size else float("nan"),
        "phase mismatch rad": shot.typical_mismatch_rad,
        "min depth m": near_m,
        "max depth m": far_m,
        "method": sensor.method,
        "fringe period px": sensor.pattern.period_px,
        "step count": sensor.pattern.step_count,
        "waveform": sensor.pattern.waveform,
    }
