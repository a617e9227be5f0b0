"""Where the head and all that moves before it stand."""

from __future__ import annotations

from typing import NamedTuple


class Moment(NamedTuple):
    """Pan (positive to the left) and tilt (positive down) in rad, and time of the scene in s; 0 in a still scene."""

    pan_rad: float = 0.0
    tilt_rad: float = 0.0
    time_s: float = 0.0
