"""Compiled angle helpers against numpy."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import fast_atan2, wrap, wrapped


@njit
def all_angles(y, x):  # type: ignore[no-untyped-def]
    result = np.empty(len(y), dtype=np.float32)
    for i in range(len(y)):
        result[i] = fast_atan2(y[i], x[i])
    return result


@njit
def all_wrapped(angles):  # type: ignore[no-untyped-def]
    result = np.empty(len(angles), dtype=np.float32)
    for i in range(len(angles)):
        result[i] = wrap(angles[i])
    return result


def test_atan2_is_that_of_numpy() -> None:
    rng = np.random.default_rng(0)
    angle = np.concatenate([np.linspace(-np.pi, np.pi, 20001), rng.uniform(-np.pi, np.pi, 20000)])
    radius = 10.0 ** rng.uniform(-6, 6, angle.size)
    y, x = ((radius * part).astype(np.float32) for part in (np.sin(angle), np.cos(angle)))
    expected = np.arctan2(y.astype(np.float64), x.astype(np.float64))
    error = all_angles(y, x) - expected
    # 2e-6 rad of the polynomial and 2.4e-7 rounding of pi in float32; at the cut both signs of pi are right
    assert np.abs(np.angle(np.exp(1j * error))).max() < 2.5e-6


def test_atan2_on_the_axes_and_at_the_origin() -> None:
    y = np.array([0, 1, 0, -1, 0, 1, -1, 1, -1], dtype=np.float32)
    x = np.array([1, 0, -1, 0, 0, 1, 1, -1, -1], dtype=np.float32)
    np.testing.assert_allclose(all_angles(y, x), np.arctan2(y, x), atol=2.5e-6)


def test_both_wraps_fold_to_half_a_turn() -> None:
    angle = np.random.default_rng(0).uniform(-100, 100, 20000).astype(np.float32)
    truth = angle.astype(np.float64)
    for found in (all_wrapped(angle), wrapped(angle)):
        assert found.dtype == np.float32
        assert np.abs(found).max() <= np.pi + 1e-5
        # 100 rad in float32 is known to 8e-6
        np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * truth), atol=2e-5)


def test_unknown_angles_stay_unknown() -> None:
    assert np.isnan(wrapped(np.array([np.nan], dtype=np.float32))).all()
