"""Point clouds of a shot as ``sensor_msgs/PointCloud2``."""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from moire_sensor.rig import StereoRig
from moire_sensor.ros.image_messages import fill

Cloud = npt.NDArray[np.float32]
FIELDS = ("x", "y", "z", "intensity")
POINT_BYTES = 4 * len(FIELDS)


def organised_cloud(header: Header, rig: StereoRig, depth_m: Cloud, intensity: Cloud) -> tuple[PointCloud2, Cloud]:
    """Return the message of a depth image (H, W) in metres with its grey levels (H, W), and its points (H, W, 4).

    The points, x y z intensity, are NaN where unknown and aligned with the image.
    """
    cloud = np.empty((*depth_m.shape, len(FIELDS)), dtype=np.float32)
    rig.points(depth_m, out=cloud[..., :3])
    cloud[..., 3] = intensity
    return cloud_message(header, cloud), cloud


def cloud_message(header: Header, cloud: Cloud) -> PointCloud2:
    """Return the message of x y z intensity (H, W, 4): 16 bytes a point, no padding, ``is_dense`` as it is."""
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
    fill(message.data, cloud)
    return message
