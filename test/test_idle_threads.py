"""Idle kernel threads: what is set for OpenMP, and that the user's own choice stays."""

from __future__ import annotations

import os

import pytest

from moire_sensor.idle_threads import SPIN_ROUNDS, let_idle_threads_sleep

NAMES = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, ("passive", str(SPIN_ROUNDS))),
        ({"GOMP_SPINCOUNT": "0"}, ("passive", "0")),
        ({"OMP_WAIT_POLICY": "active"}, ("active", None)),
        ({"OMP_WAIT_POLICY": "passive"}, ("passive", None)),
    ],
)
def test_threads_sleep_soon_unless_the_user_chose(
    given: dict[str, str], expected: tuple[str | None, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    environment = dict(given)
    monkeypatch.setattr(os, "environ", environment)
    let_idle_threads_sleep()
    assert tuple(environment.get(name) for name in NAMES) == expected
