"""Who may import what: a core without ROS and pybullet, one file for pybullet, no way back from the simulator."""

from __future__ import annotations

import subprocess
import sys

import pytest
from source_scan import ROOT, ROS_PACKAGES, imported_packages, python_files

ROS_OF_THE_SIMULATOR = {
    "moire_sim/demo_node.py",
    *(f"moire_sim/virtual_head_{name}.py" for name in ("node", "parameters", "joints", "status")),
}


def is_ros(path: str) -> bool:
    return path.startswith("moire_sensor/ros/") or path in ROS_OF_THE_SIMULATOR


@pytest.mark.parametrize("path", python_files("moire_sensor") + python_files("moire_sim"))
def test_layers(path: str) -> None:
    packages = imported_packages(path)
    if not is_ros(path):
        assert not packages & ROS_PACKAGES
    if path.startswith("moire_sensor/"):
        assert "moire_sim" not in packages
    if path != "moire_sim/render_geometry.py":
        assert "pybullet" not in packages


def import_without(blocked: list[str], modules: list[str]) -> subprocess.CompletedProcess[str]:
    """Import modules in a fresh interpreter in which importing a blocked package fails."""
    code = (
        f"import sys, importlib\nfor name in {blocked!r}: sys.modules[name] = None\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
    )
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)


def test_core_needs_neither_ros_nor_pybullet_nor_the_simulator() -> None:
    modules = [path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
               for path in python_files("moire_sensor") if not is_ros(path)]  # fmt: skip
    assert "moire_sensor.rig" in modules
    done = import_without(sorted(ROS_PACKAGES | {"pybullet", "moire_sim"}), modules)
    assert done.returncode == 0, done.stderr


def test_blocking_blocks() -> None:
    assert "ModuleNotFoundError" in import_without(["rclpy"], ["rclpy"]).stderr


def test_simulator_is_importable_without_ros_and_pybullet() -> None:
    done = import_without(sorted(ROS_PACKAGES | {"pybullet"}), ["moire_sim"])
    assert done.returncode == 0, done.stderr
