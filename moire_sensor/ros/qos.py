"""Quality of service: drivers publish reliable, consumers subscribe with sensor data (REP 2003)."""

from __future__ import annotations

from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    QoSReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

PUBLISHER_DEPTH = 5
INPUT_DEPTH = 5
RELIABLE_INPUT_DEPTH = 10
OVERRIDABLE = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)


def publisher_qos() -> QoSProfile:
    """Reliable, keep the last 5."""
    return QoSProfile(depth=PUBLISHER_DEPTH, reliability=QoSReliabilityPolicy.RELIABLE)


def latched_qos() -> QoSProfile:
    """Reliable, and the last message also reaches those who come later."""
    return QoSProfile(
        depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
    )


def input_qos(reliable: bool) -> QoSProfile:
    """Sensor data with depth 5; reliable with depth 10 where nothing may be lost (demo, bags)."""
    if reliable:
        return QoSProfile(depth=RELIABLE_INPUT_DEPTH, reliability=QoSReliabilityPolicy.RELIABLE)
    return QoSProfile(
        depth=INPUT_DEPTH,
        history=QoSHistoryPolicy.KEEP_LAST,
        reliability=QoSReliabilityPolicy.BEST_EFFORT,
    )


def overridable() -> QoSOverridingOptions:
    """Let the user override each policy by ``qos_overrides`` parameters."""
    return QoSOverridingOptions(OVERRIDABLE)


def publisher_maker(node: Any) -> Any:
    """Return the node's method that makes publishers; those of a managed node publish only while it is active."""
    return node.create_lifecycle_publisher if isinstance(node, LifecycleNode) else node.create_publisher


def destroy_publisher(node: Any, publisher: Any) -> None:
    """Give back what ``publisher_maker`` made."""
    managed = isinstance(node, LifecycleNode)
    (node.destroy_lifecycle_publisher if managed else node.destroy_publisher)(publisher)
