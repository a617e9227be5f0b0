"""Counts and latencies that several threads write and the diagnostics read."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from threading import Lock

import numpy as np

RECENT = 300


@dataclass(frozen=True)
class TallySnapshot:
    """Counts so far, the latest text of each counted reason, and recent latencies and delays in seconds."""

    counts: dict[str, int]
    texts: dict[str, str]
    latencies_s: tuple[float, ...]
    delays_s: tuple[float, ...] = ()

    def latency_s(self, percentile: float) -> float:
        """Return a percentile (0 to 100) of the recent times from capture stamp to result, seconds; NaN of none."""
        return percentile_or_nan(self.latencies_s, percentile)

    def delay_s(self, percentile: float) -> float:
        """Return a percentile (0 to 100) of the recent times from whole set to result, seconds; NaN of none."""
        return percentile_or_nan(self.delays_s, percentile)


def percentile_or_nan(values: tuple[float, ...], percentile: float) -> float:
    """Return a percentile (0 to 100) of values, NaN of none."""
    return float(np.percentile(values, percentile)) if values else float("nan")


@dataclass
class Tally:
    """Thread-safe counters."""

    _counts: Counter[str] = field(default_factory=Counter)
    _texts: dict[str, str] = field(default_factory=dict)
    _latencies_s: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    _delays_s: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    _lock: Lock = field(default_factory=Lock)

    def count(self, name: str, text: str = "", number: int = 1) -> None:
        """Count something; ``text`` says what happened the last time."""
        with self._lock:
            self._counts[name] += number
            if text:
                self._texts[name] = text

    def add_latency(self, seconds: float, delay_s: float = 0.0) -> None:
        """Note the times from a capture stamp, and from the arrival of its whole set, to the published result."""
        with self._lock:
            self._latencies_s.append(seconds)
            self._delays_s.append(delay_s)

    def snapshot(self) -> TallySnapshot:
        """Return a consistent copy."""
        with self._lock:
            return TallySnapshot(dict(self._counts), dict(self._texts), tuple(self._latencies_s), tuple(self._delays_s))
