"""A node of one's own among those of a head."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.node import Node

from moire_sensor.ros.executable import use_large_message_profile


@contextmanager
def ros_node(name: str) -> Iterator[Node]:
    """A node in the head's namespace; a mere shutdown would leave its subscriptions, and messages be sent to them."""
    use_large_message_profile()
    rclpy.init()
    try:
        node = rclpy.create_node(name, namespace="head")
        try:
            yield node
        finally:
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
