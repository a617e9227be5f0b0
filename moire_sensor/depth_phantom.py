"""Phantoms: a strip of a far surface that one camera sees alone, matched to a strip that the other sees alone.

Both show the same fringes, so phase, projector and grey levels agree, and a narrow post seems to stand where nothing
is. But in the left image the fringes run on from the far surface into the strip as if there were no edge, which they
do by chance for one real edge in six; and where the far surface would be seen on the right, something
nearer stands, or it is seen. Such a strip is left unknown.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.angles import wrap
from moire_sensor.apart import BARE, NAN_SAFE
from moire_sensor.depth_claims import claim_nearest
from moire_sensor.depth_narrow import STEP_PX
from moire_sensor.depth_refine import Match
from moire_sensor.depth_runs import TASKS, list_edges, marks_for
from moire_sensor.phase_carrier import Float32
from moire_sensor.projector_map import ProjectorMap, phase_of_disparity
from moire_sensor.settings import Settings

# The widest phantom, and the widest gap between it and the far surface, pixels.
MOST_PX, GAP_PX = 24, 24
# How well the fringes run on; the share of a strip that the far surface explains; the share that would be hidden, as
# else both would be seen and the far one found.
RUNS_ON_RAD, EXPLAINED, HIDDEN = np.float32(0.5), np.float32(0.8), np.float32(0.25)
# Noise of a difference of grey levels, sigmas, and the share of the amplitude that shading makes of it. Where noise is
# more than the last share, views are alike by chance.
SIGMAS, SHADING_SHARE, TELLING_SHARE = np.float32(3.0), np.float32(0.1), np.float32(0.15)
NOTHING = np.float32(-1e9)


def drop_phantoms(
    match: Match, greys: tuple[Float32, Float32], amplitude: Float32, projector: ProjectorMap, settings: Settings
) -> None:
    """Set the disparities of phantoms to NaN in place.

    Parameters
    ----------
    match : disparities, NaN where unknown.
    greys : left, and right with the grey levels of the left, (H, W) float32.
    amplitude : fringe amplitude of the left image (H, W).
    """
    noise = np.float32(SIGMAS * np.sqrt(2.0) * settings.image_noise)
    drop_of_rows(match.disparity_px, *greys, amplitude, projector.packed(), noise)


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def drop_of_rows(disparity, left, right, amplitude, map_, noise):  # type: ignore[no-untyped-def]
    """Kernel of :func:`drop_phantoms`: runs of a row one by one."""
    height, width = disparity.shape
    for task in prange(TASKS):
        marks, edges = marks_for(width), np.empty(width + 1, dtype=np.int32)
        starts, ends = np.empty((2, width), dtype=np.int64)
        nearest = np.empty(width, dtype=np.float32)
        for y in range(np.int64(task), height, TASKS):
            line = disparity[y]
            count = find_runs(line, edges, list_edges(line, STEP_PX, marks, edges), starts, ends)
            views = left[y], right[y], amplitude[y]
            drop_of_row(line, views, map_, y, noise, starts[:count], ends[:count], nearest)


@njit(**BARE)
def drop_of_row(line, views, map_, y, noise, starts, ends, nearest):  # type: ignore[no-untyped-def]
    """Set the phantoms among the runs of a row to NaN; ``nearest`` (W,) is memory for what the right row shows."""
    claimed = False
    for run in range(starts.size):
        if ends[run] - starts[run] > MOST_PX:
            continue
        for other in (run - 1, run + 1):
            if not 0 <= other < starts.size or not may_hide(line, starts, ends, run, other):
                continue
            far, near = (ends[other] - 1, starts[run]) if other < run else (starts[other], ends[run] - 1)
            if not runs_on(map_, line, y, starts[run], ends[run], line[far]):
                continue
            if not claimed:
                fill_nearest(line, nearest)
                claimed = True
            if is_explained(views, near, nearest, starts[run], ends[run], line[far], noise):
                for x in range(starts[run], ends[run]):
                    line[x] = np.float32(np.nan)
                break


@njit(**BARE)
def fill_nearest(line, nearest):  # type: ignore[no-untyped-def]
    """Fill what the right row shows, ``NOTHING`` where nobody knows."""
    for x in range(nearest.size):
        nearest[x] = NOTHING
    claim_nearest(line, nearest)


@njit(**BARE)
def find_runs(line, edges, edge_count, starts, ends):  # type: ignore[no-untyped-def]
    """Fill the first columns of runs without holes and steps, and the columns behind them; return how many."""
    count = 0
    for number in range(edge_count):
        if line[edges[number]] == line[edges[number]]:
            starts[count], ends[count] = edges[number], edges[number + 1]
            count += 1
    return count


@njit(forceinline=True, **BARE)
def may_hide(line, starts, ends, run, other):  # type: ignore[no-untyped-def]
    """Whether a run lies before one close by that is wider than any phantom."""
    gap = starts[run] - ends[other] if other < run else starts[other] - ends[run]
    far = line[ends[other] - 1] if other < run else line[starts[other]]
    wider = ends[other] - starts[other] > MOST_PX
    return wider and gap <= GAP_PX and line[starts[run]] > far + STEP_PX


@njit(forceinline=True, **BARE)
def runs_on(map_, line, y, start, end, far):  # type: ignore[no-untyped-def]
    """Whether the far surface has the phase of the run at its first, middle and last pixel."""
    for x in (start, (start + end) // 2, end - 1):
        here, _ = phase_of_disparity(map_, x, y, line[x])
        there, _ = phase_of_disparity(map_, x, y, far)
        if not abs(wrap(np.float32(here - there))) < RUNS_ON_RAD:
            return False
    return True


@njit(**BARE)
def is_explained(views, near, nearest, start, end, far, noise):  # type: ignore[no-untyped-def]
    """Whether most of a run could be the far surface: seen alike on the right, hidden by something nearer, outside.

    Its amplitude is that of column ``near``.
    """
    left, right, bright = views[0], views[1], views[2][near]
    alike = noise + SHADING_SHARE * bright if noise < TELLING_SHARE * bright else np.float32(0.0)
    hidden, seen_alike = 0, 0
    for x in range(start, end):
        column = np.float32(x) - far
        if column < np.float32(0.0):
            hidden += 1
            continue
        base = int(column)
        if base + 1 >= right.size:
            continue
        if max(nearest[base], nearest[base + 1]) > far + STEP_PX:
            hidden += 1
            continue
        seen = right[base] + (column - np.float32(base)) * (right[base + 1] - right[base])
        seen_alike += abs(left[x] - seen) < alike
    length = np.float32(end - start)
    return np.float32(hidden + seen_alike) >= EXPLAINED * length and np.float32(hidden) >= HIDDEN * length
