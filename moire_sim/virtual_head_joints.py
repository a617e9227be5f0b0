"""Pan and tilt of the virtual head on ROS: ``joint_trajectory`` in, ``joint_states`` of each exposure out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from moire_sensor.ros.diagnostics import OK, WARN, status_of
from moire_sensor.ros.qos import input_qos, overridable, publisher_qos
from moire_sim.errors import TrajectoryError
from moire_sim.head_motion import HeadMotion
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT
from moire_sim.render_maths import quaternion
from moire_sim.turns import NANOSECONDS
from moire_sim.virtual_head import VirtualHead


class HeadJoints:
    """Turn the head as trajectories command it, always to where the joints are at an exposure's stamp."""

    def __init__(self, node: Any, head: VirtualHead) -> None:
        self._node, self._head = node, head
        at_rest = dict(zip((PAN_JOINT, TILT_JOINT), head.pan_tilt_rad, strict=True))
        self._motion = HeadMotion(head.joint_limits, at_rest)
        self._accepted = self._refused = self._reported = 0
        self._last_refusal = "none"
        self._states = node.create_publisher(
            JointState, "joint_states", publisher_qos(), qos_overriding_options=overridable()
        )
        qos = input_qos(reliable=True)
        node.create_subscription(
            JointTrajectory, "joint_trajectory", self._follow, qos, qos_overriding_options=overridable()
        )

    def turn(self, stamp: Time) -> None:
        """Turn the head to its pose at an exposure's stamp, and publish that."""
        states = self._motion.at(stamp.nanoseconds)
        self._head.set_head(*(states[name][0] for name in (PAN_JOINT, TILT_JOINT)))
        positions, velocities = ([float(value) for value in values] for values in zip(*states.values(), strict=True))
        header = Header(stamp=stamp.to_msg())
        self._states.publish(JointState(header=header, name=list(states), position=positions, velocity=velocities))

    def after(self, stamp: Time) -> Callable[[float], tuple[float, float]]:
        """Return what tells pan and tilt, rad, so many seconds after a stamp, as the trajectory under way has it."""

        def joints(offset_s: float) -> tuple[float, float]:
            states = self._motion.at(stamp.nanoseconds + round(offset_s * NANOSECONDS))
            return states[PAN_JOINT][0], states[TILT_JOINT][0]

        return joints

    def status(self) -> DiagnosticStatus:
        """Status of the joints: where they are now, and the trajectories followed and refused."""
        now_ns = self._node.get_clock().now().nanoseconds
        moving = self._motion.is_moving(now_ns)
        values: dict[str, Any] = {f"{name} rad": state[0] for name, state in self._motion.at(now_ns).items()}
        values |= {"moving": moving, "accepted": self._accepted, "refused": self._refused}
        values["last refusal"] = self._last_refusal
        new, self._reported = self._refused - self._reported, self._refused
        if new:
            return status_of("joints", WARN, "a trajectory was refused in the last period", values)
        return status_of("joints", OK, "moving" if moving else "at rest", values)

    def _follow(self, message: JointTrajectory) -> None:
        try:
            self._motion.command(message, self._node.get_clock().now().nanoseconds)
        except TrajectoryError as error:
            self._refused += 1
            self._last_refusal = str(error)
            self._node.get_logger().warning(f"trajectory refused: {error}")
            return
        self._accepted += 1


class BasePose:
    """Tell where a head on a moving base is: ``base_pose`` (geometry_msgs/PoseStamped) of each exposure.

    It is the pose of ``head_base_link`` in a frame ``odom``, where ``head_base_link`` was at the scene's time 0.
    """

    def __init__(self, node: Any, head: VirtualHead, frame_prefix: str) -> None:
        self._head, self._frame = head, f"{frame_prefix}odom"
        self._publisher = None
        if head.base_moves:
            self._publisher = node.create_publisher(
                PoseStamped, "base_pose", publisher_qos(), qos_overriding_options=overridable()
            )

    def publish(self, stamp: Any) -> None:
        """Publish the pose at an exposure's stamp; nothing where the base stands still."""
        if self._publisher is None:
            return
        pose = self._head.world_from_base
        x, y, z = pose[:3, 3].tolist()
        qx, qy, qz, qw = quaternion(pose[:3, :3])
        place = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
        self._publisher.publish(PoseStamped(header=Header(stamp=stamp, frame_id=self._frame), pose=place))
