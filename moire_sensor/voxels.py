"""Points to one a voxel: the mean of what lies in each, where enough does.

Points that follow one another, as the pixels of a row do, mostly lie in the same voxel: each such run is added up
first, and the runs, ten times fewer, to their voxels.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.apart import EXACT, LEAF

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
# A voxel of which fewer of the pixels that fall into it are trusted is left out: where the sensor doubts most of a
# surface, those few beside them that pass are as wrong (a door's reveal seen at a grazing angle, off by 0.1 m).
TRUSTED_SHARE = 1.0 / 3.0
# A grid of this size is counted directly; of a larger one, which costs memory, the voxels that occur are sorted.
MAX_GRID_CELLS = 4_000_000
# Points whose runs are found by one thread at a time.
STRETCH = 1024
# A voxel's name holds the numbers of its cell along z, y and x, AXIS_BITS each, from -CELLS up to CELLS.
AXIS_BITS, CELLS, NOWHERE = 21, 1 << 20, -1
ZERO = np.float32(0.0)


def voxel_means(points: Floats, share: Floats, trusted: Mask, voxel_m: float, min_fill: float) -> Floats:
    """Return (1, M, C): the mean of the trusted points in each voxel whose shares sum up to ``min_fill``.

    ``points`` is (N, C) float32, x y z in metres, nearer to the origin than CELLS voxels, and perhaps one value more
    (C is 3 or 4); ``share`` (N,) what each point fills of its voxel, 0 for those that do not count, which alone may be
    NaN; of a voxel's points, TRUSTED_SHARE at least must be ``trusted`` (N,). The grid of ``voxel_m`` metres is fixed
    to the origin of the optical frame.
    """
    number, channels = points.shape
    points, share = np.ascontiguousarray(points), np.asarray(share, dtype=np.float32)
    names, tallies = np.empty(number, dtype=np.int64), np.empty((number, 2), dtype=np.int64)
    sums, found = np.empty((number, channels + 1)), np.zeros(-(-number // STRETCH), dtype=np.int64)
    find_runs(points, share, trusted, np.float32(voxel_m), names, tallies, sums, found)
    if not found.any():
        return np.empty((1, 0, channels), dtype=np.float32)
    size = number_voxels(names, found)
    every, count = np.zeros(size, dtype=np.int32), np.zeros(size, dtype=np.int32)
    total = np.zeros((size, channels + 1))
    add_up(names, found, tallies, sums, every, count, total)
    kept = np.flatnonzero((count > 0) & (count >= TRUSTED_SHARE * every) & (total[:, channels] >= min_fill))
    return np.asarray(total[kept, :channels] / count[kept, None], dtype=np.float32)[None]


def number_voxels(names: Whole, found: Whole) -> int:
    """Turn the names of runs into their voxels' numbers, in order of z, y, x; return how many there may be at most."""
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    find_box(names, found, low, high)
    sides = high - low + 1
    size = int(math.prod(sides.tolist()))
    if size <= MAX_GRID_CELLS:
        number_cells(names, found, low, sides)
        return size
    # Each stretch has its runs where it begins.
    used = np.flatnonzero((np.arange(STRETCH) < found[:, None]).reshape(-1)[: len(names)])
    occurring, inverse = np.unique(names[used], return_inverse=True)
    names[used] = inverse.reshape(-1)
    return len(occurring)


@njit(parallel=True, error_model="numpy", cache=True)
def find_runs(points, share, trusted, voxel_m, names, tallies, sums, found):  # type: ignore[no-untyped-def]
    """Fill the ``found`` runs of each stretch of points (N, C) where it begins; ``names`` is all points' at first."""
    for stretch in prange(len(found)):
        begin = stretch * STRETCH
        end = min(begin + STRETCH, len(points))
        name_voxels(points[begin:end], share[begin:end], voxel_m, names[begin:end])
        found[stretch] = add_runs(
            points[begin:end], share[begin:end], trusted[begin:end], names[begin:end], tallies[begin:end],
            sums[begin:end],
        )  # fmt: skip


@njit(**EXACT)
def name_voxels(points, share, voxel_m, names):  # type: ignore[no-untyped-def]
    """Fill the name of each point's voxel, NOWHERE for points without a share."""
    for n in range(len(points)):
        counts = share[n] > ZERO
        x = np.int64(np.floor((points[n, 0] if counts else ZERO) / voxel_m)) + CELLS
        y = np.int64(np.floor((points[n, 1] if counts else ZERO) / voxel_m)) + CELLS
        z = np.int64(np.floor((points[n, 2] if counts else ZERO) / voxel_m)) + CELLS
        names[n] = (z << (2 * AXIS_BITS)) + (y << AXIS_BITS) + x if counts else NOWHERE


@njit(**LEAF)
def add_runs(points, share, trusted, names, tallies, sums):  # type: ignore[no-untyped-def]
    """Turn ``names`` of points into those of runs, fill the runs' tallies and sums, and return how many there are."""
    runs, n, number = 0, 0, len(points)
    # Without a fourth value the third is added up twice.
    more = points.shape[1] - 1
    while n < number:
        name = names[n]
        if name == NOWHERE:
            n += 1
            continue
        every, count, x, y, z, last, filled = 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0
        while n < number and names[n] == name:
            every += 1
            if trusted[n]:
                count += 1
                x += points[n, 0]
                y += points[n, 1]
                z += points[n, 2]
                last += points[n, more]
                filled += share[n]
            n += 1
        names[runs], tallies[runs, 0], tallies[runs, 1] = name, every, count
        sums[runs, 0], sums[runs, 1], sums[runs, 2], sums[runs, more], sums[runs, more + 1] = x, y, z, last, filled
        runs += 1
    return runs


@njit(cache=True)
def find_box(names, found, low, high):  # type: ignore[no-untyped-def]
    """Fill ``low`` and ``high`` (3,) with the first and last cell of all runs along x, y and z."""
    low[:], high[:] = 2 * CELLS, 0
    for stretch in range(len(found)):
        for n in range(stretch * STRETCH, stretch * STRETCH + found[stretch]):
            for axis in range(3):
                cell = cell_of(names[n], axis)
                low[axis], high[axis] = min(low[axis], cell), max(high[axis], cell)


@njit(inline="always")
def cell_of(name, axis):  # type: ignore[no-untyped-def]
    """Cell along x, y or z (0, 1, 2) of a voxel's name."""
    return (name >> (axis * AXIS_BITS)) & (2 * CELLS - 1)


@njit(cache=True)
def number_cells(names, found, low, sides):  # type: ignore[no-untyped-def]
    """Replace the runs' names by their numbers in the box that starts at ``low`` and has ``sides`` cells."""
    for stretch in range(len(found)):
        for n in range(stretch * STRETCH, stretch * STRETCH + found[stretch]):
            x, y, z = cell_of(names[n], 0) - low[0], cell_of(names[n], 1) - low[1], cell_of(names[n], 2) - low[2]
            names[n] = (z * sides[1] + y) * sides[0] + x


@njit(cache=True)
def add_up(numbers, found, tallies, sums, every, count, total):  # type: ignore[no-untyped-def]
    """Add every run to its voxel: points to ``every``, trusted ones to ``count``, and sums to ``total``."""
    for stretch in range(len(found)):
        for n in range(stretch * STRETCH, stretch * STRETCH + found[stretch]):
            voxel = numbers[n]
            every[voxel] += tallies[n, 0]
            count[voxel] += tallies[n, 1]
            for channel in range(sums.shape[1]):
                total[voxel, channel] += sums[n, channel]
