"""Head and reconstruction as processes over DDS: latency, sets superseded, sets a second; how long a start takes."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, JointState

from moire_sensor.paper_rig import paper_pattern
from moire_sensor.ros.bag_message import header_stamp_ns
from moire_sensor.ros.executable import keep_freed_memory
from moire_sensor.ros.reconstruction_report import REFUSED, SUPERSEDED
from moire_sensor.ros.result_messages import TOPICS
from moire_sim import VirtualHead
from tools.demo.processes import NodeProcess
from tools.demo.record import Run, Watch
from tools.node_counts import ENDED, dropped_counts, set_counts
from tools.ros_domain import isolate_ros
from tools.ros_node import ros_node

DEPTH, CLOUD = "depth/image_rect", "points"
RATE_HZ, SECONDS = 30.0, 60.0
# Of the case that is as fast as it goes, the share of the sets of the others.
FAST_SHARE = 1.0 / 3.0
QUEUE = QoSProfile(depth=100)
# The listener runs on the same cores: its executor is not to look for events of each topic before every message.
NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
STARTS = 3
# What a program of one's own does first, from the start of its interpreter; the images are of the virtual head.
FIRST_FRAME = """
import sys, time
begin = time.time()
import numpy as np
from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern, paper_rig
Reconstructor(paper_rig(), paper_pattern()).reconstruct(*np.load(sys.argv[1]))
print(time.time() - begin)
"""


@dataclass(frozen=True)
class LatencyCase:
    """What runs: ``topics`` are subscribed, ``timed`` is the one whose arrival is measured.

    Without a ``rate_hz`` the head shows pictures made once, as fast as the reconstruction takes them. ``sets`` are
    worked on at a time.
    """

    name: str
    topics: tuple[str, ...]
    timed: str
    rate_hz: float | None = RATE_HZ
    sets: int = 1


CASES = (
    LatencyCase("all outputs, 30 Hz", tuple(TOPICS), CLOUD),
    LatencyCase("depth/image_rect alone, 30 Hz", (DEPTH,), DEPTH),
    LatencyCase("depth/image_rect alone, as fast as it goes", (DEPTH,), DEPTH, None),
    LatencyCase("all outputs, 30 Hz, two sets at a time", tuple(TOPICS), CLOUD, sets=2),
    LatencyCase("depth/image_rect alone, as fast as it goes, two sets at a time", (DEPTH,), DEPTH, None, 2),
)


@dataclass(frozen=True)
class LatencyRecord:
    """What one case gave; ``latencies_s`` from the exposure's stamp to the message's arrival."""

    case: LatencyCase
    exposures: int
    results: int
    lost: int
    superseded: int
    hz: float
    latencies_s: tuple[float, ...]

    def latency_ms(self, percent: float) -> float:
        """Percentile of the latency, ms; NaN where nothing came."""
        return 1e3 * float(np.percentile(self.latencies_s, percent)) if self.latencies_s else float("nan")


@dataclass
class Outputs:
    """Subscriptions to what the reconstruction publishes."""

    node: Node
    case: LatencyCase
    arrivals_s: list[float] = field(default_factory=list)
    latencies_s: list[float] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    starters: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        for topic in self.case.topics:
            callback = self._on_result if topic == self.case.timed else lambda _: None
            self.node.create_subscription(TOPICS[topic], topic, callback, QUEUE, raw=True, event_callbacks=NO_EVENTS)
        # Created last: once something comes through it, the reconstruction knows the others.
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QUEUE)

    def give_start(self) -> None:
        """Add the second subscriber of a set, for whom the head waits."""
        for kind, topic in ((Image, "left/image_raw"), (Image, "right/image_raw"), (JointState, "projector/state")):
            self.starters.append(self.node.create_subscription(kind, topic, lambda _: None, 1, raw=True))

    def has_ended(self, exposures: int) -> bool:
        """Tell whether every set is accounted for; what gave the start is taken back meanwhile."""
        while self.arrivals_s and self.starters:
            self.node.destroy_subscription(self.starters.pop())
        return self.counts.get(ENDED, 0) + sum(self.dropped.values()) >= exposures

    def _on_result(self, serialized: bytes, info: dict[str, int]) -> None:
        self.arrivals_s.append(info["received_timestamp"] * 1e-9)
        self.latencies_s.append((info["received_timestamp"] - header_stamp_ns(serialized)) * 1e-9)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.counts = set_counts(message) or self.counts
        self.dropped = dropped_counts(message) or self.dropped


def latency_records(cases: Sequence[LatencyCase], seconds: float = SECONDS) -> Iterator[LatencyRecord]:
    """Run the cases one after the other in a ROS domain of their own; raises DemoError where a node ends early."""
    keep_freed_memory()
    with isolate_ros(), tempfile.TemporaryDirectory() as folder:
        for number, case in enumerate(cases):
            place = Path(folder) / str(number)
            place.mkdir()
            with ros_node("bench") as node:
                yield measured(case, node, seconds, place)


def measured(case: LatencyCase, node: Node, seconds: float, folder: Path) -> LatencyRecord:
    """Run one case with the parameters of the demo's launch file, but for a queue that lets the newest win."""
    exposures = max(round(seconds * (case.rate_hz or FAST_SHARE * RATE_HZ)), 1)
    outputs = Outputs(node, case)
    sensor = "reliable_input:=true", f"parallel_sets:={case.sets}"
    processes = [
        NodeProcess.start("reconstruction", sensor, folder / "reconstruction.log"),
        start_head(case, exposures, folder / "head.log"),
    ]
    try:
        watch = Watch(node, Run(case.name, "head", (), "dense", exposures), processes)
        watch.until(lambda: bool(outputs.counts), "the reconstruction node to be ready")
        outputs.give_start()
        watch.until(lambda: outputs.has_ended(exposures), "the last set", lambda: outputs.counts)
    finally:
        for process in processes:
            process.stop()
    refused = sum(number for name, number in outputs.counts.items() if name.startswith(REFUSED))
    span_s = max(outputs.arrivals_s[-1] - outputs.arrivals_s[0], 1e-9) if outputs.arrivals_s else float("nan")
    return LatencyRecord(
        case,
        exposures,
        len(outputs.arrivals_s),
        refused + sum(outputs.dropped.values()),
        outputs.counts[SUPERSEDED],
        (len(outputs.arrivals_s) - 1) / span_s,
        tuple(outputs.latencies_s),
    )


def start_head(case: LatencyCase, exposures: int, log: Path) -> NodeProcess:
    """Start the virtual head before a still scene, or the one with pictures made once."""
    scene = "scene:=flat_board:distance_m=0.9"
    if case.rate_hz is not None:
        head = (scene, f"rate_hz:={case.rate_hz}", f"frames:={exposures}", "wait_for_subscribers:=2")
        return NodeProcess.start("virtual_head", head, log)
    still = (scene, "rate_hz:=0.0", f"exposures:={exposures}", "ahead:=2", "wait_for_subscribers:=2")
    return NodeProcess.run([sys.executable, "-m", "tools.still_head"], still, log)


def first_frame_of_room_s() -> float:
    """Return ``first_frame_s`` for the virtual head's view of a room."""
    with VirtualHead("room") as head:
        capture = head.capture(paper_pattern())
    return first_frame_s(capture.left, capture.right)


def first_frame_s(left: Any, right: Any) -> float:
    """Seconds from the first import to the first depth of images (H, W) in a new process, kernels cached; a median."""
    with tempfile.TemporaryDirectory() as folder:
        images = Path(folder) / "images.npy"
        np.save(images, np.stack((left, right)))
        command = [sys.executable, "-c", FIRST_FRAME, str(images)]
        outputs = [subprocess.run(command, capture_output=True, text=True, check=True).stdout for _ in range(STARTS)]
    return float(np.median([float(output.split()[-1]) for output in outputs]))
