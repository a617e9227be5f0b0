"""Errors of the simulator."""

from __future__ import annotations

from moire_sensor.errors import MoireError


class SceneError(MoireError):
    """A scene that does not exist, or an option it does not have."""


class SimulatorError(MoireError):
    """A simulator that is not installed or cannot render."""


class TrajectoryError(MoireError):
    """A trajectory that the head's joints cannot follow."""
