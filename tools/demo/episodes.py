"""Three episodes of motion, recorded as bags, reconstructed live, and shown as short animations in docs/images.

``python -m tools.demo.episodes``: the head pans over a room, a person crosses before it, it drives down a corridor.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import rclpy
from builtin_interfaces.msg import Duration
from PIL import Image
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from moire_sensor.errors import MoireError
from moire_sensor.ros.bag_message import header_stamp_ns
from moire_sensor.ros.bag_reader import read_messages
from moire_sensor.ros.executable import use_large_message_profile
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT
from tools.demo.record import DEPTH_TOPIC, DemoError, Run, record
from tools.demo.run import prepare
from tools.demo.score import read_images
from tools.demo.table import lost_sets
from tools.ros_domain import isolate_ros

OUTPUT, PICTURES = Path("demo/episodes"), Path("docs/images")
# What two cores can render, reconstruct and record at a time; a person takes 15 s to cross.
RATE_HZ = 2.0
EXPOSURES = 30
# Of the rate that was asked for, this much must come.
LEAST_RATE = 0.95
PAN_RAD, TILT_RAD = 0.30, 0.1
NEAR_M, FAR_M = 0.6, 2.0
LEFT_TOPIC = "/head/left/image_raw"
MAX_BYTES = 1_000_000
FRAME_MS = 180
STRIDE = 3


@dataclass(frozen=True)
class Episode:
    """What moves; ``far_m`` ends the colours and the depth range, ``pans`` lets the head look around."""

    name: str
    scene: str
    pans: bool = False
    far_m: float = FAR_M

    def run(self) -> Run:
        """Return what is started for it."""
        head = (f"scene:={self.scene}", f"rate_hz:={RATE_HZ}", f"frames:={EXPOSURES}", "renderer:=auto")
        return Run(self.name, "virtual_head", head, "dense", EXPOSURES, (f"max_depth_m:={self.far_m}",))


EPISODES = (
    Episode("pan_sweep", "room", pans=True),
    Episode("person_crossing", "person_crossing:speed_m_s=0.11"),
    Episode("corridor_drive", "corridor_drive:speed_m_s=0.11", far_m=3.5),
)


def main() -> int:
    """Record the episodes; 0 only if none lost a set."""
    parser = argparse.ArgumentParser(prog="python -m tools.demo.episodes", description=(__doc__ or "").split("\n")[0])
    names = [episode.name for episode in EPISODES]
    parser.add_argument("--episodes", nargs="+", choices=names, default=names, help="default: all")
    parser.add_argument("--output", type=Path, default=PICTURES, help="folder of the animations")
    options = parser.parse_args()
    try:
        OUTPUT.parent.mkdir(exist_ok=True)
        prepare(OUTPUT)
        options.output.mkdir(parents=True, exist_ok=True)
        lock = isolate_ros()
        use_large_message_profile()
        rclpy.init()
        try:
            chosen = [episode for episode in EPISODES if episode.name in options.episodes]
            complaints = [text for episode in chosen for text in record_episode(episode, options.output)]
        finally:
            rclpy.try_shutdown()
            lock.close()
    except (MoireError, DemoError) as error:
        print(f"episodes: {error}", file=sys.stderr)
        return 1
    for text in complaints:
        print(f"episodes: not right: {text}", file=sys.stderr)
    return 1 if complaints else 0


def record_episode(episode: Episode, folder: Path) -> list[str]:
    """Record one episode and draw its animation; returns what is not right."""
    run = episode.run()
    node = rclpy.create_node("episode_recorder", namespace="head")
    try:
        recording = record(run, node, OUTPUT / run.name, pan_command(node) if episode.pans else int)
    finally:
        node.destroy_node()
    path = folder / f"episode_{episode.name}.gif"
    lefts, depths = (read_images(recording.bag, topic) for topic in (LEFT_TOPIC, DEPTH_TOPIC))
    draw_animation(lefts, depths, episode.far_m, path)
    latency_ms = float(np.median(recording.latencies_s)) * 1e3 if recording.latencies_s else float("nan")
    rate_hz = rate_of(recording.bag)
    known = float(np.mean([np.isfinite(depth).mean() for depth in depths]))
    print(
        f"{run.name}: {recording.published} sets at {rate_hz:.2f} Hz, {len(depths)} depth images, {known:.1%} of the "
        f"pixels with depth, latency {latency_ms:.0f} ms (median), bag {recording.bag}, {path} "
        f"{path.stat().st_size / 1e3:.0f} kB"
    )
    complaints = lost_sets(run, recording)
    if rate_hz < LEAST_RATE * RATE_HZ:
        complaints.append(f"the head made {rate_hz:.2f} exposures per second, not {RATE_HZ:g}: the machine is too busy")
    return [f"{run.name}: {text}" for text in complaints]


def rate_of(bag: Path) -> float:
    """Exposures per second of a bag, by their stamps."""
    stamps = [header_stamp_ns(message.serialized) for message in read_messages(bag) if message.topic == LEFT_TOPIC]
    return (len(stamps) - 1) / ((stamps[-1] - stamps[0]) * 1e-9) if len(stamps) > 1 else float("nan")


def pan_command(node: Any) -> Callable[[int], object]:
    """Return what sends the head around once its first depth has come."""
    publisher = node.create_publisher(JointTrajectory, "joint_trajectory", 10)
    sent: list[JointTrajectory] = []

    def send(depths: int) -> None:
        if depths and not sent and publisher.get_subscription_count():
            sent.append(pan_trajectory((EXPOSURES - 2) / RATE_HZ))
            publisher.publish(sent[0])

    return send


def pan_trajectory(duration_s: float) -> JointTrajectory:
    """To the left, to the right, and back to the middle, at rest in between."""
    places = ((0.25, PAN_RAD, 0.0), (0.75, -PAN_RAD, TILT_RAD), (1.0, 0.0, 0.0))
    points = []
    for share, pan_rad, tilt_rad in places:
        seconds = share * duration_s
        due = Duration(sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))
        points.append(JointTrajectoryPoint(positions=[pan_rad, tilt_rad], velocities=[0.0, 0.0], time_from_start=due))
    return JointTrajectory(joint_names=[PAN_JOINT, TILT_JOINT], points=points)


def draw_animation(lefts: list[Any], depths: list[Any], far_m: float, path: Path) -> None:
    """Write a GIF of left view and depth side by side; raises DemoError where it would be too large."""
    frames = [Image.fromarray(frame_of(left, depth, far_m)) for left, depth in zip(lefts, depths, strict=False)]
    if not frames:
        raise DemoError(f"the bag of {path.stem} holds no depth image")
    small = [frame.quantize(64, dither=Image.Dither.NONE) for frame in frames]
    small[0].save(path, save_all=True, append_images=small[1:], duration=FRAME_MS, loop=0, optimize=True)
    if path.stat().st_size > MAX_BYTES:
        raise DemoError(f"{path} has {path.stat().st_size} bytes; at most {MAX_BYTES} are allowed: use fewer frames")


def frame_of(left: npt.NDArray[Any], depth_m: npt.NDArray[Any], far_m: float) -> npt.NDArray[np.uint8]:
    """Left view and depth (H / 3, 2 W / 3, 3), every third pixel; unknown depth is grey."""
    grey = np.repeat(left[::STRIDE, ::STRIDE, None], 3, axis=2)
    depth_m = depth_m[::STRIDE, ::STRIDE]
    near = np.clip((far_m - np.nan_to_num(depth_m, nan=far_m)) / (far_m - NEAR_M), 0.0, 1.0)
    colour = (mpl.colormaps["viridis"](near)[..., :3] * 255.0).astype(np.uint8)
    colour[~np.isfinite(depth_m)] = 90
    return np.concatenate([grey.astype(np.uint8), colour], axis=1)


if __name__ == "__main__":
    raise SystemExit(main())
