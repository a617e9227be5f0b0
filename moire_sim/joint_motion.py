"""Motion of one joint through points in time: straight between them, cubic where velocities are given."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
# Of the URDF, which alone holds their places, axes and limits.
PAN_JOINT, TILT_JOINT = "head_pan_joint", "head_tilt_joint"
# Times come in whole nanoseconds and angles in rounded decimals: who asks for just the limit may miss it by that.
SLACK = 1e-6


@dataclass(frozen=True)
class JointLimit:
    """What a joint can do: ``low_rad`` to ``high_rad``, at most ``speed_rad_s`` either way."""

    low_rad: float
    high_rad: float
    speed_rad_s: float


@dataclass(frozen=True)
class Knot:
    """Where a joint is at a time in seconds; ``velocity_rad_s`` is None where it was not given."""

    time_s: float
    position_rad: float
    velocity_rad_s: float | None = None


@dataclass(frozen=True)
class JointMotion:
    """A joint's way through knots of rising times; before the first and after the last one it rests."""

    knots: tuple[Knot, ...]

    def at(self, time_s: float) -> tuple[float, float]:
        """Position in rad and velocity in rad/s at a time; a knot's own time gives its position exactly."""
        after = bisect_right(self.knots, time_s, key=lambda knot: knot.time_s)
        if after in (0, len(self.knots)):
            return self.knots[max(after - 1, 0)].position_rad, 0.0
        start, end = self.knots[after - 1], self.knots[after]
        duration_s = end.time_s - start.time_s
        share = (time_s - start.time_s) / duration_s
        offset, linear, square, cube = cubic(start, end).tolist()
        position = offset + share * (linear + share * (square + share * cube))
        return position, (linear + share * (2.0 * square + share * 3.0 * cube)) / duration_s

    def complaint(self, limit: JointLimit) -> str:
        """Say how the motion leaves the limits anywhere on its way, or "" where it does not."""
        for start, end in zip(self.knots, self.knots[1:], strict=False):
            lowest, highest, fastest = extremes(start, end)
            if lowest < limit.low_rad - SLACK or highest > limit.high_rad + SLACK:
                furthest = lowest if lowest < limit.low_rad - SLACK else highest
                return f"goes to {furthest:.4g} rad; it must stay within {limit.low_rad:g} to {limit.high_rad:g}"
            if fastest > limit.speed_rad_s * (1.0 + SLACK):
                return f"moves at {fastest:.4g} rad/s; at most {limit.speed_rad_s:g}: give it more time"
        return ""


def cubic(start: Knot, end: Knot) -> Array:
    """Coefficients (4,), lowest first, of the position in rad over the share 0 to 1 of a segment's time.

    Hermite's cubic where both ends have a velocity, else a straight line.
    """
    way = end.position_rad - start.position_rad
    if start.velocity_rad_s is None or end.velocity_rad_s is None:
        return np.array([start.position_rad, way, 0.0, 0.0])
    duration_s = end.time_s - start.time_s
    first, last = start.velocity_rad_s * duration_s, end.velocity_rad_s * duration_s
    return np.array([start.position_rad, first, 3.0 * way - 2.0 * first - last, first + last - 2.0 * way])


def extremes(start: Knot, end: Knot) -> tuple[float, float, float]:
    """Lowest and highest position in rad, and highest speed in rad/s, from one knot to the next."""
    position = cubic(start, end)
    velocity = position[1:] * [1.0, 2.0, 3.0]
    turns = inner_roots(*velocity.tolist())
    positions = [start.position_rad, end.position_rad, *values_at(turns, position)]
    steepest = inner_roots(velocity[1], 2.0 * velocity[2], 0.0)
    speeds = np.abs(values_at(np.array([0.0, 1.0, *steepest]), velocity))
    return min(positions), max(positions), float(speeds.max()) / (end.time_s - start.time_s)


def values_at(parts: Array, coefficients: Array) -> Array:
    """Values (n,) of a polynomial, constant term first, at parts (n,) of the way."""
    return np.asarray(np.vander(parts, coefficients.size, increasing=True) @ coefficients)


def inner_roots(constant: float, linear: float, square: float) -> Array:
    """Real roots within 0 to 1 of a polynomial of second degree, without cancellation."""
    under = linear * linear - 4.0 * square * constant
    if under < 0.0:
        return np.empty(0)
    q = -0.5 * (linear + np.copysign(np.sqrt(under), linear))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        roots = np.array([np.divide(q, square), np.divide(constant, q)])
    return roots[(roots > 0.0) & (roots < 1.0)]
