"""Processes that die without a word, on either side: the other goes on, and says what was missing."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ros_head import Exposure, Listener, TestHead, running, stamp_of
from ros_process import EXIT_TIMEOUT_S, ros_node
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Header

from moire_sensor.paper_rig import PROJECTOR_SIZE
from moire_sensor.ros.camera_messages import camera_infos
from moire_sim.analytic_scenes import analytic_capture

DEPTH, STATE = "depth/image_rect", "projector/state"
NANOSECONDS = 1_000_000_000
# The project promises 2 s on a free machine, where it takes 0.7 to 2 s. This is the slack of a busy one, five times as
# slow: it tells recovery from none.
RECOVERY_NS = 10 * NANOSECONDS
HEAD = ("virtual_head", "scene:=flat_board:distance_m=0.9", "rate_hz:=4")
SENSOR = ("reconstruction", "diagnostics_period_s:=0.1", "queue_depth:=50", "reliable_input:=true")
CAPTURE = analytic_capture("plane_1000")
# A head's process that sends the left image and the state of a set, and is killed before the right image. What a
# reliable publisher sent to a subscriber it knows and saw acknowledged has arrived.
HALF = """
import sys
from ros_head import Exposure, TestHead
from ros_process import ros_node
from moire_sim.analytic_scenes import analytic_capture
with ros_node("half_head") as node:
    head = TestHead(node)
    head.wait(lambda: all(one.get_subscription_count() for one in head._publishers.values()), "subscribers")
    head.stamp += 10**12
    head.send(Exposure.of(analytic_capture("plane_1000")), without="right/image_raw")
    assert all(one.wait_for_all_acked() for one in head._publishers.values())
    print("sent", flush=True)
    sys.stdin.read()
"""
# A subscriber of everything large, reliable, that is then stopped and never reads again.
SLOW = """
from ros_head import Listener
from ros_process import ros_node
from sensor_msgs.msg import Image, PointCloud2
with ros_node("slow") as node:
    slow = Listener(node)
    slow.listen("points", PointCloud2)
    slow.listen("depth/image_rect", Image)
    slow.wait(lambda: all(slow.received.values()), "a first result")
    print("listening", flush=True)
    slow.wait(lambda: False, "the end")
"""


@contextmanager
def script(text: str) -> Iterator[subprocess.Popen[str]]:
    """Run a script in a process of its own and kill it at the end."""
    tests = Path(__file__).parent
    # The helpers of the tests, and from the working folder the tools.
    process = subprocess.Popen([sys.executable, "-c", text], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                               cwd=tests.parent, env={**os.environ, "PYTHONPATH": str(tests)})  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.communicate(timeout=EXIT_TIMEOUT_S)


def kill(process: subprocess.Popen[str]) -> None:
    """End a process as a power cut would."""
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=EXIT_TIMEOUT_S)


def first_after(kept: list[Any], stamp: int) -> int | None:
    """Stamp of the first message that is newer than ``stamp``."""
    return next((stamp_of(one) for one in kept if stamp_of(one) > stamp), None)


def wait_for_newer(listener: Listener, topic: str, stamp: int) -> int:
    """Wait for a message newer than ``stamp``, and return its own."""
    listener.wait(lambda: first_after(listener.received[topic], stamp) is not None, f"a newer {topic}")
    found = first_after(listener.received[topic], stamp)
    assert found is not None
    return found


def test_a_head_killed_and_restarted_is_seen_again_soon() -> None:
    """Counted in stamps: from the new head's first exposure that anyone saw to the first that became depth."""
    with ros_node("listener") as node, running(*SENSOR) as sensor:
        listener = Listener(node)
        listener.listen(DEPTH, Image)
        listener.listen(STATE, JointState)
        with running(*HEAD) as head:
            wait_for_newer(listener, DEPTH, 0)
            kill(head)
        killed = node.get_clock().now().nanoseconds
        with running(*HEAD):
            again = wait_for_newer(listener, STATE, killed)
            assert wait_for_newer(listener, DEPTH, killed) - again < RECOVERY_NS
        assert sensor.poll() is None


def test_a_reconstruction_killed_and_restarted_gives_depth_soon_after_being_ready() -> None:
    with ros_node("listener") as node, running(*HEAD) as head:
        listener = Listener(node)
        listener.listen(DEPTH, Image)
        with running(*SENSOR) as sensor:
            wait_for_newer(listener, DEPTH, 0)
            kill(sensor)
        with running(*SENSOR) as sensor:
            assert sensor.stdout is not None
            assert any("ready" in line for line in sensor.stdout)
            ready = node.get_clock().now().nanoseconds
            assert wait_for_newer(listener, DEPTH, ready) - ready < RECOVERY_NS
        assert head.poll() is None


def test_a_publisher_that_dies_in_the_middle_of_a_set_costs_that_set_alone() -> None:
    with ros_node("test_head") as node, running(*SENSOR):
        head = TestHead(node)
        head.listen(DEPTH, Image)
        head.wait_for_subscribers()
        # Sets sent before both sides had found each other may have lost their right image already.
        halves = head.count("input", "dropped: missing right")
        with script(HALF) as half:
            assert half.stdout is not None
            assert half.stdout.readline() == "sent\n"
            kill(half)
        head.stamp += 2 * 10**12
        for _ in range(3):
            head.answer(DEPTH, head.send(Exposure.of(CAPTURE)))
        head.wait_for_count("input", "dropped: missing right", halves + 1)


def test_a_subscriber_that_hangs_does_not_hold_up_the_node() -> None:
    with ros_node("test_head") as node, running(*SENSOR):
        head = TestHead(node)
        head.listen(DEPTH, Image)
        head.wait_for_subscribers()
        with script(SLOW) as slow:
            head.wait(lambda: node.count_subscribers(DEPTH) == 2, "the other subscriber")

            def listening() -> bool:
                head.answer(DEPTH, head.send(Exposure.of(CAPTURE)))
                return bool(select.select([slow.stdout], [], [], 0.0)[0])

            head.wait(listening, "the other subscriber's first results")
            slow.send_signal(signal.SIGSTOP)
            # More than all its queues hold, and the shared memory too: 1.2 MB of depth and 4.9 MB of points each.
            for _ in range(60):
                head.answer(DEPTH, head.send(Exposure.of(CAPTURE)))
            head.wait_for_count("reconstruction", "reconstructed", len(head.received[DEPTH]))
        assert head.count("reconstruction", "superseded") == 0


def test_a_head_without_one_camera_info_is_told_which_though_simulated_time_stands_still() -> None:
    with ros_node("test_head") as node, running(*SENSOR, "use_sim_time:=true"):
        head = TestHead(node)
        head.listen(DEPTH, Image)
        head.wait_for_subscribers()
        infos = camera_infos(CAPTURE.rig, Header(), PROJECTOR_SIZE)
        right = infos.pop("right")
        head.send_infos(infos)

        def named() -> bool:
            head.publish(head.messages(Exposure.of(CAPTURE)))
            return head.facts["reconstruction: input"]["message"] == "silent: /head/right/camera_info"

        # Some sets are held, for infos may come late; the others are counted.
        head.wait(lambda: named() and head.count("reconstruction", "refused: no camera info") > 0, "its name")
        head.send_infos({"right": right})
        head.answer(DEPTH, head.send(Exposure.of(CAPTURE)))
        head.wait(lambda: "silent" not in head.facts["reconstruction: input"]["message"], "it to be over")
