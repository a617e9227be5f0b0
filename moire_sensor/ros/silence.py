"""Which of several streams has fallen silent while others go on; no ROS needed."""

from __future__ import annotations

from collections.abc import Iterable


class SilenceWatch:
    """Notice a stream that does not bring the stamp that another one brought.

    A head that pauses as a whole is not silent: only a stream that others run ahead of is. Nor is a slow one: the wait
    counts from the first message of another stream whose stamp this one has not reached.

    Parameters
    ----------
    streams : names of the streams that bring the same stamps.
    """

    def __init__(self, streams: Iterable[str]) -> None:
        self._streams = tuple(streams)
        self._last_ns: dict[str, int] = {}
        self._waiting_since_s: dict[str, float] = {}

    def note(self, stream: str, stamp_ns: int, now_s: float) -> None:
        """A message of a stream came, at ``now_s`` of a clock that never goes back."""
        self._waiting_since_s.pop(stream, None)
        if stamp_ns < self._last_ns.get(stream, stamp_ns):
            # A loop, a seek or a reset: what the others had before does not count any more.
            self._last_ns.clear()
            self._waiting_since_s.clear()
        self._last_ns[stream] = stamp_ns
        for other in self._streams:
            if other != stream and self._last_ns.get(other, stamp_ns - 1) < stamp_ns:
                self._waiting_since_s.setdefault(other, now_s)

    def silent(self, after_s: float, now_s: float) -> tuple[str, ...]:
        """Return the streams that the others have run ahead of for ``after_s`` seconds or longer."""
        return tuple(
            stream
            for stream in self._streams
            if stream in self._waiting_since_s and now_s - self._waiting_since_s[stream] >= after_s
        )
