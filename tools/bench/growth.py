"""How the time of our methods grows with the image and the depth range, and what memory they need."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tools.bench.accuracy import DEPTH_RANGE_M
from tools.bench.conditions import DEFAULT
from tools.bench.methods import FringeMethod
from tools.bench.speed import (
    LARGEST_SIZE,
    THREADS,
    USUAL_SIZE,
    WIDE_RANGE_M,
    Case,
    SpeedScene,
    scaled_rig,
    scales_of,
    set_threads,
    turns,
)

GROWING = FringeMethod("dense"), FringeMethod("phase_shift"), FringeMethod("fringe_edges")
MEMORY_CASES = tuple((method, size) for method in GROWING for size in (USUAL_SIZE, LARGEST_SIZE))
MB = 1024.0


@dataclass(frozen=True)
class GrowthRecord:
    """Time per pixel of the largest images over that of the usual ones, and of the wide depth range over the usual."""

    method: str
    threads: int
    by_pixels: float
    by_range: float


@dataclass(frozen=True)
class MemoryRecord:
    """Resident memory of a process that has measured depth, at its peak, and before it made a reconstructor, MB."""

    method: str
    image_size: tuple[int, int]
    peak_mb: float
    imports_mb: float


def growth_records() -> Iterator[GrowthRecord]:
    """Time usual images, large ones and the wide range in turn, for each method and number of threads."""
    usual, large = SpeedScene(USUAL_SIZE), SpeedScene(LARGEST_SIZE)
    pixels = float(np.prod(LARGEST_SIZE) / np.prod(USUAL_SIZE))
    for method in GROWING:
        for threads in THREADS:
            tasks = [
                scene.task(method, Case(scene.rig.image_size, depth_range_m, threads))
                for scene, depth_range_m in ((usual, DEPTH_RANGE_M), (large, DEPTH_RANGE_M), (usual, WIDE_RANGE_M))
            ]
            set_threads(threads)
            times_s = turns(tasks)
            more, wider = np.median(times_s[:, 1:] / times_s[:, :1], axis=0)
            yield GrowthRecord(method.name, threads, float(more) / pixels, float(wider))
    set_threads(max(THREADS))


def memory_records(cases: Sequence[tuple[FringeMethod, tuple[int, int]]] = MEMORY_CASES) -> Iterator[MemoryRecord]:
    """Measure memory, each method and size in a process of its own."""
    for method, size in cases:
        command = [sys.executable, "-m", "tools.bench.growth", method.name, *(str(length) for length in size)]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        peak_mb, imports_mb = (float(word) for word in said.split())
        yield MemoryRecord(method.name, size, peak_mb, imports_mb)


def peak_mb() -> float:
    """Most resident memory that this process ever had, MB."""
    # Not getrusage: what it says begins with the peak of the parent.
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / MB


def main(arguments: Sequence[str]) -> int:
    """Print the peak of memory of a method at a size, and that of the imports alone."""
    name, width, height = arguments
    method = next(one for one in GROWING if one.name == name)
    print(*peaks_mb(method, (int(width), int(height))))
    return 0


def peaks_mb(method: FringeMethod, image_size: tuple[int, int]) -> tuple[float, float]:
    """Peak of memory after the first depth (kernels loaded from their cache), and before."""
    imports_mb = peak_mb()
    sensor = method.sensor(scaled_rig(image_size), DEFAULT, DEPTH_RANGE_M, scales_of(image_size)[0])
    sensor.warm_up()
    return peak_mb(), imports_mb


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
