"""Launch files: what they name exists; where a full ROS 2 is sourced, they run."""

from __future__ import annotations

import ast
import json
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from ros_head import Listener, pixels, running
from ros_process import TIMEOUT_S, ros_node
from sensor_msgs.msg import Image, PointCloud2

from moire_sensor.ros import bag_topics, capture_player_node, reconstruction_settings, viewer_node
from moire_sensor.ros.parameters import ParameterSpec
from moire_sensor.ros.result_messages import TOPICS
from moire_sim import virtual_head_node

ROOT = Path(__file__).parents[1]
SPECS: dict[str, tuple[ParameterSpec, ...]] = {
    "head": virtual_head_node.SPECS,
    "player": capture_player_node.SPECS,
    "reconstruction": reconstruction_settings.SPECS,
    "viewer": viewer_node.SPECS,
}


OWN_EXECUTABLES = {"virtual_head", "reconstruction", "capture_player", "moire_demo", "moire_viewer"}
OTHERS_EXECUTABLES = {"robot_state_publisher", "static_transform_publisher", "rviz2"}
LAUNCH_FILES = {path.name.removesuffix(".launch.py") for path in (ROOT / "launch").glob("*.py")}
HEAD_TOPICS = {"robot_description", "joint_states", *(topic.name for topic in bag_topics.HEAD_TOPICS)}


def tree_of(name: str) -> ast.Module:
    return ast.parse((ROOT / "launch" / f"{name}.launch.py").read_text())


def texts_of(tree: ast.Module) -> set[str]:
    """Every text in a launch file."""
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def keyword_texts(tree: ast.Module, name: str) -> set[str]:
    """Texts given as keyword or dictionary entry of a name."""
    pairs = [(node.arg, node.value) for node in ast.walk(tree) if isinstance(node, ast.keyword)]
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            keys = (key.value if isinstance(key, ast.Constant) else None for key in node.keys)
            pairs += zip(keys, node.values, strict=True)
    return {value.value for key, value in pairs if key == name and isinstance(value, ast.Constant)}


@pytest.mark.parametrize("name", sorted(LAUNCH_FILES))
def test_a_launch_file_names_executables_files_and_parameters_that_exist(name: str) -> None:
    tree = tree_of(name)
    executables = keyword_texts(tree, "executable")
    assert executables <= OWN_EXECUTABLES | OTHERS_EXECUTABLES
    included = {
        text.removesuffix(".launch.py") for text in texts_of(tree) if text.endswith(".launch.py") and "/" not in text
    }
    assert included <= LAUNCH_FILES
    assert executables or included
    for text in texts_of(tree):
        if text.endswith((".yaml", ".rviz", ".urdf")) and " " not in text:
            assert list(ROOT.glob(f"*/{text}")), text
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


def test_every_topic_shown_in_rviz_and_foxglove_is_published() -> None:
    known = {f"/head/{topic}" for topic in (*HEAD_TOPICS, *TOPICS)} | {"/diagnostics", "/local_costmap/costmap"}
    displays = yaml.safe_load((ROOT / "rviz" / "head.rviz").read_text())["Visualization Manager"]["Displays"]
    shown = {one[key]["Value"] for one in displays for key in ("Topic", "Description Topic") if key in one}
    layout = json.loads((ROOT / "config" / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    for panel in panels.values():
        shown |= set(panel.get("topics", {})) | {panel.get("topicToRender", "/diagnostics")}
        shown |= {value for key, value in panel.get("imageMode", {}).items() if key.endswith("Topic")}
        shown |= {path["value"].partition(".")[0] for path in panel.get("paths", [])}
    assert len(shown) > 8
    assert shown <= known
    assert placed(layout["layout"]) == set(panels)


def placed(area: Any) -> set[str]:
    """Panels that a Foxglove layout places."""
    return {area} if isinstance(area, str) else placed(area["first"]) | placed(area["second"])


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


@contextmanager
def launched(ros2: str, nodes: int, *arguments: str) -> Iterator[None]:
    """Launch; at the end, Ctrl-C must end all nodes cleanly."""
    command = [ros2, "launch", "moire_sensor", *arguments]
    launch = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield
        launch.send_signal(signal.SIGINT)
        output, _ = launch.communicate(timeout=TIMEOUT_S)
    except BaseException:
        # To launch, so that it ends the nodes too.
        launch.send_signal(signal.SIGINT)
        print(launch.communicate(timeout=TIMEOUT_S)[0])
        raise
    assert "process has died" not in output
    assert "Traceback" not in output
    assert output.count("process has finished cleanly") >= nodes


@pytest.mark.parametrize(("composed", "processes"), [("false", 2), ("true", 1)])
def test_the_demo_launches_gives_depth_and_ends_on_ctrl_c(ros2: str, composed: str, processes: int) -> None:
    arguments = ("demo.launch.py", "scene:=flat_board", "rate_hz:=5.0", f"composed:={composed}")
    with ros_node("listener") as node, launched(ros2, processes, *arguments):
        listener = Listener(node)
        listener.listen("depth/image_rect", Image)
        listener.wait(lambda: bool(listener.received["depth/image_rect"]), "depth", 3 * TIMEOUT_S)
    depth_m = pixels(listener.received["depth/image_rect"][0])
    assert abs(float(depth_m[240, 320]) - 1.0) < 0.005


def test_two_heads_launch_side_by_side(ros2: str) -> None:
    topics = {name: f"/{name}/depth/image_rect" for name in ("left_head", "right_head")}
    with ros_node("listener") as node, launched(ros2, 4, "two_heads.launch.py", "scene:=flat_board", "rate_hz:=1.0"):
        listener = Listener(node)
        for topic in topics.values():
            listener.listen(topic, Image)
        listener.wait(lambda: all(listener.received.values()), "depth of both", 3 * TIMEOUT_S)
    for name, topic in topics.items():
        assert listener.received[topic][0].header.frame_id == f"{name}/head_left_optical_frame"


def test_navigation_launches_the_reconstruction_for_the_topics_of_any_head(ros2: str) -> None:
    head = running("virtual_head", "scene:=doorway", "tilt_rad:=0.15", "rate_hz:=2.0", "wait_for_subscribers:=1")
    with ros_node("listener") as node, launched(ros2, 1, "navigation.launch.py"), head:
        listener = Listener(node)
        listener.listen("points_nav", PointCloud2)
        listener.wait(lambda: bool(listener.received["points_nav"]), "points", 3 * TIMEOUT_S)
    # With the node's own 2 m of depth range, the far room would make it refuse the whole image.
    assert listener.received["points_nav"][0].width > 100
