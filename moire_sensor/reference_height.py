"""Height above the reference plane and shift of the fringe on it (equations 3, 5 and 6, and their exact forms).

Camera and projector at equal height l above the plane, separation B.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from moire_sensor.rig import Array


def shift_of_height_m(height_m: npt.ArrayLike, plane_m: float, separation_m: float) -> Array:
    """Shift u of the fringe on the plane by a point ``height_m`` above it: ``z B / (l - z)``, metres (any shape).

    Equations (5) and (6) give ``z B / l``: they take both angles at the point of the plane that the camera sees, where
    the light would have to come from the point above it. Off by the factor l / (l - z), 1.5 for a board at two thirds.
    """
    height = np.asarray(height_m, dtype=np.float64)
    return np.asarray(height * separation_m / (plane_m - height))


def height_of_shift_m(shift_m: npt.ArrayLike, plane_m: float, separation_m: float) -> Array:
    """Height above the plane of a fringe shifted by u on it: ``u l / (B + u)``, metres (any shape); NaN for u <= -B."""
    shift = np.asarray(shift_m, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(shift > -separation_m, shift * plane_m / (separation_m + shift), np.nan)


def shift_of_phase_m(psi_periods: npt.ArrayLike, pitch_m: float) -> Array:
    """Shift u of a fringe out of phase by psi periods where the fringes are ``pitch_m`` wide, equation (3)."""
    return np.asarray(np.asarray(psi_periods, dtype=np.float64) * pitch_m)
