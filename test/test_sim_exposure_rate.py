"""The head knows, and says, when it falls behind its rate."""

from __future__ import annotations

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from moire_sim import virtual_head_node
from moire_sim.exposure_rate import FEWEST, WINDOW_S, ExposureRate
from moire_sim.virtual_head_status import exposure_status


def after(rate: ExposureRate, seconds: float, hz: float, start_s: float = 0.0) -> float:
    """Make exposures at a rate; return the time of the last."""
    count = math.ceil(seconds * hz)
    for number in range(count + 1):
        rate.note(start_s + number / hz)
    return start_s + count / hz


@pytest.mark.parametrize(
    ("wanted_hz", "hz", "slow"),
    [(30.0, 30.0, False), (30.0, 20.0, True), (30.0, 28.0, False), (0.1, 0.1, False), (0.2, 0.1, True), (0, 5, False)],
)
def test_a_rate_is_reached_or_not(wanted_hz: float, hz: float, slow: bool) -> None:
    rate = ExposureRate(wanted_hz)
    now_s = after(rate, max(2.0 * WINDOW_S, FEWEST / hz), hz)
    assert rate.reached_hz(now_s) == pytest.approx(hz)
    assert rate.is_slow(now_s) == slow


def test_a_head_that_only_begins_or_has_ended_is_not_slow() -> None:
    rate = ExposureRate(30.0)
    assert not rate.is_slow(after(rate, 0.5 * WINDOW_S, 10.0))
    now_s = after(rate, 2.0 * WINDOW_S, 10.0, start_s=10.0)
    assert rate.is_slow(now_s)
    assert math.isnan(rate.reached_hz(now_s + 2.0 * WINDOW_S))
    assert not rate.is_slow(now_s + 2.0 * WINDOW_S)
    # What was slow before is forgotten.
    assert not rate.is_slow(after(rate, 2.0 * WINDOW_S, 30.0, now_s))


def test_a_slow_head_says_what_it_reaches_and_what_to_do() -> None:
    parameters = {spec.name: spec.default for spec in virtual_head_node.SPECS} | {"rate_hz": 30.0}
    slow = exposure_status(parameters, 100, True, 7.123, True)
    assert slow.level == DiagnosticStatus.WARN
    assert "7.12 of 30 Hz reached" in slow.message
    assert "lower rate_hz" in slow.message
    assert exposure_status(parameters, 100, True, 30.0, False).level == DiagnosticStatus.OK
    assert exposure_status(parameters, 100, False, 30.0, False).message == "the projector is off"
