"""Whether left view, right view and projector agree as a whole: swapped cameras, a wrong period, a bad calibration.

Texture and noise move the phases of single pixels either way; a wrong rig or pattern moves those of whole patches one
way. So the judgement is on means over patches.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from moire_sensor.angles import wrapped
from moire_sensor.apart import NAN_SAFE
from moire_sensor.depth_refine import Match
from moire_sensor.order_range import RANGE_MARGIN_PX, OrderRange
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap

PATCH_PX = 32
# A patch counts from this share of its pixels on: the mean of fewer says little.
MIN_PATCH_SHARE = 1.0 / 6.0
SAMPLE_PX = 8
MIN_SAMPLES = 100
# Valid scenes without texture lie below, so that only doubtful images pay for the test of swapped cameras.
DOUBTFUL_RAD = 0.04
# Exchanged views that agree so much better than the given ones are no accident: valid scenes have a ratio above 1.5,
# swapped ones below 0.6, a plane at 1 m in dim phase-shifted light 0.65.
SWAPPED_SHARE = 0.75
# Median mismatch of the best order: at most 0.18 on valid textured scenes, 0.20 on the real hand, whose pair is not
# perfectly aligned; from 0.25 on with a period 10 % off.
MAX_CLOSEST_RAD = 0.22


def patch_mismatch_rad(signed_mismatch_rad: Float32, disparity_px: Float32) -> tuple[float, float]:
    """Upper quartile and maximum over patches of the absolute mean left-right phase mismatch; NaN without any patch.

    Parameters
    ----------
    signed_mismatch_rad : (H, W) float32, NaN where unknown.
    disparity_px : (H, W) float32, NaN at the pixels that get no depth.
    """
    rows, columns = (size // PATCH_PX for size in disparity_px.shape)
    count, total = np.empty((2, rows, columns), dtype=np.float32)
    sum_patches(signed_mismatch_rad, disparity_px, count, total)
    enough = count > MIN_PATCH_SHARE * PATCH_PX**2
    if not enough.any():
        return float("nan"), float("nan")
    mean = np.sort(np.abs(total[enough] / count[enough]))
    # As np.percentile, which takes longer than all else here.
    return float(np.interp(0.75 * (mean.size - 1), np.arange(mean.size), mean)), float(mean[-1])


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def sum_patches(signed, disparity, count, total):  # type: ignore[no-untyped-def]
    """Fill number and sum, each (rows, columns) of patches, of the known mismatches with a disparity."""
    rows, columns = count.shape
    for row in prange(rows):
        known, sums = np.zeros(columns * PATCH_PX, dtype=np.float32), np.zeros(columns * PATCH_PX, dtype=np.float32)
        for y in range(np.int64(row) * PATCH_PX, (np.int64(row) + 1) * PATCH_PX):
            for x in range(known.size):
                value = signed[y, x]
                seen = (value == value) & (disparity[y, x] == disparity[y, x])
                known[x] += np.float32(1.0) if seen else np.float32(0.0)
                sums[x] += value if seen else np.float32(0.0)
        for column in range(columns):
            part = slice(column * PATCH_PX, (column + 1) * PATCH_PX)
            count[row, column], total[row, column] = known[part].sum(), sums[part].sum()


def orders_fail(
    match: Match,
    phases: tuple[PhaseImage, PhaseImage],
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
) -> bool:
    """True where the phases speak against rig and pattern, whatever order is chosen for the match.

    Half of them meet no order well, as with a wrong period, or the right image taken for the left one and the left for
    the right agree far better. For at some depths an order a few off meets nearly the same phase in a swapped pair (3
    orders off lands 44 degrees away in the paper's rig), and depth from it would look sound.
    """
    keep = np.isfinite(match.disparity_px[::SAMPLE_PX, ::SAMPLE_PX])
    kept = match.mismatch_rad[::SAMPLE_PX, ::SAMPLE_PX][keep]
    if kept.size < MIN_SAMPLES or 2 * np.count_nonzero(kept < DOUBTFUL_RAD) > kept.size:
        return False
    left_rad, right_rad = phases[0].offset_rad, phases[1].offset_rad
    rows = phases[0].rows
    apart_rad = wrapped(carriers[1].phase_rad[rows] - carriers[0].phase_rad[rows])
    swapped = (wrapped(right_rad + apart_rad), wrapped(left_rad - apart_rad))
    given = median_or_nan(closest_mismatch_rad(left_rad, right_rad, rows, carriers, projector, orders))
    exchanged = median_or_nan(closest_mismatch_rad(*swapped, rows, carriers, projector, orders))
    return given > MAX_CLOSEST_RAD or exchanged < SWAPPED_SHARE * given


def median_or_nan(values: npt.NDArray[np.float64]) -> float:
    """Median of ``values`` (n,), NaN of fewer than a hundred."""
    return float(np.median(values)) if values.size >= MIN_SAMPLES else float("nan")


def closest_mismatch_rad(
    left_rad: Float32,
    right_rad: Float32,
    image_rows: npt.NDArray[np.int64],
    carriers: tuple[Carrier, Carrier],
    projector: ProjectorMap,
    orders: OrderRange,
) -> npt.NDArray[np.float64]:
    """Mismatch (n,) of the order that meets the right phase best, at left pixels on a coarse grid.

    ``left_rad``, ``right_rad`` are offsets from the carriers, (n, W), of the ``image_rows`` (n,). Pixels where no order
    meets a phase are left out.
    """
    width = left_rad.shape[1]
    indices, columns = (grid.ravel() for grid in np.mgrid[0 : image_rows.size : SAMPLE_PX // 2, 0:width:SAMPLE_PX])
    known = np.isfinite(left_rad[indices, columns])
    indices, columns = indices[known], columns[known]
    rows = image_rows[indices]
    turns = 2.0 * np.pi * np.arange(orders.first, orders.first + orders.count)[:, None]
    phase_rad = carriers[0].phase_rad[rows, columns] + left_rad[indices, columns] + turns
    disparity_px = projector.disparity_px_at(columns, rows, phase_rad)
    low, high = orders.min_disparity_px - RANGE_MARGIN_PX, orders.max_disparity_px + RANGE_MARGIN_PX
    seen = np.rint(columns - disparity_px)
    inside = (disparity_px >= low) & (disparity_px <= high) & (seen >= 0) & (seen < width)
    nearest = np.where(inside, seen, 0.0).astype(np.int64)
    part_px = columns - disparity_px - nearest
    seen_rad = carriers[1].phase_rad[rows, nearest] + right_rad[indices, nearest]
    seen_rad += part_px * carriers[1].rad_per_px[rows, nearest]
    mismatch = np.abs(wrapped((phase_rad - seen_rad).astype(np.float32))).astype(np.float64)
    mismatch[~(inside & np.isfinite(mismatch))] = np.inf
    closest = np.asarray(mismatch.min(axis=0))
    return np.asarray(closest[np.isfinite(closest)])
