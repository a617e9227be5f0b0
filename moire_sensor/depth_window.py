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
# Windows reach so far from the pixel. On a level plane so many columns from there on, of which nine count, are compared
# at once: a vector of the processor.
REACH_PX, LEVEL_PX = 4, 16
# Columns of a row that is matched, and how many of them the right image must show.
ROW_SPAN_PX = 10
LEAST_OF_ROW = ROW_SPAN_PX // 2


@njit(**BARE)
def small_difference(  # type: ignore[no-untyped-def]
    left, right, y, x, disparity, along, across, largest, enough, limit
):
    """Lowest mean difference of three windows of 5 columns and 3 rows that hold the pixel, on a plane.

    Differences count at most ``largest``. A middle window with at most ``enough`` is taken at once, and the others are
    given up when they must exceed ``limit``.
    """
    height, width = left.shape
    column = np.float32(x) - disparity
    reach = np.float32(4.0) + np.float32(4.0) * abs(along) + abs(across)
    if 0 < y < height - 1 and 4 <= x < width - 4 and reach <= column < np.float32(width - 1) - reach:
        return of_windows(left, right, y, x, column, along, across, largest, enough, limit, False)
    return of_windows(left, right, y, x, column, along, across, largest, enough, limit, True)


@njit(**BARE)
def level_difference(left, right, y, x, disparity, largest, sums):  # type: ignore[no-untyped-def]
    """:func:`small_difference` on a level plane; ``sums`` is memory for ``LEVEL_PX`` float32."""
    height, width = left.shape
    column = np.float32(x) - disparity
    reach, end = np.float32(REACH_PX), width - LEVEL_PX + REACH_PX
    if not (0 < y < height - 1 and REACH_PX <= x < end and reach <= column < np.float32(end - 1)):
        flat = np.float32(0.0)
        return small_difference(left, right, y, x, disparity, flat, flat, largest, flat, np.float32(np.inf))
    base = np.int64(column)
    first, near = np.uint64(x - REACH_PX), np.uint64(base - REACH_PX)
    column_sums(left, right, np.uint64(y), first, near, column - np.float32(base), largest, sums)
    middle = sums[3] + sums[4] + sums[5]
    before = sums[0] + sums[1] + sums[2] + sums[3] + sums[4]
    beyond = sums[4] + sums[5] + sums[6] + sums[7] + sums[8]
    return min(sums[2] + middle + sums[6], min(before, beyond)) / MOST_SEEN


@njit(**ROW)
def column_sums(left, right, y, first, near, part, largest, sums):  # type: ignore[no-untyped-def]
    """Fill the sums of the differences of three rows, of ``LEVEL_PX`` columns from two places on."""
    one = np.uint64(1)
    for k in range(np.uint64(LEVEL_PX)):
        i, j = first + k, near + k
        above = abs(left[y - one, i] - right[y - one, j] - part * (right[y - one, j + one] - right[y - one, j]))
        middle = abs(left[y, i] - right[y, j] - part * (right[y, j + one] - right[y, j]))
        below = abs(left[y + one, i] - right[y + one, j] - part * (right[y + one, j + one] - right[y + one, j]))
        above = above if above < largest else largest
        middle = middle if middle < largest else largest
        sums[k] = above + middle + (below if below < largest else largest)


@njit(**BARE)
def of_windows(  # type: ignore[no-untyped-def]
    left, right, y, x, column, along, across, largest, enough, limit, checked
):
    """Kernel of :func:`small_difference` for a pixel that the right image shows at ``column``."""
    plane = (column, along, across)
    near, seen_near = of_columns(left, right, y, x, -2, 0, plane, largest, checked)
    middle, seen_middle = of_columns(left, right, y, x, 0, 1, plane, largest, checked)
    far, seen_far = of_columns(left, right, y, x, 1, 3, plane, largest, checked)
    best = mean(near + middle + far, seen_near + seen_middle + seen_far)
    bound = limit * MOST_SEEN
    near, seen_near = near + middle, seen_near + seen_middle
    far, seen_far = far + middle, seen_far + seen_middle
    if best <= enough:
        return best
    if near <= bound:
        more, seen_more = of_columns(left, right, y, x, -4, -2, plane, largest, checked)
        best = min(best, mean(near + more, seen_near + seen_more))
    if far <= bound:
        more, seen_more = of_columns(left, right, y, x, 3, 5, plane, largest, checked)
        best = min(best, mean(far + more, seen_far + seen_more))
    return best


@njit(**BARE)
def mean(total, seen):  # type: ignore[no-untyped-def]
    """Mean of a window, infinite where too little of it is seen."""
    return total / np.float32(seen) if seen >= LEAST_SEEN else np.float32(np.inf)


@njit(**BARE)
def of_columns(left, right, y, x, first, end, plane, largest, checked):  # type: ignore[no-untyped-def]
    """Sum of the differences of three rows of columns x + first to x + end - 1, and how many pixels it has."""
    height, width = left.shape
    middle, along, across = plane
    total, seen = np.float32(0.0), 0
    for aside in range(first, end):
        at = middle + np.float32(aside) * (np.float32(1.0) - along)
        for down in range(-1, 2):
            column = at - across * np.float32(down)
            if checked and not (
                0 <= y + down < height and 0 <= x + aside < width and np.float32(0.0) <= column < np.float32(width - 1)
            ):
                continue
            base = np.uint64(column)
            value = right[y + down, base]
            value += (column - np.float32(base)) * (right[y + down, base + np.uint64(1)] - value)
            total += min(abs(left[y + down, x + aside] - value), largest)
            seen += 1
    return total, seen


@njit(**BARE)
def row_match(left, right, y, x, disparity, along, first):  # type: ignore[no-untyped-def]
    """Shift that matches ``ROW_SPAN_PX`` + 1 columns of the row best, mean squared slope, variance of the shift."""
    width = left.shape[1]
    step = np.float32(1.0) - along
    start = np.float32(x) - disparity + np.float32(first - x) * step
    end = start + np.float32(ROW_SPAN_PX) * step
    lowest, highest = min(start, end), max(start, end)
    whole = first >= 0 and first + ROW_SPAN_PX < width
    if whole and np.float32(1.0) <= lowest and highest < np.float32(width - 2):
        return of_row(left, right, y, first, start, step, False)
    return of_row(left, right, y, first, start, step, True)


@njit(**BARE)
def of_row(left, right, y, first, start, step, checked):  # type: ignore[no-untyped-def]
    """Kernel of :func:`row_match` for a row whose first column the right image shows at ``start``."""
    width = left.shape[1]
    met, power, squares, seen = np.float32(0.0), np.float32(1e-3), np.float32(0.0), 0
    for number in range(ROW_SPAN_PX + 1):
        column = start + np.float32(number) * step
        at = first + number
        if checked and not (0 <= at < width and np.float32(1.0) <= column < np.float32(width - 2)):
            continue
        base = np.uint64(column)
        part = column - np.float32(base)
        before, near = right[y, base - np.uint64(1)], right[y, base]
        far, after = right[y, base + np.uint64(1)], right[y, base + np.uint64(2)]
        slope = np.float32(0.5) * (far - before + part * (after - near - far + before))
        difference = left[y, at] - near - part * (far - near)
        met += slope * difference
        power += slope * slope
        squares += difference * difference
        seen += 1
    if seen < LEAST_OF_ROW:
        return np.float32(0.0), np.float32(0.0), np.float32(np.inf)
    left_over = max(squares - met * met / power, np.float32(0.0)) / np.float32(seen)
    return -met / power, power / np.float32(seen), left_over / power
