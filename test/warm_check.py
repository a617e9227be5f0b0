"""Run as a program: warms a method up as the node does, reconstructs, and prints the kernels that came in only then."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt
from numba.core.dispatcher import Dispatcher

from moire_sensor import Reconstructor
from moire_sensor.nav_cloud import NavSettings, clearing_cloud, obstacle_cloud
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.rectify import rectify_pair
from moire_sensor.ros.kernels import STEPS, warm_up
from moire_sensor.settings import Settings
from moire_sim import VirtualHead

LEVELS = {"uint8": 255.0, "uint16": 4095.0}
FINER = 16


def kernels() -> set[tuple[str, str]]:
    """Every compiled kernel of the package and the arguments that it is compiled for."""
    modules = [module for name, module in sys.modules.items() if name.startswith("moire_sensor.")]
    found = {kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)}
    return {(f"{kernel.__module__}.{kernel.__name__}", str(one)) for kernel in found for one in kernel.signatures}


def work(sensor: Reconstructor, left: npt.NDArray[Any], right: npt.NDArray[Any]) -> None:
    """What a node does with a set."""
    shot = sensor.reconstruct(left, right)
    points = sensor.rig.points(shot.depth_m)
    cloud = np.concatenate([points, shot.background[..., None]], axis=-1)
    obstacle_cloud(sensor.rig, cloud, shot, NavSettings())
    clearing_cloud(cloud, shot, NavSettings())


def main() -> int:
    """Take the method and the type of the images."""
    method, dtype = sys.argv[1:]
    warm_up({method}, Settings(), LEVELS[dtype])
    warm = kernels()
    pattern = paper_pattern(STEPS.get(method, 1))
    with VirtualHead("room") as head:
        seen, rig = head.capture(pattern), head.rig
    sensor = Reconstructor(rig, pattern, method=method, saturation_level=LEVELS[dtype])
    views = [image if dtype == "uint8" else image.astype(np.uint16) * FINER for image in (seen.left, seen.right)]
    for writeable in (True, False):
        for view in views:
            view.flags.writeable = writeable
        work(sensor, *views)
    raw = [view.reshape(-1, *view.shape[-2:])[0] for view in views]
    lens = (1e-3, 0.0, 0.0, 0.0)
    rectify_pair(rig.P_left, rig.P_right, rig.P_projector, rig.image_size, lens, lens).rectify(*raw)
    print(len(warm), sorted({name for name, _ in kernels() - warm}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
