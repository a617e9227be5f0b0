"""The score against errors put in on purpose."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sensor.errors import ImageError
from moire_sim import HeadCapture, score_depth
from moire_sim.analytic_scenes import analytic_capture
from moire_sim.score import near_edges


@pytest.fixture(scope="module")
def capture() -> HeadCapture:
    return analytic_capture("small_plate")


def test_truth_scores_perfect(capture: HeadCapture) -> None:
    result = score_depth(capture.depth_m, capture)
    assert (result.completeness, result.outlier_share, result.median_error_mm, result.ghost_share) == (1, 0, 0, 0)
    assert result.covisible_share == capture.covisible.mean()


def test_errors_are_scaled_to_one_metre(capture: HeadCapture) -> None:
    result = score_depth(capture.depth_m + 1e-3 * capture.depth_m**2, capture)
    # float32 depth at 1.2 m is known to 1e-4 mm.
    assert result.median_error_mm == pytest.approx(1.0, abs=1e-3)
    assert result.median_error_mm_near == pytest.approx(1.0, abs=1e-3)


def test_shares_count_what_they_say(capture: HeadCapture) -> None:
    depth = np.where(capture.covisible, capture.depth_m, np.nan)
    wrong = depth.copy()
    rows, columns = np.nonzero(capture.covisible)
    wrong[rows[:1000], columns[:1000]] = np.nan
    wrong[rows[1000:3000], columns[1000:3000]] = capture.rig.depth_m(
        capture.rig.disparity_px(depth[rows[1000:3000], columns[1000:3000]]) + 1.1
    )
    wrong[rows[3000:4000], columns[3000:4000]] = capture.rig.depth_m(
        capture.rig.disparity_px(depth[rows[3000:4000], columns[3000:4000]]) - 0.9
    )
    result = score_depth(wrong, capture)
    assert result.completeness == pytest.approx(1 - 1000 / rows.size)
    assert result.outlier_share == pytest.approx(2000 / (rows.size - 1000))
    assert result.ghost_share == 0.0


def test_ghosts_are_wrong_depths_where_none_can_be_known(capture: HeadCapture) -> None:
    blind = ~capture.covisible
    depth = np.where(blind, 0.7, capture.depth_m).astype(np.float32)
    assert score_depth(depth, capture).ghost_share == pytest.approx(blind.mean())
    assert score_depth(capture.depth_m, capture).ghost_share == 0.0


def test_near_and_away_split_at_ten_pixels_from_the_plate(capture: HeadCapture) -> None:
    plate = np.argwhere(capture.depth_m < 1.0)
    (top, _), (bottom, right) = plate.min(axis=0), plate.max(axis=0)
    near = near_edges(capture)
    middle = (top + bottom) // 2
    assert near[middle, right]
    assert near[middle, right + 10]
    assert not near[middle, right + 12]
    assert not near[240, 600]


def test_nothing_known_scores_zero_and_nan(capture: HeadCapture) -> None:
    result = score_depth(np.full((480, 640), np.nan), capture)
    assert result.completeness == 0.0
    assert np.isnan(result.median_error_mm)
    assert np.isnan(result.outlier_share)


def test_another_size_is_refused(capture: HeadCapture) -> None:
    with pytest.raises(ImageError, match=r"\(10, 10\).*\(480, 640\)"):
        score_depth(np.zeros((10, 10)), capture)
