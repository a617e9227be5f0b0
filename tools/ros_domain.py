"""A ROS domain of one's own on this machine, so that demo runs, test runs and live robots do not hear each other."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path
from typing import TextIO

# Domains up to 101 keep the DDS ports below Linux's ephemeral ports; 0 is everyone's default.
DOMAINS = range(1, 102)


def reserve_domain() -> tuple[int, TextIO]:
    """Return a domain id nobody else reserved, and the lock file that holds it until it is closed.

    Raises
    ------
    RuntimeError
        Every domain is reserved.
    """
    for domain in sorted(DOMAINS, key=lambda number: (number * 37 + os.getpid()) % len(DOMAINS)):
        try:
            lock = (Path(tempfile.gettempdir()) / f"moire_ros_domain_{domain}.lock").open("w")
        except PermissionError:  # another user's
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        return domain, lock
    raise RuntimeError(f"all ROS domains {DOMAINS.start} to {DOMAINS.stop - 1} are in use on this machine")


def isolate_ros() -> TextIO:
    """Keep this process and its children in a reserved domain on this machine; hold on to what is returned."""
    domain, lock = reserve_domain()
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    return lock
