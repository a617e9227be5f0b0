"""After a warm-up no kernel is compiled, or read, for the first real images."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

LEAST_KERNELS = 8


@pytest.mark.parametrize(
    ("method", "dtype"),
    [("dense", "uint8"), ("dense", "uint16"), ("phase_shift", "uint8"), ("fringe_edges", "uint8")],
)
def test_nothing_is_left_for_the_first_images(method: str, dtype: str) -> None:
    command = [sys.executable, str(Path(__file__).with_name("warm_check.py")), method, dtype]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    number, late = done.stdout.splitlines()[-1].split(maxsplit=1)
    assert late == "[]"
    assert int(number) >= LEAST_KERNELS
