"""Compile the kernels into their cache, in a process of its own, before tests and demo use them.

Code that a process has just compiled may round otherwise in the last bit than the same code read from the cache, so
every process that is compared with another reads it.
"""

from __future__ import annotations

import sys

import numpy as np

from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.resample import resample


def main() -> int:
    """Warm up the methods that the nodes offer, and the rectification."""
    print("kernels: compiling or loading (a minute or two the first time)", file=sys.stderr, flush=True)
    for method, steps in (("dense", 1), ("phase_shift", 4), ("fringe_edges", 1), ("reference_plane", 1)):
        Reconstructor(paper_rig(), paper_pattern(steps), method=method).warm_up()
    places = np.stack(np.meshgrid(np.arange(64), np.arange(48)), axis=-1).astype(np.float32)
    resample(np.zeros((48, 64), dtype=np.uint8), places)
    resample(np.zeros((48, 64), dtype=np.uint16), places)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
