"""A long run of head and reconstruction: memory must stay flat and no set may be lost.

    .venv/bin/python -m tools.soak                                # 30 minutes at 30 Hz
    .venv/bin/python -m tools.soak --minutes 2 --rate-hz 10       # what continuous integration can spare

Prints a line every ten seconds and a verdict; ends with 0 only if every exposure became depth and neither process grew
by more than 5 MB after its first tenth.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, JointState

from moire_sensor.ros.executable import use_large_message_profile
from moire_sensor.ros.reconstruction_report import RECONSTRUCTED
from tools.demo.processes import NodeProcess
from tools.demo.record import DemoError, Run, Watch
from tools.ros_domain import isolate_ros

ALLOWED_GROWTH_MB = 5.0
SAMPLE_S = 1.0
PRINT_S = 10.0
# Queues that outlast a hiccup of the machine; what is lost with them is lost for good.
QUEUE = QoSProfile(depth=100)
SENSOR = ("reliable_input:=true", "queue_depth:=300", "diagnostics_period_s:=0.2")


@dataclass
class Soak:
    """What the run has shown so far.

    Attributes
    ----------
    memory_mb : resident memory by process name, one value a second.
    """

    node: Node
    exposures: int
    depths: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    trouble: dict[str, int] = field(default_factory=dict)
    memory_mb: dict[str, list[float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.node.create_subscription(Image, "depth/image_rect", self._on_depth, QUEUE, raw=True)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QUEUE)

    def give_start(self) -> None:
        """Add the second subscriber of a set, for whom the head waits."""
        for kind, topic in ((Image, "left/image_raw"), (Image, "right/image_raw"), (JointState, "projector/state")):
            self.node.create_subscription(kind, topic, lambda _: None, 1, raw=True)

    def is_over(self) -> bool:
        """Tell whether every exposure is accounted for."""
        return self.depths >= self.exposures or self.counts.get("ended", 0) >= self.exposures

    def sample(self, processes: list[NodeProcess]) -> None:
        """Note the memory of the processes."""
        for process in processes:
            self.memory_mb.setdefault(process.name, []).append(resident_mb(process.process.pid))

    def growth_mb(self, name: str) -> float:
        """Last tenth against the second tenth, medians: the first one fills caches and queues."""
        samples = self.memory_mb[name]
        tenth = max(len(samples) // 10, 1)
        return median(samples[-tenth:]) - median(samples[tenth : 2 * tenth] or samples[:1])

    def _on_depth(self, serialized: bytes) -> None:
        self.depths += 1

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if status.name == "reconstruction: reconstruction":
                refused = sum(int(text) for key, text in values.items() if key.startswith("refused: "))
                names = (RECONSTRUCTED, "superseded", "unwatched", "matched")
                self.counts = {"refused": refused, **{name: int(values[name]) for name in names}}
                self.counts["ended"] = sum(self.counts[name] for name in ("refused", *names[:3]))
            if status.name == "reconstruction: input":
                self.trouble = {key: int(text) for key, text in values.items() if key.startswith("dropped: ")}


def resident_mb(process_id: int) -> float:
    """Memory of a process that is in RAM; Linux."""
    lines = Path(f"/proc/{process_id}/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmRSS:")) / 1024.0


def soak(minutes: float, rate_hz: float, scene: str, node: Node, folder: Path) -> Soak:
    """Run both nodes until every exposure is accounted for; raises DemoError when one ends early or hangs."""
    run = Run("soak", "virtual_head", (), "dense", max(round(minutes * 60.0 * rate_hz), 1))
    state = Soak(node, run.exposures)
    head = (f"scene:={scene}", f"rate_hz:={rate_hz}", f"frames:={run.exposures}", "wait_for_subscribers:=2")
    processes = [
        NodeProcess.start("reconstruction", SENSOR, folder / "reconstruction.log"),
        NodeProcess.start("virtual_head", head, folder / "head.log"),
    ]
    try:
        watch = Watch(node, run, processes)
        watch.until(lambda: bool(state.counts), "the reconstruction node to be ready")
        state.give_start()
        begin_s = sampled_s = printed_s = time.monotonic()

        def over() -> bool:
            nonlocal sampled_s, printed_s
            now_s = time.monotonic()
            if now_s - sampled_s >= SAMPLE_S:
                sampled_s = now_s
                state.sample(processes)
            if now_s - printed_s >= PRINT_S:
                printed_s = now_s
                print(f"{now_s - begin_s:7.0f} s  {summary(state)}", flush=True)
            return state.is_over()

        watch.until(over, "the last set", lambda: (state.depths, state.counts.get("ended")))
    finally:
        codes = [process.stop() for process in processes]
    if any(codes):
        raise DemoError(f"the nodes ended with {codes} when stopped")
    return state


def summary(state: Soak) -> str:
    """One line of figures."""
    memory = ", ".join(f"{name} {samples[-1]:.1f} MB" for name, samples in state.memory_mb.items())
    lost = sum(state.trouble.values()) + state.counts.get("superseded", 0) + state.counts.get("refused", 0)
    return f"{state.depths} depths of {state.exposures}, {lost} lost; {memory}"


def verdict(state: Soak) -> list[str]:
    """Return what was not as it must be."""
    faults = [
        f"{name} grew by {state.growth_mb(name):.1f} MB, more than {ALLOWED_GROWTH_MB:g}"
        for name in state.memory_mb
        if state.growth_mb(name) > ALLOWED_GROWTH_MB
    ]
    if state.depths != state.exposures:
        faults.append(f"{state.exposures} exposures gave {state.depths} depths: {state.counts}, {state.trouble}")
    return faults


def main() -> int:
    """Run the soak; returns 0 only if nothing was lost and memory stayed flat."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate-hz", type=float, default=30.0)
    parser.add_argument("--scene", default="flat_board:distance_m=0.9")
    options = parser.parse_args()
    lock = isolate_ros()
    use_large_message_profile()
    rclpy.init()
    try:
        node = rclpy.create_node("soak", namespace="head")
        with tempfile.TemporaryDirectory() as folder:
            state = soak(options.minutes, options.rate_hz, options.scene, node, Path(folder))
    except DemoError as error:
        print(f"soak: {error}", file=sys.stderr)
        return 1
    finally:
        rclpy.try_shutdown()
        lock.close()
    growth = ", ".join(f"{name} {state.growth_mb(name):+.1f} MB" for name in state.memory_mb)
    print(f"{summary(state)}; growth {growth}")
    for fault in verdict(state):
        print(f"soak: {fault}", file=sys.stderr)
    return int(bool(verdict(state)))


if __name__ == "__main__":
    sys.exit(main())
