"""Compile the kernels into their cache, in a process of its own, before tests and demo use them.

Code that a process has just compiled may round otherwise in the last bit than the same code read from the cache, so
every process that is compared with another reads it.
"""

from __future__ import annotations

import sys

import numpy as np

from moire_sensor.paper_rig import paper_rig
from moire_sensor.reconstructor import METHODS
from moire_sensor.ros.kernels import warm_up
from moire_sensor.settings import Settings
from moire_sim.device_view import DeviceView, tangent_planes, visible_share


def main() -> int:
    """Warm up all that the nodes offer, and the simulator's light and shadow."""
    print("kernels: compiling or loading (a minute or two the first time)", file=sys.stderr, flush=True)
    warm_up(set(METHODS), Settings())
    view, wall_m = DeviceView.of(paper_rig().P_left, (64, 48)), np.ones((48, 64))
    visible_share(view, wall_m, view.points(wall_m), tangent_planes(view, wall_m))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
