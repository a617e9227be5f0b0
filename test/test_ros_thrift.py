"""What the nodes do not do twice: read a camera info, or fetch from the kernel memory that they had."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from typing import Any

import pytest
from ros_process import ros_node, spin_until
from sensor_msgs.msg import CameraInfo

from moire_sensor.ros.head_inputs import HeadInputs
from moire_sensor.ros.head_sets import HeadSets
from moire_sensor.ros.qos import latched_qos

# Twenty results' worth of arrays, made and dropped; prints the page faults for each page used.
WORK = """
import resource
import numpy as np
from moire_sensor.ros.executable import keep_freed_memory

def work():
    for _ in range(20):
        arrays = [np.ones((480, 640, 4), np.float32) for _ in range(4)]
    return 20 * sum(array.nbytes for array in arrays) // resource.getpagesize()

keep_freed_memory()
work()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
pages = work()
print((resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before) / pages)
"""
# With it, none but stray ones; without it, a fifth of the pages and more.
MOST_FAULTS = 0.05


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="the C library is not glibc")
def test_freed_memory_is_kept_for_the_next_result() -> None:
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, check=True)
    assert float(done.stdout) < MOST_FAULTS


def test_a_camera_info_that_was_kept_is_read_and_no_later_one_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """What differs from the last one in its stamp alone is not read at all."""
    read: list[int] = []
    monkeypatch.setattr(HeadSets, "add_info", lambda _, device, info: read.append(info.width))

    def nothing(*_: Any) -> None:
        """No set comes, and nothing is refused."""

    with ros_node("reader") as node:
        node.declare_parameter("input_rectified", False)
        publisher = node.create_publisher(CameraInfo, "left/camera_info", latched_qos())
        info = CameraInfo(width=1)
        publisher.publish(info)
        inputs = HeadInputs(node, True, nothing, nothing)
        spin_until(node, lambda: bool(read), "the camera info that was kept")
        spin_until(node, lambda: publisher.get_subscription_count() == 1, "one of the two subscriptions to end")
        for number in range(2, 6):
            info.header.stamp.sec += 1
            publisher.publish(info)
            info.width = number
            publisher.publish(info)
            spin_until(node, lambda seen=number: read[-1:] == [seen], "the camera info")  # type: ignore[misc]
        inputs.close()
    assert read == [1, 2, 3, 4, 5]
