"""A shot as messages, topic by topic: what the reconstruction node publishes and reconstruct_bag writes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import Any

from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from moire_sensor.nav_cloud import clearing_cloud, obstacle_cloud, supported
from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.cloud_messages import Cloud, cloud_message, organised_cloud
from moire_sensor.ros.image_messages import image_message
from moire_sensor.ros.reconstruction_settings import OutputSettings
from moire_sensor.ros.shot_messages import background_image, depth_camera_info, depth_image, disparity_message
from moire_sensor.shot import Shot

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
    "points_nav_clearing": PointCloud2,
    "disparity": DisparityImage,
}
Makers = dict[str, Callable[[], Any]]
NAV_CLOUDS = ("points_nav", "points_nav_clearing")
CLOUDS = ("points", *NAV_CLOUDS)


def result_messages(
    header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings, wanted: Collection[str]
) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of every wanted view of a shot, under one header; the others are not computed.

    What robots steer by comes first, what takes longest last.
    """
    yield from made(depth_makers(header, sensor, shot, output), wanted)
    cloud = None
    if any(topic in wanted for topic in CLOUDS):
        message, cloud = organised_cloud(header, sensor.rig, shot.depth_m, shot.background)
        if "points" in wanted:
            yield "points", message
    yield from made(image_makers(header, sensor, shot), wanted)
    if cloud is not None and any(topic in wanted for topic in NAV_CLOUDS):
        yield from made(nav_makers(header, sensor, shot, output, cloud), wanted)


def made(makers: Makers, wanted: Collection[str]) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of what is wanted, each made when its turn comes."""
    yield from ((topic, make()) for topic, make in makers.items() if topic in wanted)


def depth_makers(header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings) -> Makers:
    """Return what makes the depth image and its camera info."""
    return {
        "depth/image_rect": lambda: depth_image(header, shot.depth_m, output.depth_encoding),
        "depth/camera_info": lambda: depth_camera_info(header, sensor.rig),
    }


def image_makers(header: Header, sensor: Reconstructor, shot: Shot) -> Makers:
    """Return what makes the other images."""
    return {
        "depth/sigma": lambda: image_message(header, shot.depth_sigma_m),
        "confidence/image": lambda: image_message(header, shot.confidence),
        "status/image": lambda: image_message(header, shot.status),
        "fringe_order/image": lambda: image_message(header, shot.fringe_order),
        "background/image_rect": lambda: background_image(header, shot.background),
        "disparity": lambda: disparity_message(header, sensor.rig, shot.disparity_px, sensor.depth_range_m),
    }


def nav_makers(header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings, cloud: Cloud) -> Makers:
    """Return what makes the clouds for costmaps of ``cloud`` (H, W, 4)."""
    surface = supported(shot.depth_m)
    return {
        "points_nav": lambda: cloud_message(header, obstacle_cloud(sensor.rig, cloud, shot, output.nav, surface)),
        "points_nav_clearing": lambda: cloud_message(header, clearing_cloud(cloud, shot, output.nav, surface)),
    }
