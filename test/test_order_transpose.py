"""Transposition in words against numpy's."""

from __future__ import annotations

import numpy as np

from moire_sensor.order_tiles import LANES, as_rows, put_line, tiles_for
from moire_sensor.order_transpose import WORDS, transpose


def test_rows_and_columns_change_places() -> None:
    source = np.random.default_rng(1).integers(0, 256, (LANES, 3, LANES), dtype=np.uint8)
    target = np.zeros_like(source)
    transpose(source.view(np.uint64), np.zeros((WORDS, WORDS, WORDS), dtype=np.uint64), target.view(np.uint64))
    np.testing.assert_array_equal(target, source.transpose(2, 1, 0))


def test_lines_come_back_from_their_strips() -> None:
    lines = np.random.default_rng(2).integers(0, 256, (70, 2, 3 * LANES), dtype=np.uint8)
    tiles = tiles_for(70, 150, 2)
    for y, line in enumerate(lines):
        put_line(line.reshape(2, 3, LANES), tiles[:, y])
    np.testing.assert_array_equal(as_rows(tiles, 70, 150), lines[:, :, :150])
