"""How the reconstruction node fares: what it counts, warns of in the log, and reports on ``/diagnostics``."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from std_msgs.msg import Header

from moire_sensor.errors import ImageError, MoireError, PatternError, RigError
from moire_sensor.ros.diagnostics import DiagnosticsPublisher
from moire_sensor.ros.head_inputs import HeadInputs
from moire_sensor.ros.reconstruction_report import RECONSTRUCTED, REFUSED, InputState, Report, WorkState
from moire_sensor.ros.spare_moment import SpareMoment
from moire_sensor.ros.tally import Tally
from moire_sensor.ros.thresholds import Thresholds

WARNING_PERIOD_S = 5.0
# Facts of a result older than this, and than two periods of the diagnostics, are not reported as if they were new.
FRESH_S = 5.0
REASONS: dict[type[MoireError], str] = {
    ImageError: "bad image",
    PatternError: "bad projector state",
    RigError: "bad calibration",
}


class Health:
    """Counts of one activation, and their report; methods may be called from any thread unless they say otherwise.

    Parameters
    ----------
    node : whose log and clock are used.
    limits : thresholds; may be replaced at any time.
    """

    def __init__(self, node: Any, limits: Thresholds) -> None:
        self.limits = limits
        self.laser_on: bool | None = None
        self._node = node
        self._tally = Tally()
        self._report = Report()
        self._found: tuple[float, Callable[[], dict[str, Any]]] = (-math.inf, dict)
        self._alignment: dict[str, Any] = {}
        self._spare_moment = SpareMoment()
        self._silent: set[str] = set()

    def count(self, name: str, number: int = 1) -> None:
        """Count what became of sets."""
        self._tally.count(name, number=number)

    def refuse(self, reason: str, text: str) -> None:
        """Count a refused set or message and say so in the log, not too often."""
        self._tally.count(REFUSED + reason, text)
        self._node.get_logger().warning(f"refused a set, {reason}: {text}", throttle_duration_sec=WARNING_PERIOD_S)

    def refuse_for(self, error: MoireError) -> None:
        """Count a set refused for an error."""
        self.refuse(REASONS.get(type(error), "bad settings"), str(error))

    def note_alignment(self, measure: Callable[[], dict[str, Any]], busy: bool) -> None:
        """In the worker's thread: measure what is too dear for every set, once in ``check_period_s``.

        While it is ``busy``, with more sets waiting, that is put off, so that none is superseded by it.
        """
        if self._spare_moment.is_now(time.monotonic(), self.limits.check_period_s, busy):
            self._alignment = measure()

    def note_result(self, header: Header, taken_s: float, facts: Callable[[], dict[str, Any]]) -> None:
        """A result was published whose set was whole at ``taken_s`` of ``time.monotonic``.

        ``facts`` is called for the report, if no newer result comes before that.
        """
        now_s = time.monotonic()
        stamp_ns = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
        age_s = float(self._node.get_clock().now().nanoseconds - stamp_ns) * 1e-9
        self._tally.add_latency(age_s, now_s - taken_s)
        self._found = (now_s, facts)
        self._tally.count(RECONSTRUCTED)

    def watch(self, inputs: HeadInputs) -> bool:
        """In the executor's thread: say once which topic falls silent or is back; True when any did."""
        silent = set(inputs.silent(self.limits.silent_after_s))
        before, self._silent = self._silent, silent
        log = self._node.get_logger()
        for topic in sorted(silent - before):
            log.error(f"{topic} is silent while the rest of the head goes on: no depth until it is back")
        for topic in sorted(before - silent):
            log.info(f"{topic} is back")
        return silent != before

    def report(self, inputs: HeadInputs, publisher: DiagnosticsPublisher, period_s: float) -> None:
        """In the executor's thread: publish all statuses; ``period_s`` is the time between reports."""
        now_s = time.monotonic()
        found_s, facts = self._found
        is_fresh = now_s - found_s <= max(FRESH_S, 2.0 * period_s)
        received = InputState(
            inputs.sets.matcher.counts,
            inputs.incompatible(),
            sorted(self._silent),
            inputs.unpublished(),
            inputs.sets.missing_infos,
            self.laser_on,
        )
        work = WorkState(self._tally.snapshot(), facts() | self._alignment if is_fresh else {}, is_fresh)
        publisher.publish(self._report.statuses(received, work, self.limits, now_s))
