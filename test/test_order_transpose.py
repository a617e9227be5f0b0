"""Transposition in words against numpy's."""

from __future__ import annotations

import numpy as np

from moire_sensor.order_transpose import transpose_back, transpose_bytes


def test_bytes_change_places() -> None:
    source = np.random.default_rng(1).integers(0, 256, (40, 48), dtype=np.uint8)
    target = np.zeros((48, 24), dtype=np.uint8)
    transpose_bytes(source.view(np.uint64), 8, target.view(np.uint64))
    np.testing.assert_array_equal(target, source[8:32].T)


def test_numbers_of_two_bytes_change_places() -> None:
    source = np.random.default_rng(2).integers(-32768, 32768, (48, 24), dtype=np.int16)
    target = np.zeros((40, 48), dtype=np.int16)
    transpose_back(source.view(np.uint64), target.view(np.uint64), 8)
    np.testing.assert_array_equal(target[8:32], source.T)
    assert not target[:8].any()
    assert not target[32:].any()
