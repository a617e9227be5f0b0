"""Points for costmaps: what may be marked as an obstacle, and rays along which nothing stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE, ROW
from moire_sensor.rig import StereoRig
from moire_sensor.settings import check_ranges, setting
from moire_sensor.shot import Shot
from moire_sensor.voxels import voxel_means

Cloud = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
# A neighbour belongs to the same surface within this share of the depth.
SAME_SURFACE = 0.02
# Half the length of the row and the column of neighbours that are looked at, pixels.
REACH_PX = 3
# Clearing rays: one for each block of this side, pixels; 13 mm apart at 2 m in the paper's rig.
RAY_BLOCK_PX = 8


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


def warm_up() -> None:
    """Load or compile the kernels of this module and of the voxels."""
    cloud = np.ones((RAY_BLOCK_PX, RAY_BLOCK_PX, 4), dtype=np.float32)
    depth_m, confidence, trusted = cloud[..., 2].copy(), cloud[..., 3].copy(), np.ones(cloud.shape[:2], dtype=np.bool_)
    share = np.empty_like(depth_m)
    weigh(cloud, supported(depth_m), confidence, np.ones(3, dtype=np.float32), share, trusted)
    ray_ends(cloud, trusted, NavSettings())
    voxel_means(cloud.reshape(-1, 4), confidence.reshape(-1), trusted.reshape(-1), 1.0, 0.0)


def obstacle_cloud(
    rig: StereoRig, cloud: Cloud, shot: Shot, nav: NavSettings, surface: Mask | None = None
) -> Cloud:
    """Return (1, N, C) float32, one point a voxel: surfaces within range, without flying pixels.

    Parameters
    ----------
    rig : the rig of the shot.
    cloud : (H, W, C) float32, x y z in metres first, NaN where unknown.
    shot : the shot that the cloud is of.
    nav : thresholds.
    surface : what :func:`supported` says of the shot's depth, where that is known already.
    """
    surface = supported(shot.depth_m) if surface is None else surface
    share, trusted = np.empty(cloud.shape[:2], dtype=np.float32), np.empty(cloud.shape[:2], dtype=np.bool_)
    # Pixels that cover a facing square of a voxel's size 1 m away.
    facing_px = rig.fx_px * rig.fy_px * nav.nav_voxel_m**2
    limits = np.array([nav.nav_max_range_m, facing_px, nav.nav_min_confidence], dtype=np.float32)
    weigh(cloud, surface, shot.confidence, limits, share, trusted)
    points = cloud.reshape(-1, cloud.shape[-1])
    return voxel_means(points, share.reshape(-1), trusted.reshape(-1), nav.nav_voxel_m, nav.nav_min_fill)


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def weigh(cloud, surface, confidence, limits, share, trusted):  # type: ignore[no-untyped-def]
    """Fill what each pixel fills of its voxel, 0 where it shows no surface within range, and whether it is trusted."""
    height, width = share.shape
    farthest, facing, least = limits[0], limits[1], limits[2]
    for y in prange(height):
        for x in range(width):
            within = surface[y, x] & (distance(cloud, y, x) <= farthest)
            share[y, x] = cloud[y, x, 2] * cloud[y, x, 2] / facing if within else np.float32(0.0)
            trusted[y, x] = confidence[y, x] >= least


@njit(inline="always")
def distance(cloud, y, x):  # type: ignore[no-untyped-def]
    """Distance of a point of ``cloud`` (H, W, C) float32 from the camera."""
    return np.sqrt(
        cloud[y, x, 0] * cloud[y, x, 0] + cloud[y, x, 1] * cloud[y, x, 1] + cloud[y, x, 2] * cloud[y, x, 2]
    )


def clearing_cloud(cloud: Cloud, shot: Shot, nav: NavSettings, surface: Mask | None = None) -> Cloud:
    """Return (1, N, C) float32, ends of rays from the camera along which nothing stands; never obstacles.

    One ray for each block of pixels most of which are trusted: towards the nearest of them, ending one voxel before
    it or at the range, if that is nearer. Pixels without a depth clear nothing: to the sensor, black things look like
    open space. The parameters are those of :func:`obstacle_cloud`.
    """
    surface = supported(shot.depth_m) if surface is None else surface
    return ray_ends(cloud, (shot.confidence >= nav.nav_min_confidence) & surface, nav)


def ray_ends(cloud: Cloud, trusted: Mask, nav: NavSettings) -> Cloud:
    """Return (1, N, C): the end of the ray of each whole block with enough ``trusted`` (H, W) pixels."""
    rows, columns = cloud.shape[0] // RAY_BLOCK_PX, cloud.shape[1] // RAY_BLOCK_PX
    ends = np.empty((rows, columns, cloud.shape[2]), dtype=np.float32)
    clears = np.empty((rows, columns), dtype=np.bool_)
    find_ray_ends(cloud, trusted, np.float32(nav.nav_voxel_m), np.float32(nav.nav_max_range_m), ends, clears)
    return np.asarray(ends[clears][None])


@njit(parallel=True, error_model="numpy", cache=True)
def find_ray_ends(cloud, trusted, before, farthest, ends, clears):  # type: ignore[no-untyped-def]
    """Fill the end of each block's ray, ``before`` its nearest trusted point, and whether most of it is trusted."""
    for row in prange(ends.shape[0]):
        for column in range(ends.shape[1]):
            nearest, at_y, at_x, count = np.float32(np.inf), 0, 0, 0
            for y in range(row * RAY_BLOCK_PX, (row + 1) * RAY_BLOCK_PX):
                for x in range(column * RAY_BLOCK_PX, (column + 1) * RAY_BLOCK_PX):
                    away = distance(cloud, y, x)
                    if trusted[y, x] and away < np.inf:
                        count += 1
                        if away < nearest:
                            nearest, at_y, at_x = away, y, x
            clears[row, column] = 2 * count > RAY_BLOCK_PX * RAY_BLOCK_PX
            shorter = min(nearest - before, farthest) / nearest
            for channel in range(ends.shape[2]):
                ends[row, column, channel] = cloud[at_y, at_x, channel] * (shorter if channel < 3 else np.float32(1.0))


def supported(depth_m: npt.NDArray[np.float32]) -> Mask:
    """Return the pixels (H, W) that have enough neighbours on their own surface, along the row and the column.

    Of 2 REACH_PX neighbours, REACH_PX must be: a pixel at a straight edge or a right-angled corner has as many, one of
    a strip of flying pixels no wider than REACH_PX has not. Unknown pixels (NaN) are never supported.
    """
    mask = np.empty(depth_m.shape, dtype=np.bool_)
    find_supported(np.ascontiguousarray(depth_m, dtype=np.float32), mask)
    return mask


@njit(parallel=True, cache=True)
def find_supported(depth, mask):  # type: ignore[no-untyped-def]
    """Fill ``mask`` (H, W) bool from ``depth`` (H, W) float32."""
    height, width = depth.shape
    for row in prange(height):
        y = np.int64(row)
        in_row, in_column = np.zeros(width, dtype=np.int32), np.zeros(width, dtype=np.int32)
        for step in range(1, REACH_PX + 1):
            add_alike(depth[y, step:], depth[y, : width - step], in_row[step:])
            add_alike(depth[y, : width - step], depth[y, step:], in_row)
            if y >= step:
                add_alike(depth[y], depth[y - step], in_column)
            if y + step < height:
                add_alike(depth[y], depth[y + step], in_column)
        for x in range(width):
            mask[y, x] = (in_row[x] >= REACH_PX) & (in_column[x] >= REACH_PX)


@njit(**ROW)
def add_alike(depth, other, count):  # type: ignore[no-untyped-def]
    """Count where ``other`` lies on the surface of ``depth``; a comparison with NaN is false, as it should be."""
    for x in range(min(depth.size, other.size)):
        count[x] += abs(other[x] - depth[x]) <= np.float32(SAME_SURFACE) * depth[x]
