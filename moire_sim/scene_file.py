"""A scene read from a YAML, URDF or SDF file."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from moire_sensor.errors import quoted
from moire_sim.body_motion import Motion
from moire_sim.errors import SceneError
from moire_sim.meshes import Body, LoadedBody
from moire_sim.scene_fields import Fields
from moire_sim.scene_shapes import SHAPES, WORLD_FROM_FILE, finish_of, loaded_of, motion_of, one_shape
from moire_sim.sdf_file import sdf_bodies

FORMAT = 1
MAX_BYTES = 1_000_000
MAX_BODIES = 1000


@dataclass(frozen=True)
class Option:
    """A number that a scene can be given, with its range."""

    default: float
    low: float
    high: float


@dataclass(frozen=True)
class Scene:
    """What stands before the head.

    Attributes
    ----------
    bodies : all of it, in the world frame (the left optical frame at rest: x right, y down, z forward, metres).
    head_motion : how the head's base moves; None stands still.
    """

    bodies: tuple[Body | LoadedBody, ...]
    head_motion: Motion | None = None

    @cached_property
    def moves(self) -> bool:
        """True where anything moves over time."""
        return self.head_motion is not None or any(body.motion is not None for body in self.bodies)


@dataclass(frozen=True)
class SceneFile:
    """A YAML scene: its content, and the options that it takes."""

    path: Path
    content: Fields
    options: Mapping[str, Option]
    indoor: bool

    @classmethod
    def read(cls, path: Path) -> SceneFile:
        """Read a file; raises SceneError, naming file and place, for one that is no scene."""
        content = Fields.of(f"scene file {path}", parsed(path), {})
        if content.number("format", 0) != FORMAT:
            raise SceneError(f"scene file {path} has format {content.get('format')}; this program reads {FORMAT}")
        content.get("about"), content.get("bodies"), content.get("head")
        options = {}
        declared = content.inner("options")
        for name in declared.values if declared else ():
            assert declared is not None
            one = declared.inner(name)
            if one is None or not name.isidentifier():
                raise SceneError(f"{declared.place}: {quoted(name)} needs default, low and high")
            options[name] = Option(one.number("default"), one.number("low"), one.number("high"))
            one.finish()
        indoor = content.truth("indoor", False)
        content.finish()
        return cls(path, content, options, indoor)

    def scene(self, options: Mapping[str, float]) -> Scene:
        """Build the scene with its options' values."""
        entries = self.content.get("bodies")
        if not isinstance(entries, list) or not 1 <= len(entries) <= MAX_BODIES:
            raise SceneError(f"scene file {self.path} has no list of bodies; give 1 to {MAX_BODIES} of them")
        bodies = [body for number, entry in enumerate(entries, start=1) for body in self._read(number, entry, options)]
        head = self.content.get("head")
        motion = None
        if head is not None:
            fields = Fields.of(f"scene file {self.path}, head", head, options)
            motion = motion_of(fields.inner("motion"))
            fields.finish()
        return Scene(tuple(bodies), motion)

    def _read(self, number: int, entry: Any, options: Mapping[str, float]) -> list[Body | LoadedBody]:
        """Return what an entry puts into the scene: one body, all that an SDF file shows, or nothing."""
        fields = Fields.of(f"scene file {self.path}, body {number}", entry, options)
        shape = one_shape(fields)
        inner = fields.inner(shape)
        assert inner is not None
        albedo = fields.number("albedo", 0.9, 0.0, 1.0)
        present = fields.truth("when", True)
        finish, motion = finish_of(fields.inner("finish")), motion_of(fields.inner("motion"))
        fields.get("name")
        fields.finish()
        if not present:
            return []
        loads = shape not in SHAPES
        body = loaded_of(shape, inner, albedo, self.path.parent) if loads else SHAPES[shape](inner, albedo)
        inner.finish()
        return [dataclasses.replace(one, finish=finish, motion=motion) for one in bodies_of(body)]


def parsed(path: Path) -> Any:
    """Return what a YAML file says, or raise SceneError."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise SceneError(f"scene file {path} is larger than {MAX_BYTES} bytes; keep meshes in files of their own")
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(f"scene file {path} cannot be read: {error.strerror}; check its path") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" near line {mark.line + 1}" if mark else ""
        raise SceneError(f"scene file {path} is no YAML{where}; write bodies as in config/scenes") from None


def robot_scene(path: Path) -> Scene:
    """Scene of one URDF or SDF file, its frame x ahead, y left, z up from the left camera."""
    try:
        root = ET.parse(path).getroot().tag
    except OSError as error:
        raise SceneError(f"scene file {path} cannot be read: {error.strerror}; check its path") from None
    except ET.ParseError as error:
        raise SceneError(f"scene file {path} is no XML ({error}); give a URDF or SDF file") from None
    kind = {"robot": "urdf", "sdf": "sdf"}.get(root)
    if kind is None:
        raise SceneError(f"scene file {path} holds <{root}>; a URDF file holds <robot>, an SDF file <sdf>")
    return Scene(tuple(bodies_of(LoadedBody(kind, path, WORLD_FROM_FILE))))


def bodies_of(body: Body | LoadedBody) -> list[Body | LoadedBody]:
    """Return a body itself, or of an SDF file all that it shows."""
    if isinstance(body, LoadedBody) and body.kind == "sdf":
        return sdf_bodies(body.path, body.pose, body.albedo)
    return [body]
