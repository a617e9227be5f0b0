"""Kernels of the edge finder: a row of grey levels to its up and down fringe edges, in one go."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

UP, DOWN = 1, -1
SMOOTHING = (1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0)
OUTER, INNER, CENTRE = (np.float32(weight) for weight in SMOOTHING[:3])
# Smoothing and the parabola of an extremum each reach two pixels to either side.
BORDER_PX = 4
ZERO, HALF, TWO, EIGHT = (np.float32(number) for number in (0.0, 0.5, 2.0, 8.0))
ENDLESS = np.float32(np.inf)


@njit(parallel=True, cache=True, error_model="numpy")
def scan_rows(image, scale, contrast, edge_noise, edges):  # type: ignore[no-untyped-def]
    """Fill ``edges`` (EdgeRows) from an image whose grey levels times ``scale`` are those of 255."""
    for y in prange(image.shape[0]):
        scan_row(image, np.int64(y), scale, contrast, edge_noise, edges)


@njit(error_model="numpy")
def scan_row(image, y, scale, contrast, edge_noise, edges):  # type: ignore[no-untyped-def]
    """Fill row y of the edges."""
    smooth = np.empty(image.shape[1], dtype=np.float32)
    smooth_row(image[y], scale, smooth)
    extrema = np.empty(edges.x_px.shape[1], dtype=np.int32)
    number = mark_extrema(smooth, contrast, extrema)
    level, drift = np.empty(number, dtype=np.float32), np.empty(number, dtype=np.float32)
    fill_levels(smooth, extrema[:number], level, drift)
    edges.number[y] = mark_edges(
        smooth, extrema[:number], level, drift, edge_noise, edges.x_px[y], edges.side[y], edges.height[y],
        edges.sigma_px[y],
    )  # fmt: skip


@njit
def smooth_row(image, scale, smooth):  # type: ignore[no-untyped-def]
    """A row under a binomial of five; the border pixels are repeated."""
    last = image.size - 1
    # Slices, since indices that might be negative keep the loop from being vectorised.
    add_taps(image[:-4], image[1:-3], image[2:-2], image[3:-1], image[4:], scale, smooth[2:-2])
    for x in (0, 1, last - 1, last):
        before, after = max(x - 2, 0), min(x + 1, last)
        add_taps(
            image[before : before + 1], image[max(x - 1, 0) : max(x, 1)], image[x : x + 1], image[after : after + 1],
            image[min(x + 2, last) : min(x + 3, last + 1)], scale, smooth[x : x + 1],
        )  # fmt: skip


@njit
def add_taps(first, second, third, fourth, fifth, scale, target):  # type: ignore[no-untyped-def]
    """Weighted sum of five neighbours."""
    for x in range(target.size):
        outer = np.float32(first[x]) + np.float32(fifth[x])
        inner = np.float32(second[x]) + np.float32(fourth[x])
        target[x] = scale * (OUTER * outer + INNER * inner + CENTRE * np.float32(third[x]))


@njit
def mark_extrema(row, contrast, extrema):  # type: ignore[no-untyped-def]
    """Peaks and troughs of a row in turn, each ``contrast`` off what is before and behind it; their number.

    Of the first turn nobody knows what came before it.
    """
    x, rising = first_turn(row, contrast)
    number = 0
    while x < row.size:
        found, x = next_peak(row, x, contrast) if rising else next_trough(row, x, contrast)
        rising = not rising
        if x < row.size and BORDER_PX <= found < row.size - BORDER_PX and number < extrema.size:
            extrema[number] = found
            number += 1
    return number


@njit
def first_turn(row, contrast):  # type: ignore[no-untyped-def]
    """Column at which a row first lies ``contrast`` off what it reached before, and whether above it."""
    top = bottom = row[0]
    for x in range(1, row.size):
        top, bottom = max(top, row[x]), min(bottom, row[x])
        if row[x] <= top - contrast:
            return x, False
        if row[x] >= bottom + contrast:
            return x, True
    return row.size, True


@njit
def next_peak(row, start, contrast):  # type: ignore[no-untyped-def]
    """Peak from ``start`` on, and the column at which the row lies ``contrast`` below it; the row's end if nowhere."""
    top, level = start, row[start]
    for x in range(start + 1, row.size):
        if row[x] > level:
            top, level = x, row[x]
        elif row[x] <= level - contrast:
            return top, x
    return top, row.size


@njit
def next_trough(row, start, contrast):  # type: ignore[no-untyped-def]
    """Trough from ``start`` on, and the column at which the row lies ``contrast`` above it."""
    bottom, level = start, row[start]
    for x in range(start + 1, row.size):
        if row[x] < level:
            bottom, level = x, row[x]
        elif row[x] >= level + contrast:
            return bottom, x
    return bottom, row.size


@njit(error_model="numpy")
def fill_levels(row, extrema, level, drift):  # type: ignore[no-untyped-def]
    """Level of each extremum, and its change per column: along the flatter of the lines to its two likes."""
    for number in range(extrema.size):
        level[number] = extremum_level(row, extrema[number])
    before = ENDLESS, ENDLESS
    for number in range(extrema.size):
        rise = ENDLESS
        if number + 2 < extrema.size:
            rise = (level[number + 2] - level[number]) / np.float32(extrema[number + 2] - extrema[number])
        flatter = before[0] if abs(before[0]) <= abs(rise) else rise
        drift[number] = flatter if flatter < ENDLESS else ZERO
        before = before[1], rise


@njit(error_model="numpy")
def extremum_level(row, x):  # type: ignore[no-untyped-def]
    """Grey level at the top of the parabola through an extremum and the samples two pixels off."""
    tilt = row[x + 2] - row[x - 2]
    bend = row[x + 2] - TWO * row[x] + row[x - 2]
    if abs(bend) <= abs(tilt):
        return row[x]
    return row[x] - tilt * tilt / (EIGHT * bend)


@njit(error_model="numpy")
def mark_edges(row, extrema, level, drift, edge_noise, x_px, side, height, sigma_px):  # type: ignore[no-untyped-def]
    """One edge between each two extrema of a row, where the row crosses the middle level; their number."""
    number = 0
    for after in range(1, extrema.size):
        start, end = extrema[after - 1], extrema[after]
        middle = HALF * np.float32(start + end)
        first = level[after - 1] + drift[after - 1] * (middle - np.float32(start))
        second = level[after] + drift[after] * (middle - np.float32(end))
        crossed = HALF * (first + second)
        sign = UP if row[end] > row[start] else DOWN
        x = crossing(row, start, end, crossed, np.float32(sign))
        if x >= 0:
            slope = row[x + 1] - row[x]
            x_px[number] = np.float32(x) + (crossed - row[x]) / slope
            side[number] = sign
            height[number] = HALF * abs(second - first)
            sigma_px[number] = edge_noise / abs(slope)
            number += 1
    return number


@njit
def crossing(row, start, end, level, sign):  # type: ignore[no-untyped-def]
    """Column behind which a row crosses a level upwards (sign 1) or downwards, sought from the middle; -1 if none."""
    x = (start + end) >> 1
    while x >= start and sign * (row[x] - level) > 0.0:
        x -= 1
    while start <= x < end and sign * (row[x + 1] - level) <= 0.0:
        x += 1
    return x if start <= x < end else -1
