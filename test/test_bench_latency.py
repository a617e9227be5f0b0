"""The benchmark over DDS: what its figures mean; the runs themselves are part of ``make bench``."""

from __future__ import annotations

import math

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ros_process import ros_node, spin_until
from sensor_msgs.msg import PointCloud2

from tools.bench.figures import latency_table
from tools.bench.latency import CASES, LatencyRecord
from tools.node_counts import dropped_counts, set_counts


def report(concern: str, **counts: int) -> DiagnosticStatus:
    pairs = [KeyValue(key=name.replace("_", " "), value=str(number)) for name, number in counts.items()]
    return DiagnosticStatus(name=f"reconstruction: {concern}", values=pairs)


def test_a_row_tells_of_sets_rate_and_percentiles() -> None:
    record = LatencyRecord(CASES[0], 101, 101, 0, 0, 29.96, tuple(0.001 * number for number in range(101)))
    row = latency_table([record], "").rows[0]
    assert row == ("all outputs, 30 Hz", "101", "101", "0", "0", "30.0", "50.0", "99.0")


def test_where_nothing_came_there_is_no_latency() -> None:
    record = LatencyRecord(CASES[1], 5, 0, 5, 0, math.nan, ())
    assert latency_table([record], "").rows[0][-3:] == ("-", "-", "-")


def test_every_set_is_counted_by_what_became_of_it() -> None:
    sets = report("reconstruction", matched=9, reconstructed=4, superseded=2, unwatched=1, gathering=0)
    sets.values.append(KeyValue(key="refused: bad image", value="2"))
    lost = report("input", matched=9)
    lost.values.append(KeyValue(key="dropped: missing right", value="3"))
    message = DiagnosticArray(status=[lost, sets])
    counts = set_counts(message)
    assert (counts["matched"], counts["ended"], counts["refused: bad image"]) == (9, 9, 2)
    assert dropped_counts(message) == {"dropped: missing right": 3}
    assert set_counts(DiagnosticArray()) == {} == dropped_counts(DiagnosticArray())


def test_what_one_case_subscribed_is_not_published_in_the_next() -> None:
    context = rclpy.Context()
    context.init()
    observer = rclpy.create_node("observer", context=context, namespace="head")
    try:
        with ros_node("bench") as node:
            node.create_subscription(PointCloud2, "points", lambda _: None, 1)
            spin_until(observer, lambda: observer.count_subscribers("points") == 1, "the subscription")
        spin_until(observer, lambda: observer.count_subscribers("points") == 0, "its end")
    finally:
        observer.destroy_node()
        context.try_shutdown()
