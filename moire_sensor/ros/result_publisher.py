"""The outputs of the reconstruction node; nothing is computed for a topic that nobody listens to."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.cloud_messages import cloud_message, navigation_cloud, organised_cloud
from moire_sensor.ros.image_messages import image_message
from moire_sensor.ros.qos import overridable, publisher_qos
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


class ResultPublisher:
    """Publish a shot on the topics that have subscribers."""

    def __init__(self, node: Any) -> None:
        self._publishers = {
            topic: node.create_publisher(kind, topic, publisher_qos(), qos_overriding_options=overridable())
            for topic, kind in TOPICS.items()
        }

    def wanted(self) -> set[str]:
        """Return the topics that have subscribers now."""
        return {topic for topic, publisher in self._publishers.items() if publisher.get_subscription_count()}

    def publish(self, header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings) -> None:
        """Publish every wanted view of a shot under one header."""
        wanted = self.wanted()
        results = {
            "depth/image_rect": lambda: depth_image(header, shot.depth_m, output.depth_encoding),
            "depth/camera_info": lambda: depth_camera_info(header, sensor.rig),
            "depth/sigma": lambda: image_message(header, shot.depth_sigma_m),
            "confidence/image": lambda: image_message(header, shot.confidence),
            "status/image": lambda: image_message(header, shot.status),
            "fringe_order/image": lambda: image_message(header, shot.fringe_order),
            "background/image_rect": lambda: background_image(header, shot.background),
            "disparity": lambda: disparity_message(header, sensor.rig, shot.disparity_px, sensor.depth_range_m),
        }
        for topic in results.keys() & wanted:
            self._publishers[topic].publish(results[topic]())
        if wanted & {"points", "points_nav"}:
            self._publish_clouds(header, sensor, shot, output, wanted)

    def _publish_clouds(
        self, header: Header, sensor: Reconstructor, shot: Shot, output: OutputSettings, wanted: set[str]
    ) -> None:
        cloud = organised_cloud(sensor.rig.points(shot.depth_m), shot.background)
        if "points" in wanted:
            self._publishers["points"].publish(cloud_message(header, cloud))
        if "points_nav" in wanted:
            kept = navigation_cloud(cloud, trusted(shot, output), output.nav_voxel_m, output.nav_min_points)
            self._publishers["points_nav"].publish(cloud_message(header, kept))


def trusted(shot: Shot, output: OutputSettings) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) whose depth a costmap may take as an obstacle."""
    good = (shot.status == Status.OK) | (shot.status == Status.FROM_SINGLE_SHOT)
    return np.asarray(good & (shot.confidence >= output.nav_min_confidence))
