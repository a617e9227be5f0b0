"""The file camera: a folder of PNGs over DDS into the reconstruction, simulated and real."""

from __future__ import annotations

import signal
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from ros_head import Listener, pixels, running, stamp_of
from ros_process import TIMEOUT_S, ros_node, start
from sensor_msgs.msg import CameraInfo, Image, JointState

from moire_sensor import Reconstructor, read_capture
from moire_sensor.camera_info import rectification_from_camera_info
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.ros.image_messages import grey_image
from moire_sensor.ros.projector_state import projector_state
from moire_sim.analytic_scenes import analytic_capture

DEPTH = "depth/image_rect"


def write_folder(folder: Path) -> Path:
    """A capture folder of four steps of a plane at 1 m."""
    scene = analytic_capture("plane_1000", paper_pattern(4))
    folder.mkdir()
    for step in range(4):
        for side in ("left", "right"):
            assert cv2.imwrite(str(folder / f"{side}_{step:02d}.png"), getattr(scene, side)[step])
    rig = {name: getattr(scene.rig, f"P_{name}").tolist() for name in ("left", "right", "projector")}
    pattern = asdict(scene.pattern)
    pattern["step_phases_rad"] = list(pattern["step_phases_rad"])
    content = {"image_size": [640, 480], "projector_columns": 960, "pattern": pattern, "depth_range_m": [0.6, 1.4],
               "projections": rig}  # fmt: skip
    (folder / "rig.yaml").write_text(yaml.safe_dump(content))
    return folder


def play(folder: Path, results: int, method: str) -> tuple[dict[str, list[Any]], str]:
    """Play a folder once into a reconstruction; return what came on the topics once ``results`` depths had come."""
    sensor = running("reconstruction", f"method:={method}", "reliable_input:=true", "queue_depth:=50")
    with ros_node("listener") as node, sensor:
        listener = Listener(node)
        kinds = {"left/image_raw": Image, "right/image_raw": Image, "projector/state": JointState, DEPTH: Image}
        kinds |= {f"{device}/camera_info": CameraInfo for device in ("left", "right", "projector")}
        for topic, kind in kinds.items():
            listener.listen(topic, kind)
        listener.wait(lambda: node.count_publishers(DEPTH) > 0, "the reconstruction")
        with running("capture_player", f"folder:={folder}", "rate_hz:=10", "wait_for_subscribers:=2") as player:
            listener.wait(lambda: len(listener.received[DEPTH]) >= results, f"{results} depth images")
            output, _ = player.communicate(timeout=TIMEOUT_S)
            assert player.returncode == 0, output
        return listener.received, output


def check_published(folder: Path, received: dict[str, list[Any]]) -> None:
    """Images, states and camera infos are those of the rectified capture, one stamp an exposure."""
    capture = read_capture(folder)
    infos = [received[f"{device}/camera_info"][-1] for device in ("left", "right", "projector")]
    pair = rectification_from_camera_info(*infos)
    assert pair.left_map is None
    for name in ("P_left", "P_right", "P_projector"):
        # Some roundings of 64 bit numbers: a rig brings its matrices to one scale.
        np.testing.assert_allclose(getattr(pair.rig, name), getattr(capture.rig, name), rtol=1e-13, atol=1e-12)
    assert len(received["left/image_raw"]) == capture.frame_count
    sets = zip(received["left/image_raw"], received["right/image_raw"], received["projector/state"], strict=True)
    for frame, (left, right, message) in enumerate(sets):
        assert stamp_of(left) == stamp_of(right) == stamp_of(message)
        for name, image, expected in zip(("left", "right"), (left, right), capture.frame(frame), strict=True):
            np.testing.assert_array_equal(grey_image(name, image), expected)
        state = projector_state(message)
        assert (state.step_index, state.step_count) == (frame % 4, 4)
        phase_rad = capture.pattern.phase_rad + capture.pattern.step_phases_rad[frame % 4]
        assert state.fringe_phase_rad == pytest.approx(phase_rad)
        assert state.depth_range_m == capture.depth_range_m


def test_a_folder_played_once_becomes_the_library_s_depth(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "capture")
    received, output = play(folder, 4, "dense")
    assert "4 frames, 4 steps, depth 0.6 to 1.4 m, as they are" in output
    check_published(folder, received)
    capture = read_capture(folder)
    sensor = Reconstructor(capture.rig, capture.pattern, capture.depth_range_m)
    assert len(received[DEPTH]) == 4
    for frame, message in enumerate(received[DEPTH]):
        expected = sensor.reconstruct(*capture.frame(frame), first_step=frame)
        np.testing.assert_allclose(pixels(message), expected.depth_m, rtol=1e-5)


def test_the_real_capture_gives_a_hand_at_its_distance(capture_folder: Path) -> None:
    """Eight frames give four results; coverage of a lit hand and its range are those the capture's notes tell."""
    received, output = play(capture_folder, 4, "phase_shift")
    assert "rectified" in output
    check_published(capture_folder, received)
    capture = read_capture(capture_folder)
    frames = np.stack([capture.frame(n)[0] for n in range(4)]).astype(float)
    modulation = np.hypot(frames[0] - frames[2], frames[1] - frames[3]) / 2.0
    assert len(received[DEPTH]) == 4
    for message in received[DEPTH]:
        depth_m = pixels(message)
        lit = depth_m[modulation > 12.0]
        assert np.isfinite(lit).mean() >= 0.90
        assert ((lit > 0.44) & (lit < 0.52))[np.isfinite(lit)].mean() >= 0.98


def test_a_loop_goes_on_and_ends_with_0_on_a_signal(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "capture")
    with ros_node("listener") as node:
        listener = Listener(node)
        listener.listen("projector/state", JointState)
        listener.listen("left/image_raw", Image)
        listener.listen("right/image_raw", Image)
        with running("capture_player", f"folder:={folder}", "rate_hz:=50", "loop:=true", number=signal.SIGTERM):
            listener.wait(lambda: len(listener.received["projector/state"]) >= 10, "two rounds and more")
    states = [projector_state(message) for message in listener.received["projector/state"]]
    assert [state.step_index for state in states] == [n % 4 for n in range(len(states))]
    stamps = [stamp_of(message) for message in listener.received["projector/state"]]
    within, between = np.diff(stamps)[[0, 1, 2]], np.diff(stamps)[3]
    assert between > 4 * np.median(within)


@pytest.mark.parametrize("damage", ["size", "shape", "missing"])
def test_a_damaged_folder_is_one_line_and_exit_code_1(tmp_path: Path, damage: str) -> None:
    folder = write_folder(tmp_path / "capture")
    if damage == "size":
        assert cv2.imwrite(str(folder / "left_02.png"), np.zeros((10, 10), dtype=np.uint8))
    elif damage == "missing":
        (folder / "right_01.png").unlink()
    else:
        content = yaml.safe_load((folder / "rig.yaml").read_text())
        content["projections"]["right"] = [[1.0, 0.0], [0.0, 1.0]]
        (folder / "rig.yaml").write_text(yaml.safe_dump(content))
    player = start("capture_player", f"folder:={folder}")
    output, _ = player.communicate(timeout=TIMEOUT_S)
    assert player.returncode == 1
    says = {"size": "10 x 10", "shape": "(3, 4)", "missing": "01"}[damage]
    assert len(output.splitlines()) == 1, output
    assert says in output
