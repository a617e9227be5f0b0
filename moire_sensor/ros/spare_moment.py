"""When to do what is wanted once in a while and can wait; no ROS needed."""

from __future__ import annotations


class SpareMoment:
    """Due at once and then once in a period; while other work waits it is put off, by one more period at most."""

    def __init__(self) -> None:
        self._last_s: float | None = None

    def is_now(self, now_s: float, period_s: float, busy: bool) -> bool:
        """Tell whether to do it now, which is then taken for done; ``busy`` while other work waits."""
        if self._last_s is None:
            self._last_s, late_s = now_s - period_s, 0.0
        else:
            late_s = now_s - self._last_s - period_s
        if late_s < 0.0 or (busy and late_s < period_s):
            return False
        self._last_s = now_s
        return True
