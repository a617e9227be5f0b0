"""What a head publishes for each exposure: images, camera infos and projector state, all with one stamp."""

from __future__ import annotations

import time
from typing import Any

from rclpy.duration import Duration
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header

from moire_sensor.rig import StereoRig
from moire_sensor.ros.camera_messages import FRAMES, camera_infos
from moire_sensor.ros.image_messages import GREY_TYPES, GreyImage, image_message
from moire_sensor.ros.projector_state import ProjectorState, state_message
from moire_sensor.ros.qos import latched_qos, overridable, publisher_qos

# DDS tells a publisher of a subscriber before the subscriber knows of the publisher; what is sent between is lost.
SETTLE_S = 0.5
ENCODING_OF = {pixel: encoding for encoding, pixel in GREY_TYPES.items()}


class HeadPublisher:
    """Publish exposures of a rig on a head's topics.

    ``projector_size`` : (width, height) of the projector's device in pixels, for its camera info. ``frame_prefix``
    stands before the names of all frames; ``lens`` is the distortion of both cameras, in OpenCV's order.
    """

    def __init__(
        self,
        node: Any,
        rig: StereoRig,
        projector_size: tuple[int, int],
        frame_prefix: str = "",
        lens: tuple[float, ...] = (),
    ) -> None:
        self.frames = {device: frame_prefix + frame for device, frame in FRAMES.items()}
        self._info_messages = camera_infos(rig, Header(), projector_size, frame_prefix, lens)
        self._heard_at_s: float | None = None
        self._images = {side: self._publisher(node, Image, f"{side}/image_raw") for side in ("left", "right")}
        self._state = self._publisher(node, JointState, "projector/state")
        self._infos = {
            device: node.create_publisher(
                CameraInfo, f"{device}/camera_info", latched_qos(), qos_overriding_options=overridable()
            )
            for device in FRAMES
        }

    @staticmethod
    def _publisher(node: Any, kind: Any, topic: str) -> Any:
        return node.create_publisher(kind, topic, publisher_qos(), qos_overriding_options=overridable())

    def has_audience(self, awaited: int) -> bool:
        """Tell whether each topic of a set has ``awaited`` subscribers, and has had them long enough to be heard."""
        if awaited and min(one.get_subscription_count() for one in (*self._images.values(), self._state)) < awaited:
            self._heard_at_s = None
            return False
        if self._heard_at_s is None:
            self._heard_at_s = time.monotonic()
        return not awaited or time.monotonic() - self._heard_at_s >= SETTLE_S

    def publish_infos(self, stamp: Any) -> None:
        """Publish the three camera infos; they stay available to those who subscribe later."""
        for device, info in self._info_messages.items():
            info.header.stamp = stamp
            self._infos[device].publish(info)

    def publish(self, stamp: Any, left: GreyImage, right: GreyImage, state: ProjectorState) -> None:
        """Publish one exposure: camera infos and state first, then the images (H, W), uint8 or uint16."""
        self.publish_infos(stamp)
        self._state.publish(state_message(Header(stamp=stamp, frame_id=self.frames["projector"]), state))
        for side, image in (("left", left), ("right", right)):
            header = Header(stamp=stamp, frame_id=self.frames[side])
            self._images[side].publish(image_message(header, image, ENCODING_OF[image.dtype]))

    def wait_until_received(self, seconds: float) -> bool:
        """Wait until each reliable subscriber has everything; False when that takes longer than ``seconds``."""
        patience = Duration(seconds=seconds)
        return all(one.wait_for_all_acked(patience) for one in (*self._images.values(), self._state))
