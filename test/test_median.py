"""The median of samples is that of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sensor.median import median


@pytest.mark.parametrize("count", [1, 2, 5, 1000, 1001])
def test_it_is_numpys(count: int) -> None:
    values = np.random.default_rng(count).normal(0.0, 10.0, count).astype(np.float32)
    given = values.copy()
    assert median(values) == np.median(values)
    np.testing.assert_array_equal(values, given)
