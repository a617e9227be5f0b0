"""The renderer, where pybullet is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from moire_sim.errors import SimulatorError

if TYPE_CHECKING:
    from moire_sim.render_geometry import GeometryRenderer


def open_renderer() -> type[GeometryRenderer]:
    """Import the renderer, or raise SimulatorError saying how to get pybullet."""
    try:
        from moire_sim.render_geometry import GeometryRenderer
    except ModuleNotFoundError as error:
        if error.name != "pybullet":
            raise
        raise SimulatorError(
            "the virtual head needs pybullet, which is not installed; run make setup, or pip install pybullet "
            "(Python 3.11) or pybullet-arm64 (Python 3.12 and 3.13)"
        ) from error
    return GeometryRenderer
