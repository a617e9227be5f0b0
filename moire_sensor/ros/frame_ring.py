"""The frames of a phase-shift programme that are decoded together; no ROS needed."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Generic, TypeVar

from moire_sensor.pattern import FringePattern
from moire_sensor.phase_steps import needed_frames
from moire_sensor.ros.projector_state import ProjectorState

Item = TypeVar("Item")


@dataclass(frozen=True)
class Frame(Generic[Item]):
    """One exposure: its stamp, what the projector showed, and its images."""

    stamp_ns: int
    state: ProjectorState
    item: Item


class FrameRing(Generic[Item]):
    """Keep the last consecutive frames of one programme; a gap, a repeat or a new pattern starts anew."""

    def __init__(self) -> None:
        self._frames: deque[Frame[Item]] = deque()

    def clear(self) -> None:
        """Forget all frames (stamps jumped back)."""
        self._frames.clear()

    def add(self, frame: Frame[Item]) -> tuple[Frame[Item], ...] | None:
        """Take the next frame; return the newest frames once there are as many as one result needs."""
        if self._frames and not self._continues(frame):
            self._frames.clear()
        self._frames.append(frame)
        needed = needed_frames(frame.state.step_count)
        while len(self._frames) > needed:
            self._frames.popleft()
        return tuple(self._frames) if len(self._frames) == needed else None

    def _continues(self, frame: Frame[Item]) -> bool:
        """Tell whether a frame follows the last one in the same programme, with none lost between."""
        last, state = self._frames[-1], frame.state
        next_step = (last.state.step_index + 1) % last.state.step_count
        same_programme = replace(
            state, fringe_phase_rad=last.state.fringe_phase_rad, step_index=last.state.step_index
        ) == last.state
        if not same_programme or state.step_index != next_step or frame.stamp_ns <= last.stamp_ns:
            return False
        if any(old.state.step_index == state.step_index and old.state != state for old in self._frames):
            return False
        return not self._programme_was_lost(frame)

    def _programme_was_lost(self, frame: Frame[Item]) -> bool:
        """Tell whether a whole programme may be missing: the step fits but the pause is as long as that."""
        if len(self._frames) < 2:
            return False
        stamps = [old.stamp_ns for old in self._frames]
        shortest = min(late - early for early, late in pairwise(stamps))
        return frame.stamp_ns - stamps[-1] > max(2, frame.state.step_count) * shortest


def pattern_of(states: tuple[ProjectorState, ...]) -> tuple[FringePattern, int]:
    """Return pattern and first step for frames that are decoded together, from their own states alone.

    Several frames must show each step at least once; step 0 gives the pattern's phase, the others are relative to
    it. A single frame of a longer programme cannot know the phase of step 0: its fringe orders count from phase 0,
    so that they do not change from step to step.
    """
    first = states[0]
    if first.step_count == 1:
        return first.pattern(), 0
    if len(states) == 1:
        steps: tuple[float, ...] = (first.fringe_phase_rad,)
        return FringePattern(first.fringe_period_px, 0.0, steps, first.waveform), 0
    phases = {state.step_index: state.fringe_phase_rad for state in states}
    steps = tuple(phases[index] - phases[0] for index in range(first.step_count))
    return FringePattern(first.fringe_period_px, phases[0], steps, first.waveform), first.step_index
