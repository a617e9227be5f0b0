"""Which fringes each exposure shows: one pattern step by step, or two pitches in turn."""

from __future__ import annotations

from collections.abc import Sequence

from moire_sensor.errors import PatternError
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_steps import needed_frames


class FringeProgramme:
    """Patterns in turn; where there are several, each stays for as many exposures as one result needs."""

    def __init__(self, patterns: Sequence[FringePattern]) -> None:
        self._patterns: tuple[FringePattern, ...] = ()
        self.change(patterns)

    def change(self, patterns: Sequence[FringePattern]) -> None:
        """Begin anew with other patterns; raises PatternError for none."""
        if not patterns:
            raise PatternError("a fringe programme has no pattern; give at least one")
        self._patterns = tuple(patterns)
        self._exposures = 0

    @property
    def patterns(self) -> tuple[FringePattern, ...]:
        """The patterns, in the order in which they are shown."""
        return self._patterns

    def next(self) -> tuple[FringePattern, int]:
        """Return pattern and step of the next exposure, and go on to the one after it."""
        upcoming = self.upcoming
        self._exposures += 1
        return upcoming

    @property
    def upcoming(self) -> tuple[FringePattern, int]:
        """Pattern and step of the next exposure."""
        number = self._exposures
        if len(self._patterns) == 1:
            return self._patterns[0], number % self._patterns[0].step_count
        turns = [needed_frames(pattern.step_count) for pattern in self._patterns]
        number %= sum(turns)
        for pattern, turn in zip(self._patterns, turns, strict=True):
            if number < turn:
                return pattern, number % pattern.step_count
            number -= turn
        raise AssertionError("a number below the sum lies within one of the turns")
