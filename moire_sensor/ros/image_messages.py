"""``sensor_msgs/Image`` to and from arrays."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor.errors import ImageError, quoted
from moire_sensor.projection import MAX_SIDE_PX

GreyImage = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
GREY_TYPES: dict[str, np.dtype[Any]] = {"mono8": np.dtype(np.uint8), "mono16": np.dtype(np.uint16)}
# The encodings that this package publishes, by the array's type.
ENCODINGS = {"f4": "32FC1", "u1": "8UC1", "u2": "16UC1", "i2": "16SC1"}
# 64 megapixels of 16 bit: what a node may have to hold of one message, and several of them at once.
MAX_IMAGE_BYTES = 2 * 64 * 1024 * 1024


def fill(data: array[int], values: npt.NDArray[Any]) -> None:
    """Append the bytes of an array to the ``data`` that a message was made with.

    Setting ``data`` would copy all of it once more, or check it element by element.
    """
    if values.size:
        data.frombytes(np.ascontiguousarray(values).data.cast("B"))


def image_message(header: Header, values: npt.NDArray[Any], encoding: str = "") -> Image:
    """Return a message of an image (H, W) of float32, uint8, uint16 or int16; the encoding follows from the type.

    ``encoding`` overrides the name, for example ``"mono8"`` for an intensity image.
    """
    message = Image(header=header, encoding=encoding or ENCODINGS[values.dtype.str[1:]])
    message.height, message.width = values.shape
    message.step = values.shape[1] * values.dtype.itemsize
    message.is_bigendian = int(sys.byteorder == "big")
    fill(message.data, values)
    return message


def grey_image(name: str, message: Image) -> GreyImage:
    """Return the pixels (H, W) of a mono8 or mono16 message; see ``typed_image``."""
    return typed_image(name, message, GREY_TYPES)


def typed_image(name: str, message: Image, types: Mapping[str, np.dtype[Any]]) -> npt.NDArray[Any]:
    """Return the pixels (H, W) of a message in one of the encodings of ``types``; padding and byte order are honoured.

    ``name`` says whose image it is. The array may share the message's memory.

    Raises
    ------
    ImageError
        Another encoding, a size of zero or beyond reason, a step too short, or data of another length.
    """
    pixel = types.get(message.encoding)
    if pixel is None:
        raise ImageError(
            f"the {name} image has encoding {quoted(message.encoding)}; allowed are {' and '.join(types)}: set the "
            "camera to one"
        )
    height, width, step = message.height, message.width, message.step
    if not (1 <= height <= MAX_SIDE_PX and 1 <= width <= MAX_SIDE_PX):
        raise ImageError(f"the {name} image is {width}x{height} pixels; each side must be 1 to {MAX_SIDE_PX}")
    if step * height > MAX_IMAGE_BYTES:
        raise ImageError(f"the {name} image has step {step} times height {height}; at most {MAX_IMAGE_BYTES} bytes")
    if step < width * pixel.itemsize or step % pixel.itemsize:
        raise ImageError(
            f"the {name} image has step {step}; {width} pixels of {message.encoding} need a multiple of "
            f"{pixel.itemsize} of at least {width * pixel.itemsize} bytes"
        )
    if len(message.data) != step * height:
        raise ImageError(
            f"the {name} image has {len(message.data)} bytes of data; step {step} times height {height} is "
            f"{step * height}: the message is truncated or damaged"
        )
    sent = pixel.newbyteorder(">" if message.is_bigendian else "<")
    rows = np.frombuffer(message.data, dtype=sent).reshape(height, -1)[:, :width]
    return rows.astype(pixel, copy=False)
