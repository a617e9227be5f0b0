"""The visible shapes of an SDF file, each where its poses put it.

The simulator's own reader takes some poses and leaves others, so this one reads the file: shapes of every link of every
model, the innermost in the frame of what holds it. What it does not know it refuses.
"""

from __future__ import annotations

import dataclasses
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import quoted
from moire_sim.body_motion import turn_about
from moire_sim.errors import SceneError
from moire_sim.meshes import Body, LoadedBody, board, box, capsule, sphere, upright_cylinder
from moire_sim.scene_shapes import MESH_SUFFIXES, placed

Array = npt.NDArray[np.float64]
HOLDERS = ("world", "model", "link", "visual")
# Each puts something into the picture that would be missing.
UNKNOWN = ("include", "actor", "population", "road")
ORIGIN = (0.0, 0.0, 0.0)
# Our upright shapes stand along y, those of SDF along z; our board shows its face to -z, a plane of SDF to z.
ALONG_Z = turn_about(ORIGIN, (1.0, 0.0, 0.0), math.pi / 2.0)


@dataclasses.dataclass(frozen=True)
class Place:
    """An element of the file, with its pose (4, 4) in the file's frame and its name for messages."""

    element: ET.Element
    pose: Array
    name: str

    def numbers(self, path: str, count: int, default: str | None = None) -> list[float]:
        """Numbers of an inner element; SceneError for others than ``count`` finite ones."""
        text = self.element.findtext(path) or default
        return numbers_of(text, count, f"{self.name}: <{path.rpartition('/')[2]}>")

    def length(self, path: str) -> float:
        """One number above 0."""
        (value,) = self.numbers(path, 1)
        if not value > 0.0:
            raise SceneError(f"{self.name}: <{path.rpartition('/')[2]}> is {value:g}; it must be more than 0 m")
        return value


def sdf_bodies(path: Path, pose: Array, albedo: float) -> list[Body | LoadedBody]:
    """Return what an SDF file shows, its frame at ``pose`` (4, 4); ``albedo`` is of what has no diffuse colour.

    Raises
    ------
    SceneError
        No XML, nothing visible, or something in it that this reader does not know.
    """
    try:
        root = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise SceneError(f"{path} is no XML ({error}); give an SDF file") from None
    bodies = [body_of(visual, albedo, path.parent) for visual in visuals(Place(root, pose, str(path)))]
    if not bodies:
        raise SceneError(f"{path} has no model with a link with a visual; there is nothing to see")
    return bodies


def visuals(place: Place) -> Iterator[Place]:
    """All visuals within an element, depth first."""
    for inner in place.element:
        if inner.tag in UNKNOWN:
            raise SceneError(f"{place.name} has <{inner.tag}>, which is not read; put the models into the file itself")
        if inner.tag in HOLDERS:
            name = f"{place.name}, {inner.tag} {quoted(inner.get('name', ''))}"
            if inner.get("placement_frame"):
                raise SceneError(f"{name} has a placement_frame, which is not read; give the model's own pose")
            here = Place(inner, place.pose @ pose_of(inner.find("pose"), name), name)
            yield from (here,) if inner.tag == "visual" else visuals(here)


def pose_of(element: ET.Element | None, name: str) -> Array:
    """Pose (4, 4) of ``x y z roll pitch yaw``, metres and radians, in what holds it; the identity without."""
    if element is None:
        return np.eye(4)
    for attribute, usual in (("relative_to", ""), ("rotation_format", "euler_rpy")):
        if element.get(attribute, usual) not in ("", usual):
            raise SceneError(
                f"{name} has a pose with {attribute} {quoted(element.get(attribute, ''))}, which is not read; give "
                "x y z roll pitch yaw in the frame of what holds it"
            )
    values = numbers_of(element.text, 6, f"{name}: <pose>", zeros=True)
    unit = math.pi / 180.0 if element.get("degrees") in ("true", "1") else 1.0
    return placed((values[0], values[1], values[2]), (values[3] * unit, values[4] * unit, values[5] * unit))


def numbers_of(text: str | None, count: int, name: str, zeros: bool = False) -> list[float]:
    """Return ``count`` finite numbers, or none at all as zeros where that is allowed; SceneError for anything else."""
    words = (text or "").split()
    if zeros and not words:
        return [0.0] * count
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise SceneError(f"{name} is {quoted((text or '').strip())}; give {count} finite number(s)")
    return values


def body_of(visual: Place, albedo: float, folder: Path) -> Body | LoadedBody:
    """Body of a visual, in the world."""
    shapes = visual.element.findall("geometry/*")
    shape = shapes[0].tag if len(shapes) == 1 else "of several kinds, or none"
    if shape not in (*SHAPES, "mesh"):
        known = ", ".join(sorted((*SHAPES, "mesh")))
        raise SceneError(f"{visual.name}: its geometry is {quoted(shape)}; give one of {known}")
    if visual.element.find("material/diffuse") is not None:
        albedo = min(max(visual.numbers("material/diffuse", 4)[0], 0.0), 1.0)
    if shape == "mesh":
        return mesh_of(visual, albedo, folder)
    body = SHAPES[shape](visual, albedo)
    return dataclasses.replace(body, vertices_m=body.vertices_m @ visual.pose[:3, :3].T + visual.pose[:3, 3])


def mesh_of(visual: Place, albedo: float, folder: Path) -> LoadedBody:
    """Body of a mesh beside the file."""
    uri = (visual.element.findtext("geometry/mesh/uri") or "").strip()
    path = folder / uri.removeprefix("file://")
    if "://" in uri.removeprefix("file://") or path.suffix.lower() not in MESH_SUFFIXES or not path.is_file():
        raise SceneError(
            f"{visual.name}: its mesh {quoted(uri)} is not read; give {' or '.join(MESH_SUFFIXES)}, by a path that "
            "begins at the SDF file"
        )
    scale = visual.numbers("geometry/mesh/scale", 3, "1 1 1")
    if not (scale[0] > 0.0 and scale[0] == scale[1] == scale[2]):
        raise SceneError(f"{visual.name}: the scale of its mesh is {scale}; give three times the same, more than 0")
    return LoadedBody("mesh", path, visual.pose, scale[0], albedo)


def box_of(visual: Place, albedo: float) -> Body:
    """Box."""
    x, y, z = visual.numbers("geometry/box/size", 3)
    if not min(x, y, z) > 0.0:
        raise SceneError(f"{visual.name}: <size> is {x:g} {y:g} {z:g}; each must be more than 0 m")
    return box(ORIGIN, (x, y, z), albedo)


def sphere_of(visual: Place, albedo: float) -> Body:
    """Sphere."""
    return sphere(ORIGIN, visual.length("geometry/sphere/radius"), albedo)


def cylinder_of(visual: Place, albedo: float) -> Body:
    """Cylinder along z."""
    half_m = visual.length("geometry/cylinder/length") / 2.0
    return turned(upright_cylinder(0.0, 0.0, visual.length("geometry/cylinder/radius"), -half_m, half_m, albedo))


def capsule_of(visual: Place, albedo: float) -> Body:
    """Capsule along z; its length is that of the cylinder within."""
    radius_m = visual.length("geometry/capsule/radius")
    half_m = visual.length("geometry/capsule/length") / 2.0 + radius_m
    return turned(capsule(0.0, 0.0, radius_m, -half_m, half_m, albedo))


def plane_of(visual: Place, albedo: float) -> Body:
    """Rectangle across z, seen from above."""
    if visual.numbers("geometry/plane/normal", 3, "0 0 1") != [0.0, 0.0, 1.0]:
        raise SceneError(f"{visual.name}: <normal> of a plane must be 0 0 1; turn it by its pose")
    x, y = visual.numbers("geometry/plane/size", 2, "1 1")
    if not min(x, y) > 0.0:
        raise SceneError(f"{visual.name}: <size> is {x:g} {y:g}; each must be more than 0 m")
    return turned(turned(board(0.0, (x / 2.0, y / 2.0), albedo)))


def turned(body: Body) -> Body:
    """Return a body turned from y to z, which takes z to -y."""
    return dataclasses.replace(body, vertices_m=body.vertices_m @ ALONG_Z[:3, :3].T)


SHAPES: dict[str, Callable[[Place, float], Body]] = {
    "box": box_of, "capsule": capsule_of, "cylinder": cylinder_of, "plane": plane_of, "sphere": sphere_of,
}  # fmt: skip
