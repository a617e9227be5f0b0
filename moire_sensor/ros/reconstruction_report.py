"""What the reconstruction node says about itself on ``/diagnostics``: one status per concern."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from moire_sensor.ros.diagnostics import ERROR, OK, WARN, status_of
from moire_sensor.ros.result_report import result_statuses
from moire_sensor.ros.set_matcher import MatchCounts
from moire_sensor.ros.tally import TallySnapshot
from moire_sensor.ros.thresholds import Thresholds

RECONSTRUCTED, SUPERSEDED, GATHERING, UNWATCHED = "reconstructed", "superseded", "gathering", "unwatched"
REFUSED = "refused: "
LASER_OFF = "laser off"
# Rates are means over this time.
RATE_WINDOW_S = 5.0


@dataclass(frozen=True)
class InputState:
    """What the subscriptions know.

    Attributes
    ----------
    counts : of the matcher.
    incompatible : policy that keeps a publisher from reaching the node, by topic.
    silent, unpublished, missing_infos : names of topics.
    laser_on : as the last projector state said, None before the first.
    """

    counts: MatchCounts
    incompatible: dict[str, str]
    silent: list[str]
    unpublished: list[str]
    missing_infos: list[str]
    laser_on: bool | None


@dataclass(frozen=True)
class WorkState:
    """What the reconstruction knows: counts and latencies, and the last result's facts, empty when it is old."""

    tally: TallySnapshot
    facts: dict[str, Any]
    is_fresh: bool


@dataclass
class Report:
    """Make the statuses of one period; remembers the last period to tell what is new."""

    last: dict[str, int] = field(default_factory=dict)
    history: deque[tuple[float, dict[str, int]]] = field(default_factory=deque)

    def statuses(
        self, inputs: InputState, work: WorkState, limits: Thresholds, now_s: float
    ) -> list[DiagnosticStatus]:
        """Return all statuses; ``now_s`` is the time of a clock that never goes back, seconds."""
        totals = totals_of(inputs.counts, work.tally)
        new = {name: number - self.last.get(name, 0) for name, number in totals.items()}
        self.last = totals
        return [
            input_status(inputs, new),
            work_status(inputs.counts, work, new, limits),
            self._rate_status(totals, now_s, limits),
            latency_status(work.tally, limits),
            *result_statuses(work.facts, work.is_fresh, inputs.laser_on, limits),
        ]

    def _rate_status(self, totals: dict[str, int], now_s: float, limits: Thresholds) -> DiagnosticStatus:
        self.history.append((now_s, totals))
        while len(self.history) > 2 and now_s - self.history[1][0] >= RATE_WINDOW_S:
            self.history.popleft()
        begin_s, before = self.history[0]
        span_s = now_s - begin_s
        if span_s <= 0.0:
            return status_of("rates", OK, "not measured yet", {})
        rates = {
            f"{name} Hz": (totals[name] - before[name]) / span_s
            for name in totals
            if name in ("matched", RECONSTRUCTED) or name.startswith("received ")
        }
        matched_hz = rates["matched Hz"]
        if matched_hz < limits.warn_rate_hz:
            text = f"{matched_hz:.3g} whole sets a second, fewer than warn_rate_hz {limits.warn_rate_hz:g}"
            return status_of("rates", WARN, text, rates)
        return status_of("rates", OK, f"{matched_hz:.3g} whole sets a second", rates)


def totals_of(counts: MatchCounts, tally: TallySnapshot) -> dict[str, int]:
    """Return the counts that the report compares with those of the last period."""
    return {
        **{f"received {stream}": number for stream, number in counts.received.items()},
        "received": sum(counts.received.values()),
        "matched": counts.matched,
        "dropped": sum(counts.dropped.values()),
        "refused": sum(number for name, number in tally.counts.items() if name.startswith(REFUSED)),
        LASER_OFF: tally.counts.get(REFUSED + LASER_OFF, 0),
        RECONSTRUCTED: tally.counts.get(RECONSTRUCTED, 0),
        SUPERSEDED: tally.counts.get(SUPERSEDED, 0) + counts.superseded,
    }


def input_status(inputs: InputState, new: dict[str, int]) -> DiagnosticStatus:
    """Return the status of what comes in: quality of service, silent topics, camera infos, incomplete sets."""
    counts = inputs.counts
    values: dict[str, Any] = {f"received {stream}": number for stream, number in counts.received.items()}
    values |= {"matched": counts.matched, "superseded before work": counts.superseded}
    values |= {"repeated messages": counts.repeated, "jumps back in time": counts.jumps}
    values |= {f"dropped: {reason}": number for reason, number in sorted(counts.dropped.items())}
    values |= {f"incompatible {topic}": policy for topic, policy in inputs.incompatible.items()}
    values |= {f"silent {topic}": "yes" for topic in inputs.silent}
    level, text = OK, "receiving"
    if inputs.incompatible:
        level, text = ERROR, "a publisher's quality of service does not match"
    elif inputs.silent:
        level, text = ERROR, f"silent: {', '.join(inputs.silent)}"
    elif not new["received"]:
        level, text = WARN, "nothing received in the last period"
        if inputs.unpublished:
            text += f"; nobody publishes {', '.join(inputs.unpublished)}"
    elif inputs.missing_infos:
        level, text = WARN, f"waiting for {', '.join(inputs.missing_infos)}"
    elif new["dropped"]:
        level, text = WARN, "sets were dropped in the last period"
    return status_of("input", level, text, values)


def work_status(
    counts: MatchCounts, work: WorkState, new: dict[str, int], limits: Thresholds
) -> DiagnosticStatus:
    """Return the status of the sets: what became of every whole one, and why some were refused."""
    tally = work.tally
    values: dict[str, Any] = {"matched": counts.matched}
    for name in (RECONSTRUCTED, SUPERSEDED, GATHERING, UNWATCHED):
        values[name] = tally.counts.get(name, 0)
    values[SUPERSEDED] += counts.superseded
    values |= {name: number for name, number in sorted(tally.counts.items()) if name.startswith(REFUSED)}
    values |= {f"last {name}": text for name, text in sorted(tally.texts.items())}
    values |= work.facts
    overtaken = new[SUPERSEDED] / new["matched"] if new["matched"] else 0.0
    # What the projector was told to do is no fault of the set; the concern "laser" speaks of it.
    if new["refused"] > new[LASER_OFF]:
        return status_of("reconstruction", ERROR, "sets were refused in the last period", values)
    if overtaken > limits.warn_superseded_share:
        text = f"{overtaken:.0%} of the sets were overtaken by newer ones: slow the head down, or raise queue_depth"
        return status_of("reconstruction", WARN, text, values)
    return status_of("reconstruction", OK, "working", values)


def latency_status(tally: TallySnapshot, limits: Thresholds) -> DiagnosticStatus:
    """Return the status of the time from whole set to result; that from the capture's stamp is shown beside it."""
    values = {f"whole set to result p{p} ms": tally.delay_s(p) * 1e3 for p in (50, 99)}
    values |= {f"latency p{p} ms": tally.latency_s(p) * 1e3 for p in (50, 99)}
    median_s = tally.delay_s(50)
    if median_s > limits.warn_latency_s:
        text = f"{median_s:.3g} s from a whole set to its result, above warn_latency_s {limits.warn_latency_s:g}"
        return status_of("latency", WARN, text, values)
    return status_of("latency", OK, "not measured yet" if median_s != median_s else "in time", values)
