"""A shot as messages, topic by topic: what the reconstruction node publishes and reconstruct_bag writes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.cloud_messages import cloud_message, navigation_cloud, organised_cloud
from moire_sensor.ros.image_messages import image_message
from moire_sensor.ros.reconstruction_settings import OutputSettings
from moire_sensor.ros.shot_messages import background_image, depth_camera_info, depth_image, disparity_message
from moire_sensor.shot import Shot, Status

TOPICS: dict[str, Any] = {
    "depth/image_rect": Image,
    "depth/camera_info": CameraInfo,
    "depth/sigma": Image,
    "confidence/image": Image,
    "status/image": Image,
    "fringe_order/image": Image,
    "background/image_rect": Image,
    "points": PointCloud2,
    "points_nav": PointCloud2,
    "disparity": DisparityImage,
}


def result_messages(
    header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings, wanted: Collection[str]
) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of every wanted view of a shot, under one header; the others are not computed."""
    results: dict[str, Callable[[], Any]] = {
        "depth/image_rect": lambda: depth_image(header, shot.depth_m, output.depth_encoding),
        "depth/camera_info": lambda: depth_camera_info(header, sensor.rig),
        "depth/sigma": lambda: image_message(header, shot.depth_sigma_m),
        "confidence/image": lambda: image_message(header, shot.confidence),
        "status/image": lambda: image_message(header, shot.status),
        "fringe_order/image": lambda: image_message(header, shot.fringe_order),
        "background/image_rect": lambda: background_image(header, shot.background),
        "disparity": lambda: disparity_message(header, sensor.rig, shot.disparity_px, sensor.depth_range_m),
    }
    yield from ((topic, make()) for topic, make in results.items() if topic in wanted)
    if "points" in wanted or "points_nav" in wanted:
        yield from cloud_messages(header, sensor, shot, output, wanted)


def cloud_messages(
    header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings, wanted: Collection[str]
) -> Iterator[tuple[str, PointCloud2]]:
    """Yield the wanted clouds, which share their points."""
    cloud = organised_cloud(sensor.rig.points(shot.depth_m), shot.background)
    if "points" in wanted:
        yield "points", cloud_message(header, cloud)
    if "points_nav" in wanted:
        kept = navigation_cloud(cloud, trusted(shot, output), output.nav_voxel_m, output.nav_min_points)
        yield "points_nav", cloud_message(header, kept)


def trusted(shot: Shot, output: OutputSettings) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) whose depth a costmap may take as an obstacle."""
    good = (shot.status == Status.OK) | (shot.status == Status.FROM_SINGLE_SHOT)
    return np.asarray(good & (shot.confidence >= output.nav_min_confidence))
