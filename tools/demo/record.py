"""One run of the demo: a head and the reconstruction as processes, everything recorded into a bag."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Image, JointState, PointCloud2

from moire_sensor.ros.bag_message import header_stamp_ns
from moire_sensor.ros.bag_recorder import BagRecorder
from moire_sensor.ros.bag_topics import topics_named
from moire_sensor.ros.reconstruction_report import GATHERING, RECONSTRUCTED, REFUSED, SUPERSEDED, UNWATCHED
from tools.demo.processes import NodeProcess

RECORDED = "head depth/image_rect depth/camera_info fringe_order/image status/image acquisition_done /diagnostics"
DEPTH_TOPIC = "/head/depth/image_rect"
# The head waits for the recorder, the reconstruction, and a third subscriber that gives the start.
SUBSCRIBERS = 3
# Queues hold what comes in one second at 10 Hz, so that a hiccup of the machine loses nothing; latency tells of it.
RECONSTRUCTION = ("reliable_input:=true", "queue_depth:=10", "diagnostics_period_s:=0.1")
# Without any news for so long, something hangs; a busy machine needs up to a minute to compile the kernels.
NEWS_TIMEOUT_S = 120.0


class DemoError(Exception):
    """Why the demo failed, in one sentence."""


@dataclass(frozen=True)
class Run:
    """What to start: ``exposures`` sets from ``executable``, reconstructed by ``method``.

    ``parameters`` are for the executable, ``reconstruction`` for the reconstruction node.
    """

    name: str
    executable: str
    parameters: tuple[str, ...]
    method: str
    exposures: int
    reconstruction: tuple[str, ...] = ()


@dataclass
class Recording:
    """What a run gave; ``counts`` are the reconstruction's own, latencies are from capture stamp to received cloud."""

    bag: Path
    published: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    latencies_s: list[float] = field(default_factory=list)
    truth_m: npt.NDArray[np.float32] | None = None


class Monitor:
    """Subscriptions beside the recorder: progress, latency, truth and the start signal."""

    def __init__(self, node: Node, recording: Recording) -> None:
        self._node = node
        self._recording = recording
        node.create_subscription(PointCloud2, "points", self._on_cloud, 10, raw=True)
        self._truth = node.create_subscription(Image, "ground_truth/depth", self._on_truth, 10)
        # Created last: once something comes through it, the reconstruction knows all subscriptions made before.
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def give_start(self) -> None:
        """Add the subscriber that the head waits for."""
        for kind, topic in ((Image, "left/image_raw"), (Image, "right/image_raw"), (JointState, "projector/state")):
            self._node.create_subscription(kind, topic, lambda _: None, 1, raw=True)

    def drop_truth(self) -> None:
        """One image of the truth is enough for a still scene; unsubscribed, the head no longer sends it."""
        if self._truth is not None and self._recording.truth_m is not None:
            self._node.destroy_subscription(self._truth)
            self._truth = None

    def _on_cloud(self, serialized: bytes, info: dict[str, int]) -> None:
        self._recording.latencies_s.append((info["received_timestamp"] - header_stamp_ns(serialized)) * 1e-9)

    def _on_truth(self, message: Image) -> None:
        self._recording.truth_m = np.frombuffer(message.data, np.float32).reshape(message.height, message.width)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if status.name.startswith("reconstruction:") and RECONSTRUCTED in values:
                self._recording.counts = {key: int(text) for key, text in values.items() if is_count(key)}


def record(run: Run, node: Node, folder: Path, progress: Callable[[int], object] = int) -> Recording:
    """Start both nodes, record through ``node`` until every exposure is accounted for, stop both cleanly.

    ``progress`` is called with the number of depth images so far. Nodes print into log files in ``folder``.

    Raises
    ------
    DemoError
        A node that ends early or not with 0, or nothing new for two minutes.
    """
    folder.mkdir(parents=True)
    recording = Recording(folder / "bag")
    recorder = BagRecorder(node, recording.bag, topics_named(RECORDED))
    monitor = Monitor(node, recording)
    parameters = [f"method:={run.method}", *RECONSTRUCTION, *run.reconstruction]
    processes = [
        NodeProcess.start("reconstruction", parameters, folder / "reconstruction.log"),
        NodeProcess.start(
            run.executable, (*run.parameters, f"wait_for_subscribers:={SUBSCRIBERS}"), folder / "head.log"
        ),
    ]
    try:
        watch = Watch(node, run, processes)
        watch.until(lambda: bool(recording.counts), "the reconstruction node to be ready")
        monitor.give_start()

        def accounted_for() -> bool:
            monitor.drop_truth()
            progress(recorder.counts[DEPTH_TOPIC])
            recording.published = recorder.counts["/head/left/image_raw"]
            return all_sets_done(run, recording, recorder.counts[DEPTH_TOPIC])

        watch.until(accounted_for, "the last set", lambda: (recording.published, recorder.counts[DEPTH_TOPIC]))
    finally:
        codes = [process.stop() for process in processes]
        recorder.close()
    for process, code in zip(processes, codes, strict=True):
        if code:
            raise DemoError(f"{process.name} ended with {code} when stopped: {process.last_words()}")
    return recording


def all_sets_done(run: Run, recording: Recording, depths: int) -> bool:
    """Tell whether each exposure is reconstructed, superseded or otherwise counted, and its depth recorded."""
    counts = recording.counts
    ended = sum(number for name, number in counts.items() if name != "matched")
    settled = counts["matched"] >= run.exposures and ended >= counts["matched"]
    return recording.published >= run.exposures and settled and depths >= counts[RECONSTRUCTED]


def is_count(name: str) -> bool:
    """Tell whether a value of the diagnostics counts sets."""
    return name in ("matched", RECONSTRUCTED, SUPERSEDED, GATHERING, UNWATCHED) or name.startswith(REFUSED)


@dataclass
class Watch:
    """Handles messages while nothing goes wrong."""

    node: Node
    run: Run
    processes: list[NodeProcess]

    def until(self, happened: Callable[[], bool], what: str, news: Callable[[], object] = lambda: None) -> None:
        """Spin until ``happened()``; raises DemoError when a process ends early or ``news()`` does not change."""
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        last, since = news(), time.monotonic()
        try:
            while not happened():
                executor.spin_once(timeout_sec=0.1)
                self._check_processes()
                if news() != last:
                    last, since = news(), time.monotonic()
                if time.monotonic() - since > NEWS_TIMEOUT_S:
                    raise DemoError(f"{self.run.name}: waited {NEWS_TIMEOUT_S:g} s for {what}; {self._last_words()}")
        finally:
            executor.remove_node(self.node)
            executor.shutdown()

    def _check_processes(self) -> None:
        for process in self.processes:
            if process.ended_badly():
                raise DemoError(f"{self.run.name}: {process.name} ended early: {process.last_words()}")

    def _last_words(self) -> str:
        return "; ".join(f"{process.name} said: {process.last_words()}" for process in self.processes)
