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


@pytest.fixture(scope="session")
def dense_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten exposures of the head and their depth, recorded over DDS; more sets than the matcher remembers."""
    from bag_runs import record_run

    return record_run(tmp_path_factory.mktemp("dense") / "run", "dense", 1, 10, 10)


@pytest.fixture(scope="session")
def phase_shift_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven exposures in four steps, and the three results that they give."""
    from bag_runs import record_run

    return record_run(tmp_path_factory.mktemp("phase_shift") / "run", "phase_shift", 4, 7, 3)
