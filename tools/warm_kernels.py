"""Compile the kernels into their cache, in a process of its own, before tests and demo use them.

Code that a process has just compiled may round otherwise in the last bit than the same code read from the cache, so
every process that is compared with another reads it.
"""

from __future__ import annotations

import sys

from moire_sensor.reconstructor import METHODS
from moire_sensor.ros.kernels import warm_up
from moire_sensor.settings import Settings


def main() -> int:
    """Warm up all that the nodes offer."""
    print("kernels: compiling or loading (a minute or two the first time)", file=sys.stderr, flush=True)
    warm_up(set(METHODS), Settings())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
