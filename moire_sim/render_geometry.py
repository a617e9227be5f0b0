"""Depth and albedo of a scene as any device of the head sees it, rendered by pybullet.

This is the one file that imports pybullet.
"""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet

from moire_sensor.resources import resource_path
from moire_sim.device_view import DeviceView
from moire_sim.errors import SceneError, SimulatorError
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT, JointLimit
from moire_sim.meshes import Body, LoadedBody, to_obj
from moire_sim.moment import Moment
from moire_sim.render_maths import (
    EGL_CENTRE,
    FAR_M,
    NEAR_M,
    TINY_CENTRE,
    clip_from_device,
    column_major,
    quaternion,
)
from moire_sim.scene_file import Scene
from moire_sim.surface_kernels import fill_bodies, fill_depth

Array = npt.NDArray[np.float64]
LEFT_OPTICAL_FRAME = "head_left_optical_frame"
OPENGL_FROM_OPTICAL: Array = np.diag(np.array([1.0, -1.0, -1.0, 1.0]))
ALBEDO_OF_RED = (np.arange(256) / 255.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Buffers:
    """What a device sees: z along its optical axis (H, W) float64 in metres, NaN for nothing; albedo 0 to 1.

    ``body`` (H, W) int32 is the number of the scene's body, -1 for nothing; None where it was not asked for.
    """

    depth_m: Array
    albedo: npt.NDArray[np.float32]
    body: npt.NDArray[np.int32] | None = None


class GeometryRenderer:
    """A pybullet world with the head's URDF and a scene; at rest the left optical frame is the world frame."""

    def __init__(self, scene: Scene, egl: bool = False) -> None:
        self._scene, self._egl = scene, egl
        self._client = pybullet.connect(pybullet.DIRECT)
        try:
            if egl:
                load_egl(self._client)
            urdf = str(resource_path("urdf/head.urdf"))
            self._head = pybullet.loadURDF(urdf, useFixedBase=True, physicsClientId=self._client)
            # A link has the number of the joint that carries it.
            self._joints = {info[1].decode(): info[0] for info in self._joint_infos()}
            self._links = {info[12].decode(): info[0] for info in self._joint_infos()}
            self._world_from_base: Array = np.asarray(np.linalg.inv(self._link_pose(LEFT_OPTICAL_FRAME)), np.float64)
            self._base_at_rest = self._world_from_base
            self._place(self._head, self._world_from_base)
            added = {number: self._add(number + 1, scene.bodies[number]) for number in nearest_first(scene.bodies)}
            self._placed = [placed for _, placed in sorted(added.items())]
            self._poses = [np.eye(4) for _ in scene.bodies]
            albedos = [self._albedo_of(body, one) for body, (one, _) in zip(scene.bodies, self._placed, strict=True)]
            # The last one is of number -1: what is not of the scene.
            self._albedos = np.array([*albedos, 0.0], dtype=np.float32)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Leave the pybullet world; calling it again does nothing."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1

    def joint_limits(self) -> dict[str, JointLimit]:
        """What the URDF allows pan and tilt, by joint name."""
        movable = (info for info in self._joint_infos() if info[2] == pybullet.JOINT_REVOLUTE)
        return {
            info[1].decode(): JointLimit(low_rad=info[8], high_rad=info[9], speed_rad_s=info[11]) for info in movable
        }

    def go_to(self, moment: Moment) -> None:
        """Turn the head, and put its base and all bodies where they are at a time; limits are the caller's business."""
        for joint, angle in ((PAN_JOINT, moment.pan_rad), (TILT_JOINT, moment.tilt_rad)):
            pybullet.resetJointState(self._head, self._joints[joint], angle, physicsClientId=self._client)
        if self._scene.head_motion is not None:
            self._world_from_base = self._scene.head_motion.pose(moment.time_s) @ self._base_at_rest
            self._place(self._head, self._world_from_base)
        for number, (body, placed) in enumerate(zip(self._scene.bodies, self._placed, strict=True)):
            if body.motion is not None:
                self._poses[number] = body.motion.pose(moment.time_s)
                one, at_rest = placed
                self._place(one, self._poses[number] @ at_rest)

    def rest_from_left(self) -> tuple[Array, ...]:
        """For each body, what takes points (4, 4) from the left optical frame to where the body is at rest."""
        world_from_left = self._link_pose(LEFT_OPTICAL_FRAME)
        return tuple(np.linalg.inv(pose) @ world_from_left for pose in self._poses)

    @property
    def world_from_base(self) -> Array:
        """Pose (4, 4) of ``head_base_link`` in the world frame, which is the left optical frame at rest."""
        return self._world_from_base

    def frames(self) -> dict[str, Array]:
        """Pose (4, 4) of each link of the URDF in ``head_base_link``."""
        base_from_world = np.linalg.inv(self._world_from_base)
        poses = {name: base_from_world @ self._link_pose(name) for name in self._links}
        return {"head_base_link": np.eye(4), **poses}

    def render_views(self, views: Sequence[DeviceView], with_bodies: Sequence[bool]) -> list[Buffers]:
        """Render several views of now, each with or without the numbers of the bodies."""
        return [self.render(view, bodies) for view, bodies in zip(views, with_bodies, strict=True)]

    def render(self, view: DeviceView, with_bodies: bool = False) -> Buffers:
        """Render depth and albedo, perhaps bodies too, of a device given relative to the left optical frame."""
        device_from_world = view.device_from_left @ np.linalg.inv(self._link_pose(LEFT_OPTICAL_FRAME))
        width, height = view.size
        _, _, colour, depth, segments = pybullet.getCameraImage(
            width,
            height,
            column_major(OPENGL_FROM_OPTICAL @ device_from_world),
            column_major(clip_from_device(view, EGL_CENTRE if self._egl else TINY_CENTRE)),
            lightAmbientCoeff=1.0,
            lightDiffuseCoeff=0.0,
            lightSpecularCoeff=0.0,
            shadow=0,
            flags=0 if with_bodies or self._egl else pybullet.ER_NO_SEGMENTATION_MASK,
            renderer=pybullet.ER_BULLET_HARDWARE_OPENGL if self._egl else pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        depth_m = np.empty((height, width))
        # Wheels built without numpy return flat tuples.
        fill_depth(np.asarray(depth, dtype=np.float32).ravel(), NEAR_M, FAR_M, depth_m.ravel())
        bodies = self._numbers(segments, depth_m) if with_bodies or self._egl else None
        if self._egl and bodies is not None:
            # This renderer shades whatever it is told; the scene knows its albedos.
            return Buffers(depth_m, self._albedos[bodies], bodies)
        red = np.asarray(colour, dtype=np.uint8).reshape(height, width, 4)[..., 0]
        return Buffers(depth_m, ALBEDO_OF_RED[red], bodies)

    def _numbers(self, segments: Any, depth_m: Array) -> npt.NDArray[np.int32]:
        """Numbers (H, W) of the scene's bodies; the head itself, where it is seen, counts as nothing."""
        number_of = np.full(pybullet.getNumBodies(physicsClientId=self._client), -1, dtype=np.int32)
        for number, (placed, _) in enumerate(self._placed):
            number_of[placed] = number
        bodies = np.empty(depth_m.shape, dtype=np.int32)
        fill_bodies(np.asarray(segments, dtype=np.int32).ravel(), number_of, depth_m.ravel(), bodies.ravel())
        return bodies

    def _albedo_of(self, body: Body | LoadedBody, placed: int) -> float:
        """Albedo 0 to 1 as a picture of 8 bits has it; of what a file colours itself, that of its first visual."""
        if isinstance(body, LoadedBody) and body.kind != "mesh":
            red = pybullet.getVisualShapeData(placed, physicsClientId=self._client)[0][7][0]
        else:
            red = body.albedo
        return int(255.0 * float(red)) / 255.0

    def _joint_infos(self) -> list[Any]:
        joints = range(pybullet.getNumJoints(self._head, physicsClientId=self._client))
        return [pybullet.getJointInfo(self._head, joint, physicsClientId=self._client) for joint in joints]

    def _link_pose(self, name: str) -> Array:
        state = pybullet.getLinkState(
            self._head, self._links[name], computeForwardKinematics=True, physicsClientId=self._client
        )
        return as_pose(state[4], state[5])

    def _place(self, body: int, pose: Array) -> None:
        pybullet.resetBasePositionAndOrientation(
            body, pose[:3, 3].tolist(), quaternion(np.asarray(pose[:3, :3])), physicsClientId=self._client
        )

    def _pose(self, body: int) -> Array:
        return as_pose(*pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client))

    def _add(self, number: int, body: Body | LoadedBody) -> tuple[int, Array]:
        """Add a body of the scene; returns the simulator's number of it, and its pose at rest."""
        if isinstance(body, LoadedBody):
            try:
                placed = self._load(body)
            except pybullet.error as error:
                placed = -1
                reason = f": {error}".rstrip(".")
            else:
                reason = ""
            if placed < 0:
                raise SceneError(
                    f"body {number} of the scene cannot be loaded from {body.path}{reason}; check the file, and the "
                    "meshes that it names"
                )
            pose = body.pose @ self._pose(placed)
            self._place(placed, pose)
            return placed, pose
        # Meshes go through files: vertices passed as arguments are limited in number.
        with tempfile.TemporaryDirectory(prefix="moire_scene_") as folder:
            path = Path(folder) / "body.obj"
            path.write_text(to_obj(body), encoding="ascii")
            return self._add_mesh(path, 1.0, body.albedo), np.eye(4)

    def _load(self, body: LoadedBody) -> int:
        if body.kind == "mesh":
            return self._add_mesh(body.path, body.scale, body.albedo)
        number: int = pybullet.loadURDF(str(body.path), useFixedBase=True, physicsClientId=self._client)
        return number

    def _add_mesh(self, path: Path, scale: float, albedo: float) -> int:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            fileName=str(path),
            meshScale=[scale] * 3,
            rgbaColor=[albedo] * 3 + [1.0],
            physicsClientId=self._client,
        )
        if shape < 0:
            return -1
        body: int = pybullet.createMultiBody(baseVisualShapeIndex=shape, physicsClientId=self._client)
        return body


def nearest_first(bodies: Sequence[Body | LoadedBody]) -> list[int]:
    """Numbers of the bodies in the order to draw: what is hidden by something drawn already is not shaded."""
    away_m = [
        float(body.vertices_m[:, 2].mean()) if isinstance(body, Body) else float(body.pose[2, 3]) for body in bodies
    ]
    return sorted(range(len(bodies)), key=away_m.__getitem__)


def as_pose(position_m: Sequence[float], orientation: Sequence[float]) -> Array:
    """Pose (4, 4) of a position and a quaternion (x, y, z, w)."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(orientation), (3, 3))
    matrix[:3, 3] = position_m
    return matrix


def load_egl(client: int) -> None:
    """Let a world render by EGL, or raise SimulatorError; without a driver the plug-in may end the process."""
    plugin = importlib.util.find_spec("eglRenderer")
    if plugin is None or pybullet.loadPlugin(plugin.origin, "_eglRendererPlugin", physicsClientId=client) < 0:
        raise SimulatorError("pybullet's EGL renderer cannot be loaded here; use renderer tiny")


def egl_depth_m() -> float:
    """Depth that EGL gives a wall at 1 m: a try in a process of its own, which a machine without EGL may end."""
    from moire_sensor.paper_rig import paper_rig
    from moire_sim.scenes import load_scene

    rig = paper_rig()
    renderer = GeometryRenderer(load_scene("flat_board"), egl=True)
    try:
        return float(np.median(renderer.render(DeviceView.of(rig.P_left, rig.image_size)).depth_m))
    finally:
        renderer.close()
