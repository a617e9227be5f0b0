"""What the stages of ``dense`` take, one by one."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from moire_sensor import phase_image, phase_pipeline, scratch
from moire_sensor.order_solver import OrderSolver
from moire_sensor.reconstructor import Reconstructor
from tools.bench.accuracy import DEPTH_RANGE_M
from tools.bench.conditions import DEFAULT
from tools.bench.methods import FringeMethod
from tools.bench.speed import ROUNDS, THREADS, USUAL_SIZE, SpeedScene, set_threads

PACKAGE = phase_pipeline.__name__.split(".")[0]
NO_STAGES = (phase_pipeline.__name__, scratch.__name__, phase_image.__name__)
REST = "between the stages"


@dataclass(frozen=True)
class StageRecord:
    """A stage of the pipeline: its name, and median milliseconds by number of threads."""

    name: str
    milliseconds: tuple[float, ...]


class Clock:
    """Seconds spent in each stage of one reconstruction; what a stage calls counts as its own."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inside = False

    def around(self, name: str, stage: Callable[..., Any]) -> Callable[..., Any]:
        """Return the stage, timed."""

        def timed(*arguments: Any, **named: Any) -> Any:
            if self._inside:
                return stage(*arguments, **named)
            self._inside, begin = True, time.perf_counter()
            try:
                return stage(*arguments, **named)
            finally:
                self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
                self._inside = False

        return timed


def stages() -> dict[str, tuple[Any, str, Callable[..., Any]]]:
    """Name, and where to find it, of everything that the pipeline calls."""
    found: dict[str, tuple[Any, str, Callable[..., Any]]] = {}
    for name, value in vars(phase_pipeline).items():
        if inspect.isfunction(value) and value.__module__.startswith(PACKAGE) and value.__module__ not in NO_STAGES:
            found[f"{value.__module__.split('.')[-1]}.{name}"] = phase_pipeline, name, value
    for name in ("solve", "second"):
        found[f"order_solver.{name}"] = OrderSolver, name, getattr(OrderSolver, name)
    return found


@contextmanager
def timed_stages(clock: Clock) -> Iterator[None]:
    """Have every stage timed as long as the context lasts."""
    untimed = stages()
    for label, (place, name, stage) in untimed.items():
        setattr(place, name, clock.around(label, stage))
    try:
        yield
    finally:
        for place, name, stage in untimed.values():
            setattr(place, name, stage)


def stage_records(rounds: int = ROUNDS) -> list[StageRecord]:
    """Time the stages of ``dense`` on the usual images, in the order in which they come; the last is what is left."""
    scene, method = SpeedScene(USUAL_SIZE), FringeMethod("dense")
    left, right = scene.pictures(method)
    sensor = method.sensor(scene.rig, DEFAULT, DEPTH_RANGE_M)
    columns = []
    for threads in THREADS:
        set_threads(threads)
        columns.append(stage_times(sensor, left, right, rounds))
    set_threads(max(THREADS))
    return [StageRecord(name, tuple(1e3 * column[name] for column in columns)) for name in columns[0]]


def stage_times(sensor: Reconstructor, left: Any, right: Any, rounds: int) -> dict[str, float]:
    """Median seconds of each stage that the sensor's reconstructions have."""
    sensor.reconstruct(left, right)
    times: list[dict[str, float]] = []
    for _ in range(rounds):
        clock = Clock()
        with timed_stages(clock):
            begin = time.perf_counter()
            sensor.reconstruct(left, right)
            whole = time.perf_counter() - begin
        times.append({**clock.seconds, REST: whole - sum(clock.seconds.values())})
    return {name: float(np.median([one.get(name, 0.0) for one in times])) for name in times[0]}
