"""The reconstruction as a managed node, asked through the services that ``ros2 lifecycle`` uses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rcl_interfaces.srv import DescribeParameters, ListParameters
from ros_head import Exposure, TestHead, pixels, running, stamp_of
from ros_process import ros_node
from sensor_msgs.msg import Image

from moire_sensor import Reconstructor
from moire_sensor.ros.result_messages import TOPICS
from moire_sim.analytic_scenes import analytic_capture

DEPTH = "depth/image_rect"
INPUTS = ("left/image_raw", "right/image_raw", "projector/state", "left/camera_info")
CAPTURE = analytic_capture("plane_1000")


@pytest.fixture(scope="module")
def head() -> Iterator[TestHead]:
    process = running("reconstruction", "autostart:=false", "reliable_input:=true", "diagnostics_period_s:=0.1")
    with process, ros_node("test_head") as node:
        under_test = TestHead(node)
        under_test.listen(DEPTH, Image)
        under_test.listen("/diagnostics", DiagnosticArray)
        yield under_test


def state(head: TestHead) -> int:
    answer = head.call(GetState, "reconstruction/get_state", GetState.Request())
    return int(answer.current_state.id)


def change(head: TestHead, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(head.call(ChangeState, "reconstruction/change_state", request).success)


def wait_for_ends(head: TestHead, publishers: int, subscriptions: int) -> None:
    """Wait until the graph shows so many ends of the reconstruction on each of its topics."""
    own = {"/diagnostics": 0}

    def settled() -> bool:
        outputs = [len(own_ends(head.node.get_publishers_info_by_topic(name(head, topic)))) for topic in TOPICS]
        inputs = [len(own_ends(head.node.get_subscriptions_info_by_topic(name(head, topic)))) for topic in INPUTS]
        own.update(zip((*TOPICS, *INPUTS), (*outputs, *inputs), strict=True))
        return set(outputs) == {publishers} and {bool(count) for count in inputs} == {bool(subscriptions)}

    head.wait(settled, f"{publishers} publishers and {subscriptions} subscriptions of the node")


def own_ends(ends: list[Any]) -> list[Any]:
    return [one for one in ends if one.node_name == "reconstruction"]


def name(head: TestHead, topic: str) -> str:
    return str(head.node.resolve_topic_name(topic))


def test_it_waits_unconfigured_and_refuses_what_is_out_of_place(head: TestHead) -> None:
    assert state(head) == State.PRIMARY_STATE_UNCONFIGURED
    for transition in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE, 222):
        assert not change(head, transition)
    assert state(head) == State.PRIMARY_STATE_UNCONFIGURED
    wait_for_ends(head, 0, 0)


def test_configure_makes_publishers_and_activate_subscribes(head: TestHead) -> None:
    assert change(head, Transition.TRANSITION_CONFIGURE)
    assert state(head) == State.PRIMARY_STATE_INACTIVE
    wait_for_ends(head, 1, 0)
    assert change(head, Transition.TRANSITION_ACTIVATE)
    assert state(head) == State.PRIMARY_STATE_ACTIVE
    wait_for_ends(head, 1, 1)
    head.wait_for_subscribers()
    depth_m = pixels(head.answer(DEPTH, head.send(Exposure.of(CAPTURE))))
    expected = Reconstructor(CAPTURE.rig, CAPTURE.pattern).reconstruct(CAPTURE.left, CAPTURE.right)
    np.testing.assert_array_equal(depth_m, expected.depth_m)


def test_an_inactive_node_publishes_nothing_and_goes_on_when_activated(head: TestHead) -> None:
    assert change(head, Transition.TRANSITION_DEACTIVATE)
    silence_begins = head.node.get_clock().now().nanoseconds
    wait_for_ends(head, 1, 0)
    unheard = {head.send(Exposure.of(CAPTURE)) for _ in range(5)}
    assert state(head) == State.PRIMARY_STATE_INACTIVE
    silence_ends = head.node.get_clock().now().nanoseconds
    assert change(head, Transition.TRANSITION_ACTIVATE)
    head.wait_for_subscribers()
    head.answer(DEPTH, head.send(Exposure.of(CAPTURE)))
    reported = [stamp_of(message) for message in head.received["/diagnostics"]]
    assert min(reported) < silence_begins
    assert max(reported) > silence_ends
    assert not [stamp for stamp in reported if silence_begins < stamp < silence_ends]
    assert unheard.isdisjoint(map(stamp_of, head.received[DEPTH]))
    # Counts begin anew with each activation: a first set without light was sent until one arrived.
    head.wait_for_count("reconstruction", "reconstructed", 1)


def test_cleanup_gives_everything_back_and_shutdown_ends_it(head: TestHead) -> None:
    assert change(head, Transition.TRANSITION_DEACTIVATE)
    assert change(head, Transition.TRANSITION_CLEANUP)
    assert state(head) == State.PRIMARY_STATE_UNCONFIGURED
    wait_for_ends(head, 0, 0)
    assert change(head, Transition.TRANSITION_CONFIGURE)
    assert change(head, Transition.TRANSITION_INACTIVE_SHUTDOWN)
    assert state(head) == State.PRIMARY_STATE_FINALIZED
    wait_for_ends(head, 0, 0)
    answer = head.call(
        GetAvailableTransitions, "reconstruction/get_available_transitions", GetAvailableTransitions.Request()
    )
    assert not answer.available_transitions
    assert not change(head, Transition.TRANSITION_CONFIGURE)


def test_every_parameter_of_the_node_tells_what_it_is(head: TestHead) -> None:
    """Own parameters have a description and, being numbers, a range; ROS' own ones are not ours to describe."""
    names = head.call(ListParameters, "reconstruction/list_parameters", ListParameters.Request()).result.names
    own = [one for one in names if not one.startswith(("qos_overrides.", "use_sim_time", "start_type_description"))]
    assert {"autostart", "silent_after_s", "warn_dark_share", "half_height_px"} <= set(own)
    request = DescribeParameters.Request(names=own)
    for one in head.call(DescribeParameters, "reconstruction/describe_parameters", request).descriptors:
        assert one.description, one.name
        if one.type in (2, 3):
            assert len(one.integer_range) + len(one.floating_point_range) == 1, one.name
