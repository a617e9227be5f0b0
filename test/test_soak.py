"""The soak script: two minutes' worth of sets, of which none may be lost; and its verdict can be bad."""

from __future__ import annotations

import subprocess
import sys

import pytest
from source_scan import ROOT

from tools.soak import ALLOWED_GROWTH_MB, Soak, verdict

# Some 30 s on two free cores; the script itself ends when nothing new comes for two minutes.
HANG_S = 900.0

# Two minutes at 30 Hz. Small pictures, sent as fast as the reconstruction takes them: the same sets in less time.
EXPOSURES = 2 * 60 * 30


def test_two_minutes_of_sets_at_30_hz_lose_none_and_keep_memory_flat() -> None:
    options = ("--exposures", str(EXPOSURES), "--rate-hz", "0", "--scale", "0.2")
    command = [sys.executable, "-m", "tools.soak", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{EXPOSURES} depths of {EXPOSURES} at " in done.stdout
    assert ", 0 lost; " in done.stdout


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
