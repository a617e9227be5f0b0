"""docs/reference.md is what the running nodes, their parameters and the launch files say."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from source_scan import ROOT

from tools.docs.launch_files import arguments_of

LAUNCH = """
SHARED = {"rate_hz": ("5.0", "exposures per second"), "scene": ("room", "what is seen")}
INPUTS = {"left_image": "left/image_raw"}

def generate_launch_description():
    defaults = str(share("moire_sensor") / "config" / "some.yaml")
    return LaunchDescription([
        DeclareLaunchArgument("bag", description="folder"),
        DeclareLaunchArgument("parameters", default_value=defaults, description="file"),
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, (default, text) in SHARED.items()),
        *[DeclareLaunchArgument(name, default_value=topic, description=f"stands for {topic}")
          for name, topic in INPUTS.items()],
    ])
"""


def test_the_page_is_what_the_code_says() -> None:
    """In a process of its own: it starts the nodes in a domain of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "tools.docs.reference", "--check"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_arguments_of_a_launch_file_are_read_however_they_are_declared(tmp_path: Path) -> None:
    path = tmp_path / "some.launch.py"
    path.write_text(LAUNCH)
    assert [(one.name, one.default, one.text) for one in arguments_of(path)] == [
        ("bag", None, "folder"),
        ("parameters", "some.yaml", "file"),
        ("rate_hz", "5.0", "exposures per second"),
        ("scene", "room", "what is seen"),
        ("left_image", "left/image_raw", "stands for left/image_raw"),
    ]


def test_every_launch_file_shows_as_many_arguments_as_it_declares() -> None:
    for path in (ROOT / "launch").glob("*.launch.py"):
        tree = ast.parse(path.read_text())
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == "DeclareLaunchArgument"]
        found = arguments_of(path)
        assert len(found) >= len(calls)
        assert all(one.text for one in found), path.name
