"""Points for costmaps: what may be marked as an obstacle, and rays along which nothing stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit, prange

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
    points = np.ones((2, 4), dtype=np.float32)
    supported(points)
    distances(points[None])
    voxel_means(points, points[:, 0], np.ones(2, dtype=np.bool_), 1.0, 0.0)


def obstacle_cloud(rig: StereoRig, cloud: Cloud, shot: Shot, nav: NavSettings) -> Cloud:
    """Return (1, N, C) float32, one point a voxel: surfaces within range, without flying pixels.

    Parameters
    ----------
    rig : the rig of the shot.
    cloud : (H, W, C) float32, x y z in metres first, NaN where unknown.
    shot : the shot that the cloud is of.
    nav : thresholds.
    """
    surface = np.flatnonzero((distances(cloud) <= nav.nav_max_range_m) & supported(shot.depth_m))
    points = cloud.reshape(-1, cloud.shape[-1])[surface]
    # What one pixel covers of a facing square of a voxel's size.
    share = points[:, 2] ** 2 / (rig.fx_px * rig.fy_px * nav.nav_voxel_m**2)
    trusted = shot.confidence.reshape(-1)[surface] >= nav.nav_min_confidence
    return voxel_means(points, share, trusted, nav.nav_voxel_m, nav.nav_min_fill)


def clearing_cloud(cloud: Cloud, shot: Shot, nav: NavSettings) -> Cloud:
    """Return (1, N, C) float32, ends of rays from the camera along which nothing stands; never obstacles.

    One ray for each block of pixels most of which are trusted: towards the nearest of them, ending one voxel before
    it or at the range, if that is nearer. Pixels without a depth clear nothing: to the sensor, black things look like
    open space. The parameters are those of :func:`obstacle_cloud`.
    """
    trusted = (shot.confidence >= nav.nav_min_confidence) & supported(shot.depth_m)
    in_blocks = blocks(np.where(trusted, distances(cloud), np.float32(np.inf)))
    nearest = in_blocks.argmin(axis=-1)
    nearest_m = np.take_along_axis(in_blocks, nearest[..., None], axis=-1)[..., 0]
    free_m = np.minimum(nearest_m - np.float32(nav.nav_voxel_m), np.float32(nav.nav_max_range_m))
    known = 2 * np.isfinite(in_blocks).sum(axis=-1) > in_blocks.shape[-1]
    row, column = np.nonzero(known)
    within = np.divmod(nearest[known], RAY_BLOCK_PX)
    ends = cloud[row * RAY_BLOCK_PX + within[0], column * RAY_BLOCK_PX + within[1]]
    ends[:, :3] *= (free_m[known] / nearest_m[known])[:, None]
    return np.asarray(ends[None], dtype=np.float32)


def blocks(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the pixels of each whole block of RAY_BLOCK_PX squared: (H, W) to (rows, columns, pixels)."""
    side = RAY_BLOCK_PX
    rows, columns = image.shape[0] // side, image.shape[1] // side
    cut = image[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return np.ascontiguousarray(cut.swapaxes(1, 2)).reshape(rows, columns, side * side)


def distances(cloud: Cloud) -> npt.NDArray[np.float32]:
    """Return the distance of each point of a cloud (H, W, C) from the camera, (H, W) metres, NaN where unknown."""
    distance_m = np.empty(cloud.shape[:2], dtype=np.float32)
    find_distances(cloud, distance_m)
    return distance_m


@njit(parallel=True, cache=True)
def find_distances(cloud, distance_m):  # type: ignore[no-untyped-def]
    """Fill ``distance_m`` (H, W) float32 from x y z, the first channels of ``cloud`` (H, W, C) float32."""
    for y in prange(cloud.shape[0]):
        for x in range(cloud.shape[1]):
            distance_m[y, x] = np.sqrt(cloud[y, x, 0] ** 2 + cloud[y, x, 1] ** 2 + cloud[y, x, 2] ** 2)


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
