"""Settings of every test run: ROS traffic isolated, the real capture found or its tests skipped."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tools.ros_domain import isolate_ros

# Held for the life of the test process; set before any test module imports rclpy.
ROS_DOMAIN_LOCK = isolate_ros()


@pytest.fixture(scope="session")
def capture_folder() -> Path:
    """Folder of the real capture, named by MOIRE_CAPTURE_DIR."""
    folder = os.environ.get("MOIRE_CAPTURE_DIR")
    if not folder:
        pytest.skip("MOIRE_CAPTURE_DIR is not set: the real capture is not on this machine")
    return Path(folder)
