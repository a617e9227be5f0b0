"""Run as a program, without the compiler: reconstructs, and checks what kernels over rows promise the compiler.

Every call of a kernel that is compiled with :class:`moire_sensor.apart.Apart` is looked at: what it changes in one
array may not lie in another argument.
"""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Iterator
from itertools import combinations
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Kernel = Callable[..., Any]
called: set[str] = set()
broken: set[str] = set()


def arrays_of(arguments: tuple[Any, ...]) -> Iterator[npt.NDArray[Any]]:
    """All arrays, also those in tuples."""
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            yield argument
        elif isinstance(argument, tuple):
            yield from arrays_of(argument)


def checked(kernel: Kernel) -> Kernel:
    """The kernel, and notes whether it kept its promise."""

    @functools.wraps(kernel)
    def call(*arguments: Any) -> Any:
        arrays = [array for array in arrays_of(arguments) if array.size]
        near = [pair for pair in combinations(arrays, 2) if np.shares_memory(*pair)]
        before = [[array.tobytes() for array in pair] for pair in near]
        result = kernel(*arguments)
        called.add(kernel.__name__)
        for pair, held in zip(near, before, strict=True):
            if all(array.tobytes() != old for array, old in zip(pair, held, strict=True)):
                broken.add(f"{kernel.__module__}.{kernel.__name__}")
        return result

    return call


def njit(*functions: Kernel, **options: Any) -> Any:
    """``numba.njit`` without the compiler."""
    watch = checked if "pipeline_class" in options else lambda kernel: kernel
    return watch(functions[0]) if functions else watch


def reconstruct_all() -> None:
    """One small reconstruction of each method."""
    sys.path[:0] = sys.argv[1:]
    from dense_rigs import small_rig

    from moire_sensor import Reconstructor
    from moire_sensor.paper_rig import paper_pattern
    from moire_sim.analytic_scenes import analytic_capture

    for steps, method in ((1, "dense"), (4, "phase_shift"), (1, "fringe_edges"), (1, "reference_plane")):
        seen = analytic_capture("plane_1000", paper_pattern(steps), rig=small_rig(shift_px=97.0))
        Reconstructor(seen.rig, seen.pattern, (0.8, 1.3), method).reconstruct(seen.left, seen.right)


@checked
def copy(values: npt.NDArray[np.float32], target: npt.NDArray[np.float32]) -> None:
    """A kernel to see that the check can fail."""
    target[:] = values


if __name__ == "__main__":
    numba.njit = njit
    warnings.simplefilter("error")
    # Vectors go on behind the last number of a row: what is computed there means nothing.
    np.seterr(divide="ignore", invalid="ignore")
    reconstruct_all()
    row = np.arange(6.0, dtype=np.float32)
    copy(row[:2], row[3:5])
    print(f"{len(called)} kernels; broken: {' '.join(sorted(broken)) or 'none'}")
    copy(row[:-1], row[1:])
    print("can fail" if f"{__name__}.copy" in broken else "cannot fail")
