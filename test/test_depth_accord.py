"""Surfaces outside the depth range are left unknown, those inside measured all the same."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import capture

from moire_sensor import Reconstructor, Status
from moire_sensor.depth_accord import FOREIGN_RAD, SURE_RAD, agreeing
from moire_sensor.depth_refine import Match


def two_surfaces(left_rad: float, right_rad: float) -> Match:
    """Two surfaces side by side, of 60 and 140 columns, with a mismatch each and noise."""
    rng = np.random.default_rng(3)
    disparity = np.full((120, 200), 40.0, dtype=np.float32)
    disparity[:, 60:] = 60.0
    signed = np.where(disparity < 50.0, left_rad, right_rad) + rng.normal(0.0, 0.1, disparity.shape)
    sigma = np.full_like(disparity, 0.02)
    return Match(disparity, sigma, signed.astype(np.float32), np.abs(signed).astype(np.float32))


@pytest.mark.parametrize(
    ("left_rad", "views_fit", "kept"),
    [(0.0, True, True), (FOREIGN_RAD - 0.1, True, True), (FOREIGN_RAD + 0.1, True, False), (-0.8, True, False),
     (0.0, False, True), (SURE_RAD + 0.05, False, False)],
)  # fmt: skip
def test_a_surface_is_kept_or_dropped_as_a_whole(left_rad: float, views_fit: bool, kept: bool) -> None:
    match = two_surfaces(left_rad, 0.0)
    match.disparity_px[:10] = np.nan
    found = np.isfinite(agreeing(match, views_fit).disparity_px)
    assert (found[10:, :59] == kept).all()
    assert found[10:119, 60:199].all()
    assert not found[:10].any()


def test_few_good_surfaces_among_bad_ones_are_chance() -> None:
    match = two_surfaces(0.3, 0.0)
    match.disparity_px[:, 70:] = np.nan
    assert np.isnan(agreeing(match, False).disparity_px).all()


def test_what_stands_before_a_background_behind_the_range_is_measured() -> None:
    """Steps at 1.1 m before a wall at 1.3 m, with a range up to 1.2 m."""
    seen = capture("stairs")
    shot = Reconstructor(seen.rig, seen.pattern, (0.5, 1.2)).reconstruct(seen.left, seen.right)
    known = np.isfinite(shot.depth_m)
    inside = seen.covisible & (seen.depth_m < 1.2)
    assert 0.3 < inside.mean() < 0.4
    assert known[inside].mean() >= 0.95
    off = np.abs(shot.disparity_px - seen.rig.disparity_px(seen.depth_m)) > 1.0
    # The limit of a whole scene, 0.5 %, by ten: only what lies beside the wall may be off.
    assert off[known].mean() <= 0.0005
    behind = seen.covisible & (seen.depth_m > 1.25)
    assert (shot.status[behind & ~known] == Status.AMBIGUOUS).mean() > 0.9


@pytest.mark.parametrize("name", ["stairs", "small_plate", "spheres"])
def test_nothing_is_measured_where_all_lies_behind_the_range(name: str) -> None:
    seen = capture(name)
    shot = Reconstructor(seen.rig, seen.pattern, (0.5, 0.8)).reconstruct(seen.left, seen.right)
    assert not np.isfinite(shot.depth_m).any()
