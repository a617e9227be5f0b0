"""FringePattern: phase, signal and fringe order by the contract's formulas."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moire_sensor.errors import PatternError
from moire_sensor.pattern import FringePattern
from moire_sensor.shot import UNKNOWN_ORDER

few = settings(derandomize=True, deadline=None, max_examples=30)
periods = st.floats(4.0, 500.0)
phases = st.floats(-20.0, 20.0)


@few
@given(periods, phases, st.floats(-3000.0, 3000.0))
def test_order_is_the_period_of_the_nearest_brightest_line(
    period_px: float, phase_rad: float, column_px: float
) -> None:
    pattern = FringePattern(period_px, phase_rad)
    order = int(pattern.order_at(column_px))
    line_px = (order - phase_rad / (2.0 * math.pi)) * period_px
    assert abs(column_px - line_px) <= period_px / 2.0 * (1.0 + 1e-9)
    assert float(pattern.signal(line_px)) == pytest.approx(1.0, abs=1e-9)


def test_order_by_hand_and_where_it_is_unknown() -> None:
    pattern = FringePattern(10.0, math.pi / 2.0)
    # floor(u / 10 + 1/4 + 1/2)
    np.testing.assert_array_equal(pattern.order_at([-7.6, -7.4, 0.0, 2.4, 2.6, 12.6]), [-1, 0, 0, 0, 1, 2])
    unknown = pattern.order_at([np.nan, np.inf, 1e9])
    assert unknown.dtype == np.int16
    np.testing.assert_array_equal(unknown, [UNKNOWN_ORDER] * 3)


@few
@given(periods, phases, st.integers(1, 9), st.integers(-20, 20))
def test_signal_is_the_cosine_of_the_contract(period_px: float, phase_rad: float, count: int, step: int) -> None:
    pattern = FringePattern(period_px, phase_rad).with_equal_steps(count)
    columns = np.linspace(-100.0, 1400.0, 41)
    expected = np.cos(2 * np.pi * columns / period_px + phase_rad + 2 * np.pi * (step % count) / count)
    np.testing.assert_allclose(pattern.signal(columns, step), expected, atol=1e-9)
    assert pattern.step_count == count


def test_square_is_the_sign_of_the_sine() -> None:
    columns = np.arange(0.25, 100.0)
    sine, square = FringePattern(16.0, 0.3), FringePattern(16.0, 0.3, waveform="square")
    np.testing.assert_array_equal(square.signal(columns), np.sign(sine.signal(columns)))


def test_patterns_are_values() -> None:
    assert FringePattern(16, 0, [0, 1]) == FringePattern(16.0, 0.0, (0.0, 1.0))  # type: ignore[arg-type]
    assert len({FringePattern(16.0), FringePattern(16.0), FringePattern(17.0)}) == 2
    assert FringePattern(np.float32(16.0)).period_px == 16.0  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"period_px": 3.9}, "period_px is 3.9; it must be at least 4.0"),
        ({"period_px": -16.0}, "period_px is -16.0"),
        ({"period_px": math.nan}, "period_px is nan; it must be a finite number"),
        ({"period_px": "wide"}, "period_px is 'wide'"),
        ({"period_px": None}, "period_px is None"),
        ({"period_px": True}, "period_px is True"),
        ({"phase_rad": math.inf}, "phase_rad is inf"),
        ({"step_phases_rad": ()}, "step_phases_rad is empty"),
        ({"step_phases_rad": (0.0, math.nan)}, "a phase of step_phases_rad is nan"),
        ({"step_phases_rad": 4}, "step_phases_rad is 4; give a list"),
        ({"step_phases_rad": "0123"}, "step_phases_rad is '0123'"),
        ({"waveform": "triangle"}, "waveform is 'triangle'; it must be one of sine, square"),
    ],
)
def test_what_is_no_pattern_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(PatternError, match=message):
        FringePattern(**{"period_px": 16.0, **fields})


def test_no_steps_are_refused() -> None:
    with pytest.raises(PatternError, match="step_count is 0"):
        FringePattern(16.0).with_equal_steps(0)
