"""``make demo``: run every scene, or a recorded capture, through the two nodes and check the depth."""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rclpy
from tqdm import tqdm

from moire_sensor.capture_folder import Capture, read_capture
from moire_sensor.errors import MoireError
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.phase_steps import needed_frames
from moire_sensor.ros.executable import use_large_message_profile
from moire_sim import VirtualHead, indoor_names, scene_names
from moire_sim.capture import HeadCapture
from tools.demo.pictures import View, draw_overview
from tools.demo.record import DEPTH_TOPIC, DemoError, Recording, Run, record
from tools.demo.report import write_report
from tools.demo.score import local_median, read_images, score_capture, score_scene
from tools.demo.table import Outcome, as_text, lost_sets
from tools.ros_domain import isolate_ros

OUTPUT = Path("demo")
RATE_HZ = 10.0
SCENE_EXPOSURES = 25
SEED = 0
SCENE_ERROR_MM, CAPTURE_ERROR_MM = 2.0, 2.0


def main() -> int:
    """Run the demo; 0 only if every depth image is right."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--capture", type=Path, help="capture folder to play instead of the scenes")
    folder = parser.parse_args().capture
    try:
        prepare(OUTPUT)
        capture = folder and read_capture(folder)
        lock = isolate_ros()
        use_large_message_profile()
        rclpy.init()
        try:
            outcomes = run_capture(capture) if capture else run_scenes()
        finally:
            rclpy.try_shutdown()
            lock.close()
    except (MoireError, DemoError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("demo: stopped", file=sys.stderr)
        return 130
    return conclude(outcomes)


def conclude(outcomes: list[tuple[Outcome, View]]) -> int:
    """Print the table, write the report, name everything that is not right; 1 if anything is not."""
    print(f"\n{as_text([outcome for outcome, _ in outcomes])}\n")
    print(f"pictures and the cloud to turn: {write_report(OUTPUT, outcomes)}")
    complaints = [f"{outcome.run.name}, {text}" for outcome, _ in outcomes for text in outcome.complaints]
    for complaint in complaints:
        print(f"demo: not right: {complaint}", file=sys.stderr)
    return 1 if complaints else 0


def prepare(output: Path) -> None:
    """Make an empty output folder; one that this demo did not make is left alone."""
    marker = output / "COLCON_IGNORE"
    if output.exists() and not marker.is_file():
        raise DemoError(f"the folder {output} exists and is not from an earlier demo; move it away")
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir()
    marker.touch()


def record_with_progress(run: Run) -> Recording:
    """Record one run with a progress bar on the terminal."""
    node = rclpy.create_node("demo_recorder", namespace="head")
    try:
        with tqdm(total=run.exposures, desc=f"{run.name} ({run.method})", unit="depth", ncols=100) as bar:
            return record(run, node, OUTPUT / run.name, lambda count: bar.update(max(count - bar.n, 0)))
    finally:
        node.destroy_node()


def run_scenes() -> list[tuple[Outcome, View]]:
    """Run every scene within the default depth range; test/test_nav_costmap.py judges rooms beyond it."""
    return [run_scene(scene) for scene in scene_names() if scene not in indoor_names()]


def run_scene(scene: str) -> tuple[Outcome, View]:
    """Record one scene and compare each depth image with the truth."""
    parameters = (f"scene:={scene}", f"seed:={SEED}", f"rate_hz:={RATE_HZ}", f"frames:={SCENE_EXPOSURES}")
    run = Run(scene, "virtual_head", parameters, "dense", SCENE_EXPOSURES)
    recording = record_with_progress(run)
    with VirtualHead(scene, seed=SEED) as head:
        capture = head.capture(paper_pattern())
    result = score_scene(recording, capture)
    complaints = (*lost_sets(run, recording), *result.complaints())
    view = scene_view(run, recording, capture)
    draw_overview(view, OUTPUT / run.name / "overview.png")
    return Outcome(run, recording, result, complaints), view


def scene_view(run: Run, recording: Recording, capture: HeadCapture) -> View:
    """Return the pictures of the last exposure of a scene."""
    left, right, order, depth_m = last_images(recording.bag)
    error_mm = np.asarray((depth_m - capture.depth_m) * 1e3)
    title = f"{run.name}: {run.method}, one exposure"
    points_m = capture.rig.points(depth_m)
    return View(title, left, right, order, depth_m, error_mm, "depth minus truth", SCENE_ERROR_MM, points_m)


def run_capture(capture: Capture) -> list[tuple[Outcome, View]]:
    """Play a capture folder, with every method that its frames allow."""
    return [run_capture_method(capture, method) for method in capture_methods(capture)]


def capture_methods(capture: Capture) -> list[str]:
    """Return the methods that can work on a capture's frames."""
    steps = capture.pattern.step_count
    return ["dense"] if steps < 3 or capture.frame_count < needed_frames(steps) else ["phase_shift", "dense"]


def run_capture_method(capture: Capture, method: str) -> tuple[Outcome, View]:
    """Play a capture folder into one method and judge the depth."""
    parameters = (f"folder:={capture.folder.resolve()}", f"rate_hz:={RATE_HZ}")
    run = Run(f"{capture.folder.resolve().name}_{method}", "capture_player", parameters, method, capture.frame_count)
    recording = record_with_progress(run)
    result = score_capture(read_images(recording.bag, DEPTH_TOPIC), method, capture)
    complaints = (*lost_sets(run, recording), *result.complaints())
    left, right, order, depth_m = last_images(recording.bag)
    rough_mm = np.asarray((depth_m - local_median(depth_m)) * 1e3)
    title = f"{capture.folder.resolve().name}: {method}, last result of {capture.frame_count} frames"
    view = View(
        title, left, right, order, depth_m, rough_mm, "depth minus median of 15x15 px around", CAPTURE_ERROR_MM,
        capture.rig.points(depth_m),
    )  # fmt: skip
    draw_overview(view, OUTPUT / run.name / "overview.png")
    return Outcome(run, recording, result, complaints), view


def last_images(bag: Path) -> tuple[npt.NDArray[Any], ...]:
    """Return the last left and right image, fringe order and depth of a bag."""
    topics: Sequence[str] = ("left/image_raw", "right/image_raw", "fringe_order/image", "depth/image_rect")
    left, right, order, depth = (read_images(bag, f"/head/{topic}")[-1] for topic in topics)
    return left, right, order, depth


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the nodes are stopped then too
    sys.exit(main())
