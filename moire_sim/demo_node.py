"""Executable ``moire_demo``: virtual head and reconstruction as two nodes of one process."""

from __future__ import annotations

import sys
from functools import partial

from moire_sensor.ros.executable import run_nodes
from moire_sensor.ros.parameters import help_text
from moire_sensor.ros.reconstruction_node import ReconstructionNode
from moire_sensor.ros.reconstruction_settings import SPECS
from moire_sim import virtual_head_node
from moire_sim.virtual_head_node import VirtualHeadNode

USAGE = """
moire_demo --ros-args [-p scene:=room] [-p method:=dense] [-p NAME:=VALUE ...] [-r __ns:=/head]
Virtual head and reconstruction in one process; takes the parameters of both.
"""


def main() -> int:
    """Run both nodes; the console script. The reconstruction's kernels load while the head renders its scene."""
    head, reconstruction = ({spec.name for spec in specs} for specs in (virtual_head_node.SPECS, SPECS))
    makers = (partial(ReconstructionNode, others=head), partial(VirtualHeadNode, others=reconstruction))
    return run_nodes(makers, USAGE + help_text((*virtual_head_node.SPECS, *SPECS)))


if __name__ == "__main__":
    sys.exit(main())
