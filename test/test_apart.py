"""The promise that arguments of kernels over rows lie apart in memory, kept in every call of a reconstruction."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

LEAST_KERNELS = 40


@pytest.mark.skipif(
    np.lib.NumpyVersion(np.__version__) < "2.0.0",
    reason="kernels are interpreted here, and numpy 1.x makes floats of uint64 and int; what lies apart is the same",
)
def test_kernels_over_rows_get_arguments_that_lie_apart() -> None:
    test = Path(__file__).parent
    command = [sys.executable, str(test / "apart_check.py"), str(test.parent), str(test)]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found, control = done.stdout.splitlines()
    assert found.endswith("broken: none"), found
    assert int(found.split()[0]) >= LEAST_KERNELS, found
    assert control == "can fail"
