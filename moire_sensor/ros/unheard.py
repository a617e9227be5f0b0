"""Subscribers that ask for another quality of service than is offered, so that nothing reaches them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import QoSCompatibility, qos_check_compatible

# The middleware has events for this, two a publisher; but rclpy's executor asks each of them anew before every message
# that it takes, and those of a dozen publishers took a quarter of the executor's time.
NO_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)


class UnheardWatch:
    """Look for them now and then, among the subscribers of publishers made with ``NO_EVENTS``."""

    def __init__(self, node: Any, publishers: Iterable[Any]) -> None:
        self._node = node
        self._publishers = tuple(publishers)
        self._known: set[bytes] = set()

    def look(self) -> None:
        """Say once of each such subscriber, in the log, what it asks for and what is offered."""
        found: set[bytes] = set()
        for publisher in self._publishers:
            # Of subscribers that all are reached, nothing more is asked.
            if self._node.count_subscribers(publisher.topic_name) > publisher.get_subscription_count():
                found |= self._of(publisher)
        self._known = found

    def _of(self, publisher: Any) -> set[bytes]:
        topic, found = publisher.topic_name, set()
        offered = self._offered(topic)
        for one in self._node.get_subscriptions_info_by_topic(topic) if offered else ():
            compatible, reason = qos_check_compatible(offered, one.qos_profile)
            if compatible != QoSCompatibility.ERROR:
                continue
            identity = bytes(one.endpoint_gid)
            found.add(identity)
            if identity not in self._known:
                self._node.get_logger().warning(
                    f"a subscriber of {topic} in node {one.node_namespace.rstrip('/')}/{one.node_name} gets nothing: "
                    f"{reason.removeprefix('ERROR: ').rstrip('; ')}; set "
                    f"qos_overrides.{topic}.publisher.* to what it asks for"
                )
        return found

    def _offered(self, topic: str) -> Any:
        """What this node's publisher offers, as the middleware has it: what was left open is filled in there."""
        name, namespace = self._node.get_name(), self._node.get_namespace()
        return next(
            (
                one.qos_profile
                for one in self._node.get_publishers_info_by_topic(topic)
                if (one.node_name, one.node_namespace) == (name, namespace)
            ),
            None,
        )
