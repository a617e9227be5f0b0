"""The scenes a head can stand before."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from moire_sensor.paper_rig import REFERENCE_DEPTH_M
from moire_sim.errors import SceneError
from moire_sim.indoor_scenes import corridor_with_boxes, doorway, table_edge
from moire_sim.meshes import Array, Body, board, box, sheet, upright_cylinder

# Wide enough to fill the views at all depths and within the neck's usual turns.
WALL_HALF_SIZE_M = (2.0, 1.5)


@dataclass(frozen=True)
class Option:
    """A number that a scene can be given, with its range."""

    default: float
    low: float
    high: float


@dataclass(frozen=True)
class Scene:
    """A scene's builder, called with its options by name."""

    build: Callable[..., tuple[Body, ...]]
    options: Mapping[str, Option]


def reference_plane() -> Body:
    """The paper's reference plane at 1500 mm."""
    return board(REFERENCE_DEPTH_M, WALL_HALF_SIZE_M, 0.85)


def flat_board(distance_m: float, slope: float) -> tuple[Body, ...]:
    """One board (paper, figure 9); ``slope`` is dz/dx."""
    return (board(distance_m, (1.0, 1.0) if slope else WALL_HALF_SIZE_M, 1.0, slope),)


def board_before_plane(distance_m: float) -> tuple[Body, ...]:
    """A small board before the reference plane (paper, figure 10 b)."""
    return reference_plane(), box((0.03, 0.0, distance_m + 0.005), (0.24, 0.18, 0.01), 1.0)


def convex_cylinder(distance_m: float, radius_m: float) -> tuple[Body, ...]:
    """A convex curved wall before the reference plane (paper, figure 10 d)."""
    return reference_plane(), upright_cylinder(0.047, distance_m + radius_m, radius_m, -1.0, 1.0, 1.0)


def free_form(distance_m: float, amplitude_m: float) -> tuple[Body, ...]:
    """A sine surface (paper, figure 11), with a gentle wave across it."""

    def height(x: Array, y: Array) -> Array:
        across = np.sin(2.0 * math.pi * x / 0.30)
        return np.asarray(distance_m + amplitude_m * (across + 0.4 * np.sin(2.0 * math.pi * y / 0.45)))

    return (sheet(height, (0.6, 0.4), (0.003, 0.004), 1.0),)


def cylinder_and_box() -> tuple[Body, ...]:
    """A cylinder and a box before the reference plane (paper, figure 12)."""
    return (
        reference_plane(),
        upright_cylinder(-0.06, 1.2, 0.08, -0.13, 0.6, 1.0),
        box((0.17, 0.24, 1.15), (0.16, 0.62, 0.16), 0.9, 0.5),
    )


def room() -> tuple[Body, ...]:
    """A corner of a room: two walls, floor, cabinet, stool, table with legs, a thin pole; what a robot meets."""
    left_wall = box((-0.42, 0.0, 1.62), (2.0, 2.0, 0.1), 0.8, 0.45)
    right_wall = box((0.65, 0.0, 1.55), (1.4, 2.0, 0.1), 0.9, -0.70)
    floor = box((0.0, 0.36, 1.4), (2.4, 0.1, 1.8), 0.7)
    cabinet = box((-0.23, 0.16, 1.22), (0.24, 0.40, 0.18), 0.65, 0.45)
    stool = box((0.02, 0.20, 0.90), (0.15, 0.18, 0.14), 0.95, 0.3)
    table = (
        box((0.30, 0.06, 1.18), (0.28, 0.025, 0.22), 0.9, -0.3),
        box((0.20, 0.19, 1.11), (0.03, 0.25, 0.03), 0.75, -0.3),
        box((0.39, 0.19, 1.25), (0.03, 0.25, 0.03), 0.75, -0.3),
    )
    pole = upright_cylinder(0.115, 0.72, 0.010, -1.0, 0.31, 1.0)
    return left_wall, right_wall, floor, cabinet, stool, *table, pole


SCENES: dict[str, Scene] = {
    "flat_board": Scene(flat_board, {"distance_m": Option(1.0, 0.3, 3.0), "slope": Option(0.0, -1.5, 1.5)}),
    "board_before_plane": Scene(board_before_plane, {"distance_m": Option(1.0, 0.4, 1.45)}),
    "convex_cylinder": Scene(
        convex_cylinder, {"distance_m": Option(1.1, 0.5, 1.4), "radius_m": Option(0.2, 0.05, 1.0)}
    ),
    "free_form": Scene(free_form, {"distance_m": Option(1.1, 0.6, 1.5), "amplitude_m": Option(0.04, 0.0, 0.08)}),
    "cylinder_and_box": Scene(cylinder_and_box, {}),
    "room": Scene(room, {}),
    "corridor_with_boxes": Scene(corridor_with_boxes, {"boxes": Option(2.0, 0.0, 2.0)}),
    "doorway": Scene(doorway, {"bin_m": Option(0.3, 0.0, 1.0)}),
    "table_edge": Scene(table_edge, {"distance_m": Option(0.92, 0.6, 1.5)}),
}


def scene_names() -> tuple[str, ...]:
    """Names of the scenes a head can stand before."""
    return tuple(SCENES)


def scene_bodies(scene: str) -> tuple[Body, ...]:
    """Build a scene from its name and options, such as ``"flat_board:distance_m=0.8,slope=0.5"``.

    Raises
    ------
    SceneError
        An unknown scene or option, or a value that is no number or outside its range.
    """
    name, _, options = scene.strip().partition(":")
    if name not in SCENES:
        raise SceneError(f"unknown scene {name!r}; choose one of {', '.join(SCENES)}")
    kind = SCENES[name]
    values = {key: option.default for key, option in kind.options.items()}
    for item in filter(None, (part.strip() for part in options.split(","))):
        key, value = parsed_option(name, kind, item)
        values[key] = value
    return kind.build(**values)


def parsed_option(name: str, kind: Scene, item: str) -> tuple[str, float]:
    """Read one ``key=number``, or raise SceneError saying what the scene takes."""
    key, _, text = (part.strip() for part in item.partition("="))
    allowed = ", ".join(f"{known}={o.low:g}..{o.high:g}" for known, o in kind.options.items()) or "no options"
    if key not in kind.options:
        raise SceneError(f"scene {name!r} has no option {key!r}; it takes {allowed}")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not kind.options[key].low <= value <= kind.options[key].high:
        raise SceneError(f"scene {name!r} was given {key}={text!r}; it takes {allowed}")
    return key, value
