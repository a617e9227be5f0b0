"""A long run of head and reconstruction: memory must stay flat and no set may be lost.

    .venv/bin/python -m tools.soak --scale 0.5                    # 30 minutes of 320x240 at 30 Hz
    .venv/bin/python -m tools.soak --minutes 2 --rate-hz 10       # 640x480 from the virtual head
    .venv/bin/python -m tools.soak --exposures 3600 --rate-hz 0 --scale 0.2     # as fast as they are taken

With ``--scale`` the exposures are pictures made once (tools/still_head.py), so that the machine's time is the
reconstruction's; where it cannot keep up, that head waits, and the rate says so. Prints a line every ten seconds
and a verdict; ends with 0 only if every exposure became depth and neither process grew by more than 5 MB after its
first tenth.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, JointState

from moire_sensor.ros.reconstruction_report import REFUSED, SUPERSEDED
from tools.demo.processes import NodeProcess
from tools.demo.record import DemoError, Run, Watch
from tools.node_counts import ENDED, dropped_counts, set_counts
from tools.ros_domain import isolate_ros
from tools.ros_node import ros_node

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
    first_s, last_s : when the first and the last depth came, seconds of ``time.monotonic``.
    memory_mb : resident memory by process name, one value a second.
    """

    node: Node
    exposures: int
    depths: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    counts: dict[str, int] = field(default_factory=dict)
    trouble: dict[str, int] = field(default_factory=dict)
    memory_mb: dict[str, list[float]] = field(default_factory=dict)
    starters: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.node.create_subscription(Image, "depth/image_rect", self._on_depth, QUEUE, raw=True)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QUEUE)

    def give_start(self) -> None:
        """Add the second subscriber of a set, for whom the head waits."""
        for kind, topic in ((Image, "left/image_raw"), (Image, "right/image_raw"), (JointState, "projector/state")):
            self.starters.append(self.node.create_subscription(kind, topic, lambda _: None, 1, raw=True))

    def take_start_back(self) -> None:
        """Stop listening to the head, which costs time, once it has begun."""
        while self.depths and self.starters:
            self.node.destroy_subscription(self.starters.pop())

    def is_over(self) -> bool:
        """Tell whether every exposure is accounted for."""
        return self.depths >= self.exposures or self.counts.get(ENDED, 0) >= self.exposures

    def rate_hz(self) -> float:
        """Depths a second, from the first to the last."""
        return (self.depths - 1) / (self.last_s - self.first_s) if self.last_s > self.first_s else 0.0

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
        self.last_s = time.monotonic()
        self.first_s = self.first_s or self.last_s

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.counts = set_counts(message) or self.counts
        self.trouble = dropped_counts(message) or self.trouble


def resident_mb(process_id: int) -> float:
    """Memory of a process that is in RAM; Linux."""
    lines = Path(f"/proc/{process_id}/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmRSS:")) / 1024.0


def soak(options: argparse.Namespace, node: Node, folder: Path) -> Soak:
    """Run both nodes until every exposure is accounted for; raises DemoError when one ends early or hangs."""
    exposures = options.exposures or max(round(options.minutes * 60.0 * options.rate_hz), 1)
    state = Soak(node, exposures)
    processes = [
        NodeProcess.start("reconstruction", SENSOR, folder / "reconstruction.log"),
        start_head(options, exposures, folder / "head.log"),
    ]
    try:
        watch = Watch(node, Run("soak", "head", (), "dense", exposures), processes)
        watch.until(lambda: bool(state.counts), "the reconstruction node to be ready")
        state.give_start()
        begin_s = sampled_s = printed_s = time.monotonic()

        def over() -> bool:
            nonlocal sampled_s, printed_s
            now_s = time.monotonic()
            state.take_start_back()
            if now_s - sampled_s >= SAMPLE_S:
                sampled_s = now_s
                state.sample(processes)
            if now_s - printed_s >= PRINT_S:
                printed_s = now_s
                print(f"{now_s - begin_s:7.0f} s  {summary(state)}", flush=True)
            return state.is_over()

        watch.until(over, "the last set", lambda: (state.depths, state.counts.get(ENDED)))
    finally:
        codes = [process.stop() for process in processes]
    if any(codes):
        raise DemoError(f"the nodes ended with {codes} when stopped")
    return state


def start_head(options: argparse.Namespace, exposures: int, log: Path) -> NodeProcess:
    """Start the virtual head, or with ``scale`` the one that shows pictures made once."""
    parameters = [f"scene:={options.scene}", f"rate_hz:={options.rate_hz}", "wait_for_subscribers:=2"]
    if options.scale is None:
        return NodeProcess.start("virtual_head", [*parameters, f"frames:={exposures}"], log)
    parameters += [f"scale:={options.scale}", f"exposures:={exposures}"]
    return NodeProcess.run([sys.executable, "-m", "tools.still_head"], parameters, log)


def summary(state: Soak) -> str:
    """One line of figures."""
    memory = ", ".join(f"{name} {samples[-1]:.1f} MB" for name, samples in state.memory_mb.items())
    refused = sum(number for name, number in state.counts.items() if name.startswith(REFUSED))
    lost = sum(state.trouble.values()) + state.counts.get(SUPERSEDED, 0) + refused
    return f"{state.depths} depths of {state.exposures} at {state.rate_hz():.1f} Hz, {lost} lost; {memory}"


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
    parser.add_argument("--exposures", type=int, help="in place of minutes")
    parser.add_argument("--rate-hz", type=float, default=30.0)
    parser.add_argument("--scene", default="flat_board:distance_m=0.9")
    parser.add_argument("--scale", type=float, help="size of pictures made once, times 640x480; default: virtual_head")
    options = parser.parse_args()
    lock = isolate_ros()
    try:
        with ros_node("soak") as node, tempfile.TemporaryDirectory() as folder:
            state = soak(options, node, Path(folder))
    except DemoError as error:
        print(f"soak: {error}", file=sys.stderr)
        return 1
    except (KeyboardInterrupt, ExternalShutdownException):
        print("soak: interrupted, no verdict", file=sys.stderr)
        return 1
    finally:
        lock.close()
    growth = ", ".join(f"{name} {state.growth_mb(name):+.1f} MB" for name in state.memory_mb)
    print(f"{summary(state)}; growth {growth}")
    for fault in verdict(state):
        print(f"soak: {fault}", file=sys.stderr)
    return int(bool(verdict(state)))


if __name__ == "__main__":
    sys.exit(main())
