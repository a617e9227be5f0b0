"""Compile the kernels into their cache, in a process of its own, before tests and demo use them.

Code that a process has just compiled may round otherwise in the last bit than the same code read from the cache, so
every process that is compared with another reads it.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from moire_sensor.paper_rig import paper_rig
from moire_sensor.reconstructor import METHODS
from moire_sensor.ros.kernels import warm_up
from moire_sensor.settings import Settings
from moire_sim.device_view import DeviceView
from moire_sim.fringe_image import light_surfaces
from moire_sim.render_maths import FAR_M, NEAR_M
from moire_sim.surface_kernels import fill_bodies, fill_depth

# Share no more than a few small kernels with the other methods, and take a third of the time: compiled beside them.
APART = {"fringe_edges"}


def main() -> int:
    """Warm up all that the nodes offer, and the simulator's light and shadow, in two processes."""
    print("kernels: compiling or loading (a minute or two the first time)", file=sys.stderr, flush=True)
    with ProcessPoolExecutor(2, get_context("spawn")) as processes:
        for work in (processes.submit(warm_methods, set(METHODS) - APART), processes.submit(warm_others)):
            work.result()
    return 0


def warm_methods(methods: set[str]) -> None:
    """Warm up what some methods and all clouds need."""
    warm_up(methods, Settings())


def warm_others() -> None:
    """Warm up the simulator and the methods apart."""
    rig, wall_m, white = paper_rig(), np.ones((48, 64)), np.ones((48, 64), dtype=np.float32)
    view = DeviceView.of(rig.P_left, (64, 48))
    light_surfaces(rig, view, wall_m, white, view, wall_m)
    fill_depth(white.ravel(), NEAR_M, FAR_M, wall_m.ravel())
    fill_bodies(np.zeros(48 * 64, np.int32), np.zeros(1, np.int32), wall_m.ravel(), np.empty(48 * 64, np.int32))
    warm_methods(APART)


if __name__ == "__main__":
    raise SystemExit(main())
