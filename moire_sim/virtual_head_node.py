"""Node ``virtual_head``: the simulated head on the topics of a real one."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from moire_sensor.errors import MoireError
from moire_sensor.paper_rig import PROJECTOR_SIZE
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_steps import needed_frames
from moire_sensor.resources import resource_path
from moire_sensor.ros.diagnostics import DiagnosticsPublisher
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.head_publisher import HeadPublisher
from moire_sensor.ros.image_messages import image_message
from moire_sensor.ros.parameters import ParameterSpec, changed_values, declare, help_text, refuse_unknown
from moire_sensor.ros.projector_state import state_of_exposure
from moire_sensor.ros.qos import latched_qos, overridable, publisher_qos
from moire_sim.exposure_rate import ExposureRate
from moire_sim.fringe_programme import FringeProgramme
from moire_sim.turns import NANOSECONDS, seconds_to_turn
from moire_sim.virtual_head import VirtualHead
from moire_sim.virtual_head_joints import BasePose, HeadJoints
from moire_sim.virtual_head_parameters import (
    FRINGE_SPECS,
    PRESET_SPEC,
    PROCESSES_SPEC,
    RENDERER_SPEC,
    optics_specs,
    options_of,
    patterns_of,
)
from moire_sim.virtual_head_status import exposure_status

USAGE = """
virtual_head --ros-args [-p scene:=flat_board] [-p rate_hz:=10] [-p seed:=0] [-p phase_steps:=1] [-r __ns:=/head]
A simulated head with two cameras and a fringe projector before a scene.
"""
NAMESPACE = "head"
DIAGNOSTICS_PERIOD_S = 1.0
SLOW_NEWS_S = 30.0
# The next exposure of a still scene is made ready so late in the period, when the work on the last one is mostly done.
READY_SHARE = 0.75
HEAD_SPECS = (
    ParameterSpec(
        "scene",
        "flat_board",
        "name, or path of a YAML, URDF or SDF file; options after a colon: flat_board:distance_m=0.8",
        read_only=True,
    ),
    ParameterSpec("rate_hz", 10.0, "exposures per second; 0: only by the service capture", 0.0, 200.0, read_only=True),
    ParameterSpec("seed", 0, "of the camera noise", 0, 2**31 - 1, read_only=True),
    ParameterSpec("pan_rad", 0.0, "turn of the head, positive to the left, rad", -3.15, 3.15, read_only=True),
    ParameterSpec("tilt_rad", 0.0, "nod of the head, positive down, rad", -3.15, 3.15, read_only=True),
    ParameterSpec(
        "start_offset",
        0.0,
        "share of the period by which exposures follow its whole multiples on the clock, so that "
        "heads take turns: 0 and 0.5 for two",
        0.0,
        1.0,
        read_only=True,
    ),
    ParameterSpec("frame_prefix", "", "put before the names of all frames, for several heads: left/", read_only=True),
    ParameterSpec("frames", 0, "exposures to make, then idle; 0: no end", 0, 2**31 - 1, read_only=True),
    ParameterSpec(
        "wait_for_subscribers", 0, "subscribers of images and state to wait for first; 0: none", 0, 100, read_only=True
    ),
)
SPECS = (*HEAD_SPECS, *FRINGE_SPECS, PRESET_SPEC, RENDERER_SPEC, PROCESSES_SPEC, *optics_specs())


class VirtualHeadNode(Node):  # type: ignore[misc]
    """Make an exposure at each tick; the stamp is taken when the exposure starts.

    ``others`` are parameters of other nodes of the process.
    """

    def __init__(self, others: Collection[str] = ()) -> None:
        super().__init__("virtual_head", namespace=NAMESPACE)
        values = declare(self, (*HEAD_SPECS, *FRINGE_SPECS, PRESET_SPEC, RENDERER_SPEC, PROCESSES_SPEC))
        values |= declare(self, optics_specs(values["optics"]))
        refuse_unknown(self, others=others)
        self._values = values
        self._programme = FringeProgramme(patterns_of(values))
        self._head = open_head(values)
        self._exposures = 0
        self._rate = ExposureRate(values["rate_hz"])
        self._scene_start_ns: int | None = None
        self._laser_on = True
        self._awaited: int = values["wait_for_subscribers"]
        self._publisher = HeadPublisher(
            self, self._head.rig, PROJECTOR_SIZE, values["frame_prefix"], self._head.options.optics.lens
        )
        self._joints = HeadJoints(self, self._head)
        self._truth = self.create_publisher(
            Image, "ground_truth/depth", publisher_qos(), qos_overriding_options=overridable()
        )
        self._base = BasePose(self, self._head, values["frame_prefix"])
        self._diagnostics = DiagnosticsPublisher(self)
        self._describe_robot()
        refuse_unknown(self, qos=True)
        self.create_service(SetBool, "projector/enable", self._enable_projector)
        self.create_service(Trigger, "capture", self._capture_once)
        self._expose_first()
        self.add_on_set_parameters_callback(self._change_fringes)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._diagnose)
        if values["rate_hz"] > 0.0:
            now_ns = self.get_clock().now().nanoseconds
            wait_s = seconds_to_turn(now_ns, values["rate_hz"], values["start_offset"])
            self._first_turn = self.create_timer(wait_s, self._begin_turns)
        self.get_logger().info(
            f"ready: scene {values['scene']}, {values['rate_hz']:g} Hz, {values['phase_steps']} step(s), "
            f"optics {values['optics']}, rendered by {'EGL' if self._head.uses_egl else 'TinyRenderer'}, "
            f"with up to {self._head.render_processes} processes where something moves"
        )

    def close(self) -> None:
        """Leave the simulator."""
        self._head.close()

    def _describe_robot(self) -> None:
        """Publish the URDF; robot_state_publisher makes the TF from it and the joint states."""
        self._description = self.create_publisher(
            String, "robot_description", latched_qos(), qos_overriding_options=overridable()
        )
        self._description.publish(String(data=resource_path("urdf/head.urdf").read_text()))

    def _expose_first(self) -> None:
        """Render every picture once, so that the stream does not start with a pause; nothing is published."""
        for pattern in self._programme.patterns:
            for step in range(pattern.step_count):
                self._head.expose(pattern, step)

    def _begin_turns(self) -> None:
        """At the first turn: expose at each one from now on."""
        self.destroy_timer(self._first_turn)
        self._getting_ready = self.create_timer(READY_SHARE / self._values["rate_hz"], self._get_ready)
        self.create_timer(1.0 / self._values["rate_hz"], self._tick)
        self._tick()

    def _tick(self) -> None:
        if not self._publisher.has_audience(self._awaited):
            return
        self._awaited = 0
        if not self._values["frames"] or self._exposures < self._values["frames"]:
            self._rate.note(time.monotonic())
            self._expose()
            self._getting_ready.reset()

    def _get_ready(self) -> None:
        """Make the next exposure before its time, as a camera's chip is ready for its; once for each tick."""
        self._getting_ready.cancel()
        pattern, step = self._programme.upcoming
        self._head.prepare(self._shown(pattern), step, self._exposures)

    def _shown(self, pattern: FringePattern) -> FringePattern | None:
        return pattern if self._laser_on else None

    def _expose(self) -> None:
        """Make the next exposure and publish everything that belongs to it with its stamp."""
        now = self.get_clock().now()
        stamp = now.to_msg()
        self._head.set_time(self._scene_time_s(now.nanoseconds))
        self._joints.turn(now)
        self._base.publish(stamp)
        pattern, step = self._programme.next()
        left, right = self._head.expose(self._shown(pattern), step, self._exposures, self._joints.after(now))
        self._exposures += 1
        self._publisher.publish(stamp, left, right, state_of_exposure(pattern, step, self._laser_on))
        if self._truth.get_subscription_count():
            self._truth.publish(
                image_message(Header(stamp=stamp, frame_id=self._publisher.frames["left"]), self._head.depth_m)
            )

    def _scene_time_s(self, now_ns: int) -> float:
        """Time of the scene at a stamp: it begins with the first exposure, and again where the clock jumps back."""
        if self._scene_start_ns is None or now_ns < self._scene_start_ns:
            self._scene_start_ns = now_ns
        return (now_ns - self._scene_start_ns) / NANOSECONDS

    def _change_fringes(self, parameters: list[Any]) -> SetParametersResult:
        """Show other fringes from the next exposure on."""
        try:
            values = changed_values(FRINGE_SPECS, self._values, parameters)
            patterns = patterns_of(values)
        except MoireError as error:
            return SetParametersResult(successful=False, reason=str(error))
        if patterns != self._programme.patterns:
            self._programme.change(patterns)
            self.get_logger().info(f"fringes of {', '.join(f'{one.period_px:g}' for one in patterns)} columns")
        self._values = values
        return SetParametersResult(successful=True)

    def _enable_projector(self, request: Any, response: Any) -> Any:
        self._laser_on = request.data
        response.success = True
        response.message = "the projector is on" if request.data else "the projector is off: views without fringes"
        return response

    def _capture_once(self, request: Any, response: Any) -> Any:
        """Make the exposures of one result, at once: one, or steps + 1 made odd."""
        count = sum(needed_frames(pattern.step_count) for pattern in self._programme.patterns)
        for _ in range(count):
            self._expose()
        response.success = True
        response.message = f"{count} exposure(s) published"
        return response

    def _diagnose(self) -> None:
        now_s = time.monotonic()
        reached_hz, is_slow = self._rate.reached_hz(now_s), self._rate.is_slow(now_s)
        status = exposure_status(self._values, self._exposures, self._laser_on, reached_hz, is_slow)
        if is_slow:
            self.get_logger().warning(status.message, throttle_duration_sec=SLOW_NEWS_S)
        self._diagnostics.publish([status, self._joints.status()])


def open_head(values: dict[str, Any]) -> VirtualHead:
    """Return the simulated head that the parameters ask for; raises MoireError where there is no such."""
    head = VirtualHead(values["scene"], values["seed"], options=options_of(values))
    head.set_head(values["pan_rad"], values["tilt_rad"])
    return head


def main() -> int:
    """Run the node; the console script."""
    return run_node(VirtualHeadNode, USAGE + help_text(SPECS))


if __name__ == "__main__":
    sys.exit(main())
