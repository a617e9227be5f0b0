"""Rectification: two cameras anyhow placed become a pair with common rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import ImageError, RigError
from moire_sensor.plain_image import Grey
from moire_sensor.projection import (
    Array,
    as_projection,
    check_image_size,
    check_lens,
    distort_pixels,
    split_projection,
)
from moire_sensor.resample import resample
from moire_sensor.rig import StereoRig

Map = npt.NDArray[np.float32]
Image = Grey
# Cameras turned further than this from each other's row direction or view share too little of the scene.
MAX_TURN_DEG = 45.0


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
            Images of another size than the calibration's, or neither uint8 nor uint16.
        """
        return self._remap("left", left, self.left_map), self._remap("right", right, self.right_map)

    def _remap(self, name: str, image: Image, pixel_map: Map | None) -> Image:
        width, height = self.raw_size
        if image.shape != (height, width):
            raise ImageError(
                f"the {name} image has shape {image.shape}; the calibration is for {(height, width)}: "
                "calibrate at this size or set the camera to it"
            )
        if image.dtype not in (np.uint8, np.uint16):
            raise ImageError(f"the {name} image is {image.dtype}; give uint8 or uint16 grey levels")
        return image if pixel_map is None else resample(image, pixel_map)


def rectify_pair(
    P_left: npt.ArrayLike,
    P_right: npt.ArrayLike,
    P_projector: npt.ArrayLike,
    image_size: tuple[int, int],
    left_distortion: Sequence[float] = (),
    right_distortion: Sequence[float] = (),
    projector_distortion: Sequence[float] = (),
    projector_matrix: npt.ArrayLike | None = None,
    projector_size: tuple[int, int] | None = None,
) -> RectifiedPair:
    """Rectify a pair given by (3, 4) projections in one metric frame and, if any, OpenCV lens coefficients.

    Both virtual cameras look along the mean of the two axes, made square to the baseline; rows agree exactly, columns
    keep each image's own centre, so that little of the view is lost when the principal points differ. The lens of the
    projector is told as for :meth:`StereoRig.from_projections`.

    Raises
    ------
    RigError
        Malformed matrices or lenses, cameras at one place, or a right camera that does not stand to the right of the
        left one, looking the same way.
    """
    size = check_image_size(image_size)
    cameras = [RawCamera.from_projection(*named) for named in (("P_left", P_left), ("P_right", P_right))]
    lenses = [check_lens(*named) for named in (("left camera", left_distortion), ("right camera", right_distortion))]
    rotation = common_rotation(*cameras)
    focal_px = float(np.mean([camera.intrinsic[1, 1] for camera in cameras]))
    centres = [camera.centre_after(rotation, focal_px, size) for camera in cameras]
    row_px = float(np.mean([centre[1] for centre in centres]))
    intrinsics = [np.array([[focal_px, 0, centre[0]], [0, focal_px, row_px], [0, 0, 1.0]]) for centre in centres]
    left, right = (
        intrinsic @ np.hstack([rotation, -rotation @ camera.position[:, None]])
        for intrinsic, camera in zip(intrinsics, cameras, strict=True)
    )
    rig = StereoRig.from_projections(
        left, right, P_projector, size, projector_distortion, projector_matrix, projector_size
    )
    left_map, right_map = (
        camera.raw_map(rotation, intrinsic, lens, size)
        for camera, intrinsic, lens in zip(cameras, intrinsics, lenses, strict=True)
    )
    return RectifiedPair(rig, left_map, right_map, size)


@dataclass(frozen=True, eq=False)
class RawCamera:
    """Intrinsics (3, 3), rotation camera-from-world (3, 3) and position (3,) in metres of a raw camera."""

    intrinsic: Array
    rotation: Array
    position: Array

    @classmethod
    def from_projection(cls, name: str, projection: npt.ArrayLike) -> RawCamera:
        """Split a (3, 4) projection; raises RigError naming a malformed one."""
        return cls(*split_projection(as_projection(name, projection)))

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
        return np.asarray(raw, dtype=np.float32)


def common_rotation(left: RawCamera, right: RawCamera) -> Array:
    """Rotation rectified-from-world (3, 3): x along the baseline, z near the mean of both optical axes."""
    baseline = right.position - left.position
    length_m = float(np.linalg.norm(baseline))
    if length_m < 1e-6:
        raise RigError("both cameras stand at one place; a stereo pair needs a baseline, check P_left and P_right")
    x_axis = baseline / length_m
    for name, camera in (("left", left), ("right", right)):
        turn_deg = angle_deg(camera.rotation[0], x_axis)
        if turn_deg > MAX_TURN_DEG:
            raise RigError(
                f"the way from the left to the right camera is {turn_deg:.0f} degrees off the rows of the {name} one; "
                f"at most {MAX_TURN_DEG:.0f} is allowed: swap left and right if they are swapped, or turn the images"
            )
    if (between_deg := angle_deg(left.rotation[2], right.rotation[2])) > MAX_TURN_DEG:
        raise RigError(
            f"the cameras look {between_deg:.0f} degrees apart; at most {MAX_TURN_DEG:.0f} is allowed: "
            "turn them towards one scene"
        )
    y_axis = np.cross(left.rotation[2] + right.rotation[2], x_axis)
    y_axis /= np.linalg.norm(y_axis)
    return np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)])


def angle_deg(first: Array, second: Array) -> float:
    """Angle between two unit vectors (3,), degrees."""
    return float(np.degrees(np.arccos(np.clip(first @ second, -1.0, 1.0))))
