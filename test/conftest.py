"""Settings of every test run: ROS traffic isolated, the real capture found or its tests skipped."""

from __future__ import annotations

import atexit
import os
from pathlib import Path

import pytest

from tools.ros_domain import isolate_ros

# Held for the life of the test process; set before any test module imports rclpy.
atexit.register(isolate_ros().close)


@pytest.fixture(scope="session")
def capture_folder() -> Path:
    """Folder of the real capture, named by MOIRE_CAPTURE_DIR."""
    folder = os.environ.get("MOIRE_CAPTURE_DIR")
    if not folder:
        pytest.skip("MOIRE_CAPTURE_DIR is not set: the real capture is not on this machine")
    return Path(folder)
