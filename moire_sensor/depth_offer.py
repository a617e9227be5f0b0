"""The plane of a trusted pixel, offered to a pixel beside an edge, and how well its grey levels speak for it."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import wrap
from moire_sensor.projector_map import phase_of_disparity

# Trusted pixels have no jump and no hole within so many pixels.
RIM_PX = 3
SAME_CLAIM_PX = np.float32(1.5)
# A small window counts from so many of its fifteen pixels on.
LEAST_SEEN = 8
NO_CLAIM = np.float32(-1e9)
# The row beside the pixel must carry fringes of this share of the power of the plane's own.
LEAST_POWER = np.float32(0.2)
ROW_SPAN_PX = 10
# A plane is moved by what the row says if that is more than noise, and given up beyond the largest move.
MOVE_PX, LARGEST_MOVE_PX = np.float32(0.3), np.float32(0.8)
# Light that the plane promises may be missing by this share of the fringe amplitude; a shadow lacks more.
DIM_SHARE = np.float32(0.7)
GLARE_SHARE = np.float32(0.4)


@njit(inline="always", fastmath=False)
def taken(claim, y, x, disparity):  # type: ignore[no-untyped-def]
    """Whether the right pixel lies outside the image or shows another surface."""
    column = int(np.floor(np.float32(x) - disparity + np.float32(0.5)))
    if column < 0 or column >= claim.shape[1]:
        return True
    return claim[y, column] > NO_CLAIM and abs(claim[y, column] - disparity) > SAME_CLAIM_PX


@njit(inline="always", fastmath=False)
def small_difference(left, right, y, x, disparity, along, across, largest):  # type: ignore[no-untyped-def]
    """Lowest mean difference of three windows of 5 columns and 3 rows that hold the pixel, on a plane."""
    height, width = left.shape
    before, middle, after = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    seen_before, seen_middle, seen_after = 0, 0, 0
    for aside in range(max(-4, -x), min(4, width - 1 - x) + 1):
        total, count = np.float32(0.0), 0
        for down in range(-min(1, y), min(1, height - 1 - y) + 1):
            column = np.float32(x + aside) - (disparity + across * np.float32(down) + along * np.float32(aside))
            if np.float32(0.0) <= column < np.float32(width - 1):
                base = int(column)
                seen = right[y + down, base]
                seen += (column - np.float32(base)) * (right[y + down, base + 1] - seen)
                total += min(abs(left[y + down, x + aside] - seen), largest)
                count += 1
        if aside <= 0:
            before += total
            seen_before += count
        if abs(aside) <= 2:
            middle += total
            seen_middle += count
        if aside >= 0:
            after += total
            seen_after += count
    best = before / np.float32(seen_before) if seen_before >= LEAST_SEEN else np.float32(np.inf)
    if seen_middle >= LEAST_SEEN:
        best = min(best, middle / np.float32(seen_middle))
    return min(best, after / np.float32(seen_after)) if seen_after >= LEAST_SEEN else best


@njit(inline="always", fastmath=False)
def row_match(left, right, y, x, disparity, along, first, last):  # type: ignore[no-untyped-def]
    """Shift that matches columns ``first`` to ``last`` of the row best, mean squared slope, variance of the shift."""
    width = left.shape[1]
    met, power, squares, count = np.float32(0.0), np.float32(1e-3), np.float32(0.0), 0
    for at in range(max(first, 0), min(last, width - 1) + 1):
        column = np.float32(at) - (disparity + along * np.float32(at - x))
        if column < np.float32(1.0) or column >= np.float32(width - 2):
            continue
        base = int(column)
        part = column - np.float32(base)
        before, near, far, after = right[y, base - 1], right[y, base], right[y, base + 1], right[y, base + 2]
        slope = np.float32(0.5) * (far - before + part * (after - near - far + before))
        difference = left[y, at] - near - part * (far - near)
        met += slope * difference
        power += slope * slope
        squares += difference * difference
        count += 1
    if count < ROW_SPAN_PX // 2:
        return np.float32(0.0), np.float32(0.0), np.float32(np.inf)
    left_over = max(squares - met * met / power, np.float32(0.0)) / np.float32(count)
    return -met / power, power / np.float32(count), left_over / power


@njit(inline="always", fastmath=False)
def plane_offered(disparity, y, x, y0, x0):  # type: ignore[no-untyped-def]
    """Disparity at (y, x) of the plane around trusted pixel (y0, x0), and its slopes along x and y."""
    span = np.float32(2 * RIM_PX)
    along = (disparity[y0, x0 + RIM_PX] - disparity[y0, x0 - RIM_PX]) / span
    across = (disparity[y0 + RIM_PX, x0] - disparity[y0 - RIM_PX, x0]) / span
    return disparity[y0, x0] + along * np.float32(x - x0) + across * np.float32(y - y0), along, across


@njit(inline="always", fastmath=False)
def fits(  # type: ignore[no-untyped-def]
    offer, y, x, y0, x0, left, right, background, amplitude, map_, rad_per_px, claim, noise
):
    """Disparity of an offered plane as the row moves it, its difference in amplitudes (inf: refused), its variance."""
    disparity, along, across = offer
    refused = np.float32(np.inf)
    bright = amplitude[y0, x0]
    phase, _ = phase_of_disparity(map_, x, y, disparity)
    lacks = background[y0, x0] + bright * np.cos(wrap(np.float32(phase))) - left[y, x]
    if lacks > DIM_SHARE * bright + np.float32(3.0) * noise or -lacks > GLARE_SHARE * bright + np.float32(3.0) * noise:
        return disparity, refused, refused
    aside = ROW_SPAN_PX if x0 > x else ROW_SPAN_PX // 2 if x0 == x else 0
    first = x + aside - ROW_SPAN_PX
    shift, power, variance = row_match(left, right, y, x, disparity, along, first, first + ROW_SPAN_PX)
    fringe_slope = bright * rad_per_px
    if power < LEAST_POWER * np.float32(0.5) * fringe_slope * fringe_slope or abs(shift) > LARGEST_MOVE_PX:
        return disparity, refused, variance
    if abs(shift) > MOVE_PX:
        disparity += shift
    if taken(claim, y, x, disparity):
        return disparity, refused, variance
    return disparity, small_difference(left, right, y, x, disparity, along, across, bright) / bright, variance
