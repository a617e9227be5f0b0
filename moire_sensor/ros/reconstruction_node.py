"""Node ``reconstruction``: fringe images and projector state in, depth out; see the README for topics."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from std_msgs.msg import Header

from moire_sensor.errors import MoireError, SettingsError
from moire_sensor.kernel_threads import check_parallel_kernels, share_kernel_threads
from moire_sensor.ros.diagnostics import DiagnosticsPublisher
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.head_inputs import HeadInputs
from moire_sensor.ros.kernels import warm_up
from moire_sensor.ros.lifecycle import STEADY_CLOCK, ManagedNode
from moire_sensor.ros.parameters import changed_values, declare, help_text, refuse_unknown
from moire_sensor.ros.qos import destroy_publisher, overridable, publisher_maker, publisher_qos
from moire_sensor.ros.reconstruction_health import Health
from moire_sensor.ros.reconstruction_job import Job, Result, alignment_facts, reconstruct
from moire_sensor.ros.reconstruction_report import SUPERSEDED, UNWATCHED
from moire_sensor.ros.reconstruction_settings import SPECS, read_settings
from moire_sensor.ros.result_publisher import ResultPublisher
from moire_sensor.ros.sensor_cache import Calibration, ThreadCaches
from moire_sensor.ros.set_intake import SetIntake
from moire_sensor.ros.set_matcher import MatchedSet
from moire_sensor.ros.thresholds import read_thresholds
from moire_sensor.ros.worker import Worker

USAGE = """
reconstruction --ros-args [-r __ns:=/head] [-p NAME:=VALUE ...]
Depth, cloud and disparity from the topics of a head in the same namespace (default: head).
"""
NAMESPACE = "head"
STOP_PATIENCE_S = 10.0
KERNEL_POLL_S = 0.05
# How often a node that compiles its kernels says so.
KERNEL_NEWS_S = 10.0
# A topic is called silent this much late at most.
WATCH_PERIOD_S = 0.25


class ReconstructionNode(ManagedNode):
    """Match sets in the executor's thread, reconstruct and publish in worker threads, one by default.

    A managed node: configure makes the publishers, activate subscribes; an inactive node neither receives nor
    publishes. With ``autostart`` it does both by itself. ``others`` are parameters of other nodes of the process.
    """

    def __init__(self, others: Collection[str] = ()) -> None:
        super().__init__("reconstruction", NAMESPACE)
        self._values = declare(self, SPECS)
        refuse_unknown(self, others=others)
        self._read(self._values)
        self._intake = SetIntake()
        self._caches = ThreadCaches()
        self._inputs: HeadInputs | None = None
        self._results: ResultPublisher | None = None
        self._timers_of_work: list[Any] = []
        self._jumps: Any = None
        self._health = Health(self, self._limits)
        self._worker: Worker[Job] = Worker(
            self._work, self._supersede, self._values["queue_depth"], self._warm_up, self._values["parallel_sets"]
        )
        self.add_on_set_parameters_callback(self._change_parameters)
        if self._values["autostart"]:
            self.start_by_itself()
        self.get_logger().info("loading the kernels; the first start on a machine compiles them, a minute or two")
        self._kernel_news = self.create_timer(KERNEL_NEWS_S, self._tell_of_kernels, clock=STEADY_CLOCK)
        self._compiling_s = 0.0

    def close(self) -> None:
        """Finish the set under way and say the last counts."""
        if self._state_machine.available_transitions:
            self.trigger_shutdown()
        self._worker.stop(STOP_PATIENCE_S if self._worker.is_prepared() else 0.0)

    def is_ready(self) -> bool:
        """Tell whether the kernels are there."""
        return self._worker.is_prepared()

    def set_up(self) -> None:
        """Make the publishers; once the kernels are there, unless the node starts by itself."""
        if not self._values["autostart"]:
            self._wait_for_kernels()
        self._results = ResultPublisher(self)
        self._done = publisher_maker(self)(
            Header, "acquisition_done", publisher_qos(), qos_overriding_options=overridable()
        )
        self._diagnostics = DiagnosticsPublisher(self)

    def begin(self) -> None:
        """Subscribe once the kernels are there: who waits for a subscriber loses nothing."""
        self._wait_for_kernels()
        self._health = Health(self, self._limits)
        self._intake.clear()
        self._inputs = HeadInputs(self, self._values["reliable_input"], self._take, self._health.refuse)
        refuse_unknown(self, qos=True)
        self._restart_timers()
        self._jumps = self.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True),
            post_callback=self._clock_jumped,
        )
        self.get_logger().info(f"ready: method {self._settings.method}, listening in {self.get_namespace()}")

    def pause(self) -> None:
        """End the subscriptions, finish the set under way, and say the last counts."""
        for timer in self._timers_of_work:
            self.destroy_timer(timer)
        self._timers_of_work.clear()
        if self._jumps is not None:
            self._jumps.unregister()
            self._jumps = None
        if self._inputs is None:
            return
        self._inputs.close()
        if not self._worker.drain(STOP_PATIENCE_S):
            self.get_logger().warning("the set under way takes too long; its result will not be published")
        self._diagnose()
        self._inputs = None

    def release(self) -> None:
        """Give back the publishers and what was built for camera infos and pattern."""
        if self._results is not None:
            self._results.close()
            self._diagnostics.close()
            destroy_publisher(self, self._done)
            self._results = None
        self._caches = ThreadCaches()

    def _read(self, values: dict[str, Any]) -> None:
        """Take over parameter values; raises MoireError for those that do not go together, and takes over none."""
        settings, limits = read_settings(values), read_thresholds(values)
        self._settings, self._output = settings
        self._limits = limits

    def _warm_up(self) -> None:
        """In a worker's thread: load or compile the kernels, so that no set is superseded by a slow start."""
        # Dense too: whoever changes the method at run time most likely changes to it.
        wanted = self._settings
        warm_up({"dense", wanted.method}, wanted.settings, wanted.saturation_level)
        if self._values["parallel_sets"] > 1:
            check_parallel_kernels()

    def _tell_of_kernels(self) -> None:
        self._compiling_s += KERNEL_NEWS_S
        if self._worker.is_prepared():
            self._kernel_news.cancel()
        else:
            self.get_logger().info(
                f"still compiling the kernels, {self._compiling_s:.0f} s so far; next time they are read"
            )

    def _wait_for_kernels(self) -> None:
        while not self._worker.wait_prepared(KERNEL_POLL_S):
            if self.stop_asked():
                raise SettingsError("the node was asked to end while its kernels were loading")

    def _restart_timers(self) -> None:
        for timer in self._timers_of_work:
            self.destroy_timer(timer)
        self._timers_of_work = [
            self.create_timer(self._values["diagnostics_period_s"], self._diagnose, clock=STEADY_CLOCK),
            self.create_timer(WATCH_PERIOD_S, self._watch, clock=STEADY_CLOCK),
        ]

    def _take(self, matched: MatchedSet[Any], calibration: Calibration | None) -> None:
        """Take one whole set; hand over to the worker what is wanted of it."""
        job = self._intake.job(matched, calibration, self._settings, self._output, self._health)
        if job is None:
            return
        self._done.publish(job.header)
        if self._results is None or not self._results.wanted():
            self._health.count(UNWATCHED)
            return
        self._worker.submit(job)

    def _work(self, job: Job) -> Callable[[], None]:
        """In a worker's thread: reconstruct, and return what publishes; no message may end the thread."""
        # Those of the activation that took the set.
        health, results = self._health, self._results
        share_kernel_threads(self._worker.under_way())
        try:
            result = reconstruct(job, self._caches.own)
        except Exception as error:
            return partial(refuse_for, error, health)
        return partial(self._publish, job, result, health, results)

    def _publish(self, job: Job, result: Result, health: Health, results: ResultPublisher | None) -> None:
        """In a worker's thread, set by set in their order."""
        try:
            if results is not None:
                results.publish(job.header, result.sensor, result.shot, job.output)
            health.note_result(job.header, job.taken_s, result.facts)
            health.note_alignment(lambda: alignment_facts(job, result, self._caches.own), self._worker.has_waiting())
        except Exception as error:
            refuse_for(error, health)

    def _supersede(self, number: int) -> None:
        self._health.count(SUPERSEDED, number)

    def _change_parameters(self, parameters: list[Any]) -> SetParametersResult:
        try:
            values = changed_values(SPECS, self._values, parameters)
            self._read(values)
        except MoireError as error:
            return SetParametersResult(successful=False, reason=str(error))
        new_period = values["diagnostics_period_s"] != self._values["diagnostics_period_s"]
        self._values = values
        self._health.limits = self._limits
        self._worker.set_queue_depth(values["queue_depth"])
        if new_period and self._inputs is not None:
            self._restart_timers()
        self._intake.clear()
        return SetParametersResult(successful=True)

    def _clock_jumped(self, jump: Any) -> None:
        if self._inputs is not None:
            self._inputs.sets.clear("the clock jumped")
        self._intake.clear()

    def _watch(self) -> None:
        if self._inputs is not None and self._health.watch(self._inputs):
            self._diagnose()

    def _diagnose(self) -> None:
        if self._inputs is not None and self._results is not None:
            self._results.say_unheard()
            self._health.report(self._inputs, self._diagnostics, self._values["diagnostics_period_s"])


def refuse_for(error: Exception, health: Health) -> None:
    """Count a set refused for an error, which may be one of our own."""
    if isinstance(error, MoireError):
        health.refuse_for(error)
    else:
        health.refuse("internal error", "".join(traceback.format_exception(error)))


def main() -> int:
    """Run the node; the console script."""
    return run_node(ReconstructionNode, USAGE + help_text(SPECS))


if __name__ == "__main__":
    sys.exit(main())
