"""The bodies that a scene file can name, each built from its fields."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import quoted
from moire_sim.body_motion import Motion, Swing, Vector, turn_about
from moire_sim.body_motion import Path as Way
from moire_sim.errors import SceneError
from moire_sim.finish import Finish
from moire_sim.meshes import Body, LoadedBody, board, box, capsule, sheet, sphere, upright_cylinder
from moire_sim.scene_fields import Fields

Array = npt.NDArray[np.float64]
MESH_SUFFIXES = (".obj", ".stl")
MAX_SHEET_STEPS = 2000
# From x ahead, y left, z up (REP 103) to the world frame: z ahead, x right, y down.
WORLD_FROM_FILE = np.array([[0.0, -1.0, 0, 0], [0, 0, -1.0, 0], [1.0, 0, 0, 0], [0, 0, 0, 1.0]])


def box_of(fields: Fields, albedo: float) -> Body:
    """Box, turned about the upright axis."""
    centre = fields.vector("centre_m", 3)
    size = fields.vector("size_m", 3, low=1e-6)
    return box(triple(centre), triple(size), albedo, fields.number("yaw_rad", 0.0))


def cylinder_of(fields: Fields, albedo: float) -> Body:
    """Upright cylinder with flat ends."""
    return upright_cylinder(
        fields.number("x_m"), fields.number("z_m"), fields.number("radius_m", low=1e-6),
        fields.number("top_m"), fields.number("bottom_m"), albedo,
    )  # fmt: skip


def capsule_of(fields: Fields, albedo: float) -> Body:
    """Upright cylinder with round ends."""
    radius_m, top_m = fields.number("radius_m", low=1e-6), fields.number("top_m")
    bottom_m = fields.number("bottom_m", low=top_m + 2.0 * radius_m)
    return capsule(fields.number("x_m"), fields.number("z_m"), radius_m, top_m, bottom_m, albedo)


def sphere_of(fields: Fields, albedo: float) -> Body:
    """Sphere."""
    return sphere(triple(fields.vector("centre_m", 3)), fields.number("radius_m", low=1e-6), albedo)


def board_of(fields: Fields, albedo: float) -> Body:
    """Flat sheet that faces the head."""
    half = fields.vector("half_size_m", 2, low=1e-3)
    return board(fields.number("z_m"), (half[0], half[1]), albedo, fields.number("slope_x", 0.0))


def relief_of(fields: Fields, albedo: float) -> Body:
    """Wavy sheet: ``z = z_m + sum amplitude sin(2 pi (x / length_x + y / length_y))``."""
    z_m, waves = fields.number("z_m"), fields.get("waves")
    half = fields.vector("half_size_m", 2, low=1e-3)
    step = fields.vector("step_m", 2, low=1e-4)
    if max(half[0] / step[0], half[1] / step[1]) > MAX_SHEET_STEPS:
        raise SceneError(f"{fields.place}: step_m is too fine; at most {MAX_SHEET_STEPS} steps to a side are built")
    parts = [wave_of(fields, number, wave) for number, wave in enumerate(waves if isinstance(waves, list) else [waves])]

    def height(x: Array, y: Array) -> Array:
        across = [high_m * np.sin(2.0 * math.pi * (x / x_m + y / y_m)) for high_m, x_m, y_m in parts]
        return np.asarray(z_m + np.sum(across, axis=0))

    return sheet(height, (half[0], half[1]), (step[0], step[1]), albedo)


def wave_of(fields: Fields, number: int, wave: Any) -> tuple[float, float, float]:
    """Amplitude and the lengths of a wave along x and y, endless where they are not given."""
    inner = Fields.of(f"{fields.place}, wave {number + 1}", wave, fields.options)
    amplitude_m = inner.number("amplitude_m")
    lengths = [inner.number(name, math.inf, 1e-3, math.inf) for name in ("length_x_m", "length_y_m")]
    inner.finish()
    return amplitude_m, lengths[0], lengths[1]


SHAPES: dict[str, Callable[[Fields, float], Body]] = {
    "box": box_of, "cylinder": cylinder_of, "capsule": capsule_of, "sphere": sphere_of, "board": board_of,
    "relief": relief_of,
}  # fmt: skip
LOADED = ("mesh", "urdf", "sdf")


def loaded_of(kind: str, fields: Fields, albedo: float, folder: Path) -> LoadedBody:
    """Body from a file, whose own frame is x ahead, y left, z up as of a robot."""
    path = checked_file(folder / fields.text("file"), kind, fields.place)
    position = fields.vector("position_m", 3, (0.0, 0.0, 0.0))
    turn = fields.vector("rpy_rad", 3, (0.0, 0.0, 0.0))
    scale = fields.number("scale", 1.0, 1e-6, 1e6) if kind == "mesh" else 1.0
    pose = WORLD_FROM_FILE @ placed((0.0, 0.0, 0.0), triple(turn))
    pose[:3, 3] = position
    return LoadedBody(kind, path, pose, scale, albedo)


def placed(position_m: Vector, rpy_rad: Vector) -> Array:
    """Pose (4, 4) of a position and of turns about the fixed axes x, then y, then z."""
    roll, pitch, yaw = rpy_rad
    pose = turn_about((0, 0, 0), (0, 0, 1), yaw) @ turn_about((0, 0, 0), (0, 1, 0), pitch)
    pose = np.asarray(pose @ turn_about((0, 0, 0), (1, 0, 0), roll))
    pose[:3, 3] = position_m
    return pose


def checked_file(path: Path, kind: str, place: str) -> Path:
    """Return the path, or raise SceneError for a file that is not there or of another kind."""
    if not path.is_file():
        raise SceneError(f"{place}: there is no file {path}; paths are relative to the scene file")
    if kind == "mesh" and path.suffix.lower() not in MESH_SUFFIXES:
        raise SceneError(f"{place}: {path.name} is no mesh that can be read; give {' or '.join(MESH_SUFFIXES)}")
    return path


def motion_of(fields: Fields | None) -> Motion | None:
    """Read ``path`` or ``swing``."""
    if fields is None:
        return None
    way, swing = fields.inner("path"), fields.inner("swing")
    fields.finish()
    if (way is None) == (swing is None):
        raise SceneError(f"{fields.place} is neither or both; give path or swing")
    if swing is not None:
        motion: Motion = Swing(
            triple(swing.vector("pivot_m", 3)), triple(swing.vector("axis", 3)),
            swing.number("amplitude_rad", low=-math.pi, high=math.pi), swing.number("period_s", low=1e-3),
        )  # fmt: skip
        swing.finish()
        return motion
    assert way is not None
    times = way.numbers("times_s")
    shifts = tuple(triple(one) for one in way.vectors("shifts_m", 3))
    yaws = way.numbers("yaws_rad") if way.get("yaws_rad") is not None else (0.0,) * len(times)
    motion = Way(times, shifts, yaws, triple(way.vector("pivot_m", 3, (0.0, 0.0, 0.0))), way.truth("repeat", False))
    way.finish()
    return motion


def finish_of(fields: Fields | None) -> Finish | None:
    """Read a finish."""
    if fields is None:
        return None
    usual = Finish()
    texture: Any = fields.text("texture", usual.texture)
    names = ("contrast", "cell_m", "specular", "shininess")
    numbers = {name: fields.number(name, getattr(usual, name), 0.0, 1e4) for name in names}
    fields.finish()
    try:
        return Finish(texture, **numbers)
    except SceneError as error:
        raise SceneError(f"{fields.place}: {error}") from None


def triple(values: tuple[float, ...]) -> tuple[float, float, float]:
    """Return three numbers as a point."""
    return values[0], values[1], values[2]


def one_shape(fields: Fields) -> str:
    """Return the name of the one shape that a body is given as."""
    allowed = (*SHAPES, *LOADED)
    given = [name for name in allowed if fields.get(name) is not None]
    if len(given) != 1:
        came = ", ".join(given) or f"of {quoted(', '.join(fields.values))}"
        raise SceneError(f"{fields.place} is {came}; give it as one of {', '.join(allowed)}")
    return given[0]
