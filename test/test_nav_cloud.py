"""Points for costmaps: voxels and support against the obvious way, flying pixels gone, rays that end before things."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from moire_sensor import SettingsError
from moire_sensor.nav_cloud import (
    RAY_BLOCK_PX,
    REACH_PX,
    SAME_SURFACE,
    NavSettings,
    clearing_cloud,
    obstacle_cloud,
    supported,
)
from moire_sensor.paper_rig import paper_rig
from moire_sensor.shot import Shot
from moire_sensor.voxels import STRETCH, voxel_means

Depth = np.ndarray[Any, np.dtype[np.float32]]
WALL_M, BOX_M = 1.8, 1.0


def slow_voxels(points: np.ndarray[Any, Any], voxel_m: float, min_points: int) -> dict[tuple[int, ...], Any]:
    """The obvious way, point by point."""
    cells: dict[tuple[int, ...], list[Any]] = {}
    for point in points:
        if np.isfinite(point).all():
            cells.setdefault(tuple(np.floor(point[:3] / np.float32(voxel_m)).astype(int)), []).append(point)
    return {cell: np.mean(held, axis=0) for cell, held in cells.items() if len(held) >= min_points}


def slow_support(depth_m: Depth) -> np.ndarray[Any, Any]:
    """The obvious way, pixel by pixel."""
    mask = np.zeros(depth_m.shape, dtype=bool)
    for y, x in np.ndindex(depth_m.shape):
        row = depth_m[y, max(x - REACH_PX, 0) : x + REACH_PX + 1]
        column = depth_m[max(y - REACH_PX, 0) : y + REACH_PX + 1, x]
        near = [np.abs(line - depth_m[y, x]) <= np.float32(SAME_SURFACE) * depth_m[y, x] for line in (row, column)]
        mask[y, x] = all(same.sum() > REACH_PX for same in near)
    return mask


def shot_of(depth_m: Depth, confidence: float = 1.0) -> Shot:
    zeros = np.zeros(depth_m.shape, dtype=np.float32)
    order, status = zeros.astype(np.int16), zeros.astype(np.uint8)
    sure = np.where(np.isfinite(depth_m), np.float32(confidence), np.float32(0.0))
    return Shot(depth_m, zeros, zeros, order, sure, status, zeros)


def box_before_wall() -> Depth:
    """A box in the middle, pixels of neither surface on its left side, unknown ones on its right."""
    depth_m = np.full((480, 640), WALL_M, dtype=np.float32)
    depth_m[160:320, 240:400] = BOX_M
    depth_m[160:320, 240 - REACH_PX : 240] = np.linspace(1.2, 1.6, REACH_PX, dtype=np.float32)
    depth_m[160:320, 400:440] = np.nan
    return depth_m


@pytest.mark.parametrize("voxel_m", [0.05, 0.0007])
@pytest.mark.parametrize("channels", [3, 4])
def test_voxels_equal_the_obvious_way(voxel_m: float, channels: int) -> None:
    """Runs of one to four points, some across the border of two stretches, with unknown points between."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.5, 0.5, (1000, channels)).astype(np.float32)
    points[:, :3] = np.round(points[:, :3], 1)
    points = np.repeat(points, rng.integers(1, 5, len(points)), axis=0)
    points[rng.random(len(points)) < 0.1] = np.nan
    share = np.where(np.isfinite(points).all(axis=1), 0.5, 0.0)
    assert len(points) > 2 * STRETCH
    kept = voxel_means(points, share, np.ones(len(points), dtype=bool), voxel_m, 1.0)
    expected = slow_voxels(points, voxel_m, 2)
    assert kept.shape == (1, len(expected), channels)
    assert np.isfinite(kept).all()
    order = np.lexsort(np.round(kept[0, :, :3], 3).T)
    wanted = np.array(list(expected.values()))
    np.testing.assert_allclose(kept[0][order], wanted[np.lexsort(np.round(wanted[:, :3], 3).T)], atol=1e-5)


def test_voxels_leave_out_lone_points() -> None:
    points = np.zeros((4, 4), dtype=np.float32)
    points[:, 2] = [1.0, 1.001, 2.0, 3.0]
    every = np.ones(4, dtype=bool)
    kept = voxel_means(points, np.array([0.1, 0.1, 0.1, 0.3]), every, 0.02, 0.2)
    np.testing.assert_allclose(kept[0, :, 2], [1.0005, 3.0])
    assert voxel_means(points[:0], np.empty(0), every[:0], 0.02, 0.1).shape == (1, 0, 4)


def test_voxels_are_of_trusted_points_and_leave_out_what_is_mostly_doubted() -> None:
    """Of nine points in each of two voxels, three and two are trusted."""
    points = np.zeros((18, 4), dtype=np.float32)
    points[:9, 2] = 1.015
    points[9:, 2] = 2.0
    trusted = np.zeros(18, dtype=bool)
    trusted[[0, 1, 2, 9, 10]] = True
    points[:3, 2] = [1.001, 1.002, 1.003]
    kept = voxel_means(points, np.full(18, 0.1), trusted, 0.02, 0.2)
    np.testing.assert_allclose(kept[0, :, 2], [1.002])


def test_support_equals_the_obvious_way() -> None:
    rng = np.random.default_rng(2)
    depth_m = np.where(rng.random((60, 80)) < 0.5, 1.0, 1.5).astype(np.float32)
    depth_m[20:40, 20:50] = np.linspace(1.0, 1.3, 30, dtype=np.float32)
    depth_m[rng.random((60, 80)) < 0.1] = np.nan
    np.testing.assert_array_equal(supported(depth_m), slow_support(depth_m))


def test_flying_pixels_are_dropped_and_edges_and_corners_kept() -> None:
    depth_m = box_before_wall()
    kept = supported(depth_m)
    assert not kept[160:320, 240 - REACH_PX : 240].any()
    assert not kept[160:320, 400:440].any()
    surface = np.isin(depth_m, np.float32([WALL_M, BOX_M]))
    # The image's own corners have no neighbours on two sides, and stay: three of three.
    np.testing.assert_array_equal(kept, surface)


def test_obstacles_are_within_range_and_trusted() -> None:
    depth_m = box_before_wall()
    rig = paper_rig()
    nav = NavSettings(nav_max_range_m=1.5)
    cloud = rig.points(depth_m)
    found = obstacle_cloud(rig, cloud, shot_of(depth_m), nav)[0]
    np.testing.assert_allclose(found[:, 2], BOX_M, rtol=1e-6)
    # The box covers 160 by 160 pixels: 0.128 by 0.1275 m of 20 mm voxels, cut ones at its ends.
    assert 6 * 6 <= len(found) <= 8 * 8
    assert obstacle_cloud(rig, cloud, shot_of(depth_m, confidence=0.7), nav).shape == (1, 0, 3)


def test_clearing_rays_end_before_the_nearest_thing_or_at_the_range() -> None:
    depth_m = box_before_wall()
    rig = paper_rig()
    nav = NavSettings(nav_max_range_m=1.5)
    ends = clearing_cloud(rig.points(depth_m), shot_of(depth_m), nav)[0]
    assert np.isfinite(ends).all()
    pixels = np.rint(ends[:, :2] / ends[:, 2:] * [rig.fx_px, rig.fy_px] + rig.centre_px).astype(int)
    length_m = np.linalg.norm(ends, axis=-1)
    towards_m = np.linalg.norm(rig.points(depth_m)[pixels[:, 1], pixels[:, 0]], axis=-1)
    np.testing.assert_allclose(length_m, np.minimum(towards_m - nav.nav_voxel_m, nav.nav_max_range_m), rtol=1e-5)
    # Blocks of 8 pixels: 40 columns of the box's unknown side clear nothing, nor does a block that holds too few.
    blocks = pixels // RAY_BLOCK_PX
    unknown = (blocks[:, 0] >= 50) & (blocks[:, 0] < 55) & (blocks[:, 1] >= 20) & (blocks[:, 1] < 40)
    assert not unknown.any()
    assert len(ends) == 80 * 60 - 5 * 20


def test_nothing_known_clears_nothing_and_marks_nothing() -> None:
    depth_m = np.full((480, 640), np.nan, dtype=np.float32)
    cloud = paper_rig().points(depth_m)
    shot = shot_of(depth_m)
    assert clearing_cloud(cloud, shot, NavSettings()).shape == (1, 0, 3)
    assert obstacle_cloud(paper_rig(), cloud, shot, NavSettings()).shape == (1, 0, 3)


def test_a_setting_out_of_range_is_named() -> None:
    with pytest.raises(SettingsError, match=r"nav_voxel_m is 0\.0; allowed is 0\.001 to 1"):
        NavSettings(nav_voxel_m=0.0)
