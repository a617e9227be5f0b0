"""Match the messages of one exposure by exact stamp, with bounded memory; no ROS needed."""

from __future__ import annotations

from collections import Counter, OrderedDict, deque
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from moire_sensor.errors import SettingsError

Item = TypeVar("Item")


@dataclass(frozen=True)
class MatchedSet(Generic[Item]):
    """One message of every stream, all of stamp ``stamp_ns``; ``after_jump`` for the first of a new time."""

    stamp_ns: int
    items: dict[str, Item]
    after_jump: bool = False


@dataclass(frozen=True)
class MatchCounts:
    """What became of the messages so far.

    ``repeated`` counts messages that came twice or after their set was over; ``dropped`` counts incomplete
    sets by the reason as a user reads it.
    """

    received: dict[str, int]
    matched: int
    superseded: int
    repeated: int
    jumps: int
    dropped: dict[str, int]


@dataclass
class _Pending(Generic[Item]):
    """An incomplete set, with the number of newer sets handed out since it was opened."""

    items: dict[str, Item] = field(default_factory=dict)
    overtaken: int = 0


class SetMatcher(Generic[Item]):
    """Collect one item of every stream for each stamp.

    A set older than one already handed out is complete too, but superseded. An incomplete set is given up
    when ``patience`` newer sets have been completed, or when more than ``capacity`` sets are open. A stamp
    older than all remembered ones (a looped bag, a seek, a reset clock) clears everything; so does a whole
    set that comes a second time after a newer one (a loop shorter than the memory). Other messages of a set
    that is over are only counted.

    Parameters
    ----------
    streams : names of the streams that make a set.
    capacity : sets kept open, and stamps remembered, at least 2.
    patience : newer sets that may complete before an incomplete one is given up, at least 1.
    """

    def __init__(self, streams: tuple[str, ...], capacity: int = 8, patience: int = 2) -> None:
        if capacity < 2 or patience < 1:
            raise SettingsError(f"capacity is {capacity}, patience {patience}; at least 2 and 1 are needed")
        self.streams = streams
        self._capacity, self._patience = capacity, patience
        self._received: Counter[str] = Counter(dict.fromkeys(streams, 0))
        self._dropped: Counter[str] = Counter()
        self._matched = self._superseded = self._repeated = self._jumps = 0
        self._after_jump = False
        self._forget()

    def _forget(self) -> None:
        self._open: OrderedDict[int, _Pending[Item]] = OrderedDict()
        self._echo: OrderedDict[int, dict[str, Item]] = OrderedDict()
        self._closed: deque[int] = deque(maxlen=self._capacity)
        self._seen: deque[int] = deque(maxlen=self._capacity)
        self._newest_ns: int | None = None
        self._newest_of: dict[str, int] = {}

    @property
    def counts(self) -> MatchCounts:
        """A snapshot of the counters."""
        return MatchCounts(
            dict(self._received),
            self._matched,
            self._superseded,
            self._repeated,
            self._jumps,
            dict(self._dropped),
        )

    @property
    def open_count(self) -> int:
        """Number of messages held: those of open sets and possible first messages of a loop."""
        return sum(len(pending.items) for pending in self._open.values()) + sum(map(len, self._echo.values()))

    def clear(self, reason: str) -> None:
        """Drop every open set, counted under ``reason``, and forget all stamps (the clock jumped)."""
        if self._open:
            self._dropped[reason] += len(self._open)
        self._after_jump = True
        self._forget()

    def add(self, stream: str, stamp_ns: int, item: Item) -> MatchedSet[Item] | None:
        """Take one message; return its set when that makes it whole and none newer was handed out."""
        self._received[stream] += 1
        if stamp_ns in self._open:
            return self._fill(stream, stamp_ns, item)
        if stamp_ns in self._closed:
            return self._repeat(stream, stamp_ns, item)
        if self._jumped_back(stream, stamp_ns):
            self._jump()
        self._seen.append(stamp_ns)
        self._open[stamp_ns] = _Pending()
        matched = self._fill(stream, stamp_ns, item)
        self._give_up()
        return matched

    def _jumped_back(self, stream: str, stamp_ns: int) -> bool:
        """Tell whether this very stream, not one that only lags, went behind everything remembered."""
        newest_ns = self._newest_of.get(stream)
        return newest_ns is not None and stamp_ns < newest_ns and stamp_ns < min(self._seen)

    def _fill(self, stream: str, stamp_ns: int, item: Item) -> MatchedSet[Item] | None:
        items = self._open[stamp_ns].items
        if stream in items:
            self._repeated += 1
            return None
        items[stream] = item
        self._newest_of[stream] = max(stamp_ns, self._newest_of.get(stream, stamp_ns))
        if len(items) < len(self.streams):
            return None
        del self._open[stamp_ns]
        self._closed.append(stamp_ns)
        if self._newest_ns is not None and stamp_ns < self._newest_ns:
            self._superseded += 1
            return None
        return self._hand_out(stamp_ns, items)

    def _hand_out(self, stamp_ns: int, items: dict[str, Item]) -> MatchedSet[Item]:
        after_jump, self._after_jump = self._after_jump, False
        self._newest_ns = stamp_ns
        self._matched += 1
        for open_ns, pending in self._open.items():
            pending.overtaken += open_ns < stamp_ns
        self._give_up()
        return MatchedSet(stamp_ns, items, after_jump)

    def _give_up(self) -> None:
        """Drop open sets that are too many, or that newer sets have overtaken ``patience`` times."""
        while self._open:
            stamp_ns, pending = min(self._open.items())
            if len(self._open) <= self._capacity and pending.overtaken < self._patience:
                return
            missing = " and ".join(name for name in self.streams if name not in pending.items)
            self._dropped[f"missing {missing}"] += 1
            self._closed.append(stamp_ns)
            del self._open[stamp_ns]

    def _repeat(self, stream: str, stamp_ns: int, item: Item) -> MatchedSet[Item] | None:
        """A message of a set that is over: repeated, late, or the start of a loop shorter than the memory."""
        self._repeated += 1
        if self._newest_ns is None or stamp_ns >= self._newest_ns:
            return None
        items = self._echo.setdefault(stamp_ns, {})
        items[stream] = item
        if len(items) == len(self.streams):
            return self._loop(stamp_ns)
        if len(self._echo) > self._capacity:
            self._echo.popitem(last=False)
        return None

    def _loop(self, stamp_ns: int) -> MatchedSet[Item]:
        """A whole set came again: start anew with it; messages that came again after it are open sets now."""
        echo = self._echo
        self._jump()
        items = echo.pop(stamp_ns)
        self._repeated -= len(items)
        for later_ns, later in echo.items():
            if later_ns > stamp_ns:
                self._repeated -= len(later)
                self._open[later_ns] = _Pending(later)
                self._seen.append(later_ns)
        self._seen.append(stamp_ns)
        self._closed.append(stamp_ns)
        return self._hand_out(stamp_ns, items)

    def _jump(self) -> None:
        self._jumps += 1
        self.clear("stamps jumped back")
