"""Node ``capture_player``: a file camera that publishes a capture folder on a head's topics."""

from __future__ import annotations

import sys
from typing import Any

from rclpy.node import Node

from moire_sensor.capture_folder import RIG_FILE, Capture, read_capture, read_rig_file
from moire_sensor.errors import CaptureError
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.head_publisher import HeadPublisher
from moire_sensor.ros.parameters import ParameterSpec, declare, help_text, refuse_unknown
from moire_sensor.ros.projector_state import state_of_exposure

USAGE = """
capture_player --ros-args -p folder:=FOLDER [-p rate_hz:=10] [-p loop:=true] [-r __ns:=/head]
Publishes left_NN.png and right_NN.png with rig.yaml of a capture folder, rectified, on the topics of a head.
"""
NAMESPACE = "head"
DELIVERY_S = 5.0
SPECS = (
    ParameterSpec("folder", "", "capture folder: left_NN.png, right_NN.png and rig.yaml", read_only=True),
    ParameterSpec("rate_hz", 10.0, "exposures per second", 0.01, 1000.0, read_only=True),
    ParameterSpec("loop", False, "play again from the start, after a pause, until stopped", read_only=True),
    ParameterSpec(
        "wait_for_subscribers", 1, "subscribers of images and state to wait for first; 0: none", 0, 100, read_only=True
    ),
)


class CapturePlayerNode(Node):  # type: ignore[misc]
    """Publish one frame at each tick; ends after the last one unless looping."""

    def __init__(self) -> None:
        super().__init__("capture_player", namespace=NAMESPACE)
        values = declare(self, SPECS)
        refuse_unknown(self)
        if not values["folder"]:
            raise CaptureError("parameter folder is not set; give the folder of a capture: -p folder:=FOLDER")
        self._capture = read_capture(values["folder"])
        self._loop: bool = values["loop"]
        self._awaited: int = values["wait_for_subscribers"]
        self._next = 0
        self._head = HeadPublisher(self, self._capture.rig, projector_size(self._capture))
        refuse_unknown(self, qos=True)
        self._head.publish_infos(self.get_clock().now().to_msg())
        self.create_timer(1.0 / values["rate_hz"], self._tick)
        self._announce(values)

    def finished(self) -> bool:
        """Tell whether the last frame was played."""
        return not self._loop and self._next >= self._capture.frame_count

    def close(self) -> None:
        """Leave only when the subscribers have what was sent, as far as they take it."""
        if not self._head.wait_until_received(DELIVERY_S):
            self.get_logger().warning("a subscriber did not take everything; it may be too slow for rate_hz")

    def _announce(self, values: dict[str, Any]) -> None:
        capture = self._capture
        near_m, far_m = capture.depth_range_m
        self.get_logger().info(
            f"{capture.frame_count} frames, {capture.pattern.step_count} steps, depth {near_m:g} to {far_m:g} m, "
            f"{'as they are' if capture.pair.left_map is None else 'rectified'}; "
            f"waiting for {values['wait_for_subscribers']} subscribers"
        )

    def _tick(self) -> None:
        if not self._head.has_audience(self._awaited):
            return
        self._awaited = 0
        capture = self._capture
        if self._next < capture.frame_count:
            step = capture.step_index(self._next)
            state = state_of_exposure(capture.pattern, step, depth_range_m=capture.depth_range_m)
            self._head.publish(self.get_clock().now().to_msg(), *capture.frame(self._next), state)
        self._next += 1
        # A pause longer than one programme tells receivers that the last frames and the first do not belong together.
        if self._loop and self._next > capture.frame_count + capture.pattern.step_count:
            self._next = 0


def projector_size(capture: Capture) -> tuple[int, int]:
    """Return (width, height) of the projector: as the rig file says, else like the camera images."""
    width, height = capture.rig.image_size
    content = read_rig_file(capture.folder / RIG_FILE)
    return int(content.get("projector_columns", width)), int(content.get("projector_rows", height))


def main() -> int:
    """Run the node; the console script."""
    return run_node(CapturePlayerNode, USAGE + help_text(SPECS))


if __name__ == "__main__":
    sys.exit(main())
