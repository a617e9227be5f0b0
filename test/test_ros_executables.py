"""Every executable: one clear line and exit code 1 on bad input, 0 on a signal, at the start and later."""

from __future__ import annotations

import signal
import subprocess
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from ros_head import Listener, running
from ros_process import TIMEOUT_S, ros_node
from sensor_msgs.msg import PointCloud2

from moire_sensor.ros import reconstruction_settings
from moire_sim import virtual_head_node

SCRIPTS = Path(sysconfig.get_path("scripts"))
BAD = {
    "reconstruction": {
        ("-p", "method:=magic"): "allowed are dense, phase_shift",
        ("-p", "mehtod:=dense"): "did you mean method?",
        ("-p", "min_depth_m:=-1.0"): "a number from 0 to 100",
        ("-p", "min_depth_m:=1.5", "-p", "max_depth_m:=1.0"): "the nearest must be the smaller",
        ("-p", "queue_depth:=many"): "a whole number from 1 to 1000",
        ("-p", "parallel_sets:=0"): "a whole number from 1 to 16",
        ("-p", "qos_overrides./head/left/image.subscription.depth:=3"): "qos_overrides./head/left/image_raw",
        ("-p", "qos_overrides./head/left/image_raw.subscription.reliability:=perhaps"): "reliable, best_effort",
        ("-p", "qos_overrides./head/points.publisher.depth:=-3"): "a whole number from 1 to 10000",
        ("-p", "half_height_px:=99"): "a whole number from",
        ("--params-file", "nowhere.yaml"): "nowhere.yaml",
    },
    "virtual_head": {
        ("-p", "scene:=moon"): "flat_board",
        ("-p", "scene:=flat_board:size=3"): "distance_m",
        ("-p", "rate_hz:=-1"): "a number from 0",
        ("-p", "waveform:=saw"): "allowed are sine, square",
        ("-p", "bits:=10"): "allowed are 8, 12 and 16",
        ("-p", "qos_overrides./head/left/image_raw.publisher.history:=3"): "keep_last, keep_all",
        ("-p", "pan_rad:=3.0"): "head_pan_joint",
        ("-p", "optics:=dirty"): "allowed are clean, realistic",
        ("-p", "scene:=none.yaml"): "cannot be read: No such file",
    },
    "moire_demo": {
        ("-p", "scene:=moon"): "flat_board",
        ("-p", "method:=magic"): "allowed are dense, phase_shift",
        ("-p", "scenes:=room"): "unknown parameter scenes",
    },
    "capture_player": {
        (): "give the folder of a capture",
        ("-p", "folder:=nowhere"): "there is no folder nowhere",
        ("-p", "folder:=."): "rig.yaml",
        ("-p", "folder:=.", "-p", "rate_hz:=0"): "a number from 0.01",
    },
}  # fmt: skip


def run(name: str, arguments: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    command = [str(SCRIPTS / name), *(("--ros-args", *arguments) if arguments else ())]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [(name, arguments, says) for name, cases in BAD.items() for arguments, says in cases.items()],
)
def test_bad_input_is_one_line_and_exit_code_1(name: str, arguments: tuple[str, ...], says: str) -> None:
    done = run(name, arguments)
    assert done.returncode == 1, done
    # The log is something else, and what rcl and pybullet say by themselves is not ours to silence.
    others = ("[INFO]", "[ERROR] [", "pybullet build")
    lines = [line for line in done.stderr.splitlines() if not line.startswith(others)]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    assert says in lines[0]


def test_parallel_sets_are_refused_where_kernels_run_one_at_a_time_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_THREADING_LAYER", "workqueue")
    done = run("reconstruction", ("-p", "parallel_sets:=2"))
    assert done.returncode == 1, done
    assert "install libgomp1 (apt), or set parallel_sets to 1" in done.stderr.splitlines()[-1]


def test_arguments_that_are_no_ros_arguments_are_refused_and_help_is_given() -> None:
    unknown = subprocess.run([str(SCRIPTS / "virtual_head"), "--scene", "room"], capture_output=True, text=True,
                             timeout=TIMEOUT_S, check=False)  # fmt: skip
    assert (unknown.returncode, unknown.stderr.count("\n")) == (1, 1)
    assert "unknown argument '--scene room'" in unknown.stderr
    asked = subprocess.run([str(SCRIPTS / "capture_player"), "--help"], capture_output=True, text=True,
                           timeout=TIMEOUT_S, check=False)  # fmt: skip
    assert asked.returncode == 0
    assert "folder:=FOLDER" in asked.stdout
    assert "rate_hz:=" in asked.stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", ["virtual_head", "reconstruction", "moire_demo"])
def test_a_signal_ends_a_ready_node_with_0_and_no_traceback(name: str, number: signal.Signals) -> None:
    with running(name, number=number) as process:
        assert process.stdout is not None
        assert any("ready" in line for line in process.stdout), "the node ended before it was ready"


def change(asker: Listener, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(asker.call(ChangeState, "reconstruction/change_state", request).success)


def state(asker: Listener) -> int:
    return int(asker.call(GetState, "reconstruction/get_state", GetState.Request()).current_state.id)


def test_a_managed_node_says_in_its_log_why_it_cannot_be_activated() -> None:
    process = running("reconstruction", "autostart:=false", "qos_overrides./head/nowhere.subscription.depth:=3")
    with process as child, ros_node("asker") as node:
        asker = Listener(node)
        assert change(asker, Transition.TRANSITION_CONFIGURE)
        assert not change(asker, Transition.TRANSITION_ACTIVATE)
        assert state(asker) == State.PRIMARY_STATE_INACTIVE
        assert child.stdout is not None
        assert any("activate failed: unknown parameter qos_overrides" in line for line in child.stdout)


def test_a_node_that_started_by_itself_stays_as_it_was_put_afterwards() -> None:
    """Asked often enough for the timer that starts it to have come again."""
    with running("reconstruction") as process, ros_node("asker") as node:
        asker = Listener(node)
        assert process.stdout is not None
        assert any("ready" in line for line in process.stdout)
        assert state(asker) == State.PRIMARY_STATE_ACTIVE
        assert change(asker, Transition.TRANSITION_DEACTIVATE)
        assert {state(asker) for _ in range(10)} == {State.PRIMARY_STATE_INACTIVE}
        assert change(asker, Transition.TRANSITION_CLEANUP)
        assert {state(asker) for _ in range(10)} == {State.PRIMARY_STATE_UNCONFIGURED}
        assert change(asker, Transition.TRANSITION_CONFIGURE)
        assert change(asker, Transition.TRANSITION_ACTIVATE)


def test_a_parameter_of_the_demo_belongs_to_one_node_alone() -> None:
    head, sensor = ({spec.name for spec in specs} for specs in (virtual_head_node.SPECS, reconstruction_settings.SPECS))
    assert not head & sensor


def test_the_demo_runs_both_nodes_in_one_process_and_a_cloud_arrives() -> None:
    parameters = ("scene:=flat_board:distance_m=0.8", "rate_hz:=2", "wait_for_subscribers:=1", "min_depth_m:=0.6")
    with ros_node("asker") as node, running("moire_demo", *parameters):
        asker = Listener(node)
        asker.listen("points", PointCloud2)
        asker.wait(lambda: bool(asker.received["points"]), "a cloud")
        names = {name for name, _ in node.get_node_names_and_namespaces()}
    assert names >= {"virtual_head", "reconstruction"}
    cloud = asker.received["points"][0]
    assert (cloud.height, cloud.width, cloud.header.frame_id) == (480, 640, "head_left_optical_frame")
    depth_m = np.frombuffer(cloud.data, np.float32).reshape(480, 640, -1)[..., 2]
    assert np.nanmedian(depth_m) == pytest.approx(0.8, abs=1e-3)
