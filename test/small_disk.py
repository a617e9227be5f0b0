"""A command on a disk that fills up: a file system of its own in memory, gone with the command."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest


def start_on_small_disk(disk: Path, megabytes: int, command: list[str]) -> subprocess.Popen[str]:
    """Start a command that sees a small disk at ``disk``; when it ends, what it left is in ``disk`` for everybody."""
    if subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False).returncode:
        pytest.skip("this machine lets no test mount a small disk (unshare -rm)")
    disk.mkdir()
    kept = disk.with_name(disk.name + "_kept")
    kept.mkdir()
    # The disk itself is seen only inside; what is on it at the end is copied to the folder beneath it.
    script = (
        f"mount --bind {disk} {kept} && mount -t tmpfs -o size={megabytes}m none {disk} || exit 99; "
        f'"$@"; code=$?; cp -r {disk}/. {kept}/; exit $code'
    )
    return subprocess.Popen(
        ["unshare", "-rm", "sh", "-c", script, "sh", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
