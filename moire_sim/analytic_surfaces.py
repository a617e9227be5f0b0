"""Surfaces with exact ray intersections, in the left optical frame (metres, y down, z forward).

Rays are ``origin + t * direction`` with origin (3,) and directions (3, N); ``hit`` returns the smallest t > 0 of each
ray, (N,), infinity where it misses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
NEWTON_STEPS = 12


class Surface(Protocol):
    """Anything a ray can hit."""

    def hit(self, origin: Array, directions: Array) -> Array:
        """Return the ray parameter of the first hit, (N,), infinity for a miss."""

    def normal(self, points: Array) -> Array:
        """Return outward unit normals (3, N) at points (3, N) on the surface."""


@dataclass(frozen=True)
class Relief:
    """Endless relief ``z = depth + slope_x x + slope_y y + sum A sin(2 pi (x / Lx + y / Ly))``.

    Slopes must stay below about 2, so that the relief never hides itself from a head that looks along z.
    ``waves`` holds (amplitude_m, wavelength_x_m, wavelength_y_m); an infinite wavelength leaves that axis out.
    """

    depth_m: float
    slope_x: float = 0.0
    slope_y: float = 0.0
    waves: tuple[tuple[float, float, float], ...] = ()

    def height(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z and its derivatives by x and y."""
        z = self.depth_m + self.slope_x * x + self.slope_y * y
        z_x, z_y = np.full_like(x, self.slope_x), np.full_like(y, self.slope_y)
        for amplitude, length_x, length_y in self.waves:
            kx, ky = 2.0 * math.pi / length_x, 2.0 * math.pi / length_y
            phase = kx * x + ky * y
            z += amplitude * np.sin(phase)
            slope = amplitude * np.cos(phase)
            z_x += kx * slope
            z_y += ky * slope
        return z, z_x, z_y

    def hit(self, origin: Array, directions: Array) -> Array:
        """Newton's method from the plane ``z = depth``; one step is exact without waves."""
        t = (self.depth_m - origin[2]) / directions[2]
        for _ in range(NEWTON_STEPS if self.waves else 1):
            z, z_x, z_y = self.height(origin[0] + t * directions[0], origin[1] + t * directions[1])
            slope = directions[2] - z_x * directions[0] - z_y * directions[1]
            change = (origin[2] + t * directions[2] - z) / slope
            t = t - change
            if np.abs(change).max(initial=0.0) < 1e-12:
                break
        return np.where(t > 0.0, t, np.inf)

    def normal(self, points: Array) -> Array:
        """Unit normals towards the head."""
        _, z_x, z_y = self.height(points[0], points[1])
        return unit(np.stack([z_x, z_y, -np.ones_like(z_x)]))


@dataclass(frozen=True)
class Box:
    """Solid box, turned by ``yaw_rad`` about the vertical."""

    centre_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float = 0.0

    def local(self, vectors: Array) -> Array:
        """Rotate vectors (3, N) into the box's axes."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ vectors

    def hit(self, origin: Array, directions: Array) -> Array:
        """Intersect the three slabs."""
        start = self.local((origin - np.array(self.centre_m))[:, None])
        slabs = [
            interval_of_slab(start[axis, 0], ray, self.size_m[axis] / 2.0)
            for axis, ray in enumerate(self.local(directions))
        ]
        return entry(slabs)

    def normal(self, points: Array) -> Array:
        """Normal of the nearest face."""
        local = self.local(points - np.array(self.centre_m)[:, None])
        half = np.array(self.size_m)[:, None] / 2.0
        axis = np.argmin(np.abs(np.abs(local) - half), axis=0)
        columns = np.arange(local.shape[1])
        faces = np.zeros_like(local)
        faces[axis, columns] = np.sign(local[axis, columns])
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.asarray(np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ faces)


@dataclass(frozen=True)
class Cylinder:
    """Solid upright cylinder between ``top_m`` and ``bottom_m`` (y, down)."""

    x_m: float
    z_m: float
    radius_m: float
    top_m: float
    bottom_m: float

    def hit(self, origin: Array, directions: Array) -> Array:
        """Intersect the endless cylinder with the slab between its ends."""
        start = origin[[0, 2]] - np.array([self.x_m, self.z_m])
        side = interval_of_ball(start, directions[[0, 2]], self.radius_m)
        middle = (self.top_m + self.bottom_m) / 2.0
        ends = interval_of_slab(origin[1] - middle, directions[1], (self.bottom_m - self.top_m) / 2.0)
        return entry([side, ends])

    def normal(self, points: Array) -> Array:
        """Radial on the side, vertical on the ends."""
        radial = np.stack([points[0] - self.x_m, np.zeros_like(points[0]), points[2] - self.z_m])
        inside = np.abs(np.hypot(radial[0], radial[2]) - self.radius_m)
        end = np.minimum(np.abs(points[1] - self.top_m), np.abs(points[1] - self.bottom_m))
        vertical = np.zeros_like(radial)
        vertical[1] = np.sign(points[1] - (self.top_m + self.bottom_m) / 2.0)
        return np.where(inside <= end, unit(radial), vertical)


@dataclass(frozen=True)
class Sphere:
    """Solid sphere."""

    centre_m: tuple[float, float, float]
    radius_m: float

    def hit(self, origin: Array, directions: Array) -> Array:
        """Solve the quadratic."""
        return entry([interval_of_ball(origin - np.array(self.centre_m), directions, self.radius_m)])

    def normal(self, points: Array) -> Array:
        """Radial."""
        return unit(points - np.array(self.centre_m)[:, None])


Interval = tuple[Array, Array]


def interval_of_slab(start: float, ray: Array, half: float) -> Interval:
    """Ray parameters between which ``|start + t ray| <= half``."""
    safe = np.where(np.abs(ray) < 1e-12, 1e-12, ray)
    one, two = (-half - start) / safe, (half - start) / safe
    return np.minimum(one, two), np.maximum(one, two)


def interval_of_ball(start: Array, rays: Array, radius: float) -> Interval:
    """Ray parameters between which ``|start + t ray| <= radius``, in two or three dimensions; empty for a miss."""
    a = (rays * rays).sum(axis=0)
    b = start @ rays
    root = b * b - a * (start @ start - radius * radius)
    with np.errstate(invalid="ignore"):
        half = np.sqrt(root)
    missed = root < 0.0
    return np.where(missed, np.inf, (-b - half) / a), np.where(missed, -np.inf, (-b + half) / a)


def entry(intervals: Sequence[Interval]) -> Array:
    """Ray parameter at which all intervals are entered; infinity where they do not overlap in front."""
    enter = np.max([low for low, _ in intervals], axis=0)
    leave = np.min([high for _, high in intervals], axis=0)
    return np.where((enter < leave) & (enter > 0.0), enter, np.inf)


def unit(vectors: Array) -> Array:
    """Scale vectors (3, N) to length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=0))


def cast(surfaces: Sequence[Surface], origin: Array, directions: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    """First hit of each ray: (t, index of the surface); t is infinite for a miss."""
    nearest = np.full(directions.shape[1], np.inf)
    index = np.zeros(directions.shape[1], dtype=np.int64)
    for number, surface in enumerate(surfaces):
        t = surface.hit(origin, directions)
        closer = t < nearest
        nearest[closer] = t[closer]
        index[closer] = number
    return nearest, index


def unobstructed(surfaces: Sequence[Surface], origin: Array, points: Array) -> npt.NDArray[np.bool_]:
    """Whether nothing lies between ``origin`` and the points (3, N) on the surfaces."""
    t, _ = cast(surfaces, origin, points - origin[:, None])
    # The point itself is at t = 1; a millionth is a micrometre at a metre, far above rounding.
    return np.asarray(t > 1.0 - 1e-6)
