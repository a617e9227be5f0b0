"""Rigs with known truth for the tests of the core."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.rig import StereoRig

Array = npt.NDArray[np.float64]
SIZE = (640, 480)


def intrinsic(fx: float, fy: float, cx: float, cy: float) -> Array:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def rotation(*degrees: float) -> Array:
    """Rotation (3, 3) by a rotation vector in degrees."""
    return np.asarray(cv2.Rodrigues(np.radians(degrees).astype(np.float64))[0], dtype=np.float64)


def projection(K: Array, device_from_world: Array, position: Array) -> Array:
    return K @ np.hstack([device_from_world, -device_from_world @ position[:, None]])


@dataclass(frozen=True)
class World:
    """A rectified rig told in a world frame of its own, with the pose that takes left points there."""

    projections: tuple[Array, Array, Array]
    world_from_left: Array
    baseline_m: float
    right_cx_px: float

    def rig(self) -> StereoRig:
        return StereoRig.from_projections(*self.projections, SIZE)

    def to_world(self, points: Array) -> Array:
        return points @ self.world_from_left[:3, :3].T + self.world_from_left[:3, 3]


def random_world(seed: int) -> World:
    """Cameras with focal lengths and centres of their own, a projector turned and placed at will."""
    rng = np.random.default_rng(seed)
    turn, place = rotation(*rng.uniform(-120, 120, 3)), rng.uniform(-2, 2, 3)
    fx, fy = rng.uniform(500, 2000, 2)
    cx, cy, right_cx = rng.uniform(200, 440), rng.uniform(150, 330), rng.uniform(200, 440)
    baseline_m = rng.uniform(0.03, 0.2)
    projector_turn = rotation(0, 0, rng.uniform(-180, 180)) @ rotation(*rng.uniform(-25, 25, 2), 0)
    projector_place = np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1)])
    devices = (
        (intrinsic(fx, fy, cx, cy), np.eye(3), np.zeros(3)),
        (intrinsic(fx, fy, right_cx, cy), np.eye(3), np.array([baseline_m, 0.0, 0.0])),
        (intrinsic(*rng.uniform(500, 2000, 2), 480, 240), projector_turn, projector_place),
    )
    # turn is left-from-world; a device at c in the left frame stands at place + turn^T c in the world.
    left, right, projector = (projection(K, R @ turn, place + turn.T @ centre) for K, R, centre in devices)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.T, place
    return World((left, right, projector), pose, baseline_m, right_cx)


def seen_points(rng: np.random.Generator, rig: StereoRig, count: int) -> tuple[Array, Array, Array, Array]:
    """Left pixels x, y, their depths, and the points (count, 3) in the left optical frame."""
    x, y = rng.uniform(0, SIZE[0] - 1, count), rng.uniform(0, SIZE[1] - 1, count)
    depth_m = rng.uniform(0.5, 2.0, count)
    rays = np.linalg.solve(rig.P_left[:, :3], np.stack([x, y, np.ones(count)]))
    return x, y, depth_m, (rays * depth_m).T


def pixels(matrix: Array, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 3)."""
    seen = points @ matrix[:, :3].T + matrix[:, 3]
    return seen[:, :2] / seen[:, 2:]
