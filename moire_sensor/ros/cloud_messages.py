"""Point clouds of a shot as ``sensor_msgs/PointCloud2``."""

from __future__ import annotations

import math
import sys

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from moire_sensor.ros.image_messages import byte_array

Cloud = npt.NDArray[np.float32]
FIELDS = ("x", "y", "z", "intensity")
POINT_BYTES = 4 * len(FIELDS)
# A grid of this size is counted directly, five times as fast as sorting the points; a larger one costs memory.
MAX_GRID_CELLS = 4_000_000


def organised_cloud(points_m: Cloud, intensity: Cloud) -> Cloud:
    """Return (H, W, 4) x y z intensity of points (H, W, 3) in metres and intensity (H, W) in grey levels."""
    cloud = np.empty((*points_m.shape[:2], len(FIELDS)), dtype=np.float32)
    cloud[..., :3] = points_m
    cloud[..., 3] = intensity
    return cloud


def navigation_cloud(cloud: Cloud, trusted: npt.NDArray[np.bool_], voxel_m: float, min_points: int) -> Cloud:
    """Return (1, N, 4): the mean of the trusted points in each voxel that holds at least ``min_points`` of them.

    Parameters
    ----------
    cloud : (H, W, 4) float32 x y z intensity, NaN where unknown.
    trusted : (H, W) pixels that may take part; those without a finite point never do.
    voxel_m : edge of a voxel, metres; the grid is fixed to the origin of the optical frame.
    min_points : voxels with fewer points are left out, since a lone point is more likely a flying pixel.
    """
    points = cloud[trusted & np.isfinite(cloud[..., :3]).all(axis=-1)]
    if not len(points):
        return np.empty((1, 0, len(FIELDS)), dtype=np.float32)
    voxel = voxel_numbers(points[:, :3], voxel_m)
    count = np.bincount(voxel)
    kept = count >= min_points
    sums = [np.bincount(voxel, weights=points[:, column])[kept] for column in range(len(FIELDS))]
    return np.asarray(np.stack(sums, axis=-1) / count[kept, None], dtype=np.float32)[None]


def voxel_numbers(points_m: Cloud, voxel_m: float) -> npt.NDArray[np.int64]:
    """Return the number of each point's (N, 3) voxel, counted from 0; not every number need occur."""
    cells = np.floor(points_m / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    sides = cells.max(axis=0) + 1
    numbers: npt.NDArray[np.int64] = (cells[:, 2] * sides[1] + cells[:, 1]) * sides[0] + cells[:, 0]
    if math.prod(sides.tolist()) <= MAX_GRID_CELLS:
        return numbers
    return np.asarray(np.unique(numbers, return_inverse=True)[1])


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
    message.data = byte_array(cloud)
    return message
