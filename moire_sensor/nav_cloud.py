"""Points for costmaps: what may be marked as an obstacle, and rays along which nothing stands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.rig import StereoRig
from moire_sensor.settings import check_ranges, setting
from moire_sensor.shot import Shot

Cloud = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
# A neighbour belongs to the same surface within this share of the depth.
SAME_SURFACE = 0.02
# Half the length of the row and the column of neighbours that are looked at, pixels.
REACH_PX = 3
# Clearing rays: one for each block of this side, pixels; 13 mm apart at 2 m in the paper's rig.
RAY_BLOCK_PX = 8
# A voxel of which fewer of the pixels that fall into it are trusted is left out: where the sensor doubts most of a
# surface, those few beside them that pass are as wrong (a door's reveal seen at a grazing angle, off by 0.1 m).
TRUSTED_SHARE = 1.0 / 3.0
# A grid of this size is counted directly, five times as fast as sorting the points; a larger one costs memory.
MAX_GRID_CELLS = 4_000_000


@dataclass(frozen=True)
class NavSettings:
    """What reaches a costmap.

    Raises
    ------
    SettingsError
        A value outside its range; the message names it.
    """

    nav_voxel_m: float = setting(0.02, 0.001, 1.0, "edge of a voxel of points_nav, m")
    nav_min_fill: float = setting(0.05, 0.0, 1.0, "share of a facing square's pixels that a voxel of points_nav needs")
    nav_min_confidence: float = setting(0.8, 0.0, 1.0, "least confidence of a pixel in points_nav")
    nav_max_range_m: float = setting(2.0, 0.05, 100.0, "distance from the camera up to which points_nav tells, m")

    def __post_init__(self) -> None:
        check_ranges(self)


def obstacle_cloud(rig: StereoRig, cloud: Cloud, shot: Shot, nav: NavSettings) -> Cloud:
    """Return (1, N, C) float32, one point a voxel: surfaces within range, without flying pixels.

    Parameters
    ----------
    rig : the rig of the shot.
    cloud : (H, W, C) float32, x y z in metres first, NaN where unknown.
    shot : the shot that the cloud is of.
    nav : thresholds.
    """
    near = np.square(cloud[..., :3]).sum(axis=-1) <= nav.nav_max_range_m**2
    surface = near & supported(shot.depth_m)
    points = cloud[surface]
    # What one pixel covers of a facing square of a voxel's size.
    share = points[:, 2] ** 2 / (rig.fx_px * rig.fy_px * nav.nav_voxel_m**2)
    trusted = shot.confidence[surface] >= nav.nav_min_confidence
    return voxel_means(points, share, trusted, nav.nav_voxel_m, nav.nav_min_fill)


def clearing_cloud(cloud: Cloud, shot: Shot, nav: NavSettings) -> Cloud:
    """Return (1, N, C) float32, ends of rays from the camera along which nothing stands; never obstacles.

    One ray for each block of pixels most of which are trusted: towards the nearest of them, ending one voxel before
    it or at the range, if that is nearer. Pixels without a depth clear nothing: to the sensor, black things look like
    open space. The parameters are those of :func:`obstacle_cloud`.
    """
    distance_m = np.sqrt(np.square(cloud[..., :3]).sum(axis=-1))
    trusted = (shot.confidence >= nav.nav_min_confidence) & supported(shot.depth_m)
    in_blocks = blocks(np.where(trusted, distance_m, np.float32(np.inf)))
    nearest = in_blocks.argmin(axis=-1)[..., None]
    nearest_m = np.take_along_axis(in_blocks, nearest, axis=-1)[..., 0]
    free_m = np.minimum(nearest_m - np.float32(nav.nav_voxel_m), np.float32(nav.nav_max_range_m))
    known = 2 * np.isfinite(in_blocks).sum(axis=-1) > in_blocks.shape[-1]
    towards = [np.take_along_axis(blocks(channel), nearest, axis=-1)[..., 0] for channel in np.moveaxis(cloud, -1, 0)]
    ends = np.stack(towards, axis=-1)[known]
    ends[:, :3] *= (free_m[known] / nearest_m[known])[:, None]
    return np.asarray(ends[None], dtype=np.float32)


def blocks(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the pixels of each whole block of RAY_BLOCK_PX squared: (H, W) to (rows, columns, pixels)."""
    side = RAY_BLOCK_PX
    rows, columns = image.shape[0] // side, image.shape[1] // side
    cut = image[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return np.ascontiguousarray(cut.swapaxes(1, 2)).reshape(rows, columns, side * side)


def supported(depth_m: npt.NDArray[np.float32]) -> Mask:
    """Return the pixels (H, W) that have enough neighbours on their own surface, along the row and the column.

    Of 2 REACH_PX neighbours, REACH_PX must be: a pixel at a straight edge or a right-angled corner has as many, one of
    a strip of flying pixels no wider than REACH_PX has not. Unknown pixels (NaN) are never supported.
    """
    mask = np.zeros(depth_m.shape, dtype=np.bool_)
    find_supported(np.ascontiguousarray(depth_m, dtype=np.float32), REACH_PX, mask)
    return mask


@njit(parallel=True, cache=True)
def find_supported(depth, reach, mask):  # type: ignore[no-untyped-def]
    """Fill ``mask`` (H, W) bool from ``depth`` (H, W) float32; a comparison with NaN is false, as it should be."""
    height, width = depth.shape
    for y in prange(height):
        for x in range(width):
            tolerance = np.float32(SAME_SURFACE) * depth[y, x]
            in_row = 0
            in_column = 0
            for step in range(1, reach + 1):
                if x >= step:
                    in_row += abs(depth[y, x - step] - depth[y, x]) <= tolerance
                if x + step < width:
                    in_row += abs(depth[y, x + step] - depth[y, x]) <= tolerance
                if y >= step:
                    in_column += abs(depth[y - step, x] - depth[y, x]) <= tolerance
                if y + step < height:
                    in_column += abs(depth[y + step, x] - depth[y, x]) <= tolerance
            mask[y, x] = in_row >= reach and in_column >= reach


def voxel_means(
    points: Cloud, share: npt.NDArray[np.floating[Any]], trusted: Mask, voxel_m: float, min_fill: float
) -> Cloud:
    """Return (1, M, C): the mean of the trusted points in each voxel whose shares sum up to ``min_fill``.

    ``points`` is (N, C) float32, x y z in metres first, all finite; ``share`` (N,) what each point fills of its voxel;
    of a voxel's points, TRUSTED_SHARE at least must be ``trusted`` (N,). The grid of ``voxel_m`` metres is fixed to
    the origin of the optical frame.
    """
    if not trusted.any():
        return np.empty((1, 0, points.shape[-1]), dtype=np.float32)
    voxel = voxel_numbers(points[:, :3], voxel_m)
    every = np.bincount(voxel)
    voxel, points, share = voxel[trusted], points[trusted], share[trusted]
    count = np.bincount(voxel, minlength=len(every))
    full = (count > 0) & (count >= TRUSTED_SHARE * every)
    full &= np.bincount(voxel, weights=share, minlength=len(every)) >= min_fill
    sums = [np.bincount(voxel, weights=channel, minlength=len(every))[full] for channel in points.T]
    return np.asarray(np.stack(sums, axis=-1) / count[full, None], dtype=np.float32)[None]


def voxel_numbers(points_m: Cloud, voxel_m: float) -> npt.NDArray[np.int64]:
    """Return the number of each point's (N, 3) voxel, counted from 0; not every number need occur."""
    cells = np.floor(points_m / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    sides = cells.max(axis=0) + 1
    numbers: npt.NDArray[np.int64] = (cells[:, 2] * sides[1] + cells[:, 1]) * sides[0] + cells[:, 0]
    if math.prod(sides.tolist()) <= MAX_GRID_CELLS:
        return numbers
    return np.asarray(np.unique(numbers, return_inverse=True)[1])
