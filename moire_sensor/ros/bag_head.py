"""The reconstruction of one head in a bag: what the node does, message by message, without a node."""

from __future__ import annotations

import traceback
from collections import Counter, deque
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from moire_sensor.errors import MoireError
from moire_sensor.ros.head_sets import INFO_TOPICS, STREAM_TOPICS, HeadSets
from moire_sensor.ros.reconstruction_health import FRESH_S, REASONS
from moire_sensor.ros.reconstruction_job import Job, alignment_facts, reconstruct
from moire_sensor.ros.reconstruction_report import RECONSTRUCTED, REFUSED, InputState, Report, WorkState
from moire_sensor.ros.reconstruction_settings import read_settings
from moire_sensor.ros.result_messages import result_messages
from moire_sensor.ros.sensor_cache import Calibration, SensorCache
from moire_sensor.ros.set_intake import SetIntake
from moire_sensor.ros.set_matcher import MatchedSet
from moire_sensor.ros.tally import TallySnapshot
from moire_sensor.ros.thresholds import read_thresholds


@dataclass
class BagLedger:
    """Counts of one head; all of it can be saved as JSON."""

    counts: Counter[str] = field(default_factory=Counter)
    texts: dict[str, str] = field(default_factory=dict)
    laser_on: bool | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    found_s: float = 0.0
    alignment: dict[str, Any] = field(default_factory=dict)
    checked_s: float | None = None

    def count(self, name: str, number: int = 1) -> None:
        """Count what became of a set."""
        self.counts[name] += number

    def refuse(self, reason: str, text: str) -> None:
        """Count a refused set."""
        self.counts[REFUSED + reason] += 1
        self.texts[REFUSED + reason] = text

    def refuse_for(self, error: MoireError) -> None:
        """Count a set refused for an error."""
        self.refuse(REASONS.get(type(error), "bad settings"), str(error))


class BagHead:
    """Feed it the messages of a head in recorded order; it gives jobs, their results, and the diagnostics.

    Parameters
    ----------
    namespace : that of the head, such as ``"/head"``.
    values : parameter values of the reconstruction node.
    """

    def __init__(self, namespace: str, values: Mapping[str, Any]) -> None:
        self.namespace = namespace
        self.ledger = BagLedger()
        self._settings, self._output = read_settings(values)
        self._limits = read_thresholds(dict(values))
        self._streams = {f"{namespace}/{topic}": stream for stream, (topic, _) in STREAM_TOPICS.items()}
        self._devices = {f"{namespace}/{topic}": device for device, topic in INFO_TOPICS.items()}
        self._sets = HeadSets(self._take, values["input_rectified"])
        self._intake = SetIntake()
        self._jobs: list[Job] = []
        self._cache = SensorCache()
        self._report = Report()

    @property
    def matched(self) -> int:
        """Number of whole sets so far."""
        return self._sets.matcher.counts.matched

    def feed(self, topic: str, message: Any) -> list[Job]:
        """Take a message; return the jobs it makes possible."""
        if topic in self._devices:
            self._sets.add_info(self._devices[topic], message)
        else:
            self._sets.add(self._streams[topic], message)
        jobs, self._jobs = self._jobs, []
        return jobs

    def finish(self) -> None:
        """Say that no message follows: sets that wait for a camera info are refused, and counted."""
        self._sets.give_up()

    def work(self, job: Job, wanted: Collection[str], now_s: float) -> list[tuple[str, Any]]:
        """Reconstruct; return full topic names and messages, none for a job that is refused and counted.

        ``wanted`` : result topics, relative; ``now_s`` : time in the bag, seconds.
        """
        try:
            result = reconstruct(job, self._cache)
            found = result_messages(job.header, result.sensor, result.shot, job.output, wanted)
            messages = [(f"{self.namespace}/{topic}", message) for topic, message in found]
        except MoireError as error:
            self.ledger.refuse_for(error)
            return []
        except Exception:
            # As in the node: nothing that a message holds may end the work on those that follow.
            self.ledger.refuse("internal error", traceback.format_exc())
            return []
        self.ledger.count(RECONSTRUCTED)
        self.ledger.facts, self.ledger.found_s = result.facts() | self.ledger.alignment, now_s
        if self._is_check_due(now_s):
            self.ledger.alignment, self.ledger.checked_s = alignment_facts(job, result, self._cache), now_s
        return messages

    def statuses(self, now_s: float) -> list[DiagnosticStatus]:
        """Return the diagnostics at a time in the bag, seconds."""
        ledger = self.ledger
        received = InputState(self._sets.matcher.counts, {}, [], [], self._sets.missing_infos, ledger.laser_on)
        tally = TallySnapshot(dict(ledger.counts), dict(ledger.texts), ())
        work = WorkState(tally, dict(ledger.facts), now_s - ledger.found_s <= FRESH_S)
        statuses = self._report.statuses(received, work, self._limits, now_s)
        for status in statuses:
            status.name = f"reconstruction: {status.name}"
            status.hardware_id = f"{self.namespace}/reconstruction"
        return statuses

    def state(self) -> dict[str, Any]:
        """Return what a later run needs to go on from here, besides the messages so far; fit for JSON."""
        ledger = {**vars(self.ledger), "counts": dict(self.ledger.counts)}
        return {"ledger": ledger, "last": self._report.last, "history": list(self._report.history)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take up a state, after the same messages were fed."""
        ledger = dict(state["ledger"])
        self.ledger = BagLedger(**{**ledger, "counts": Counter(ledger["counts"])})
        self._report = Report(dict(state["last"]), deque((time_s, totals) for time_s, totals in state["history"]))

    def _is_check_due(self, now_s: float) -> bool:
        """Tell whether it is time to measure what is too dear for every set."""
        checked_s = self.ledger.checked_s
        return checked_s is None or not 0.0 <= now_s - checked_s < self._limits.check_period_s

    def _take(self, matched: MatchedSet[Any], calibration: Calibration | None) -> None:
        missing = self._sets.missing_infos
        job = self._intake.job(matched, calibration, self._settings, self._output, self.ledger, missing)
        if job is not None:
            self._jobs.append(job)


def head_namespaces(topics: Collection[str]) -> Iterator[str]:
    """Yield the namespaces of whole heads: those that have both images and the projector's state."""
    for topic in sorted(topics):
        namespace = topic.removesuffix("/projector/state")
        needed = {f"{namespace}/{name}" for name, _ in STREAM_TOPICS.values()}
        if namespace != topic and needed <= set(topics):
            yield namespace
