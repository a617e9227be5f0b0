"""Depth and albedo of a scene as any device of the head sees it, rendered by pybullet.

This is the one file that imports pybullet.
"""

from __future__ import annotations

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
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT, JointLimit
from moire_sim.meshes import Body, to_obj

Array = npt.NDArray[np.float64]
NEAR_M, FAR_M = 0.2, 10.0
LEFT_OPTICAL_FRAME = "head_left_optical_frame"


@dataclass(frozen=True, eq=False)
class Buffers:
    """What a device sees: z along its optical axis (H, W) float64 in metres, NaN for nothing; albedo 0 to 1."""

    depth_m: Array
    albedo: npt.NDArray[np.float32]


class GeometryRenderer:
    """A pybullet world with the head's URDF and a scene; at rest the left optical frame is the world frame."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        try:
            urdf = str(resource_path("urdf/head.urdf"))
            self._head = pybullet.loadURDF(urdf, useFixedBase=True, physicsClientId=self._client)
            # A link has the number of the joint that carries it.
            self._joints = {info[1].decode(): info[0] for info in self._joint_infos()}
            self._links = {info[12].decode(): info[0] for info in self._joint_infos()}
            self._world_from_base = np.linalg.inv(self._link_pose(LEFT_OPTICAL_FRAME))
            self._place_base()
            for body in bodies:
                self._add(body)
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

    def set_joints(self, pan_rad: float, tilt_rad: float) -> None:
        """Turn the head; limits are the caller's business."""
        for joint, angle in ((PAN_JOINT, pan_rad), (TILT_JOINT, tilt_rad)):
            pybullet.resetJointState(self._head, self._joints[joint], angle, physicsClientId=self._client)

    def frames(self) -> dict[str, Array]:
        """Pose (4, 4) of each link of the URDF in ``head_base_link``."""
        base_from_world = np.linalg.inv(self._world_from_base)
        poses = {name: base_from_world @ self._link_pose(name) for name in self._links}
        return {"head_base_link": np.eye(4), **poses}

    def render(self, view: DeviceView) -> Buffers:
        """Render depth and albedo of a device given relative to the left optical frame."""
        device_from_world = view.device_from_left @ np.linalg.inv(self._link_pose(LEFT_OPTICAL_FRAME))
        width, height = view.size
        _, _, colour, depth, _ = pybullet.getCameraImage(
            width,
            height,
            column_major(np.diag([1.0, -1.0, -1.0, 1.0]) @ device_from_world),
            column_major(clip_from_device(view)),
            lightAmbientCoeff=1.0,
            lightDiffuseCoeff=0.0,
            lightSpecularCoeff=0.0,
            shadow=0,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        # Wheels built without numpy return flat tuples.
        window = np.asarray(depth, dtype=np.float64).reshape(height, width)
        z = FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * window)
        red = np.asarray(colour, dtype=np.uint8).reshape(height, width, 4)[..., 0]
        return Buffers(np.where(window < 1.0 - 1e-6, z, np.nan), (red / 255.0).astype(np.float32))

    def _joint_infos(self) -> list[Any]:
        joints = range(pybullet.getNumJoints(self._head, physicsClientId=self._client))
        return [pybullet.getJointInfo(self._head, joint, physicsClientId=self._client) for joint in joints]

    def _link_pose(self, name: str) -> Array:
        state = pybullet.getLinkState(
            self._head, self._links[name], computeForwardKinematics=True, physicsClientId=self._client
        )
        return as_pose(state[4], state[5])

    def _place_base(self) -> None:
        rotation = np.asarray(self._world_from_base[:3, :3], dtype=np.float64)
        pybullet.resetBasePositionAndOrientation(
            self._head, self._world_from_base[:3, 3].tolist(), quaternion(rotation), physicsClientId=self._client
        )

    def _add(self, body: Body) -> None:
        # Meshes go through files: vertices passed as arguments are limited in number.
        with tempfile.TemporaryDirectory(prefix="moire_scene_") as folder:
            path = Path(folder) / "body.obj"
            path.write_text(to_obj(body), encoding="ascii")
            shape = pybullet.createVisualShape(
                pybullet.GEOM_MESH,
                fileName=str(path),
                rgbaColor=[body.albedo] * 3 + [1.0],
                physicsClientId=self._client,
            )
            pybullet.createMultiBody(baseVisualShapeIndex=shape, physicsClientId=self._client)


def as_pose(position_m: Sequence[float], orientation: Sequence[float]) -> Array:
    """Pose (4, 4) of a position and a quaternion (x, y, z, w)."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(orientation), (3, 3))
    matrix[:3, 3] = position_m
    return matrix


def quaternion(rotation: Array) -> list[float]:
    """Quaternion (x, y, z, w) of a rotation matrix: the eigenvector of the largest eigenvalue (Bar-Itzhack 2000)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    symmetric = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    vector: list[float] = np.linalg.eigh(symmetric)[1][:, -1].tolist()
    return vector


def clip_from_device(view: DeviceView) -> Array:
    """OpenGL projection (4, 4) of a device, for TinyRenderer with pixel centres at integers.

    TinyRenderer samples at whole window coordinates counted from the lower left corner, and image row v is window row
    height - 1 - v: hence no half pixel along a row and a whole one down a column.
    """
    (fx, skew, cx), (_, fy, cy), _ = view.intrinsic.tolist()
    width, height = view.size
    return np.array(
        [
            [2.0 * fx / width, -2.0 * skew / width, 1.0 - 2.0 * cx / width, 0.0],
            [0.0, 2.0 * fy / height, 2.0 * (cy + 1.0) / height - 1.0, 0.0],
            [0.0, 0.0, -(FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )


def column_major(matrix: Array) -> list[float]:
    """Return a matrix as the flat list that OpenGL takes."""
    values: list[float] = matrix.T.ravel().tolist()
    return values
