"""How alike two views are in a window of a few pixels, on a plane of disparity.

Each comes twice: for windows that both images hold whole, and with a check of every pixel for those at the border.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import BARE, ROW

# A small window counts from so many of its fifteen pixels on.
LEAST_SEEN = 8
MOST_SEEN = np.float32(15.0)
# Windows reach so far from the pixel. On a gentle plane so many columns from there on, of which nine count, are
# compared at once: a vector of the processor.
REACH_PX, LANES = 4, 16
# Columns of a row that is matched, and how many of them the right image must show.
ROW_SPAN_PX = 10
LEAST_OF_ROW = ROW_SPAN_PX // 2
# Along a gentle slope the right columns fall behind, or run ahead, by less than this over a window.
MOST_LATE = np.float32(0.99)
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


@njit(**BARE)
def small_difference(left, right, y, x, disparity, along, across, largest, sums):  # type: ignore[no-untyped-def]
    """Lowest mean difference of three windows of 5 columns and 3 rows that hold the pixel, on a plane.

    Differences count at most ``largest``; ``sums`` is memory for ``LANES`` float32.
    """
    height, width = left.shape
    column, reach = np.float32(x) - disparity, np.float32(REACH_PX)
    margin = reach + reach * abs(along) + abs(across)
    whole = 0 < y < height - 1 and REACH_PX <= x <= width - LANES + REACH_PX
    whole &= margin + ONE <= column < np.float32(width - LANES - 2) - margin + reach
    if whole and np.float32(2 * REACH_PX) * abs(along) < MOST_LATE:
        column_sums(left, right, np.uint64(y), np.uint64(x - REACH_PX), column, along, across, largest, sums)
        middle = sums[3] + sums[4] + sums[5]
        before = sums[0] + sums[1] + sums[2] + sums[3] + sums[4]
        beyond = sums[4] + sums[5] + sums[6] + sums[7] + sums[8]
        return min(sums[2] + middle + sums[6], min(before, beyond)) / MOST_SEEN
    best = np.float32(np.inf)
    for aside in range(-2, 3, 2):
        best = min(best, window_difference(left, right, y, x, aside, column, along, across, largest))
    return best


@njit(**ROW)
def column_sums(left, right, y, first, column, along, across, largest, sums):  # type: ignore[no-untyped-def]
    """Fill the sums of the differences of three rows, of ``LANES`` columns from ``first`` on."""
    one, start = np.uint64(1), column - np.float32(REACH_PX) * (ONE - along)
    at_above, further_above = first_base(start + across, along)
    at, further = first_base(start, along)
    at_below, further_below = first_base(start - across, along)
    for k in range(np.uint64(LANES)):
        behind = np.float32(np.int32(k)) * along
        above = apart(left, right, y - one, first + k, at_above + k, further_above - behind)
        middle = apart(left, right, y, first + k, at + k, further - behind)
        below = apart(left, right, y + one, first + k, at_below + k, further_below - behind)
        above = above if above < largest else largest
        middle = middle if middle < largest else largest
        sums[k] = above + middle + (below if below < largest else largest)


@njit(forceinline=True, **BARE)
def first_base(start, along):  # type: ignore[no-untyped-def]
    """Column from which a right row is read pixel by pixel, and how far ``start`` lies beyond.

    The next ones of a plane lie there and the like of it, up to 2 columns beyond theirs.
    """
    base = np.int64(start) - (1 if along > ZERO else 0)
    return np.uint64(base), start - np.float32(base)


@njit(forceinline=True, **BARE)
def apart(left, right, y, x, column, further):  # type: ignore[no-untyped-def]
    """Difference of a left pixel and what the right row shows 0 to 2 columns ``further`` than a column."""
    before, middle = right[y, column], right[y, column + np.uint64(1)]
    after = right[y, column + np.uint64(2)]
    late = further >= ONE
    near, far = middle if late else before, after if late else middle
    return abs(left[y, x] - near - (further - (ONE if late else ZERO)) * (far - near))


@njit(**BARE)
def window_difference(left, right, y, x, aside, column, along, across, largest):  # type: ignore[no-untyped-def]
    """Mean difference of one window about column x + aside, as far as both images show it, infinite if too little."""
    height, width = left.shape
    total, seen = ZERO, 0
    for beside in range(aside - 2, aside + 3):
        at = column + np.float32(beside) * (ONE - along)
        for down in range(-1, 2):
            there = at - across * np.float32(down)
            if 0 <= y + down < height and 0 <= x + beside < width and ZERO <= there < np.float32(width - 1):
                base = np.uint64(there)
                value = right[y + down, base]
                value += (there - np.float32(base)) * (right[y + down, base + np.uint64(1)] - value)
                total += min(abs(left[y + down, x + beside] - value), largest)
                seen += 1
    return total / np.float32(seen) if seen >= LEAST_SEEN else np.float32(np.inf)


@njit(**BARE)
def row_match(left, right, y, x, disparity, along, first):  # type: ignore[no-untyped-def]
    """Shift that matches ``ROW_SPAN_PX`` + 1 columns of the row best, mean squared slope, variance of the shift."""
    width = left.shape[1]
    step = ONE - along
    start = np.float32(x) - disparity + np.float32(first - x) * step
    span = np.float32(ROW_SPAN_PX)
    if (
        0 <= first <= width - LANES
        and np.float32(2.0) <= start < np.float32(width - LANES - 3)
        and span * abs(along) < MOST_LATE
    ):
        met, power, squares = of_lanes(left[y], right[y], np.uint64(first), start, along)
        seen = ROW_SPAN_PX + 1
    else:
        met, power, squares, seen = of_row(left, right, y, first, start, step)
    if seen < LEAST_OF_ROW:
        return ZERO, ZERO, np.float32(np.inf)
    power += np.float32(1e-3)
    left_over = max(squares - met * met / power, ZERO) / np.float32(seen)
    return -met / power, power / np.float32(seen), left_over / power


@njit(**ROW)
def of_lanes(left, right, first, start, along):  # type: ignore[no-untyped-def]
    """Sums of :func:`row_match` for a row that both images hold whole."""
    met, power, squares = ZERO, ZERO, ZERO
    base, beyond = first_base(start, along)
    at = base - np.uint64(1)
    for k in range(np.uint64(LANES)):
        further = beyond - np.float32(np.int32(k)) * along
        i = at + k
        a, b, c = right[i], right[i + np.uint64(1)], right[i + np.uint64(2)]
        d, e = right[i + np.uint64(3)], right[i + np.uint64(4)]
        late = further >= ONE
        part = further - (ONE if late else ZERO)
        before, near = b if late else a, c if late else b
        far, after = d if late else c, e if late else d
        slope = HALF * (far - before + part * (after - near - far + before))
        difference = left[first + k] - near - part * (far - near)
        counts = np.int32(k) <= ROW_SPAN_PX
        slope = slope if counts else ZERO
        difference = difference if counts else ZERO
        met += slope * difference
        power += slope * slope
        squares += difference * difference
    return met, power, squares


@njit(forceinline=True, **BARE)
def level_and_slope(image, y, column):  # type: ignore[no-untyped-def]
    """Grey level of a row at a column that need not be whole, and its slope; two pixels lie on either side."""
    base = np.uint64(column)
    part = column - np.float32(base)
    before, near = image[y, base - np.uint64(1)], image[y, base]
    far, after = image[y, base + np.uint64(1)], image[y, base + np.uint64(2)]
    return near + part * (far - near), HALF * (far - before + part * (after - near - far + before))


@njit(**BARE)
def of_row(left, right, y, first, start, step):  # type: ignore[no-untyped-def]
    """Sums of :func:`row_match` as far as both images show the row, and how many columns that is."""
    width = left.shape[1]
    met, power, squares, seen = ZERO, ZERO, ZERO, 0
    for number in range(ROW_SPAN_PX + 1):
        column = start + np.float32(number) * step
        at = first + number
        if 0 <= at < width and ONE <= column < np.float32(width - 2):
            level, slope = level_and_slope(right, y, column)
            difference = left[y, at] - level
            met += slope * difference
            power += slope * slope
            squares += difference * difference
            seen += 1
    return met, power, squares, seen
