"""Pan and tilt of the head over time, as ``trajectory_msgs/JointTrajectory`` messages command them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from moire_sim.errors import TrajectoryError
from moire_sim.joint_motion import JointLimit, JointMotion, Knot
from moire_sim.turns import NANOSECONDS

MAX_POINTS = 1000


class HeadMotion:
    """Where each joint is at any time, and the trajectory that it follows.

    Times are nanoseconds of one clock, the one that the exposures are stamped with.

    Parameters
    ----------
    limits : of each joint, by name.
    positions_rad : where each joint rests at first.
    """

    def __init__(self, limits: Mapping[str, JointLimit], positions_rad: Mapping[str, float]) -> None:
        self._limits = dict(limits)
        self._motions = {name: JointMotion((Knot(0.0, positions_rad[name]),)) for name in limits}
        self._start_ns = 0

    def at(self, time_ns: int) -> dict[str, tuple[float, float]]:
        """Position in rad and velocity in rad/s of each joint."""
        return {name: self._joint_at(name, time_ns) for name in self._limits}

    def is_moving(self, time_ns: int) -> bool:
        """Tell whether a trajectory has not come to its end."""
        time_s = (time_ns - self._start_ns) / NANOSECONDS
        return any(time_s < motion.knots[-1].time_s for motion in self._motions.values())

    def command(self, message: Any, now_ns: int) -> None:
        """Follow a JointTrajectory from now on, in place of the one under way.

        Each point is due at the header's stamp, or now where that is zero, plus ``time_from_start``. The way there
        starts where the joints are; points that are due by now are passed over. Joints that are not named rest.
        Accelerations and efforts are not used: the simulated joints follow exactly.

        Raises
        ------
        TrajectoryError
            An unknown or repeated joint, no point, numbers missing, NaN or outside the joint's limits anywhere on the
            way, times that do not rise, or all past. The trajectory under way then goes on.
        """
        names = checked_names(message.joint_names, self._limits)
        times_ns = checked_times(message.points)
        stamp_ns = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
        late_ns = now_ns - (stamp_ns or now_ns)
        ahead = [index for index, time_ns in enumerate(times_ns) if time_ns > late_ns]
        if not ahead:
            raise TrajectoryError(
                f"the last point is due {(late_ns - times_ns[-1]) / NANOSECONDS:.4g} s ago; give a time_from_start "
                "above zero, and a stamp of zero to start at once"
            )
        states = {name: self._joint_at(name, now_ns) for name in self._limits}
        motions = {name: JointMotion((Knot(0.0, position),)) for name, (position, _) in states.items()}
        for column, name in enumerate(names):
            knots = [knot_of(message.points[index], index, column, names) for index in range(len(times_ns))]
            later = [Knot((times_ns[index] - late_ns) / NANOSECONDS, *knots[index]) for index in ahead]
            motions[name] = JointMotion((Knot(0.0, *states[name]), *later))
            complaint = motions[name].complaint(self._limits[name]) or end_complaint(later[-1])
            if complaint:
                raise TrajectoryError(f"joint {name} {complaint}")
        self._motions, self._start_ns = motions, now_ns

    def _joint_at(self, name: str, time_ns: int) -> tuple[float, float]:
        position, velocity = self._motions[name].at((time_ns - self._start_ns) / NANOSECONDS)
        limit = self._limits[name]
        # The check leaves room for rounding; the joint does not.
        return min(max(position, limit.low_rad), limit.high_rad), velocity


def checked_names(given: Sequence[str], known: Mapping[str, JointLimit]) -> list[str]:
    """Return the joints that a trajectory names, or raise TrajectoryError."""
    for name in given:
        if name not in known:
            raise TrajectoryError(f"unknown joint {name!r}; the joints are {', '.join(known)}")
    if not given or len(set(given)) < len(given):
        names = ", ".join(given) or "none"
        raise TrajectoryError(f"joint_names are {names}; name each joint that moves once: {', '.join(known)}")
    return list(given)


def checked_times(points: Sequence[Any]) -> list[int]:
    """Return ``time_from_start`` of each point in nanoseconds, or raise TrajectoryError where they do not rise."""
    if not 1 <= len(points) <= MAX_POINTS:
        raise TrajectoryError(f"the trajectory has {len(points)} points; it must have 1 to {MAX_POINTS}")
    times_ns = [point.time_from_start.sec * NANOSECONDS + point.time_from_start.nanosec for point in points]
    for index, (before, after) in enumerate(zip([-1, *times_ns], times_ns, strict=False)):
        if after <= before:
            bound = f"later than the {before / NANOSECONDS:g} s before it" if index else "0 or more"
            raise TrajectoryError(f"time_from_start of point {index} is {after / NANOSECONDS:g} s; it must be {bound}")
    return times_ns


def knot_of(point: Any, index: int, column: int, names: Sequence[str]) -> tuple[float, float | None]:
    """Return position in rad and velocity in rad/s, None where not given, of one joint at a point.

    Raises
    ------
    TrajectoryError
        Positions or velocities of another number than the joints, or not finite.
    """
    if len(point.positions) != len(names) or len(point.velocities) not in (0, len(names)):
        raise TrajectoryError(
            f"point {index} has {len(point.positions)} positions and {len(point.velocities)} velocities for "
            f"{len(names)} joint(s); give a position for each, and a velocity for each or for none"
        )
    position = float(point.positions[column])
    velocity = float(point.velocities[column]) if len(point.velocities) else None
    if not (math.isfinite(position) and math.isfinite(velocity or 0.0)):
        raise TrajectoryError(
            f"point {index} gives {names[column]} the position {position} and the velocity {velocity}; both must be "
            "finite numbers"
        )
    return position, velocity


def end_complaint(last: Knot) -> str:
    """Say that a motion does not end at rest, or "" where it does."""
    if not last.velocity_rad_s:
        return ""
    return f"ends at {last.velocity_rad_s:.4g} rad/s; it must end at rest, with velocity 0"
