"""Helpers for tests over real DDS: spin until something happened, start and stop the executables."""

from __future__ import annotations

import signal
import subprocess
import sysconfig
import time
from collections.abc import Callable
from pathlib import Path

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tools.ros_node import ros_node as ros_node

# Bounds for a hang, not measurements: two busy cores start a process with numba in some seconds.
TIMEOUT_S = 60.0
EXIT_TIMEOUT_S = 20.0


def spin_until(node: Node, happened: Callable[[], bool], what: str, timeout_s: float = TIMEOUT_S) -> None:
    """Handle messages until ``happened()``; an AssertionError naming ``what`` after the timeout."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    deadline = time.monotonic() + timeout_s
    try:
        while not happened():
            assert time.monotonic() < deadline, f"waited {timeout_s:g} s in vain for {what}"
            executor.spin_once(timeout_sec=0.05)
    finally:
        executor.remove_node(node)
        executor.shutdown()


def start(name: str, *parameters: str, namespace: str = "") -> subprocess.Popen[str]:
    """Start an executable of this package with parameters such as ``"rate_hz:=10"``, perhaps in a namespace."""
    arguments = ["--ros-args", *(part for parameter in parameters for part in ("-p", parameter))]
    arguments += ["-r", f"__ns:={namespace}"] if namespace else []
    path = Path(sysconfig.get_path("scripts")) / name
    return subprocess.Popen(
        [str(path), *(arguments if len(arguments) > 1 else [])],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def stop(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> tuple[int, str]:
    """Send a signal; return exit code and everything the process printed."""
    process.send_signal(number)
    output, _ = process.communicate(timeout=EXIT_TIMEOUT_S)
    return process.returncode, output
