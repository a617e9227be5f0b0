"""Launch files: what they name exists; where a full ROS 2 is sourced, they run."""

from __future__ import annotations

import ast
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from ros_head import Listener, pixels
from ros_process import TIMEOUT_S, ros_node
from sensor_msgs.msg import Image

from moire_sensor.ros import capture_player_node, reconstruction_settings
from moire_sensor.ros.parameters import ParameterSpec
from moire_sim import virtual_head_node

ROOT = Path(__file__).parents[1]
SPECS: dict[str, tuple[ParameterSpec, ...]] = {
    "head": virtual_head_node.SPECS,
    "player": capture_player_node.SPECS,
    "reconstruction": reconstruction_settings.SPECS,
}


@pytest.mark.parametrize("name", ["demo", "reconstruction", "capture"])
def test_a_launch_file_names_executables_and_parameters_that_exist(name: str) -> None:
    tree = ast.parse((ROOT / "launch" / f"{name}.launch.py").read_text())
    executables = {
        node.value.value
        for node in ast.walk(tree)
        if isinstance(node, ast.keyword) and node.arg == "executable" and isinstance(node.value, ast.Constant)
    }
    assert executables <= {"virtual_head", "reconstruction", "capture_player"}
    assert "reconstruction" in executables
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict):
            target = node.targets[0]
            assert isinstance(target, ast.Name)
            specs = {spec.name: spec for spec in SPECS.get(target.id, ())}
            for key, value in zip(node.value.keys, node.value.values, strict=True):
                if specs:
                    assert isinstance(key, ast.Constant)
                    assert key.value in specs
                if specs and isinstance(value, ast.Constant):
                    specs[key.value].check(value.value)  # type: ignore[union-attr]


def test_the_parameter_file_holds_values_that_the_node_takes() -> None:
    content = yaml.safe_load((ROOT / "config" / "reconstruction.yaml").read_text())
    specs = {spec.name: spec for spec in reconstruction_settings.SPECS}
    values = content["/**/reconstruction"]["ros__parameters"]
    for name, value in values.items():
        specs[name].check(value)


@pytest.fixture
def ros2() -> str:
    """The ros2 command, with this package built by colcon and sourced."""
    command = shutil.which("ros2")
    if command is None:
        pytest.skip("no ros2 command: source a ROS 2 Jazzy to run the launch files")
    try:
        prefix = get_package_prefix("moire_sensor")
    except (PackageNotFoundError, OSError):
        pytest.skip("this package is not in a sourced workspace: colcon build it to run the launch files")
    if not (Path(prefix) / "lib" / "moire_sensor" / "reconstruction").exists():
        pytest.skip("lib/moire_sensor has no executables: colcon build the package to run the launch files")
    return command


def test_the_demo_launches_gives_depth_and_ends_on_ctrl_c(ros2: str) -> None:
    command = [ros2, "launch", "moire_sensor", "demo.launch.py", "scene:=flat_board", "rate_hz:=5.0"]
    with ros_node("listener") as node:
        listener = Listener(node)
        listener.listen("depth/image_rect", Image)
        launch = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            listener.wait(lambda: bool(listener.received["depth/image_rect"]), "depth", 3 * TIMEOUT_S)
            launch.send_signal(signal.SIGINT)
            output, _ = launch.communicate(timeout=TIMEOUT_S)
        finally:
            launch.kill()
    assert "process has died" not in output
    assert "Traceback" not in output
    assert output.count("process has finished cleanly") == 2
    depth_m = pixels(listener.received["depth/image_rect"][0])
    assert abs(float(depth_m[240, 320]) - 1.0) < 0.005
