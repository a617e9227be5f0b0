"""What each executable of the package runs first: it imports the rest, which takes a second.

A signal during that second ends the process like one that comes later, with 0 and without a traceback; so nothing is
imported here that takes time.
"""

from __future__ import annotations

import os
import signal
from importlib import import_module
from types import FrameType


def virtual_head() -> int:
    """Run the simulated head."""
    return run("moire_sim.virtual_head_node")


def reconstruction() -> int:
    """Run the reconstruction node."""
    return run("moire_sensor.ros.reconstruction_node")


def moire_demo() -> int:
    """Run both in one process."""
    return run("moire_sim.demo_node")


def capture_player() -> int:
    """Play a capture folder."""
    return run("moire_sensor.ros.capture_player_node")


def record_bag() -> int:
    """Record a bag."""
    return run("moire_sensor.ros.bag_recorder")


def reconstruct_bag() -> int:
    """Reconstruct bags."""
    return run("moire_sensor.ros.reconstruct_bag")


def moire_viewer() -> int:
    """Show everything in the browser."""
    return run("moire_sensor.ros.viewer_node")


def run(module: str) -> int:
    """Import a module and return what its ``main`` does, which handles signals by itself."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, leave)
    code: int = import_module(module).main()
    return code


def leave(number: int, frame: FrameType | None) -> None:
    """End the process, in which nothing has begun yet."""
    os._exit(0)
