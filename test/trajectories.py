"""Trajectories of pan and tilt as messages."""

from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Duration, Time
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT
from moire_sim.turns import NANOSECONDS


def trajectory(
    times_s: Sequence[float],
    positions_rad: Sequence[Sequence[float]],
    velocities_rad_s: Sequence[Sequence[float]] = (),
    names: Sequence[str] = (PAN_JOINT, TILT_JOINT),
    stamp_ns: int = 0,
) -> JointTrajectory:
    """A message with a point for each time; ``velocities_rad_s`` for all points or for none."""
    points = [
        JointTrajectoryPoint(
            positions=[float(value) for value in positions],
            velocities=[float(value) for value in velocities],
            time_from_start=Duration(
                sec=round(time_s * NANOSECONDS) // NANOSECONDS, nanosec=round(time_s * NANOSECONDS) % NANOSECONDS
            ),
        )
        for time_s, positions, velocities in zip(
            times_s, positions_rad, velocities_rad_s or [()] * len(times_s), strict=True
        )
    ]
    stamp = Time(sec=stamp_ns // NANOSECONDS, nanosec=stamp_ns % NANOSECONDS)
    return JointTrajectory(header=Header(stamp=stamp), joint_names=list(names), points=points)
