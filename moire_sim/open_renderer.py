"""The renderer, where pybullet is installed."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from moire_sim.errors import SimulatorError
from moire_sim.head_options import MOST_PROCESSES
from moire_sim.scene_file import Scene

if TYPE_CHECKING:
    from moire_sim.render_geometry import GeometryRenderer


def open_renderer(scene: Scene, egl: bool, processes: int) -> GeometryRenderer:
    """Import and start the renderer, or raise SimulatorError saying how to get pybullet."""
    try:
        from moire_sim.parallel_renderer import ParallelRenderer
        from moire_sim.render_geometry import GeometryRenderer
    except ModuleNotFoundError as error:
        if error.name != "pybullet":
            raise
        raise SimulatorError(
            "the virtual head needs pybullet, which is not installed; run make setup, or pip install pybullet "
            "(Python 3.11) or pybullet-arm64 (Python 3.12 and 3.13)"
        ) from error
    return ParallelRenderer(scene, egl, processes) if processes > 1 else GeometryRenderer(scene, egl)


def processes_to_render(wanted: int) -> int:
    """Return how many processes render: as many as wanted; for 0 one a view, where there is more than one core."""
    return wanted or (MOST_PROCESSES if len(os.sched_getaffinity(0)) > 1 else 1)
