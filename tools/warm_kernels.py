"""Compile the kernels into their cache, in a process of its own, before tests and demo use them.

Code that a process has just compiled may round otherwise in the last bit than the same code read from the cache, so
every process that is compared with another reads it.
"""

from __future__ import annotations

import sys

from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern, paper_rig


def main() -> int:
    """Warm up the methods that the nodes offer."""
    print("kernels: compiling or loading (a minute or two the first time)", file=sys.stderr, flush=True)
    for method, steps in (("dense", 1), ("phase_shift", 4), ("fringe_edges", 1), ("reference_plane", 1)):
        Reconstructor(paper_rig(), paper_pattern(steps), method=method).warm_up()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
