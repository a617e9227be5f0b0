"""How bodies, and the head's base, move over time: between places, or swinging about an axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from moire_sim.errors import SceneError

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]


class Motion(Protocol):
    """Where something is at a time."""

    def pose(self, time_s: float) -> Array:
        """Pose (4, 4) that moves points from where they are at rest to where they are at ``time_s``."""


@dataclass(frozen=True)
class Path:
    """Straight ways between places; turns are about the upright axis through ``pivot_m``.

    Attributes
    ----------
    times_s : rising, the first 0 or more; before the first and after the last one it rests there.
    shifts_m : for each time, where the body is, from its rest.
    yaws_rad : for each time, its turn, positive to the left (its right side goes away from the head).
    pivot_m : what it turns about.
    repeat : begin again after the last time.
    """

    times_s: tuple[float, ...]
    shifts_m: tuple[Vector, ...]
    yaws_rad: tuple[float, ...]
    pivot_m: Vector = (0.0, 0.0, 0.0)
    repeat: bool = False

    def __post_init__(self) -> None:
        if len(self.times_s) < 2 or self.times_s[0] < 0.0 or not np.all(np.diff(self.times_s) > 0.0):
            raise SceneError(f"times_s is {list(self.times_s)}; give two or more times that rise, the first 0 or more")
        if not len(self.times_s) == len(self.shifts_m) == len(self.yaws_rad):
            raise SceneError(
                f"a motion has {len(self.times_s)} times_s, {len(self.shifts_m)} shifts_m and {len(self.yaws_rad)} "
                "yaws_rad; give as many of each"
            )

    def pose(self, time_s: float) -> Array:
        """Pose (4, 4) at a time."""
        if self.repeat:
            time_s = self.times_s[0] + (time_s - self.times_s[0]) % (self.times_s[-1] - self.times_s[0])
        shift = [np.interp(time_s, self.times_s, axis) for axis in zip(*self.shifts_m, strict=True)]
        yaw = float(np.interp(time_s, self.times_s, self.yaws_rad))
        pose = turn_about(self.pivot_m, (0.0, -1.0, 0.0), yaw)
        pose[:3, 3] += shift
        return pose


@dataclass(frozen=True)
class Swing:
    """A pendulum: ``amplitude_rad sin(2 pi time / period_s)`` about ``axis`` through ``pivot_m``."""

    pivot_m: Vector
    axis: Vector
    amplitude_rad: float
    period_s: float

    def __post_init__(self) -> None:
        if not math.hypot(*self.axis) > 0.0:
            raise SceneError(f"axis of a swing is {list(self.axis)}; give a direction")
        if not self.period_s > 0.0:
            raise SceneError(f"period_s of a swing is {self.period_s}; it must be more than 0 s")

    def pose(self, time_s: float) -> Array:
        """Pose (4, 4) at a time."""
        angle_rad = self.amplitude_rad * math.sin(2.0 * math.pi * time_s / self.period_s)
        return turn_about(self.pivot_m, self.axis, angle_rad)


def turn_about(pivot_m: Vector, axis: Vector, angle_rad: float) -> Array:
    """Pose (4, 4) of a turn by the right-hand rule (Rodrigues 1840)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / math.hypot(*axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    pose = np.eye(4)
    pose[:3, :3] += math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross
    pose[:3, 3] = np.asarray(pivot_m) - pose[:3, :3] @ pivot_m
    return pose
