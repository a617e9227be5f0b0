"""Settings of every test run: ROS traffic isolated, work shared out, the real capture found or its tests skipped."""

from __future__ import annotations

import atexit
import os
from pathlib import Path

import pytest
from source_scan import ROOT, imported_packages

from tools.ros_domain import isolate_ros

# Helpers that start nodes, and test files that start them otherwise.
STARTERS = {"bag_runs", "ros_process"}
START_NODES = {"test_docs_reference", "test_soak"}

# Idle kernel threads sleep, as in the executables; set before any test module imports numba.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# Held for the life of the test process; set before any test module imports rclpy.
atexit.register(isolate_ros().close)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In a run shared between processes (``pytest -n 2 --dist loadgroup``) all tests with nodes run in one of them.

    So nodes of one test at a time share the machine, and what a session or a file prepares is prepared once.
    """
    if config.pluginmanager.hasplugin("xdist"):
        groups = {path: group_of(path) for path in {item.path for item in items}}
        for item in items:
            item.add_marker(pytest.mark.xdist_group(groups[item.path]))


def group_of(path: Path) -> str:
    """Name of the group of a test file's tests."""
    starts_nodes = path.stem in START_NODES or imported_packages(str(path.relative_to(ROOT))) & STARTERS
    return "nodes" if starts_nodes else path.stem


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
