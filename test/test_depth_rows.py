"""Rows between the solved ones against a slow loop."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import Float32

from moire_sensor.depth_refine import Match
from moire_sensor.depth_rows import STEEPEST_PX, all_rows
from moire_sensor.phase_image import PhaseImage, solved_rows

WIDTH = 37


def random_rows(height: int, step: int) -> tuple[Match, Float32, PhaseImage]:
    """Match, margins and phases of the solved rows: two surfaces, steps of any size between rows, some unknown."""
    rng = np.random.default_rng(height)
    first, count = solved_rows(height, step)
    disparity, sigma, signed, margin, amplitude, background = rng.uniform(0, 4, (6, count, WIDTH)).astype(np.float32)
    disparity[rng.uniform(size=disparity.shape) < 0.2] = np.nan
    status = rng.integers(0, 3, disparity.shape).astype(np.uint8)
    phase = PhaseImage(signed, amplitude, background, sigma, status, first, step)
    return Match(disparity, sigma, signed - 2, np.abs(signed - 2)), margin, phase


@pytest.mark.parametrize(("height", "step"), [(11, 3), (12, 3), (13, 3), (480, 2), (8, 4), (3, 5)])
def test_rows_between_continue_what_both_neighbours_show(height: int, step: int) -> None:
    match, margin, phase = random_rows(height, step)
    buffer = np.full((6, height, WIDTH), np.nan, dtype=np.float32)
    full, margins, seen = all_rows(match, margin, phase, buffer)
    at = np.clip((np.arange(height) - phase.first_row) / step, 0, phase.rows.size - 1)
    above, below, part = np.floor(at).astype(int), np.ceil(at).astype(int), (at % 1.0)[:, None]
    blends = [
        (seen.amplitude, phase.amplitude), (seen.background, phase.background),
        (full.signed_mismatch_rad, match.signed_mismatch_rad),
    ]  # fmt: skip
    for found, some in blends:
        np.testing.assert_allclose(found, (1 - part) * some[above] + part * some[below], atol=1e-6)
    np.testing.assert_array_equal(full.mismatch_rad, np.abs(full.signed_mismatch_rad))
    np.testing.assert_array_equal(margins, np.minimum(margin[above], margin[below]))
    np.testing.assert_array_equal(seen.status, phase.status[np.floor(at + 0.499).astype(int)])
    one, other = match.disparity_px[above], match.disparity_px[below]
    same = np.abs(one - other) <= step * STEEPEST_PX
    np.testing.assert_allclose(full.disparity_px, np.where(same, (1 - part) * one + part * other, np.nan), atol=1e-6)
    np.testing.assert_array_equal(full.disparity_px[phase.rows], match.disparity_px)


def test_where_all_rows_are_solved_they_stay() -> None:
    match, margin, phase = random_rows(9, 1)
    full, margins, seen = all_rows(match, margin, phase, np.empty((6, 9, WIDTH), dtype=np.float32))
    assert full is match
    assert margins is margin
    assert seen.amplitude is phase.amplitude


def test_solved_rows_are_the_same_upside_down() -> None:
    for height, step in ((480, 3), (481, 3), (480, 1), (37, 5), (480, 2)):
        first, count = solved_rows(height, step)
        last = first + step * (count - 1)
        assert 0 <= first <= height - 1 - last <= first + 1
