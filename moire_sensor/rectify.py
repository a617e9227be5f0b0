"""Rectification: two cameras anyhow placed become a pair with common rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.errors import ImageError, RigError
from moire_sensor.rig import Array, StereoRig, as_projection, check_image_size, distort_pixels, intrinsic_matrix

Map = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """A rectified rig and the maps that bring raw images there.

    Attributes
    ----------
    rig : the rectified rig.
    left_map, right_map : (H, W, 2) float32, raw (column, row) of every rectified pixel; None leaves images as they are.
    raw_size : (width, height) of the raw images.
    """

    rig: StereoRig
    left_map: Map | None
    right_map: Map | None
    raw_size: tuple[int, int]

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Return the rectified images (H, W) of raw ones, same dtype; pixels that no camera saw are 0.

        Raises
        ------
        ImageError
            Images of another size than the calibration's.
        """
        return self._remap("left", left, self.left_map), self._remap("right", right, self.right_map)

    def _remap(self, name: str, image: Image, pixel_map: Map | None) -> Image:
        width, height = self.raw_size
        if image.shape != (height, width):
            raise ImageError(
                f"the {name} image has shape {image.shape}; the calibration is for {(height, width)}: "
                "calibrate at this size or set the camera to it"
            )
        if pixel_map is None:
            return image
        return cv2.remap(image, pixel_map, None, cv2.INTER_CUBIC)  # type: ignore[return-value]


def rectify_pair(
    P_left: npt.ArrayLike,
    P_right: npt.ArrayLike,
    P_projector: npt.ArrayLike,
    image_size: tuple[int, int],
    left_distortion: Sequence[float] = (),
    right_distortion: Sequence[float] = (),
) -> RectifiedPair:
    """Rectify a pair given by (3, 4) projections in one metric frame and, if any, OpenCV lens coefficients.

    Both virtual cameras look along the mean of the two axes, made square to the baseline; rows agree exactly, columns
    keep each image's own centre, so that little of the view is lost when the principal points differ.

    Raises
    ------
    RigError
        Malformed matrices, cameras at one place, or a right camera to the left of the left one.
    """
    size = check_image_size(image_size)
    cameras = [RawCamera.from_projection(*named) for named in (("P_left", P_left), ("P_right", P_right))]
    rotation = common_rotation(*cameras)
    focal_px = float(np.mean([camera.intrinsic[1, 1] for camera in cameras]))
    centres = [camera.centre_after(rotation, focal_px, size) for camera in cameras]
    row_px = float(np.mean([centre[1] for centre in centres]))
    intrinsics = [np.array([[focal_px, 0, centre[0]], [0, focal_px, row_px], [0, 0, 1.0]]) for centre in centres]
    projections = [
        intrinsic @ np.hstack([rotation, -rotation @ camera.position[:, None]])
        for intrinsic, camera in zip(intrinsics, cameras, strict=True)
    ]
    rig = StereoRig.from_projections(*projections, as_projection("P_projector", P_projector), size)
    maps = [
        camera.raw_map(rotation, intrinsic, lens, size)
        for camera, intrinsic, lens in zip(cameras, intrinsics, (left_distortion, right_distortion), strict=True)
    ]
    return RectifiedPair(rig, maps[0], maps[1], size)


@dataclass(frozen=True, eq=False)
class RawCamera:
    """Intrinsics (3, 3), rotation camera-from-world (3, 3) and position (3,) in metres of a raw camera."""

    intrinsic: Array
    rotation: Array
    position: Array

    @classmethod
    def from_projection(cls, name: str, projection: npt.ArrayLike) -> RawCamera:
        """Split a (3, 4) projection; raises RigError naming a malformed one."""
        matrix = as_projection(name, projection)
        _, rotation, centre, *_ = cv2.decomposeProjectionMatrix(matrix)
        return cls(intrinsic_matrix(matrix), np.asarray(rotation), (centre[:3] / centre[3]).ravel())

    def centre_after(self, rotation: Array, focal_px: float, size: tuple[int, int]) -> Array:
        """Principal point (column, row) that keeps the middle of the raw image in the middle."""
        middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
        ray = rotation @ self.rotation.T @ np.linalg.solve(self.intrinsic, [*middle, 1.0])
        return np.asarray(middle - focal_px * ray[:2] / ray[2])

    def raw_map(self, rotation: Array, intrinsic: Array, lens: Sequence[float], size: tuple[int, int]) -> Map:
        """Raw pixel (column, row), (H, W, 2) float32, of every rectified pixel."""
        columns, rows = np.meshgrid(np.arange(size[0], dtype=np.float64), np.arange(size[1], dtype=np.float64))
        pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
        to_raw = self.intrinsic @ self.rotation @ rotation.T @ np.linalg.inv(intrinsic)
        raw = pixels @ to_raw.T
        raw = raw[..., :2] / raw[..., 2:]
        if any(lens):
            raw = distort_pixels(raw, self.intrinsic, lens)
        return raw.astype(np.float32)


def common_rotation(left: RawCamera, right: RawCamera) -> Array:
    """Rotation rectified-from-world (3, 3): x along the baseline, z near the mean of both optical axes."""
    baseline = right.position - left.position
    length_m = float(np.linalg.norm(baseline))
    if length_m < 1e-6:
        raise RigError("both cameras stand at one place; a stereo pair needs a baseline, check P_left and P_right")
    x_axis = baseline / length_m
    if x_axis @ (left.rotation[0] + right.rotation[0]) <= 0.0:
        raise RigError("the right camera lies to the left of the left camera; swap left and right")
    forward = left.rotation[2] + right.rotation[2]
    y_axis = np.cross(forward, x_axis)
    y_axis /= np.linalg.norm(y_axis)
    return np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)])
