"""What the reconstruction node says about itself on ``/diagnostics``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from moire_sensor.ros.diagnostics import ERROR, OK, WARN, status_of
from moire_sensor.ros.head_inputs import HeadInputs
from moire_sensor.ros.set_matcher import MatchCounts
from moire_sensor.ros.tally import TallySnapshot

RECONSTRUCTED, SUPERSEDED, GATHERING, UNWATCHED = "reconstructed", "superseded", "gathering", "unwatched"
REFUSED = "refused: "


@dataclass
class Report:
    """Make the statuses of one period; remembers the last period to tell what is new."""

    last_received: int = 0
    last_lost: int = 0
    last_refused: int = 0

    def statuses(self, inputs: HeadInputs, tally: TallySnapshot, facts: dict[str, Any]) -> list[DiagnosticStatus]:
        """Return the statuses ``input`` and ``reconstruction``; ``facts`` are shown with the latter."""
        counts = inputs.matcher.counts
        statuses = [self._input_status(inputs, counts), self._work_status(counts, tally, facts)]
        self.last_received = sum(counts.received.values())
        self.last_lost = sum(counts.dropped.values())
        self.last_refused = refused_count(tally)
        return statuses

    def _input_status(self, inputs: HeadInputs, counts: MatchCounts) -> DiagnosticStatus:
        values: dict[str, Any] = {f"received {stream}": number for stream, number in counts.received.items()}
        values |= {"matched": counts.matched, "superseded before work": counts.superseded}
        values |= {"repeated messages": counts.repeated, "jumps back in time": counts.jumps}
        values |= {f"dropped: {reason}": number for reason, number in sorted(counts.dropped.items())}
        incompatible = inputs.incompatible()
        values |= {f"incompatible {topic}": policy for topic, policy in incompatible.items()}
        if incompatible:
            return status_of("input", ERROR, "a publisher's quality of service does not match", values)
        if sum(counts.received.values()) == self.last_received:
            return status_of("input", WARN, "nothing received in the last period", values)
        if inputs.missing_infos:
            return status_of("input", WARN, f"waiting for {', '.join(inputs.missing_infos)}", values)
        if sum(counts.dropped.values()) > self.last_lost:
            return status_of("input", WARN, "sets were dropped in the last period", values)
        return status_of("input", OK, "receiving", values)

    def _work_status(
        self, counts: MatchCounts, tally: TallySnapshot, facts: dict[str, Any]
    ) -> DiagnosticStatus:
        values: dict[str, Any] = {"matched": counts.matched}
        for name in (RECONSTRUCTED, SUPERSEDED, GATHERING, UNWATCHED):
            values[name] = tally.counts.get(name, 0)
        values[SUPERSEDED] += counts.superseded
        values |= {name: number for name, number in sorted(tally.counts.items()) if name.startswith(REFUSED)}
        values |= {f"last {name}": text for name, text in sorted(tally.texts.items())}
        values |= {f"latency p{p} ms": tally.latency_s(p) * 1e3 for p in (50, 99)}
        values |= facts
        if refused_count(tally) > self.last_refused:
            return status_of("reconstruction", ERROR, "sets were refused in the last period", values)
        return status_of("reconstruction", OK, "working", values)


def refused_count(tally: TallySnapshot) -> int:
    """Return how many sets were refused, for any reason."""
    return sum(number for name, number in tally.counts.items() if name.startswith(REFUSED))
