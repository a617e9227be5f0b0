"""``make bench``: accuracy and speed of the methods and their peers, in one run."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from moire_sensor.idle_threads import let_idle_threads_sleep
from moire_sim.analytic_scenes import analytic_scene_names
from tools.bench.accuracy import Record, scene_records
from tools.bench.conditions import CONDITIONS, DEFAULT, ILLUMINATION, PLAIN_AMBIENT, TEXTURED, Condition
from tools.bench.confidence import TrustRecord, trust_tasks
from tools.bench.dot_scan import DOTS_PX, SCAN_SCENES, Trial, best_settings, mean_trials, trials_of_dots
from tools.bench.growth import (
    GROWING,
    MEMORY_CASES,
    GrowthRecord,
    MemoryRecord,
    growth_records,
    memory_records,
)
from tools.bench.latency import CASES, LatencyRecord, first_frame_of_room_s, latency_records
from tools.bench.makers import DISTANCES_M, MakerRecord, maker_records
from tools.bench.methods import OURS, PEERS, DotMethod, Method
from tools.bench.posts import SEEDS, post_records
from tools.bench.report import tables_of, write_report
from tools.bench.simulator_report import SimulatorResults, measure_simulator
from tools.bench.speed import THREADS, SpeedRecord, cases, speed_records
from tools.bench.stages import StageRecord, stage_records
from tools.bench.tasks import Task, done, progress

PARTS = (
    "scan", "scenes", "conditions", "light", "posts", "confidence", "makers", "speed", "growth", "latency",
    "validation", "realistic",
)  # fmt: skip
# Light on these alone: a plane, slopes, solids, thin things.
LIGHT_SCENES = ("plane_1000", "tilt_0.5", "waves", "cylinder_and_box", "spheres", "thin_poles")
DOCS = Path("docs")


@dataclass
class Results:
    """Everything measured; a part that was not asked for is empty."""

    peers: tuple[DotMethod, ...] = PEERS
    trials: list[Trial] = field(default_factory=list)
    records: list[Record] = field(default_factory=list)
    posts: list[Record] = field(default_factory=list)
    trusts: list[TrustRecord] = field(default_factory=list)
    makers: list[MakerRecord] = field(default_factory=list)
    speeds: list[SpeedRecord] = field(default_factory=list)
    stages: list[StageRecord] = field(default_factory=list)
    growths: list[GrowthRecord] = field(default_factory=list)
    memories: list[MemoryRecord] = field(default_factory=list)
    latencies: list[LatencyRecord] = field(default_factory=list)
    first_frame_s: float = float("nan")
    simulator: SimulatorResults = field(default_factory=SimulatorResults)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and after a whole run write docs/bench.md and its pictures."""
    options = parse(arguments)
    let_idle_threads_sleep()
    begin = time.monotonic()
    results = measure(options)
    for table in tables_of(results):
        print(table.as_text())
    whole = set(options.parts) == set(PARTS) and set(options.scenes) == set(analytic_scene_names())
    if options.output or whole:
        folder = options.output or DOCS
        write_report(results, folder)
        print(f"\nwritten: {folder / 'bench.md'} and its pictures")
    else:
        print("\na part of the benchmark only: nothing written (--output FOLDER does)")
    print(f"took {time.monotonic() - begin:.0f} s")
    return 0


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench.run", description=__doc__)
    names = analytic_scene_names()
    methods = [method.name for method in (*OURS, *PEERS)]
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="default: all")
    for option, choices in (("scene", names), ("method", methods)):
        parser.add_argument(
            f"--{option}s", nargs="+", choices=choices, default=list(choices), metavar=option, help=", ".join(choices)
        )
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="write bench.md and images/ there")
    return parser.parse_args(arguments)


def measure(options: argparse.Namespace) -> Results:
    """Do the parts that were asked for."""
    results = Results()
    if "scan" in options.parts:
        scan(results)
    methods = [method for method in (*OURS, *results.peers) if method.name in options.methods]
    tasks = accuracy_tasks(options, methods)
    if tasks:
        results.records = done(tasks, "accuracy")
    if "posts" in options.parts:
        results.posts = done([(post_records, (seed, methods)) for seed in SEEDS], "posts")
    if "confidence" in options.parts:
        results.trusts = done(trust_tasks(), "confidence")
    if "makers" in options.parts:
        results.makers = done([(maker_records, (distance, methods)) for distance in DISTANCES_M], "trueness")
    results.simulator = measure_simulator(options.parts)
    if "speed" in options.parts:
        chosen = cases()
        dots = results.peers[0]
        for some in progress(speed_records(methods, dots, chosen), "speed", len(chosen)):
            results.speeds += some
    if "growth" in options.parts:
        measure_growth(results)
    if "latency" in options.parts:
        results.first_frame_s = first_frame_of_room_s()
        results.latencies = list(progress(latency_records(CASES), "latency", len(CASES)))
    return results


def measure_growth(results: Results) -> None:
    """Time the stages, and how our methods grow in time and memory."""
    results.stages = stage_records()
    results.growths = list(progress(growth_records(), "growth", len(GROWING) * len(THREADS)))
    results.memories = list(progress(memory_records(), "memory", len(MEMORY_CASES)))


def scan(results: Results) -> None:
    """Find the best dots and windows. SGBM HH, slow, is tried on the dots that SGBM 3-way likes best."""
    quick: list[Task[Trial]] = [
        (trials_of_dots, (scene, dot, ("StereoBM", "SGBM 3-way"))) for dot in DOTS_PX for scene in SCAN_SCENES
    ]
    trials = done(quick, "dots")
    three_way = best_settings(trials)[-1]
    slow: list[Task[Trial]] = [(trials_of_dots, (scene, three_way.dot_px, ("SGBM HH",))) for scene in SCAN_SCENES]
    trials += done(slow, "dots, HH")
    results.trials = mean_trials(trials)
    results.peers = best_settings(trials)


def accuracy_tasks(options: argparse.Namespace, methods: Sequence[Method]) -> list[Task[Record]]:
    """One task a scene and texture."""
    passive = DotMethod("SGBM 3-way", 7, projector_on=False)
    tasks: list[Task[Record]] = []
    for scene in options.scenes:
        plain: list[Condition] = [DEFAULT] if "scenes" in options.parts else []
        textured: list[Condition] = []
        if "conditions" in options.parts:
            plain = [one for one in CONDITIONS if one.texture == 0.0]
            textured = [TEXTURED]
        if plain:
            tasks.append((scene_records, (scene, plain, methods)))
        if textured:
            tasks.append((scene_records, (scene, textured, methods)))
        if "light" in options.parts and scene in LIGHT_SCENES:
            tasks.append((scene_records, (scene, ILLUMINATION, (*methods, passive))))
            tasks.append((scene_records, (scene, (PLAIN_AMBIENT,), methods)))
    return tasks


if __name__ == "__main__":
    raise SystemExit(main())
