"""Dimensions read off the measured points: what a robot would want of figures 11 and 12."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tools.figures.stage import Array

# Gauss-Newton rounds of a circle: the start is within a few per cent.
ROUNDS = 8


def sine_amplitudes_mm(points_m: npt.NDArray[Any], lengths_m: tuple[float, float]) -> tuple[float, float]:
    """Amplitudes of a sine along x and one along y in points (..., 3), by least squares; NaN points are left out."""
    x, y, z = known(points_m).T.astype(np.float64)
    along_x, along_y = 2.0 * math.pi * x / lengths_m[0], 2.0 * math.pi * y / lengths_m[1]
    model = np.stack([np.ones_like(x), np.sin(along_x), np.cos(along_x), np.sin(along_y), np.cos(along_y)], axis=1)
    found = np.linalg.lstsq(model, z, rcond=None)[0]
    return 1e3 * math.hypot(found[1], found[2]), 1e3 * math.hypot(found[3], found[4])


def upright_cylinder(points_m: npt.NDArray[Any]) -> tuple[float, float, float]:
    """Axis x and z and radius of an upright cylinder through points (..., 3), metres; one refit without misfits."""
    plan = known(points_m)[:, [0, 2]].astype(np.float64)
    fit = circle(plan)
    misfit = np.abs(np.hypot(plan[:, 0] - fit[0], plan[:, 1] - fit[1]) - fit[2])
    return circle(plan[misfit <= 3.0 * np.median(misfit)])


def circle(plan_m: Array) -> tuple[float, float, float]:
    """Centre and radius of a circle through points (N, 2): least squares of the distance from it.

    The start, least squares of the squared distance, is too small on a noisy arc.
    """
    model = np.column_stack([2.0 * plan_m, np.ones(len(plan_m))])
    x, z, rest = np.linalg.lstsq(model, (plan_m**2).sum(axis=1), rcond=None)[0]
    fit = np.array([x, z, math.sqrt(rest + x * x + z * z)])
    for _ in range(ROUNDS):
        from_centre = plan_m - fit[:2]
        distance = np.hypot(*from_centre.T)
        slopes = np.column_stack([-from_centre / distance[:, None], -np.ones(len(plan_m))])
        fit -= np.linalg.lstsq(slopes, distance - fit[2], rcond=None)[0]
    return float(fit[0]), float(fit[1]), float(fit[2])


def face_angle_deg(points_m: npt.NDArray[Any]) -> float:
    """Angle of a vertical face through points (..., 3) from the image plane, about the vertical, degrees."""
    x, _, z = known(points_m).T.astype(np.float64)
    slope, level = np.polyfit(x, z, 1)
    near = np.abs(z - slope * x - level)
    good = near <= 3.0 * np.median(near)
    return math.degrees(math.atan(np.polyfit(x[good], z[good], 1)[0]))


def known(points_m: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Points (N, 3) that are known."""
    flat = points_m.reshape(-1, 3)
    return np.asarray(flat[np.isfinite(flat[:, 2])])
