"""``make view``: a virtual head, its reconstruction and the live view, until Ctrl-C."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

from tools.demo.processes import NodeProcess
from tools.ros_domain import isolate_ros

RATE_HZ = 10.0
POLL_S = 0.2


def main() -> int:
    """Run the three nodes; 1 when one of them ends by itself."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", default="cylinder_and_box", help="what the head looks at")
    parser.add_argument("--port", default="8080", help="TCP port of the page; 0: any free one")
    options = parser.parse_args()
    parameters = {
        "moire_viewer": [f"port:={options.port}"],
        "reconstruction": [],
        "virtual_head": [f"scene:={options.scene}", f"rate_hz:={RATE_HZ}"],
    }
    lock = isolate_ros()
    nodes: list[NodeProcess] = []
    with tempfile.TemporaryDirectory(prefix="moire_view_") as folder:
        try:
            for name, values in parameters.items():
                nodes.append(NodeProcess.start(name, values, Path(folder) / f"{name}.log"))
            return watch(nodes)
        except KeyboardInterrupt:
            return 0
        finally:
            for node in nodes:
                node.stop()
            lock.close()


def watch(nodes: list[NodeProcess]) -> int:
    """Print the address once the page is there; return 1 when a node has ended."""
    told = False
    while True:
        for node in nodes:
            if node.process.poll() is not None:
                print(f"view: {node.name} has ended: {node.last_words()}", file=sys.stderr)
                return 1
        if not told and "ready" in (words := nodes[0].last_words()):
            told = True
            print(f"view: {words.partition('ready: ')[2]}; Ctrl-C ends it")
            print(f"view: ros2 commands see it with ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']}", flush=True)
        time.sleep(POLL_S)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the nodes are stopped then too
    sys.exit(main())
