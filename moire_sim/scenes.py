"""The scenes a head can stand before: files of config/scenes, or the user's own."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

from moire_sensor.resources import resource_path
from moire_sim.errors import SceneError
from moire_sim.meshes import Body, LoadedBody
from moire_sim.scene_file import Scene, SceneFile, robot_scene

# Any of the files tells where all of them are.
FIRST = "flat_board"
FILE_SUFFIXES = (".yaml", ".yml")
ROBOT_SUFFIXES = (".urdf", ".sdf")


def scene_names() -> tuple[str, ...]:
    """Names of the scenes that ship."""
    return tuple(sorted(path.stem for path in scenes_folder().glob("*.yaml")))


def indoor_names() -> tuple[str, ...]:
    """Names of those that go on beyond the default depth range, as rooms do, or move."""
    return tuple(name for name in scene_names() if shipped(name).indoor)


def load_scene(scene: str) -> Scene:
    """Build a scene from its name or file and its options, such as ``"flat_board:distance_m=0.8,slope=0.5"``.

    Raises
    ------
    SceneError
        An unknown scene or option, a value that is no number or outside its range, or a file that is no scene.
    """
    name, options = split_options(scene.strip())
    path = Path(name)
    if path.suffix.lower() in ROBOT_SUFFIXES:
        if options:
            raise SceneError(f"scene {name!r} takes no options; {options!r} was given")
        return robot_scene(path)
    kind = SceneFile.read(path) if "/" in name or path.suffix.lower() in FILE_SUFFIXES else shipped(name)
    values = {key: option.default for key, option in kind.options.items()}
    for item in filter(None, (part.strip() for part in options.split(","))):
        key, value = parsed_option(name, kind, item)
        values[key] = value
    return kind.scene(values)


def scene_bodies(scene: str) -> tuple[Body | LoadedBody, ...]:
    """Return the bodies of a scene; raises as :func:`load_scene`."""
    return load_scene(scene).bodies


def split_options(scene: str) -> tuple[str, str]:
    """Return name or path, and the options after the last colon; a path may have a colon itself."""
    name, colon, options = scene.rpartition(":")
    if not colon or ("/" in options and "=" not in options):
        return scene, ""
    return name, options


def scenes_folder() -> Path:
    """Folder of the scenes that ship."""
    return resource_path(f"config/scenes/{FIRST}.yaml").parent


@lru_cache(maxsize=64)
def shipped(name: str) -> SceneFile:
    """Read a scene that ships; raises SceneError naming those there are."""
    if name not in scene_names():
        raise SceneError(f"unknown scene {name!r}; choose one of {', '.join(scene_names())}, or give a file")
    return SceneFile.read(scenes_folder() / f"{name}.yaml")


def parsed_option(name: str, kind: SceneFile, item: str) -> tuple[str, float]:
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
