"""How many exposures a second a head reaches beside what was asked for; no ROS needed."""

from __future__ import annotations

from collections import deque

# The mean is over so long, or over so many exposures where they are rarer.
WINDOW_S, FEWEST = 3.0, 4
# A head that reaches less than this share of its rate is slow.
ENOUGH = 0.9


class ExposureRate:
    """Knows when the last exposures were made.

    Parameters
    ----------
    wanted_hz : exposures a second that were asked for; with 0 a head is never slow.
    """

    def __init__(self, wanted_hz: float) -> None:
        self._wanted_hz = wanted_hz
        self._times_s: deque[float] = deque()

    def note(self, now_s: float) -> None:
        """An exposure is made, at ``now_s`` of a clock that never goes back."""
        self._times_s.append(now_s)
        while len(self._times_s) > FEWEST and now_s - self._times_s[1] >= WINDOW_S:
            self._times_s.popleft()

    def reached_hz(self, now_s: float) -> float:
        """Return the exposures a second of late; NaN while too few were made, or none for as long as they took."""
        if len(self._times_s) < FEWEST:
            return float("nan")
        span_s = self._times_s[-1] - self._times_s[0]
        if span_s < WINDOW_S or now_s - self._times_s[-1] > span_s:
            return float("nan")
        return (len(self._times_s) - 1) / span_s

    def is_slow(self, now_s: float) -> bool:
        """Tell whether the head falls short of its rate."""
        return self.reached_hz(now_s) < ENOUGH * self._wanted_hz
