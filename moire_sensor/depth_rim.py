"""The last pixels of a surface: mixed ones at its edge, which the light of two surfaces, or of one and a shadow, makes.

No window of grey levels fits such a pixel, since the other camera mixes it differently. But its own grey level tells
which of the surfaces beside it covers more of it: each promises one, by its depth, its fringes and the projector.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import BARE, ROW
from moire_sensor.depth_offer import fringe_cos
from moire_sensor.depth_refine import Match
from moire_sensor.depth_runs import TASKS, list_marked, marks_for
from moire_sensor.depth_trust import JUMP_PX
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_image import Light
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

# What a surface is like is read so many pixels behind its edge, beyond which windows hardly straddle it.
BEHIND_PX = 3
# A single grey level tells nothing where fringes are weaker than this many times the noise.
LEAST_SIGMAS = np.float32(20.0)
# Two surfaces must promise grey levels so many times the noise apart; of that gap the pixel may differ by a share from
# the nearer one, and lie so far from the other.
APART_SIGMAS = np.float32(8.0)
MIXED_SHARE, MOST_BEYOND = np.float32(0.4), np.float32(1.3)
# A surface alone must keep its promise within this share of its amplitude, and be brighter than its own shadow by it.
PROMISE_SHARE = np.float32(0.25)
# Light is measured in so many pixels behind an edge; what the phase says of it counts as much as this part of one.
LIGHT_PX, HOLD = 5, np.float32(0.05)
HALF = np.float32(0.5)
# The sigma of a pixel that only one camera speaks for.
SIGMA_PX = np.float32(0.35)


def close_rims(match: Match, left: Float32, light: Light, projector: ProjectorMap, settings: Settings) -> None:
    """Give the unknown pixels right beside a surface to it, in place, where their grey level says so.

    Parameters
    ----------
    match : disparities, NaN where unknown; a pixel given has as mismatch half the share by which its grey level differs
        from the promised one, of the gap to the other surface or else of the amplitude, the sigma ``SIGMA_PX``, and no
        signed mismatch.
    left : grey levels (H, W) float32.
    light : amplitude and background of the left view, which tell how bright a surface is.
    """
    noise = np.float32(settings.image_noise)
    known = match.disparity_px.copy()
    fill_rims(known, left, light.background, light.amplitude, projector.packed(), noise, *match.images())


@njit(parallel=True, error_model="numpy", cache=True)
def fill_rims(  # type: ignore[no-untyped-def]
    known, left, background, amplitude, map_, noise, disparity, sigma, signed, mismatch
):
    """Kernel of :func:`close_rims`: reads ``known`` and writes the last four images (H, W)."""
    height, width = known.shape
    for task in prange(TASKS):
        marks, places = marks_for(width), np.empty(width, dtype=np.int64)
        for y in range(np.int64(task), height, TASKS):
            mark_rims(known[max(y - 1, 0)], known[y], known[min(y + 1, height - 1)], marks)
            for x in places[: list_marked(marks, places)]:
                found, apart = given(known, left, background, amplitude, map_, noise, y, x)
                if found == found:
                    disparity[y, x], sigma[y, x] = found, SIGMA_PX
                    signed[y, x], mismatch[y, x] = np.float32(np.nan), apart


@njit(**ROW)
def mark_rims(above, here, below, beside):  # type: ignore[no-untyped-def]
    """Mark the unknown pixels of a row with a known one left, right, above or below; beyond the image lie none."""
    last = here.size - 1
    for x in range(1, last):
        around = (here[x - 1] == here[x - 1]) | (here[x + 1] == here[x + 1])
        around |= (above[x] == above[x]) | (below[x] == below[x])
        beside[x] = around & (here[x] != here[x])
    for x, inner in ((0, min(1, last)), (last, max(last - 1, 0))):
        around = (here[inner] == here[inner]) | (above[x] == above[x]) | (below[x] == below[x])
        beside[x] = around & (here[x] != here[x])


@njit(forceinline=True, **BARE)
def edge_of(known, y, x, side):  # type: ignore[no-untyped-def]
    """The pixel left (side 0), right (1), above (2) or below (3), which way that is, and whether it is known."""
    height, width = known.shape
    down, right = (0, 2 * side - 1) if side < 2 else (2 * side - 5, 0)
    y0, x0 = y + down, x + right
    there = 0 <= y0 < height and 0 <= x0 < width and not np.isnan(known[y0, x0])
    return y0, x0, down, right, there


@njit(forceinline=True, **BARE)
def promised(known, left, background, amplitude, map_, y, x, edge):  # type: ignore[no-untyped-def]
    """Disparity, grey level and amplitude that the surface which ends at an edge promises, and its darkest level."""
    y0, x0, down, right, _ = edge
    height, width = known.shape
    y1 = min(max(y0 + BEHIND_PX * down, 0), height - 1)
    x1 = min(max(x0 + BEHIND_PX * right, 0), width - 1)
    here = known[y0, x0]
    step = known[y1, x1] - here
    # A surface narrower than what is looked behind is taken as level.
    if not abs(step) < JUMP_PX:
        y1, x1, step = y0, x0, np.float32(0.0)
    slope = step / np.float32(BEHIND_PX)
    dim, bright = light_behind(known, left, background[y1, x1], amplitude[y1, x1], map_, edge)
    here -= slope
    level = dim + bright * fringe_cos(map_, x, y, here)
    return here, level, bright, dim - bright


@njit(forceinline=True, **BARE)
def light_behind(known, left, background, amplitude, map_, edge):  # type: ignore[no-untyped-def]
    """Background and amplitude of the pixels right behind an edge: least squares, held by those of the phase."""
    y0, x0, down, right, _ = edge
    height, width = known.shape
    rows, cosines, squares = HOLD, np.float32(0.0), HOLD
    greys, products = HOLD * background, HOLD * amplitude
    before = known[y0, x0]
    for away in range(1, LIGHT_PX + 1):
        y, x = y0 + away * down, x0 + away * right
        if not (0 <= y < height and 0 <= x < width) or not abs(known[y, x] - before) < JUMP_PX:
            break
        before = known[y, x]
        cosine = fringe_cos(map_, x, y, before)
        rows += np.float32(1.0)
        cosines += cosine
        squares += cosine * cosine
        greys += left[y, x]
        products += cosine * left[y, x]
    bright = (products * rows - greys * cosines) / (squares * rows - cosines * cosines)
    bright = max(bright, np.float32(1.0))
    return (greys - bright * cosines) / rows, bright


@njit(forceinline=True, **BARE)
def given(known, left, background, amplitude, map_, noise, y, x):  # type: ignore[no-untyped-def]
    """Disparity that an unknown pixel is given (NaN: none), and its difference as a mismatch."""
    grey = left[y, x]
    nan, off = np.float32(np.nan), np.float32(np.inf)
    best, level, bright, dark = nan, nan, nan, nan
    edges = 0
    for side in range(4):
        edge = edge_of(known, y, x, side)
        if edge[4]:
            edges += 1
            found = promised(known, left, background, amplitude, map_, y, x, edge)
            if abs(found[1] - grey) < off:
                off = abs(found[1] - grey)
                best, level, bright, dark = found
    if best != best or bright < LEAST_SIGMAS * noise:
        return nan, nan
    gap, rival = np.float32(0.0), nan
    for side in range(4 if edges > 1 else 0):
        edge = edge_of(known, y, x, side)
        if edge[4]:
            here, other, _, _ = promised(known, left, background, amplitude, map_, y, x, edge)
            if abs(here - best) > JUMP_PX and abs(other - level) >= gap:
                gap, rival = abs(other - level), other
    if rival == rival:
        kept = gap >= APART_SIGMAS * noise and off <= MIXED_SHARE * gap and abs(grey - rival) <= MOST_BEYOND * gap
        return (best, HALF * off / gap) if kept else (nan, nan)
    kept = grey - dark > PROMISE_SHARE * bright and off <= PROMISE_SHARE * bright
    return (best, HALF * off / bright) if kept else (nan, nan)
