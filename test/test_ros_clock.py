"""A clock that jumps, as a simulator's does when it is reset: what waits for its other half belongs to another time."""

from __future__ import annotations

from itertools import cycle

from ros_head import Exposure, TestHead, running
from ros_process import ros_node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

from moire_sim.analytic_scenes import analytic_capture

DEPTH = "depth/image_rect"
CAPTURE = analytic_capture("plane_1000")


def test_a_clock_that_jumps_back_clears_half_sets_and_depth_goes_on() -> None:
    options = ("reliable_input:=true", "use_sim_time:=true", "diagnostics_period_s:=0.1")
    with ros_node("test_head") as node, running("reconstruction", *options):
        head = TestHead(node)
        head.listen(DEPTH, Image)
        head.wait_for_subscribers()
        clock = node.create_publisher(Clock, "/clock", 1)
        seconds = cycle((200, 100))
        head.send(Exposure.of(CAPTURE), without="right/image_raw")

        def cleared() -> bool:
            message = Clock()
            message.clock.sec = next(seconds)
            clock.publish(message)
            return head.count("input", "dropped: the clock jumped") > 0

        head.wait(cleared, "the half set to be cleared")
        assert head.count("input", "dropped: the clock jumped") == 1

        def depth_came() -> bool:
            head.send(Exposure.of(CAPTURE))
            return bool(head.received[DEPTH])

        head.wait(depth_came, "depth after the jump")
        assert head.count("reconstruction", "refused: internal error") == 0
