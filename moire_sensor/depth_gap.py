"""One narrow gap between two surfaces: where it begins, whether a face lies there, and what its pixels are given."""

from __future__ import annotations

import numpy as np
from numba import njit

# A pixel with fringes of less than this share of its neighbour's shows something else too.
MIXED_SHARE = np.float32(0.9)
# The largest step across a steep face at the side (what turns out to be no such face is off by no more), how far apart
# the right camera sees the pixels at its ends at most, half of each included, and the mismatch of what is filled there,
# since nothing is compared.
ASIDE_STEP_PX, ASIDE_SEEN_PX, ASIDE_MISFIT = np.float32(3.0), np.float32(2.0), np.float32(0.2)
# Half of the row of grey levels that speaks for a pixel.
HALF_ROW_PX = 3
HALF = np.float32(0.5)
# How well an end of a gap is known: a uniform error of a pixel has a sigma of 0.29.
END_DOUBT_PX = np.float32(0.25)
# A surface's light tells where it ends if it differs from the gap's by so many times the noise of a difference.
TELLING_CONTRAST = np.float32(3.0)


@njit(inline="always", fastmath=False)
def fill_gap(images, left, right, amplitude, limits, line, last, at, upright):  # type: ignore[no-untyped-def]
    """Fill the pixels of one gap that fit, in a line of the four images."""
    here, sigma, signed, mismatch = images
    bright = amplitude[:, line] if upright else amplitude[line]
    first, end = firm_ends(bright, last, at)
    begin, length = np.float32(first), np.float32(end - first)
    if upright:
        begin, length = lit_ends(left[:, line], last, at, first, end, limits[0])
    step, shine = here[end] - here[first], max(min(bright[first], bright[end]), np.float32(1.0))
    doubt = sigma[first] + END_DOUBT_PX * abs(step) / length
    along = np.float32(0.0) if upright else step / length
    for x in range(first + 1, end):
        part = min(max((np.float32(x) - begin) / length, np.float32(0.0)), np.float32(1.0))
        found = here[first] + step * part
        row, column = (x, line) if upright else (line, x)
        apart = row_difference(left, right, row, column, found, along)
        if apart < limits[0] + limits[1] * bright[x]:
            here[x], sigma[x], signed[x], mismatch[x] = found, doubt, np.float32(np.nan), apart / shine


@njit(inline="always", fastmath=False)
def is_face_aside(here, grey, bright, limits, last, at):  # type: ignore[no-untyped-def]
    """Whether a gap of a row is a dark face so steep that the right camera sees less than a pixel of it.

    It must be darker than the fringes of either surface can become so near: not a lit strip that the right camera does
    not see.
    """
    step = here[at] - here[last]
    if not np.float32(0.0) < step <= ASIDE_STEP_PX or np.float32(at - last) - step > ASIDE_SEEN_PX:
        return False
    dark = grey[(last + at) // 2]
    away = HALF * np.float32(at - last)
    for end in (last, at):
        fall = np.float32(2.0) * bright[end] * np.sin(min(HALF * limits[2] * away, np.float32(HALF * np.pi)))
        if not grey[end] - dark > fall + TELLING_CONTRAST * limits[0]:
            return False
    return True


@njit(inline="always", fastmath=False)
def fill_face(images, last, at):  # type: ignore[no-untyped-def]
    """Fill the pixels of a gap by the straight line between its ends."""
    here, sigma, signed, mismatch = images
    length = np.float32(at - last)
    step = here[at] - here[last]
    for x in range(last + 1, at):
        here[x] = here[last] + step * np.float32(x - last) / length
        sigma[x], signed[x], mismatch[x] = END_DOUBT_PX * step / length, np.float32(np.nan), ASIDE_MISFIT


@njit(inline="always", fastmath=False)
def firm_ends(bright, last, at):  # type: ignore[no-untyped-def]
    """The ends of a gap, each a pixel further out where its fringes are dim beside those behind it: a mixed pixel."""
    first = last - 1 if bright[last] < MIXED_SHARE * bright[last - 1] else last
    return first, at + 1 if bright[at] < MIXED_SHARE * bright[at + 1] else at


@njit(inline="always", fastmath=False)
def lit_ends(grey, last, at, first, end, noise):  # type: ignore[no-untyped-def]
    """Where along a column a dark gap begins, and its length, pixels: the mixed pixels at its ends tell by their light.

    Where the surface is as dark as the gap nothing tells, and the gap begins at ``first``
    or ends at ``end``, the firm pixels beside it.
    """
    dark = grey[(last + at) // 2]
    above = share_lit(grey, last, last - 2, dark, noise) + share_lit(grey, last + 1, last - 2, dark, noise)
    below = share_lit(grey, at, at + 2, dark, noise) + share_lit(grey, at - 1, at + 2, dark, noise)
    begins = np.float32(last) + above - HALF if above > 0.0 else np.float32(first)
    ends = np.float32(at) - below + HALF if below > 0.0 else np.float32(end)
    return np.float32(begins), np.float32(max(ends - begins, np.float32(1.0)))


@njit(inline="always", fastmath=False)
def share_lit(grey, mixed, whole, dark, noise):  # type: ignore[no-untyped-def]
    """Share 0..1 of a mixed pixel's light that comes from the surface of a whole one; 0 where that one is dark, too."""
    contrast = grey[whole] - dark
    if abs(contrast) < TELLING_CONTRAST * noise:
        return np.float32(0.0)
    return min(max((grey[mixed] - dark) / contrast, np.float32(0.0)), np.float32(1.0))


@njit(inline="always", fastmath=False)
def row_difference(left, right, y, x, disparity, along):  # type: ignore[no-untyped-def]
    """Mean difference of the two views along the row about a pixel; infinite where the right view ends."""
    first, last = max(x - HALF_ROW_PX, 0), min(x + HALF_ROW_PX, left.shape[1] - 1)
    total = np.float32(0.0)
    for column in range(first, last + 1):
        seen = np.float32(column) - (disparity + along * np.float32(column - x))
        if not np.float32(0.0) <= seen < np.float32(left.shape[1] - 1):
            return np.float32(np.inf)
        base = int(seen)
        part = seen - np.float32(base)
        total += abs(left[y, column] - (right[y, base] + part * (right[y, base + 1] - right[y, base])))
    return total / np.float32(last - first + 1)
