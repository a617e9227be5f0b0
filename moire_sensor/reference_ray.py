"""Where a camera pixel's ray meets the light sheet of a projector column."""

from __future__ import annotations

from typing import Literal

import numpy as np

from moire_sensor.errors import SettingsError
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import Array

Camera = Literal["left", "right"]
CAMERAS: tuple[Camera, ...] = ("left", "right")


def check_camera(camera: str) -> None:
    """Raise SettingsError unless the camera is known."""
    if camera not in CAMERAS:
        raise SettingsError(f"camera is {camera!r}; it must be one of {', '.join(CAMERAS)}")


def phase_seen_rad(
    projector: ProjectorMap, camera: Camera, x_px: Array, y_px: Array, disparity_px: Array | float
) -> Array:
    """Absolute phase, radians, that pixel (x, y) of a camera sees of a point at a disparity; arrays that broadcast."""
    left_x = x_px if camera == "left" else x_px + disparity_px
    return projector.phase_rad_at(left_x, y_px, disparity_px)


def disparity_on_ray_px(
    projector: ProjectorMap, camera: Camera, x_px: Array, y_px: Array, phase_rad: Array | float
) -> Array:
    """Disparity of the point on the ray of pixel (x, y) that has an absolute phase; NaN where they are parallel.

    Equation (11) for any projection matrices: ray and light sheet are both linear in the disparity, so the
    intersection is one division. A right pixel's ray is the left pixels ``x + d`` over all disparities d.
    """
    column = (np.asarray(phase_rad, dtype=np.float64) - projector.phase_rad) / projector.rad_per_column
    above, below = projector.numerator, projector.denominator
    per_disparity = column * below[3] - above[3]
    if camera == "right":
        per_disparity = per_disparity + column * below[1] - above[1]
    at_zero = above[0] + above[1] * x_px + above[2] * y_px - column * (below[0] + below[1] * x_px + below[2] * y_px)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(per_disparity == 0.0, np.nan, at_zero / per_disparity))
