"""The programs in docs/real_cameras.md, run as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from raw_cameras import (
    CAMERAS,
    PROJECTOR_D,
    PROJECTOR_K,
    PROJECTOR_R,
    PROJECTOR_SIZE,
    PROJECTOR_T,
    in_view,
    infos,
    raw_image,
    true_points_m,
)
from ros_head import NANOSECONDS, TestHead, pixels, running, time_of
from ros_process import TIMEOUT_S, ros_node
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Header

from moire_sensor.ros.image_messages import image_message

DOCS = Path(__file__).parents[1] / "docs" / "real_cameras.md"
BLOCKS = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL)
MARGIN_PX = 16
SENSOR = ("method:=phase_shift", "reliable_input:=true", "diagnostics_period_s:=0.1")
# Clocks of two cameras on one trigger, seconds apart.
SKEW_NS = 300_000


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the camera infos as camera_calibration writes them, and the projector's as the page makes it."""
    for side in ("left", "right"):
        info = infos()[side]
        fields = {"camera_matrix": info.k, "distortion_coefficients": info.d}
        fields |= {"rectification_matrix": info.r, "projection_matrix": info.p}
        content: dict[str, Any] = {name: {"data": [float(value) for value in data]} for name, data in fields.items()}
        content |= {"image_width": info.width, "image_height": info.height, "distortion_model": "plumb_bob"}
        (tmp_path / f"{side}.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.chdir(tmp_path)
    program: dict[str, Any] = {}
    exec(BLOCKS[0], program)
    # The page takes the projector's place from the raw left camera.
    left_from_projector = PROJECTOR_R @ CAMERAS["left"].R
    program["projector_file"](PROJECTOR_K, PROJECTOR_D, left_from_projector, PROJECTOR_T, PROJECTOR_SIZE)
    return tmp_path


def test_one_exposure_without_ros(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(8)
    for side in ("left", "right"):
        cv2.imwrite(str(folder / f"{side}.png"), raw_image(side, 0.0, rng))
    program: dict[str, Any] = {}
    exec(BLOCKS[1], program)
    error_mm = np.abs(program["shot"].depth_m - true_points_m()[..., 2])[in_view(MARGIN_PX)] * 1e3
    assert np.isfinite(error_mm).mean() >= 0.98
    # Noise floor 0.09 mm at 1 m; twice that.
    assert np.nanmedian(error_mm) <= 0.18
    mismatch = re.search(r"mismatch ([0-9.]+) rad", capsys.readouterr().out)
    assert mismatch is not None
    assert float(mismatch[1]) < 0.1


def test_the_driver_gives_one_stamp_and_the_step_though_a_frame_is_lost(folder: Path) -> None:
    (folder / "head_driver.py").write_text(BLOCKS[2])
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(DOCS.parents[1]), os.environ.get("PYTHONPATH", "")]),
    }
    with ros_node("drivers") as node, running("reconstruction", *SENSOR):
        drivers = TestHead(node)
        drivers.listen("depth/image_rect", Image)
        drivers.wait_for_subscribers()
        cameras = {side: node.create_publisher(Image, f"/{side}_camera/image_raw", 10) for side in ("left", "right")}
        # Before the driver starts, which then knows this subscription before it has anything to say.
        states = node_states(drivers)
        program = subprocess.Popen([sys.executable, "head_driver.py"], cwd=folder, env=environment)
        try:
            drivers.wait(lambda: all(one.get_subscription_count() for one in cameras.values()), "the driver", TIMEOUT_S)
            drivers.wait(lambda: node.count_publishers("projector/camera_info") == 2, "the projector's info", TIMEOUT_S)
            drivers.send_infos({side: infos()[side] for side in ("left", "right")})
            play(drivers, cameras, states)
        finally:
            program.terminate()
            code = program.wait(TIMEOUT_S)
    assert code == 0
    error_mm = np.abs(pixels(drivers.received["depth/image_rect"][-1]) - true_points_m()[..., 2])[in_view(MARGIN_PX)]
    assert np.isfinite(error_mm).mean() >= 0.98
    # One pixel in four steps: 0.33 mm at 1 m; twice that.
    assert np.nanmedian(error_mm) * 1e3 <= 0.66


def play(drivers: TestHead, cameras: dict[str, Any], states: list[int]) -> None:
    """Triggers until there is depth, each answered before the next; one frame of the right camera is lost."""
    rng = np.random.default_rng(9)

    def send(trigger: int) -> None:
        stamp = drivers.stamp + (trigger + 1) * NANOSECONDS // 10
        for side, late_ns in (("left", 0), ("right", SKEW_NS)):
            image = raw_image(side, 2.0 * np.pi * (trigger % 4) / 4, rng)
            header = Header(stamp=time_of(stamp + late_ns), frame_id=f"{side}_eye")
            if (trigger, side) != (1, "right"):
                cameras[side].publish(image_message(header, image, "mono8"))

    # What was sent before the driver knew of its cameras, or the reconstruction of the driver, is gone.
    dark_sets = drivers.count("input", "matched")
    first = drivers.node.create_timer(1.0, lambda: send(0))
    drivers.wait(lambda: bool(states) and drivers.count("input", "matched") > dark_sets, "the first step")
    drivers.node.destroy_timer(first)
    for trigger in range(1, 8):
        send(trigger)
        if trigger != 1:
            drivers.wait(lambda wanted=trigger: states[-1] == wanted % 4, f"step of trigger {trigger}")  # type: ignore[misc]
    drivers.wait(lambda: bool(drivers.received["depth/image_rect"]), "depth")


def node_states(drivers: TestHead) -> list[int]:
    """Steps that the driver tells, as they come."""
    steps: list[int] = []
    drivers.node.create_subscription(
        JointState,
        "projector/state",
        lambda message: steps.append(int(message.position[list(message.name).index("step_index")])),
        10,
    )
    return steps
