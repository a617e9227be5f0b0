"""Point clouds of a shot as ``sensor_msgs/PointCloud2``."""

from __future__ import annotations

import sys
from array import array

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from moire_sensor.rig import StereoRig
from moire_sensor.ros.image_messages import byte_array

Cloud = npt.NDArray[np.float32]
FIELDS = ("x", "y", "z", "intensity")
POINT_BYTES = 4 * len(FIELDS)


def organised_cloud(header: Header, rig: StereoRig, depth_m: Cloud, intensity: Cloud) -> tuple[PointCloud2, Cloud]:
    """Return the message of a depth image (H, W) in metres with its grey levels (H, W), and its points (H, W, 4).

    The points, x y z intensity, NaN where unknown, aligned with the image, are to be read only: they are written where
    the message takes them from.
    """
    data = array("B", bytes(1)) * (depth_m.size * POINT_BYTES)
    cloud = np.frombuffer(data, dtype=np.float32).reshape(*depth_m.shape, len(FIELDS))
    rig.points(depth_m, out=cloud[..., :3])
    cloud[..., 3] = intensity
    return message_of(header, cloud, data), cloud


def cloud_message(header: Header, cloud: Cloud) -> PointCloud2:
    """Return the message of x y z intensity (H, W, 4): 16 bytes a point, no padding, ``is_dense`` as it is."""
    return message_of(header, cloud, byte_array(cloud))


def message_of(header: Header, cloud: Cloud, data: array[int]) -> PointCloud2:
    """Return the message of points (H, W, 4) whose bytes are ``data``."""
    height, width = cloud.shape[:2]
    message = PointCloud2(header=header, height=height, width=width)
    message.fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(FIELDS)
    ]
    message.is_bigendian = sys.byteorder == "big"
    message.point_step = POINT_BYTES
    message.row_step = POINT_BYTES * width
    message.is_dense = bool(np.isfinite(cloud).all())
    message.data = data
    return message
