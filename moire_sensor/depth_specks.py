"""Rejection of what is too small to have been measured: runs of a few pixels, and specks of connected ones.

Both go by the runs of a row, pixels all on one surface: specks are unions of runs that touch from row to row.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import BARE, NAN_SAFE
from moire_sensor.depth_runs import TASKS, list_edges, marks_for
from moire_sensor.phase_carrier import Float32

SAME_SURFACE_PX = np.float32(1.0)
# Steep surfaces must not fall to pieces.
CONNECTED_PX = np.float32(1.125)
# Rows whose runs one task unites: few, so that threads share them evenly, and their seams are quickly closed.
BAND_ROWS = 30


def drop_slivers(disparity_px: Float32, least_px: int) -> None:
    """Set in place to NaN the pixels of runs along a row, all on one surface, that are shorter than ``least_px``.

    A window one period wide cannot measure what is much narrower: such a run is what an accident of two views looks
    like, a strip that each camera sees of something else behind a thin pole.
    """
    clear_short_runs(disparity_px, least_px)


def drop_specks(disparity_px: Float32, least_px: int) -> None:
    """Set in place to NaN the disparities (H, W) on connected surfaces of fewer than ``least_px`` pixels.

    Neighbours left, right, above and below are connected if they lie at most ``CONNECTED_PX`` apart.
    """
    height, width = disparity_px.shape
    # Numbers of a row lie apart, so that of so much memory only a little is touched.
    edges, parents, pixels = np.empty((3, width + 1, height), dtype=np.int32)
    unite_bands(disparity_px, edges, parents, pixels)
    unite_seams(disparity_px, edges, parents.ravel(), pixels.ravel())
    clear_small(disparity_px, least_px, edges, parents.ravel(), pixels.ravel())


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def clear_short_runs(disparity, least):  # type: ignore[no-untyped-def]
    """Kernel of :func:`drop_slivers`."""
    height, width = disparity.shape
    for task in prange(TASKS):
        marks, edges = marks_for(width), np.empty(width + 1, dtype=np.int32)
        for y in range(np.int64(task), height, TASKS):
            clear_short(disparity[y], least, edges, list_edges(disparity[y], SAME_SURFACE_PX, marks, edges))


@njit(**BARE)
def clear_short(line, least, edges, count):  # type: ignore[no-untyped-def]
    """Set to NaN the runs of a row of fewer than ``least`` pixels."""
    for run in range(count):
        if edges[run + 1] - edges[run] < least:
            for x in range(edges[run], edges[run + 1]):
                line[x] = np.float32(np.nan)


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def unite_bands(disparity, edges, parents, pixels):  # type: ignore[no-untyped-def]
    """Fill the ``edges`` (W + 1, H) of the runs of every row, and unite those that touch within bands of rows.

    ``parents`` and ``pixels``, flat (W + 1, H), are those of :func:`unite`; those of run n of row y lie at n H + y.
    """
    height, width = disparity.shape
    for band in prange((height + BAND_ROWS - 1) // BAND_ROWS):
        first = np.int64(band) * BAND_ROWS
        marks = marks_for(width)
        for y in range(first, min(first + BAND_ROWS, height)):
            count = list_edges(disparity[y], CONNECTED_PX, marks, edges[:, y])
            for run in range(count):
                parents[run, y] = run * height + y
                pixels[run, y] = edges[run + 1, y] - edges[run, y]
            if y > first:
                unite_rows(disparity, y, edges, parents.ravel(), pixels.ravel())


@njit(fastmath=NAN_SAFE, cache=True)
def unite_seams(disparity, edges, parents, pixels):  # type: ignore[no-untyped-def]
    """Unite the runs that touch from band to band."""
    for row in range(BAND_ROWS, disparity.shape[0], BAND_ROWS):
        unite_rows(disparity, row, edges, parents, pixels)


@njit(fastmath=NAN_SAFE)
def unite_rows(disparity, y, edges, parents, pixels):  # type: ignore[no-untyped-def]
    """Unite the runs of row y with those of the row above that they touch."""
    height, width = disparity.shape
    over, under, x = 0, 0, 0
    while x < width:
        end_over, end_under = edges[over + 1, y - 1], edges[under + 1, y]
        end = min(end_over, end_under)
        if disparity[y, x] == disparity[y, x] and disparity[y - 1, x] == disparity[y - 1, x]:
            for column in range(x, end):
                if abs(disparity[y, column] - disparity[y - 1, column]) <= CONNECTED_PX:
                    unite(parents, pixels, over * height + y - 1, under * height + y)
                    break
        over += end == end_over
        under += end == end_under
        x = end


@njit(inline="always")
def unite(parents, pixels, one, other):  # type: ignore[no-untyped-def]
    """Join two surfaces: ``parents`` lead from runs to the one that counts the ``pixels`` of all."""
    one, other = root_of(parents, one), root_of(parents, other)
    if one != other:
        one, other = min(one, other), max(one, other)
        parents[other] = one
        pixels[one] += pixels[other]


@njit(inline="always")
def root_of(parents, run):  # type: ignore[no-untyped-def]
    """The run that a run's surface goes by; the way there becomes shorter."""
    while parents[run] != run:
        parents[run] = parents[parents[run]]
        run = parents[run]
    return run


@njit(parallel=True, fastmath=NAN_SAFE, cache=True)
def clear_small(disparity, least, edges, parents, pixels):  # type: ignore[no-untyped-def]
    """Set to NaN the runs of surfaces of fewer than ``least`` pixels."""
    height, width = disparity.shape
    for row in prange(height):
        y = np.int64(row)
        run = 0
        while edges[run, y] < width:
            at = run * height + y
            while parents[at] != at:
                at = parents[at]
            if pixels[at] < least:
                disparity[y, edges[run, y] : edges[run + 1, y]] = np.float32(np.nan)
            run += 1
