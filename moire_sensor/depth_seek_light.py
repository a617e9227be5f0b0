"""What the fringes of an image are like, as far as the search for narrow things must know."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import NAN_SAFE
from moire_sensor.depth_seek_chain import SHARE, VIEWS_SHARE
from moire_sensor.depth_seek_fit import NO_FIT, PIECE_PX, fit_both
from moire_sensor.depth_seek_spread import MEAN_PX
from moire_sensor.median import median
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import Light
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings
from moire_sensor.shot import Status

# What counts as lit is brighter than this share of what fringes are at most; sigmas of noise that views may differ by;
# the brightest grey level.
LIT_SHARE, NOISE_SIGMAS, BRIGHTEST = 0.35, 2.5, 255.0
# One pixel in so many, along either direction, tells what the fringes are like; at least so many must be lit.
SAMPLE_PX, LEAST_SAMPLES = 13, 20
# The median misfit of pieces on so coarse a grid is below 0.06 where fringes are cosines, dim, textured and noisy ones
# included, and above 0.15 with a gamma of 2.2 and with square waves.
EVERY_PX, MOST_MISFIT = 17, 0.1


def limits_of(seen: Light, orders: OrderRange, settings: Settings) -> Float32 | None:
    """Limits as in :mod:`depth_seek_chain`, None in an image without light."""
    every = np.s_[::SAMPLE_PX, ::SAMPLE_PX]
    lit = seen.status[every] == Status.OK
    if np.count_nonzero(lit) < LEAST_SAMPLES:
        return None
    amplitude, background = seen.amplitude[every][lit], seen.background[every][lit]
    share, light = float(median(amplitude / background)), float(median(amplitude + background))
    noise = NOISE_SIGMAS * np.sqrt(2.0 / MEAN_PX) * settings.image_noise
    apart = PIECE_PX * (noise + VIEWS_SHARE * share * BRIGHTEST) ** 2
    lowest, highest = np.floor(orders.min_disparity_px), np.ceil(orders.max_disparity_px)
    return np.array([lowest, highest, share, LIT_SHARE * light, noise, apart], dtype=np.float32)


def are_cosines(
    disparity_px: Float32, greys: tuple[Float32, Float32], projector: ProjectorMap, limits: Float32
) -> bool:
    """Whether what is known shows the fringes that the projector was given: gamma and square waves do not."""
    misfit = np.full(tuple(size // EVERY_PX for size in disparity_px.shape), np.nan, dtype=np.float32)
    fill_misfits(disparity_px, *greys, projector.packed(), limits[SHARE], misfit)
    known = misfit[np.isfinite(misfit)]
    return known.size >= LEAST_SAMPLES and median(known) < MOST_MISFIT


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def fill_misfits(disparity, left, right, map_, share, misfit):  # type: ignore[no-untyped-def]
    """Fill how far pieces of row on a coarse grid differ from the fringes, in amplitudes; nothing where unknown."""
    for number in prange(misfit.shape[0]):
        row = np.int64(number)
        for column in range(misfit.shape[1]):
            y, x = row * EVERY_PX, column * EVERY_PX
            if np.isnan(disparity[y, x]):
                continue
            _, fringes, _ = fit_both(left[y], right[y], map_, share, x, y, disparity[y, x])
            if fringes < NO_FIT:
                misfit[row, column] = fringes
