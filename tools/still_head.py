"""A head that shows pictures made once, at any size and rate; it costs next to nothing, so that what is measured beside
it is the reconstruction.

    .venv/bin/python -m tools.still_head --ros-args -p scale:=0.5 -p rate_hz:=30.0 -p exposures:=900 -p ahead:=30

With ``ahead`` it waits for results: so many exposures may be under way, and no queue on the way runs over on a machine
that cannot keep up with ``rate_hz``. With ``rate_hz`` 0 each result brings the next exposure.
"""

from __future__ import annotations

import sys

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.head_publisher import HeadPublisher
from moire_sensor.ros.image_messages import GreyImage
from moire_sensor.ros.parameters import ParameterSpec, declare
from moire_sensor.ros.projector_state import state_of_exposure
from moire_sensor.ros.qos import RELIABLE_INPUT_DEPTH
from moire_sim import HeadOptions, VirtualHead
from tools.bench.speed import scaled_projector, scaled_rig, size_at

# Exposures that differ by their noise, shown in turn.
PICTURES = 8
ACKNOWLEDGED = QoSProfile(depth=1000)
# With rate 0: how often it looks whether those that it waits for are there.
LOOK_S = 0.1
SPECS = (
    ParameterSpec("scene", "flat_board:distance_m=0.9", "scene of the pictures", read_only=True),
    ParameterSpec("scale", 1.0, "size of the images, times 640x480", 0.1, 4.0, read_only=True),
    ParameterSpec("rate_hz", 30.0, "exposures per second; 0: as results come", 0.0, 1000.0, read_only=True),
    ParameterSpec("exposures", 0, "exposures to make, then idle; 0: no end", 0, 2**31 - 1, read_only=True),
    ParameterSpec("ahead", RELIABLE_INPUT_DEPTH, "exposures without a result at most; 0: any", 0, 1000, read_only=True),
    ParameterSpec("wait_for_subscribers", 1, "subscribers to wait for first", 0, 100, read_only=True),
)


class StillHead(Node):  # type: ignore[misc]
    """Publish one of the pictures at each tick, unless too many are under way."""

    def __init__(self) -> None:
        super().__init__("still_head", namespace="head")
        values = declare(self, SPECS)
        scale: float = values["scale"]
        # Fringes of the same width in pixels at every size.
        self._pattern = paper_pattern()
        self._pictures = pictures(values["scene"], scale)
        self._awaited: int = values["wait_for_subscribers"]
        self._exposures: int = values["exposures"]
        self._ahead: int = values["ahead"]
        self._sent = self._results = 0
        self._head = HeadPublisher(self, scaled_rig(size_at(scale)), scaled_projector(size_at(scale)))
        # The smallest message of a result.
        self.create_subscription(CameraInfo, "depth/camera_info", self._on_result, ACKNOWLEDGED)
        self._follows_results: bool = not values["rate_hz"]
        if self._follows_results and not self._ahead:
            raise SettingsError("with rate_hz 0, ahead must be 1 or more")
        self.create_timer(LOOK_S if self._follows_results else 1.0 / values["rate_hz"], self._tick)

    def _on_result(self, _: CameraInfo) -> None:
        self._results += 1
        if self._follows_results:
            self._tick()

    def _tick(self) -> None:
        if not self._head.has_audience(self._awaited):
            return
        self._awaited = 0
        while self._may_expose():
            self._expose()
            if not self._follows_results:
                return

    def _may_expose(self) -> bool:
        all_sent = self._exposures and self._sent >= self._exposures
        return not all_sent and not (self._ahead and self._sent - self._results >= self._ahead)

    def _expose(self) -> None:
        state = state_of_exposure(self._pattern, 0)
        self._head.publish(self.get_clock().now().to_msg(), *self._pictures[self._sent % PICTURES], state)
        self._sent += 1


def pictures(scene: str, scale: float) -> list[tuple[GreyImage, GreyImage]]:
    """Return left and right image (H, W) of some exposures of a scene."""
    options = HeadOptions(projector_size=scaled_projector(size_at(scale)))
    with VirtualHead(scene, rig=scaled_rig(size_at(scale)), options=options) as head:
        return [head.expose(paper_pattern(), 0, number) for number in range(PICTURES)]


if __name__ == "__main__":
    sys.exit(run_node(StillHead, __doc__ or ""))
