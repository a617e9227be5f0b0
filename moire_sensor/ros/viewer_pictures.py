"""What the viewer shows of a message: pictures (H, W, 3) and coloured points; no page and no node needed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import Image, PointCloud2, PointField

from moire_sensor.errors import ImageError
from moire_sensor.ros.image_messages import grey_image, typed_image

Picture = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
# Wider pictures are reduced before they are sent to the browser.
MOST_COLUMNS = 640
# Cividis is read alike with and without colour vision. No colour marks the unknown, but stripes.
COLOURS = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_CIVIDIS)[:, 0, ::-1].copy()
STRIPES, STRIPE_PX = np.array([[255, 255, 255], [205, 205, 205]], dtype=np.uint8), 8
DEPTH_TYPES: dict[str, np.dtype[Any]] = {"32FC1": np.dtype(np.float32), "16UC1": np.dtype(np.uint16)}
CONFIDENCE_TYPES: dict[str, np.dtype[Any]] = {"32FC1": np.dtype(np.float32)}
MILLIMETRES = np.float32(1000)  # in a metre
# The automatic scale leaves out this much of either end, and moves in steps, so that noise does not move it.
SPARE_PERCENT, SCALE_STEP_M = 1.0, 0.1


@dataclass(frozen=True)
class Scale:
    """Values of the darkest and the brightest colour."""

    low: float
    high: float

    def colours(self, values: Floats) -> Picture:
        """Return the colours (..., 3) of known values (...)."""
        levels = (values - np.float32(self.low)) * np.float32(255.0 / (self.high - self.low))
        return np.asarray(COLOURS[np.clip(levels, 0, 255).astype(np.uint8)])


def greys(brightness: Floats) -> Picture:
    """Return the grey (N, 3) of brightness (N,), 0 to 255."""
    return np.repeat(np.clip(brightness, 0, 255).astype(np.uint8)[:, None], 3, axis=1)


def depth_scale(depth_m: Floats, near_m: float, far_m: float) -> Scale:
    """Return the scale of depths in metres: as asked for, or where 0 from the known values."""
    known = depth_m[np.isfinite(depth_m)]
    low, high = np.percentile(known, [SPARE_PERCENT, 100 - SPARE_PERCENT]) if known.size else (0.0, 1.0)
    low = near_m or math.floor(low / SCALE_STEP_M) * SCALE_STEP_M
    high = far_m or math.ceil(high / SCALE_STEP_M) * SCALE_STEP_M
    return Scale(low, max(high, low + SCALE_STEP_M))


def known_share(values: Floats) -> float:
    """Return the share of values that are known, 0 to 1."""
    return float(np.isfinite(values).mean())


def depth_of(message: Image) -> Floats:
    """Return depth (H, W) in metres, NaN where unknown, of a 32FC1 or 16UC1 message; raises ImageError."""
    values = typed_image("depth", message, DEPTH_TYPES)
    if values.dtype == np.uint16:
        return np.where(values, values / MILLIMETRES, np.float32(np.nan))
    return values


def confidence_of(message: Image) -> Floats:
    """Return confidence (H, W), 0 to 1, of a 32FC1 message; raises ImageError."""
    return typed_image("confidence", message, CONFIDENCE_TYPES)


def grey_picture(name: str, message: Image) -> Picture:
    """Return the picture of a mono8 or mono16 message, mono16 from the highest bit that it uses; raises ImageError."""
    image = grey_image(name, message)
    if image.dtype == np.uint16:
        image = (image >> max(0, int(image.max()).bit_length() - 8)).astype(np.uint8)
    return np.asarray(cv2.cvtColor(_reduced(np.ascontiguousarray(image)), cv2.COLOR_GRAY2RGB))


def scale_picture(values: Floats, scale: Scale) -> Picture:
    """Return values (H, W) in the colours of a scale, striped where they are not finite."""
    small = _reduced(np.ascontiguousarray(values))
    known = np.isfinite(small)
    picture = scale.colours(np.where(known, small, np.float32(scale.low)))
    rows, columns = np.nonzero(~known)
    picture[rows, columns] = STRIPES[(rows + columns) // STRIPE_PX % 2]
    return picture


def _reduced(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Every n-th pixel, so that no known value is mixed with an unknown one."""
    step = -(-image.shape[1] // MOST_COLUMNS)
    return image[::step, ::step] if step > 1 else image


@dataclass(frozen=True)
class Points:
    """Known points (N, 3) in metres and their brightness (N,), 0 to 255."""

    points_m: Floats
    brightness: Floats


def points_of(message: PointCloud2, most: int) -> Points:
    """Return the known points of a cloud, evenly thinned to ``most`` or fewer.

    Raises
    ------
    ImageError
        No float32 fields x, y and z, or data of another length than the header says.
    """
    cloud = _cloud_view(message)
    if cloud.shape[0] == 1:
        thinned = cloud[0, :: max(1, -(-cloud.size // most))]
    else:
        step = math.ceil(math.sqrt(max(1.0, cloud.size / most)))
        thinned = cloud[::step, ::step].ravel()
    points = np.stack([thinned[name] for name in "xyz"], axis=-1).astype(np.float32, copy=False)
    known = np.isfinite(points).all(axis=-1)
    if "intensity" not in (cloud.dtype.names or ()):
        return Points(points[known], np.full(int(known.sum()), 128, dtype=np.float32))
    return Points(points[known], thinned["intensity"][known].astype(np.float32, copy=False))


def _cloud_view(message: PointCloud2) -> npt.NDArray[np.void]:
    """The cloud (H, W) with its float32 fields by name, in the message's own memory."""
    offsets = {field.name: field.offset for field in message.fields if field.datatype == PointField.FLOAT32}
    height, width, step, row = message.height, message.width, message.point_step, message.row_step
    names = [name for name in ("x", "y", "z", "intensity") if name in offsets]
    if names[:3] != ["x", "y", "z"] or any(offsets[name] + 4 > step for name in names):
        raise ImageError("the cloud needs fields x, y and z of type FLOAT32 within point_step")
    if row < width * step or len(message.data) != row * height:
        raise ImageError(
            f"the cloud has {len(message.data)} bytes of data; {height} rows of {width} points of {step} bytes need "
            f"row_step {width * step} or more, and exactly row_step ({row}) times height"
        )
    if height == 0 or width == 0:
        raise ImageError(f"the cloud is {width}x{height} points; a cloud of no points cannot be shown")
    order = ">" if message.is_bigendian else "<"
    kind = np.dtype(
        {"names": names, "formats": [order + "f4"] * len(names), "offsets": [offsets[name] for name in names],
         "itemsize": step}
    )  # fmt: skip
    return np.ndarray((height, width), kind, buffer=message.data, strides=(row, step))
