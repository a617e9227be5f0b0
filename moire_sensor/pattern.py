"""The projected fringe pattern: intensity over projector device columns."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import PatternError
from moire_sensor.shot import UNKNOWN_ORDER

Waveform = Literal["sine", "square"]
WAVEFORMS: tuple[Waveform, ...] = ("sine", "square")
MIN_PERIOD_PX = 4.0


@dataclass(frozen=True)
class FringePattern:
    """Vertical fringes on the projector device: ``a + b cos(2 pi u / period_px + phase_rad + step)``.

    Parameters
    ----------
    period_px : projector columns per fringe, finite, at least 4.
    phase_rad : phase at column 0, radians, finite.
    step_phases_rad : phase added at each exposure of the programme; one entry is a single shot.
    waveform : ``"sine"``, or ``"square"`` for the sign of the cosine.

    Raises
    ------
    PatternError
        A value that is not finite or outside its range, or an unknown waveform.
    """

    period_px: float
    phase_rad: float = 0.0
    step_phases_rad: tuple[float, ...] = (0.0,)
    waveform: Waveform = "sine"

    def __post_init__(self) -> None:
        object.__setattr__(self, "period_px", finite("period_px", self.period_px))
        object.__setattr__(self, "phase_rad", finite("phase_rad", self.phase_rad))
        object.__setattr__(self, "step_phases_rad", steps(self.step_phases_rad))
        if self.period_px < MIN_PERIOD_PX:
            raise PatternError(f"period_px is {self.period_px}; it must be at least {MIN_PERIOD_PX} projector columns")
        if self.waveform not in WAVEFORMS:
            raise PatternError(f"waveform is {self.waveform!r}; it must be one of {', '.join(WAVEFORMS)}")

    @property
    def step_count(self) -> int:
        """Number of exposures in one cycle of the programme."""
        return len(self.step_phases_rad)

    def with_equal_steps(self, step_count: int) -> FringePattern:
        """Return the same fringes shifted by ``2 pi / step_count`` each exposure."""
        if step_count < 1:
            raise PatternError(f"step_count is {step_count}; it must be at least 1")
        steps = tuple(2.0 * math.pi * step / step_count for step in range(step_count))
        return replace(self, step_phases_rad=steps)

    def phase_at(self, column_px: npt.ArrayLike, step: int = 0) -> npt.NDArray[np.float64]:
        """Unwrapped phase in radians at device columns ``column_px`` (any shape) in exposure ``step``."""
        columns = np.asarray(column_px, dtype=np.float64)
        shift_rad = self.phase_rad + self.step_phases_rad[step % self.step_count]
        return np.asarray(2.0 * np.pi / self.period_px * columns + shift_rad)

    def signal(self, column_px: npt.ArrayLike, step: int = 0) -> npt.NDArray[np.float64]:
        """Return the waveform in -1..1 at device columns ``column_px`` (any shape) in exposure ``step``."""
        wave = np.cos(self.phase_at(column_px, step))
        return np.sign(wave) if self.waveform == "square" else np.asarray(wave)

    def order_at(self, column_px: npt.ArrayLike) -> npt.NDArray[np.int16]:
        """Fringe order ``floor(u / period_px + phase_rad / 2 pi + 1/2)`` of device columns (any shape).

        The step's phase is not in it. -32768 where the column is NaN or too far out to count.
        """
        turns = np.asarray(column_px, dtype=np.float64) / self.period_px + self.phase_rad / (2.0 * np.pi)
        order = np.floor(turns + 0.5)
        known = np.abs(order) < -UNKNOWN_ORDER
        return np.where(known, order, UNKNOWN_ORDER).astype(np.int16)


def finite(name: str, value: float) -> float:
    """Return a number, or raise PatternError naming it."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number) or isinstance(value, (bool, str)):
        raise PatternError(f"{name} is {value!r}; it must be a finite number")
    return number


def steps(phases_rad: Iterable[float]) -> tuple[float, ...]:
    """Return the step phases as a tuple, or raise PatternError."""
    if isinstance(phases_rad, str) or not isinstance(phases_rad, Iterable):
        raise PatternError(f"step_phases_rad is {phases_rad!r}; give a list of radians, (0.0,) for a single shot")
    phases = tuple(finite("a phase of step_phases_rad", phase) for phase in phases_rad)
    if not phases:
        raise PatternError("step_phases_rad is empty; give one entry per exposure, (0.0,) for a single shot")
    return phases
