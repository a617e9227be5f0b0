"""Node ``reconstruction``: fringe images and projector state in, depth out; see the README for topics."""

from __future__ import annotations

import sys
import traceback
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Header

from moire_sensor.errors import ImageError, MoireError, PatternError, RigError
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.camera_messages import FRAMES
from moire_sensor.ros.diagnostics import DiagnosticsPublisher
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.frame_ring import Frame, FrameRing
from moire_sensor.ros.head_inputs import HeadInputs
from moire_sensor.ros.parameters import changed_values, declare, refuse_unknown
from moire_sensor.ros.projector_state import projector_state
from moire_sensor.ros.qos import overridable, publisher_qos
from moire_sensor.ros.reconstruction_job import Exposure, Job, reconstruct
from moire_sensor.ros.reconstruction_report import (
    GATHERING,
    RECONSTRUCTED,
    REFUSED,
    SUPERSEDED,
    UNWATCHED,
    Report,
)
from moire_sensor.ros.reconstruction_settings import SPECS, read_settings
from moire_sensor.ros.result_publisher import ResultPublisher
from moire_sensor.ros.sensor_cache import Calibration, SensorCache
from moire_sensor.ros.set_matcher import MatchedSet
from moire_sensor.ros.tally import Tally
from moire_sensor.ros.worker import Worker

USAGE = """
reconstruction --ros-args [-r __ns:=/head] [-p NAME:=VALUE ...]
Depth, cloud and disparity from the topics of a head in the same namespace (default: head).
"""
NAMESPACE = "head"
START_PERIOD_S = 0.05
STOP_PATIENCE_S = 10.0
WARNING_PERIOD_S = 5.0
REASONS: dict[type[MoireError], str] = {
    ImageError: "bad image",
    PatternError: "bad projector state",
    RigError: "bad calibration",
}


class ReconstructionNode(Node):  # type: ignore[misc]
    """Match sets in the executor's thread, reconstruct and publish in one worker thread."""

    def __init__(self) -> None:
        super().__init__("reconstruction", namespace=NAMESPACE)
        self._values = declare(self, SPECS)
        refuse_unknown(self)
        self._settings, self._output = read_settings(self._values)
        self._tally = Tally()
        self._report = Report()
        self._ring: FrameRing[Exposure] = FrameRing()
        self._cache = SensorCache()
        self._facts: dict[str, Any] = {}
        self._results = ResultPublisher(self)
        self._done = self.create_publisher(
            Header, "acquisition_done", publisher_qos(), qos_overriding_options=overridable()
        )
        self._diagnostics = DiagnosticsPublisher(self)
        self._inputs: HeadInputs | None = None
        self._worker: Worker[Job] = Worker(self._work, self._supersede, self._values["queue_depth"], self._warm_up)
        self._start = self.create_timer(START_PERIOD_S, self._start_when_warm)
        self.add_on_set_parameters_callback(self._change_parameters)
        self.get_logger().info("loading the kernels; the first start on a machine compiles them, up to a minute")

    def close(self) -> None:
        """Finish the set under way and say the last counts."""
        self._worker.stop(STOP_PATIENCE_S if self._worker.is_prepared() else 0.0)
        self._diagnose()

    def _warm_up(self) -> None:
        """In the worker's thread: load or compile the kernels, so that no set is superseded by a slow start."""
        settings = self._settings.settings
        Reconstructor(paper_rig(), paper_pattern(), settings=settings).warm_up()
        if self._settings.method == "phase_shift":
            Reconstructor(paper_rig(), paper_pattern(4), method="phase_shift", settings=settings).warm_up()

    def _start_when_warm(self) -> None:
        """Subscribe once the kernels are there: who waits for a subscriber loses nothing."""
        if not self._worker.is_prepared():
            return
        self._worker.check_prepared()
        self._start.cancel()
        self._inputs = HeadInputs(self, self._values["reliable_input"], self._take)
        refuse_unknown(self, qos=True)
        self.create_timer(self._values["diagnostics_period_s"], self._diagnose)
        self._jump_handle = self.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True),
            post_callback=self._clock_jumped,
        )
        self.get_logger().info(f"ready: method {self._settings.method}, listening in {self.get_namespace()}")

    def _take(self, matched: MatchedSet[Any], calibration: Calibration | None) -> None:
        """Take one whole set: convert, choose the frames, hand over to the worker."""
        if matched.after_jump:
            self._ring.clear()
        try:
            state = projector_state(matched.items["state"])
        except PatternError as error:
            self._refuse(REASONS[PatternError], str(error))
            return
        if not state.laser_on:
            self._refuse("laser off", "the projector is off; switch it on with projector/enable")
            return
        if calibration is None:
            self._refuse("no camera info", "the head must publish left, right and projector/camera_info")
            return
        left, right = matched.items["left"], matched.items["right"]
        frame = Frame(matched.stamp_ns, state, Exposure(left, right))
        frames = self._frames_for(frame)
        if frames is None:
            self._tally.count(GATHERING)
            return
        self._submit(frames, calibration)

    def _frames_for(self, frame: Frame[Exposure]) -> tuple[Frame[Exposure], ...] | None:
        if self._settings.method != "phase_shift":
            return (frame,)
        return self._ring.add(frame)

    def _submit(self, frames: tuple[Frame[Exposure], ...], calibration: Calibration) -> None:
        stamp = frames[len(frames) // 2].item.left.header.stamp
        header = Header(stamp=stamp, frame_id=FRAMES["left"])
        self._done.publish(header)
        if not self._results.wanted():
            self._tally.count(UNWATCHED)
            return
        self._worker.submit(Job(header, frames, calibration, self._settings, self._output))

    def _work(self, job: Job) -> None:
        """In the worker's thread: reconstruct, publish; nothing that a message holds may end the thread."""
        try:
            result = reconstruct(job, self._cache)
            self._results.publish(job.header, result.sensor, result.shot, job.output)
        except MoireError as error:
            self._refuse(REASONS.get(type(error), "bad settings"), str(error))
        except Exception:
            self._refuse("internal error", traceback.format_exc())
        else:
            self._facts = result.facts()
            self._tally.add_latency(self._age_s(job.header))
            self._tally.count(RECONSTRUCTED)

    def _age_s(self, header: Header) -> float:
        now_ns = self.get_clock().now().nanoseconds
        return float(now_ns - header.stamp.sec * 1_000_000_000 - header.stamp.nanosec) * 1e-9

    def _refuse(self, reason: str, text: str) -> None:
        self._tally.count(REFUSED + reason, text)
        self.get_logger().warning(f"refused a set, {reason}: {text}", throttle_duration_sec=WARNING_PERIOD_S)

    def _supersede(self, number: int) -> None:
        self._tally.count(SUPERSEDED, number=number)

    def _change_parameters(self, parameters: list[Any]) -> SetParametersResult:
        try:
            values = changed_values(SPECS, self._values, parameters)
            self._settings, self._output = read_settings(values)
        except MoireError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._values = values
        self._ring.clear()
        return SetParametersResult(successful=True)

    def _clock_jumped(self, jump: Any) -> None:
        if self._inputs is not None:
            self._inputs.clear("the clock jumped")
        self._ring.clear()

    def _diagnose(self) -> None:
        if self._inputs is None:
            return
        statuses = self._report.statuses(self._inputs, self._tally.snapshot(), dict(self._facts))
        self._diagnostics.publish(statuses)


def main() -> int:
    """Run the node; the console script."""
    return run_node(ReconstructionNode, USAGE)


if __name__ == "__main__":
    sys.exit(main())
