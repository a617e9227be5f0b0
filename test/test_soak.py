"""The soak script on a short run: it counts every exposure, and its verdict can be bad."""

from __future__ import annotations

import subprocess
import sys

import pytest
from source_scan import ROOT

from tools.soak import ALLOWED_GROWTH_MB, Soak, verdict


def test_a_short_run_loses_nothing_and_says_so() -> None:
    command = [sys.executable, "-m", "tools.soak", "--minutes", "0.1", "--rate-hz", "5"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "30 depths of 30, 0 lost" in done.stdout


class NoNode:
    """Takes the subscriptions and never hears of them."""

    def create_subscription(self, *_: object, **__: object) -> None:
        """Nothing comes of it."""


@pytest.mark.parametrize(
    ("depths", "grown_mb", "says"),
    [(10, 0.0, ""), (9, 0.0, "10 exposures gave 9 depths"), (10, ALLOWED_GROWTH_MB + 1.0, "grew by 6.0 MB")],
)
def test_the_verdict_tells_of_lost_sets_and_of_growth(depths: int, grown_mb: float, says: str) -> None:
    state = Soak(NoNode(), 10, depths)  # type: ignore[arg-type]
    state.memory_mb["reconstruction"] = [50.0] * 10 + [300.0] * 80 + [300.0 + grown_mb] * 10
    faults = verdict(state)
    assert len(faults) == bool(says)
    assert says in "".join(faults)
