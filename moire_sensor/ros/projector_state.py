"""The projector's state of one exposure, carried as name and position pairs of ``sensor_msgs/JointState``."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from moire_sensor.errors import PatternError
from moire_sensor.pattern import WAVEFORMS, FringePattern, Waveform

FORMAT_VERSION = 1
REQUIRED = (
    "format_version", "fringe_period_px", "fringe_phase_rad", "step_index", "step_count", "waveform", "laser_on",
)  # fmt: skip
# Told by a head whose scene or capture has a known working range; a receiver may use or ignore it.
DEPTH_RANGE = ("min_depth_m", "max_depth_m")
MAX_STEP_COUNT = 64
MAX_NAMES = 1000


@dataclass(frozen=True)
class ProjectorState:
    """What the projector showed during one exposure.

    Attributes
    ----------
    fringe_period_px : projector columns per fringe.
    fringe_phase_rad : phase at column 0 in this exposure, its step included, radians.
    step_index : number of this exposure in the programme, 0 to step_count - 1.
    step_count : exposures of one programme; 1 for a single shot.
    waveform : ``"sine"`` or ``"square"``.
    laser_on : False for a fringe-free view.
    depth_range_m : working range that the head knows, metres, or None.
    """

    fringe_period_px: float
    fringe_phase_rad: float
    step_index: int = 0
    step_count: int = 1
    waveform: Waveform = "sine"
    laser_on: bool = True
    depth_range_m: tuple[float, float] | None = None

    def pattern(self) -> FringePattern:
        """Return the pattern of a single-shot programme; raises PatternError where it cannot be projected."""
        return FringePattern(self.fringe_period_px, self.fringe_phase_rad, waveform=self.waveform)


def state_of_exposure(
    pattern: FringePattern,
    step_index: int,
    laser_on: bool = True,
    depth_range_m: tuple[float, float] | None = None,
) -> ProjectorState:
    """Return the state while ``pattern`` is shown in step ``step_index``."""
    phase_rad = pattern.phase_rad + pattern.step_phases_rad[step_index]
    return ProjectorState(
        pattern.period_px, phase_rad, step_index, pattern.step_count, pattern.waveform, laser_on, depth_range_m
    )


def state_message(header: Header, state: ProjectorState) -> JointState:
    """Return the message of a state."""
    pairs = {
        "format_version": FORMAT_VERSION,
        "fringe_period_px": state.fringe_period_px,
        "fringe_phase_rad": state.fringe_phase_rad,
        "step_index": state.step_index,
        "step_count": state.step_count,
        "waveform": WAVEFORMS.index(state.waveform),
        "laser_on": state.laser_on,
    }
    if state.depth_range_m is not None:
        pairs |= dict(zip(DEPTH_RANGE, state.depth_range_m, strict=True))
    return JointState(header=header, name=list(pairs), position=[float(value) for value in pairs.values()])


def projector_state(message: JointState) -> ProjectorState:
    """Return the state of a message; names that are not known are ignored.

    Raises
    ------
    PatternError
        A name that is missing or given twice, positions of another number, or a value outside its range.
    """
    values = _values(message)
    version = values["format_version"]
    if version != FORMAT_VERSION:
        raise PatternError(f"projector/state has format_version {version:g}; this node reads {FORMAT_VERSION}")
    step_count = _whole(values, "step_count", 1, MAX_STEP_COUNT)
    return ProjectorState(
        values["fringe_period_px"],
        values["fringe_phase_rad"],
        _whole(values, "step_index", 0, step_count - 1),
        step_count,
        WAVEFORMS[_whole(values, "waveform", 0, len(WAVEFORMS) - 1)],
        bool(_whole(values, "laser_on", 0, 1)),
        _depth_range_m(values),
    )


def _values(message: JointState) -> dict[str, float]:
    """Return the known names with their finite values."""
    names = list(message.name)
    if len(names) != len(message.position) or len(names) > MAX_NAMES:
        raise PatternError(
            f"projector/state has {len(names)} names and {len(message.position)} positions; give as many of each, "
            f"at most {MAX_NAMES}"
        )
    known = [name for name in names if name in REQUIRED + DEPTH_RANGE]
    missing = [name for name in REQUIRED if name not in known]
    if missing:
        raise PatternError(f"projector/state lacks {', '.join(missing)}; the head must publish all of them")
    if len(known) != len(set(known)):
        twice = sorted({name for name in known if known.count(name) > 1})
        raise PatternError(f"projector/state names {', '.join(twice)} more than once; give each name once")
    values = {name: float(value) for name, value in zip(names, message.position, strict=True) if name in known}
    for name, value in values.items():
        if not math.isfinite(value):
            raise PatternError(f"{name} in projector/state is {value}; it must be a finite number")
    return values


def _whole(values: dict[str, float], name: str, low: int, high: int) -> int:
    value = values[name]
    if value != math.floor(value) or not low <= value <= high:
        raise PatternError(f"{name} in projector/state is {value:g}; it must be a whole number from {low} to {high}")
    return int(value)


def _depth_range_m(values: dict[str, float]) -> tuple[float, float] | None:
    if not all(name in values for name in DEPTH_RANGE):
        return None
    near_m, far_m = (values[name] for name in DEPTH_RANGE)
    if not 0.0 < near_m < far_m:
        raise PatternError(f"projector/state gives the depth range {near_m:g} to {far_m:g} m; 0 < min < max is needed")
    return near_m, far_m
