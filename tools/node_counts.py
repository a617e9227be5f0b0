"""What the reconstruction's diagnostics say of its sets, as numbers."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray

from moire_sensor.ros.reconstruction_report import GATHERING, RECONSTRUCTED, REFUSED, SUPERSEDED, UNWATCHED

MATCHED, DROPPED, ENDED = "matched", "dropped: ", "ended"


def set_counts(message: DiagnosticArray) -> dict[str, int]:
    """Return the counts of whole sets by what became of them, ``ended`` their sum; empty where the message has none."""
    for status in message.status:
        if status.name == "reconstruction: reconstruction":
            values = {item.key: item.value for item in status.values}
            counts = {name: int(values[name]) for name in (RECONSTRUCTED, SUPERSEDED, UNWATCHED, GATHERING)}
            counts |= {name: int(text) for name, text in values.items() if name.startswith(REFUSED)}
            return {MATCHED: int(values[MATCHED]), ENDED: sum(counts.values()), **counts}
    return {}


def dropped_counts(message: DiagnosticArray) -> dict[str, int]:
    """Return the counts of incomplete sets by what they lacked; empty where nothing was dropped."""
    return {
        item.key: int(item.value)
        for status in message.status
        if status.name == "reconstruction: input"
        for item in status.values
        if item.key.startswith(DROPPED)
    }
