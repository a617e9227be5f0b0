"""Topics and services of the nodes, asked of the nodes themselves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import rclpy
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy

from moire_sensor.ros.bag_topics import type_name_of
from moire_sensor.ros.executable import use_large_message_profile
from moire_sensor.ros.reconstruction_node import ReconstructionNode
from moire_sim.virtual_head_node import VirtualHeadNode
from tools.ros_domain import isolate_ros

NAMESPACE = "/head/"
# What every ROS node has.
COMMON = ("/parameter_events", "/rosout")
COMMON_SERVICES = ("rcl_interfaces", "type_description_interfaces")


@dataclass(frozen=True)
class Channel:
    """A topic or service of a node: name (relative to the head's namespace), type, and quality ("" for services)."""

    name: str
    type_name: str
    quality: str = ""


@dataclass(frozen=True)
class NodeFacts:
    """What a running node publishes, subscribes to and serves."""

    publishes: tuple[Channel, ...]
    subscribes: tuple[Channel, ...]
    serves: tuple[Channel, ...]


def facts_of_nodes() -> dict[str, NodeFacts]:
    """Start each node with its defaults, in a ROS domain of its own, and return what it has by its name."""
    with isolate_ros():
        use_large_message_profile()
        rclpy.init()
        try:
            with virtual_head() as head, reconstruction() as node:
                return {"virtual_head": facts_of(head), "reconstruction": facts_of(node)}
        finally:
            rclpy.try_shutdown()


@contextmanager
def virtual_head() -> Iterator[Any]:
    """The simulated head."""
    node = VirtualHeadNode()
    try:
        yield node
    finally:
        node.close()
        node.destroy_node()


@contextmanager
def reconstruction() -> Iterator[Any]:
    """The reconstruction, active: before, it has no topics."""
    node = ReconstructionNode()
    try:
        node.trigger_configure()
        node.trigger_activate()
        yield node
    finally:
        node.close()
        node.destroy_node()


def facts_of(node: Any) -> NodeFacts:
    """Return what a node has, in the order in which it made it."""
    return NodeFacts(
        tuple(topic_of(one) for one in node.publishers if one.topic_name not in COMMON),
        tuple(topic_of(one) for one in node.subscriptions if one.topic_name not in COMMON),
        tuple(
            Channel(relative(one.service_name), service_type(one.srv_type))
            for one in node.services
            if not one.srv_type.__module__.startswith(COMMON_SERVICES)
        ),
    )


def topic_of(end: Any) -> Channel:
    """Return the topic of a publisher or a subscription."""
    profile = end.qos_profile
    words = "reliable" if profile.reliability == QoSReliabilityPolicy.RELIABLE else "best effort"
    if profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL:
        words += ", latched"
    return Channel(relative(end.topic_name), type_name_of(end.msg_type), f"{words}, last {profile.depth}")


def relative(name: str) -> str:
    """Return a name as it is written in the head's namespace."""
    return name.removeprefix(NAMESPACE)


def service_type(kind: Any) -> str:
    """Return the name of a service class, such as ``"std_srvs/srv/SetBool"``."""
    return f"{kind.__module__.partition('.')[0]}/srv/{kind.__name__}"
