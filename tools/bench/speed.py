"""Time of every method against OpenCV's StereoBM in the same process, turn by turn."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numba
import numpy as np

from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_rig
from moire_sensor.rig import StereoRig
from moire_sim.analytic_scenes import AnalyticScene, scene_surfaces
from tools.bench.accuracy import DEPTH_RANGE_M, photograph
from tools.bench.conditions import DEFAULT
from tools.bench.methods import Depth, DotMethod, Method, Range

SCENE = "cylinder_and_box"
WIDE_RANGE_M = (0.3, 3.0)
USUAL_SIZE, LARGEST_SIZE = (640, 480), (1920, 1080)
SIZES = ((320, 240), USUAL_SIZE, (1280, 960), LARGEST_SIZE)
THREADS = (1, 2)
REFERENCE_DISPARITIES, REFERENCE_WINDOW_PX = 128, 15
ROUNDS, LEAST_ROUNDS, SECONDS_A_CASE = 25, 5, 5.0

Task = Callable[[], Any]


@dataclass(frozen=True)
class Case:
    """One image size (width, height), depth range and number of threads."""

    image_size: tuple[int, int]
    depth_range_m: Range
    threads: int


@dataclass(frozen=True)
class SpeedRecord:
    """Time of one method in one case: median milliseconds, and median ratio to the reference of the same turn."""

    method: str
    case: Case
    milliseconds: float
    ratio: float


# SGBM HH takes seconds on large images and wide ranges, SGBM 3-way on the largest.
HH_CASES = tuple(Case(USUAL_SIZE, DEPTH_RANGE_M, threads) for threads in THREADS)


def cases() -> list[Case]:
    """Return all sizes at the default range, and the wide range at the rig's own size."""
    sizes = [Case(size, DEPTH_RANGE_M, threads) for size in SIZES for threads in THREADS]
    return sizes + [Case(USUAL_SIZE, WIDE_RANGE_M, threads) for threads in THREADS]


def is_timed(method: Method, case: Case) -> bool:
    """Whether a method is quick enough for a case."""
    if method.name == "SGBM HH":
        return case in HH_CASES
    return method.name != "SGBM 3-way" or case.image_size != LARGEST_SIZE


def size_at(scale: float) -> tuple[int, int]:
    """Size of images with ``scale`` times the pixels along each side."""
    return round(scale * USUAL_SIZE[0]), round(scale * USUAL_SIZE[1])


def scales_of(image_size: tuple[int, int]) -> tuple[float, float]:
    """Pixels of an image size beside the paper rig's, along rows and columns."""
    return image_size[0] / USUAL_SIZE[0], image_size[1] / USUAL_SIZE[1]


def scaled_rig(image_size: tuple[int, int]) -> StereoRig:
    """Return the paper's rig with other pixels in the same field of view."""
    rig, (along, down) = paper_rig(), scales_of(image_size)
    finer = np.array([[along, 0.0, 0.5 * (along - 1.0)], [0.0, down, 0.5 * (down - 1.0)], [0.0, 0.0, 1.0]])
    left, right, projector = (finer @ projection for projection in (rig.P_left, rig.P_right, rig.P_projector))
    return StereoRig.from_projections(
        left, right, projector, image_size, projector_size=scaled_projector(image_size)
    )


def scaled_projector(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return the projector's size in pixels for a camera of another size."""
    along, down = scales_of(image_size)
    return round(PROJECTOR_SIZE[0] * along), round(PROJECTOR_SIZE[1] * down)


class SpeedScene:
    """The scene at one size, and its pictures for each method, taken once."""

    def __init__(self, image_size: tuple[int, int]) -> None:
        self.scale = scales_of(image_size)[0]
        self.rig = scaled_rig(image_size)
        self.scene = AnalyticScene.of(scene_surfaces(SCENE), 0.0, self.rig, scaled_projector(image_size))
        self._pictures: dict[str, tuple[Any, Any]] = {}

    def pictures(self, method: Method) -> tuple[Any, Any]:
        """Return the left and right picture for a method."""
        if method.name not in self._pictures:
            self._pictures[method.name] = photograph(self.scene, method.pattern(DEFAULT, self.scale), DEFAULT)
        return self._pictures[method.name]

    def task(self, method: Method, case: Case) -> Task:
        """Return a call that measures depth once."""
        left, right = self.pictures(method)
        solver: Callable[[Any, Any], Depth] = method.solver(self.rig, DEFAULT, case.depth_range_m, self.scale)
        return lambda: solver(left, right)

    def reference(self, dots: DotMethod) -> Task:
        """Return the reference: OpenCV's StereoBM as it comes, 128 disparities, window 15, no rim added."""
        left, right = self.pictures(dots)
        matcher = cv2.StereoBM.create(REFERENCE_DISPARITIES, REFERENCE_WINDOW_PX)
        return lambda: matcher.compute(left, right)


def speed_records(methods: Sequence[Method], dots: DotMethod, chosen: Sequence[Case]) -> Iterator[list[SpeedRecord]]:
    """Time the methods case by case; each list holds the reference first, with ratio 1."""
    scene = None
    for case in chosen:
        if scene is None or scene.rig.image_size != case.image_size:
            scene = SpeedScene(case.image_size)
        timed = [method for method in methods if is_timed(method, case)]
        tasks = [scene.reference(dots), *(scene.task(method, case) for method in timed)]
        set_threads(case.threads)
        times_s = turns(tasks)
        names = [f"StereoBM({REFERENCE_DISPARITIES}, {REFERENCE_WINDOW_PX})", *(method.name for method in timed)]
        yield [
            SpeedRecord(name, case, 1e3 * float(np.median(own)), float(np.median(own / first)))
            for name, own, first in zip(names, times_s.T, np.broadcast_to(times_s[:, 0], times_s.T.shape), strict=True)
        ]
    set_threads(max(THREADS))


def turns(tasks: Sequence[Task]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Seconds (rounds, tasks): all tasks once a round, so that a busy machine slows all alike."""
    for task in tasks:
        task()
    begin = time.perf_counter()
    rounds: list[list[float]] = []
    while len(rounds) < LEAST_ROUNDS or (len(rounds) < ROUNDS and time.perf_counter() - begin < SECONDS_A_CASE):
        rounds.append([seconds(task) for task in tasks])
    return np.array(rounds)


def seconds(task: Task) -> float:
    """Time of one call."""
    begin = time.perf_counter()
    task()
    return time.perf_counter() - begin


def set_threads(count: int) -> None:
    """Let OpenCV and numba use so many threads, as far as the machine has them."""
    cv2.setNumThreads(count)
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
