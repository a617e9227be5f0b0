"""Checks at the door of the sparse and the one-camera method."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import ImageError, SettingsError
from moire_sensor.plain_image import Grey
from moire_sensor.rig import StereoRig

Float32 = npt.NDArray[np.float32]
Image = Grey


def check_numbers(depth_range_m: tuple[float, float], saturation_level: float) -> tuple[float, float]:
    """Return (nearest, farthest), or raise SettingsError."""
    nearest, farthest = (float(depth) for depth in depth_range_m)
    if not (np.isfinite(farthest) and 0.0 < nearest < farthest):
        raise SettingsError(f"depth_range_m is {depth_range_m}; give (nearest, farthest) with 0 < nearest < farthest")
    if not (np.isfinite(saturation_level) and 1.0 <= saturation_level <= 65535.0):
        raise SettingsError(f"saturation_level is {saturation_level}; allowed is 1 to 65535 grey levels")
    return nearest, farthest


def check_image(name: str, image: Image, rig: StereoRig) -> None:
    """Raise ImageError unless the image is (H, W) of the rig, uint8 or uint16."""
    width, height = rig.image_size
    array = np.asarray(image)
    if array.shape != (height, width):
        raise ImageError(f"the {name} image has shape {array.shape}; this method needs one of {(height, width)}")
    if array.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"the {name} image is {array.dtype}; give uint8 or uint16 grey levels")


def as_grey(name: str, image: Image, rig: StereoRig, saturation_level: float) -> Float32:
    """Image as float32 (H, W), grey levels scaled to 255 at saturation, or raise ImageError."""
    check_image(name, image, rig)
    return np.asarray(np.asarray(image).astype(np.float32) * np.float32(255.0 / saturation_level))
