"""What the sources import, for tests of the layers and of the manifest."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROS_PACKAGES = {"rclpy", "sensor_msgs", "std_msgs", "stereo_msgs", "diagnostic_msgs", "std_srvs", "geometry_msgs",
                "builtin_interfaces", "rcl_interfaces", "ament_index_python", "launch", "launch_ros",
                "trajectory_msgs"}  # fmt: skip


def python_files(folder: str) -> list[str]:
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / folder).rglob("*.py"))


def imported_packages(path: str) -> set[str]:
    packages = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            packages.update(name.name.partition(".")[0] for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            packages.add(node.module.partition(".")[0])
    return packages
