"""Raw images of two turned cameras with lenses, and of a turned projector with one, before a slanted plane.

The way of the light is followed backwards with OpenCV's lens, ray by ray; nothing of this package is used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

Array = npt.NDArray[np.float64]
WIDTH, HEIGHT = 640, 480
PROJECTOR_SIZE = (960, 480)
BASELINE_M, PROJECTOR_OFFSET_M = 0.094, 0.053
PERIOD_PX = 16.0
# The plane z = PLANE_M + slope . (x, y), in the rectified left frame.
PLANE_M, SLOPE = 1.0, np.array([0.25, 0.1])
NOISE = 1.5
# Each round of undoing a lens this weak leaves a tenth of the error: 1e-9 pixels after twelve.
LENS_ROUNDS = 12


def turn(*degrees: float) -> Array:
    """Rotation by a vector of degrees about x, y and z."""
    return np.asarray(cv2.Rodrigues(np.radians(np.array(degrees)))[0])


def homogeneous(plane: Array) -> Array:
    """Append a 1 to each (x, y)."""
    return np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)


@dataclass(frozen=True)
class RawCamera:
    """What a stereo calibration tells of one camera; ``offset_m`` along the rectified x axis."""

    K: Array
    D: Array
    R: Array
    offset_m: float

    def info(self, P: Array) -> CameraInfo:
        """The camera info, with the P of the rectified pair."""
        info = CameraInfo(header=Header(frame_id="stereo_camera"), width=WIDTH, height=HEIGHT)
        info.distortion_model, info.d = "plumb_bob", self.D.tolist()
        info.k, info.r, info.p = self.K.ravel().tolist(), self.R.ravel().tolist(), P.ravel().tolist()
        return info

    def points_m(self) -> Array:
        """Points (H, W, 3) of the plane that the raw pixels see, in the rectified left frame."""
        columns, rows = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
        pixels = np.stack([columns, rows], axis=-1)
        ray = np.zeros((HEIGHT, WIDTH, 2))
        for _ in range(LENS_ROUNDS):
            seen = cv2.projectPoints(homogeneous(ray).reshape(-1, 3), np.zeros(3), np.zeros(3), self.K, self.D)[0]
            ray += (pixels - seen.reshape(ray.shape)) / self.K[[0, 1], [0, 1]]
        direction = homogeneous(ray) @ self.R.T
        start = np.array([self.offset_m, 0.0, 0.0])
        reach = (PLANE_M + SLOPE @ start[:2]) / (direction[..., 2] - direction[..., :2] @ SLOPE)
        return np.asarray(start + direction * reach[..., None])


P_LEFT = np.array([[1245.0, 0.0, 318.0, 0.0], [0.0, 1245.0, 236.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
P_RIGHT = P_LEFT + np.array([[0.0, 0.0, 0.0, -1245.0 * BASELINE_M], [0.0] * 4, [0.0] * 4])
CAMERAS = {
    "left": RawCamera(
        np.array([[1251.0, 0.0, 322.0], [0.0, 1249.0, 231.0], [0.0, 0.0, 1.0]]),
        np.array([-0.11, 0.14, 0.0007, -0.0005, 0.0]), turn(0.6, -1.4, 1.1), 0.0,
    ),
    "right": RawCamera(
        np.array([[1243.0, 0.0, 315.0], [0.0, 1246.0, 244.0], [0.0, 0.0, 1.0]]),
        np.array([-0.09, 0.10, -0.0004, 0.0006, 0.0]), turn(-0.8, 1.7, -0.9), BASELINE_M,
    ),
}  # fmt: skip
PROJECTOR_K = np.array([[1250.0, 0.0, 480.0], [0.0, 1250.0, 240.0], [0.0, 0.0, 1.0]])
PROJECTOR_D = np.array([0.04, -0.05, 0.0003, 0.0002, 0.0])
PROJECTOR_R = turn(0.5, 0.8, -0.3)
PROJECTOR_T = PROJECTOR_R @ np.array([-PROJECTOR_OFFSET_M, 0.0, 0.0])


def infos() -> dict[str, CameraInfo]:
    """The three camera infos; the projector's P is the whole map from the rectified left frame to its pixels."""
    projector = CameraInfo(header=Header(frame_id="projector"), width=PROJECTOR_SIZE[0], height=PROJECTOR_SIZE[1])
    projector.distortion_model, projector.d = "plumb_bob", PROJECTOR_D.tolist()
    projector.k, projector.r = PROJECTOR_K.ravel().tolist(), np.eye(3).ravel().tolist()
    projector.p = (PROJECTOR_K @ np.hstack([PROJECTOR_R, PROJECTOR_T[:, None]])).ravel().tolist()
    return {
        "left": CAMERAS["left"].info(P_LEFT),
        "right": CAMERAS["right"].info(P_RIGHT),
        "projector": projector,
    }


@cache
def fringe_phase_rad(camera: str) -> Array:
    """Phase (H, W) of the pattern at rest at the point that each raw pixel of a camera sees."""
    points = CAMERAS[camera].points_m().reshape(-1, 3)
    rotation = cv2.Rodrigues(PROJECTOR_R)[0]
    columns = cv2.projectPoints(points, rotation, PROJECTOR_T, PROJECTOR_K, PROJECTOR_D)[0].reshape(HEIGHT, WIDTH, 2)
    return np.asarray(2.0 * math.pi * columns[..., 0] / PERIOD_PX)


def raw_image(camera: str, phase_rad: float, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """What a camera sees of the fringes, 20 + 80 + 70 cos, with noise."""
    grey = 100.0 + 70.0 * np.cos(fringe_phase_rad(camera) + phase_rad)
    return np.asarray(np.rint(grey + rng.normal(0.0, NOISE, grey.shape)).clip(0, 255).astype(np.uint8))


def rectified(camera: str, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """The image as image_proc rectifies it: OpenCV's maps, bilinear."""
    raw, P = CAMERAS[camera], P_LEFT if camera == "left" else P_RIGHT
    maps = cv2.initUndistortRectifyMap(raw.K, raw.D, raw.R, P[:, :3], (WIDTH, HEIGHT), cv2.CV_32FC1)
    return np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR))


def true_points_m() -> Array:
    """Points (H, W, 3) of the plane that the rectified left pixels see."""
    columns, rows = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    x, y = (columns - P_LEFT[0, 2]) / P_LEFT[0, 0], (rows - P_LEFT[1, 2]) / P_LEFT[1, 1]
    return homogeneous(np.stack([x, y], axis=-1)) * (PLANE_M / (1.0 - SLOPE[0] * x - SLOPE[1] * y))[..., None]


def in_view(margin_px: float) -> npt.NDArray[np.bool_]:
    """Rectified left pixels (H, W) whose point lies inside both raw images and the projector's, by a margin."""
    points = true_points_m().reshape(-1, 3)
    devices = [
        (cv2.Rodrigues(raw.R.T)[0], raw.R.T @ [-raw.offset_m, 0.0, 0.0], raw.K, raw.D, (WIDTH, HEIGHT))
        for raw in CAMERAS.values()
    ]
    devices.append((cv2.Rodrigues(PROJECTOR_R)[0], PROJECTOR_T, PROJECTOR_K, PROJECTOR_D, PROJECTOR_SIZE))
    inside = np.ones((HEIGHT, WIDTH), dtype=bool)
    for rotation, translation, K, D, size in devices:
        pixels = cv2.projectPoints(points, rotation, translation, K, D)[0].reshape(HEIGHT, WIDTH, 2)
        inside &= ((pixels >= margin_px) & (pixels <= np.array(size) - 1 - margin_px)).all(axis=-1)
    return inside
