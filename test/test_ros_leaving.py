"""An executable that has done its work ends with 0 also when a signal comes while the interpreter shuts down."""

from __future__ import annotations

import subprocess
import sys

import pytest

# The object outlives Python's own signal handlers and signals while modules are torn down.
SCRIPT = """
import os, signal, sys
import rclpy
from rclpy.node import Node
from moire_sensor.ros.executable import run_node

class Late:
    def __init__(self):
        self.kill, self.pid = os.kill, os.getpid()
    def __del__(self):
        self.kill(self.pid, {number})

class Done(Node):
    def __init__(self):
        super().__init__("done")
    def finished(self):
        return True

late = Late()
sys.argv = ["done"]
sys.exit(run_node(Done, "usage"))
"""


@pytest.mark.parametrize("number", [2, 15])
def test_a_late_signal_changes_nothing(number: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(number=number)], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")
