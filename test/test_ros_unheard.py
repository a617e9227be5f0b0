"""Subscribers that a publisher's quality of service keeps apart from it: each is named once."""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from ros_process import ros_node, spin_until
from std_msgs.msg import Header

from moire_sensor.ros.qos import publisher_qos
from moire_sensor.ros.unheard import NO_EVENTS, UnheardWatch

KEPT = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class Log:
    """Keeps what is warned of."""

    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


def test_a_subscriber_that_gets_nothing_is_named_once_and_again_when_it_comes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = Log()
    with ros_node("speaker") as node:
        publisher = node.create_publisher(Header, "said", publisher_qos(), event_callbacks=NO_EVENTS)
        assert not publisher.event_handlers
        monkeypatch.setattr(node, "get_logger", lambda: log)
        watch = UnheardWatch(node, [publisher])
        node.create_subscription(Header, "said", ignore, 1)
        spin_until(node, lambda: publisher.get_subscription_count() == 1, "the subscriber that is heard")
        watch.look()
        for times in (1, 2):
            deaf = node.create_subscription(Header, "said", ignore, KEPT)
            spin_until(node, lambda: node.count_subscribers("said") == 2, "the one that is not")
            watch.look()
            watch.look()
            assert len(log.warnings) == times
            node.destroy_subscription(deaf)
            spin_until(node, lambda: node.count_subscribers("said") == 1, "its end")
            watch.look()
    topic = publisher_topic(log.warnings[0])
    assert "/speaker gets nothing" in log.warnings[0]
    assert "durability" in log.warnings[0].lower() or "transient local" in log.warnings[0].lower()
    assert f"qos_overrides.{topic}.publisher.*" in log.warnings[0]


def ignore(_: Any) -> None:
    """What comes does not matter."""


def publisher_topic(warning: str) -> str:
    """Topic that a warning is about."""
    return warning.split(" of ")[1].split(" ")[0]
