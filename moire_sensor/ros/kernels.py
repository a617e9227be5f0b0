"""The kernels that a reconstruction node needs, loaded or compiled before it takes its first set."""

from __future__ import annotations

from moire_sensor import nav_cloud, resample
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.reconstructor import Reconstructor
from moire_sensor.settings import Settings

STEPS = {"phase_shift": 4}


def warm_up(methods: set[str], settings: Settings, saturation_level: float = 255.0) -> None:
    """Load or compile what some methods, rectification and clouds run; a minute or two the first time on a machine."""
    for method in sorted(methods):
        pattern = paper_pattern(STEPS.get(method, 1))
        Reconstructor(
            paper_rig(), pattern, method=method, saturation_level=saturation_level, settings=settings
        ).warm_up()
    resample.warm_up()
    nav_cloud.warm_up()
