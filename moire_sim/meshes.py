"""Triangle meshes fine enough for fringes; triangles turn counter-clockwise as seen from outside."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from moire_sim.body_motion import Motion
from moire_sim.finish import Finish

Array = npt.NDArray[np.float64]
# A facet of 2 pi / 1024 lies 1.4 micrometres inside a cylinder of 0.3 m.
CYLINDER_SIDES = 1024
# Of things round in two directions: a facet of 2 pi / 320 lies 24 micrometres inside a sphere of 0.5 m.
ROUND_SIDES = 320


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh in the world frame (the left optical frame at rest: x right, y down, z forward, metres).

    Attributes
    ----------
    vertices_m : (N, 3) float64.
    triangles : (M, 3) indices of vertices; only the outside is visible.
    albedo : grey reflectance, 0 to 1.
    finish : texture and gloss; None leaves them to the optics.
    motion : where it is over time; None stands still.
    """

    vertices_m: Array
    triangles: npt.NDArray[np.int64]
    albedo: float
    finish: Finish | None = None
    motion: Motion | None = None


@dataclass(frozen=True, eq=False)
class LoadedBody:
    """Something that the simulator loads from a file.

    Attributes
    ----------
    kind : ``"mesh"`` (OBJ or STL), ``"urdf"``, or ``"sdf"``, which a scene holds as what it shows.
    path : the file.
    pose : (4, 4), its place in the world frame.
    scale : of a mesh.
    albedo : of a mesh, 0 to 1; the files of robots bring their own colours.
    finish, motion : as of :class:`Body`.
    """

    kind: str
    path: Path
    pose: Array
    scale: float = 1.0
    albedo: float = 0.9
    finish: Finish | None = None
    motion: Motion | None = None


def box(
    centre_m: tuple[float, float, float], size_m: tuple[float, float, float], albedo: float, yaw_rad: float = 0.0
) -> Body:
    """Box turned by ``yaw_rad`` about the vertical; positive turns its right side away from the head."""
    signs = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    vertices = (signs * size_m) @ turn.T + centre_m
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Body(vertices, quads_to_triangles(np.array(quads)), albedo)


def upright_cylinder(x_m: float, z_m: float, radius_m: float, top_m: float, bottom_m: float, albedo: float) -> Body:
    """Cylinder between the heights ``top_m`` and ``bottom_m`` (y, down), with its ends."""
    angle = 2.0 * np.pi * np.arange(CYLINDER_SIDES) / CYLINDER_SIDES
    circle = np.stack([x_m + radius_m * np.cos(angle), z_m + radius_m * np.sin(angle)], axis=-1)
    rings = [np.insert(circle, 1, height, axis=1) for height in (top_m, bottom_m)]
    vertices = np.concatenate([*rings, [[x_m, top_m, z_m], [x_m, bottom_m, z_m]]])
    top = np.arange(CYLINDER_SIDES)
    next_top = np.roll(top, -1)
    side = quads_to_triangles(np.stack([top, top + CYLINDER_SIDES, next_top + CYLINDER_SIDES, next_top], axis=-1))
    top_end = np.stack([np.full_like(top, 2 * CYLINDER_SIDES), top, next_top], axis=-1)
    bottom_end = np.stack(
        [np.full_like(top, 2 * CYLINDER_SIDES + 1), next_top + CYLINDER_SIDES, top + CYLINDER_SIDES], axis=-1
    )
    return Body(vertices, np.concatenate([side, top_end, bottom_end]), albedo)


def sheet(
    height: Callable[[Array, Array], Array],
    half_size_m: tuple[float, float],
    step_m: tuple[float, float],
    albedo: float,
) -> Body:
    """Surface ``z = height(x, y)`` over ``|x|, |y| <= half_size_m``, visible from the head's side."""
    counts = [2 * math.ceil(half / step) + 1 for half, step in zip(half_size_m, step_m, strict=True)]
    x, y = np.meshgrid(*(np.linspace(-half, half, n) for half, n in zip(half_size_m, counts, strict=True)))
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(x.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    return Body(vertices, quads_to_triangles(quads), albedo)


def board(z_m: float, half_size_m: tuple[float, float], albedo: float, slope_x: float = 0.0) -> Body:
    """Flat sheet ``z = z_m + slope_x x`` that faces the head."""
    return sheet(lambda x, _: z_m + slope_x * x, half_size_m, half_size_m, albedo)


def round_body(x_m: float, z_m: float, profile: Array, albedo: float) -> Body:
    """Body of revolution about an upright axis: ``profile`` (N, 2) holds radius and height y of its rings, downwards.

    Both ends must have the radius 0.
    """
    angle = 2.0 * np.pi * np.arange(ROUND_SIDES) / ROUND_SIDES
    radius, height = profile[:, :1], profile[:, 1:]
    heights = np.broadcast_to(height, (len(profile), ROUND_SIDES))
    rings = [x_m + radius * np.cos(angle), heights, z_m + radius * np.sin(angle)]
    index = np.arange(len(profile) * ROUND_SIDES).reshape(len(profile), ROUND_SIDES)
    after = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], index[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    return Body(np.stack(rings, axis=-1).reshape(-1, 3), quads_to_triangles(quads), albedo)


def arc(centre_y_m: float, radius_m: float, first_rad: float, last_rad: float, count: int) -> Array:
    """Rings (count, 2), radius and height, of a part of a sphere; angles are from its top."""
    angle = np.linspace(first_rad, last_rad, count)
    radius = np.maximum(radius_m * np.sin(angle), 0.0)
    return np.stack([radius, centre_y_m - radius_m * np.cos(angle)], axis=-1)


def sphere(centre_m: tuple[float, float, float], radius_m: float, albedo: float) -> Body:
    """Sphere; its facets lie within radius / 20000 of it."""
    x, y, z = centre_m
    return round_body(x, z, arc(y, radius_m, 0.0, math.pi, ROUND_SIDES // 2 + 1), albedo)


def capsule(x_m: float, z_m: float, radius_m: float, top_m: float, bottom_m: float, albedo: float) -> Body:
    """Upright cylinder with round ends between the heights ``top_m`` and ``bottom_m`` (y, down)."""
    rings = ROUND_SIDES // 8
    upper = arc(top_m + radius_m, radius_m, 0.0, math.pi / 2.0, rings)
    lower = arc(bottom_m - radius_m, radius_m, math.pi / 2.0, math.pi, rings)
    return round_body(x_m, z_m, np.concatenate([upper, lower]), albedo)


def quads_to_triangles(quads: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Split quads (N, 4) into triangles (2 N, 3) of the same turn."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def to_obj(body: Body) -> str:
    """Return the mesh in Wavefront OBJ format."""
    vertices = "".join(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in body.vertices_m.tolist())
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in (body.triangles + 1).tolist())
    return vertices + faces
