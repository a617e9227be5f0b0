"""Settings of every test run: ROS traffic isolated, work shared out, the real capture found or its tests skipped."""

from __future__ import annotations

import atexit
import os
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from source_scan import imported_packages

from moire_sensor.idle_threads import let_idle_threads_sleep
from tools.ros_domain import isolate_ros

# Test files that start nodes without the helper for it.
START_NODES = {"test_demo", "test_docs_reference", "test_soak"}

# As in the executables; before any test module runs a kernel.
let_idle_threads_sleep()
# Held for the life of the test process; set before any test module imports rclpy.
atexit.register(isolate_ros().close)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Share a run between processes (``pytest -n 2``) by file; tests that start nodes run in one of them.

    So the live nodes of one test at a time share the machine, and what a session or a file prepares is prepared once.
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByNodesAndFile(LoadScopeScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid.partition("::")[0])

    return ByNodesAndFile(config, log)


@cache
def group_of(file: str) -> str:
    """Name of the group of a test file's tests, which run in one process; ``file`` is told from the root."""
    imported = imported_packages(file)
    if "bag_runs" in imported:
        return "recorded bags"
    return "live nodes" if "ros_process" in imported or Path(file).stem in START_NODES else file


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
