"""Planes of fits, and what the fits of neighbouring windows tell: slopes, and offsets without ripple and curvature."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import wrap
from moire_sensor.apart import LEAF_FAST
from moire_sensor.phase_sums import ONE, ZERO, copy

UNUSABLE = np.float32(1e30)
# Squared second differences below this many variances of a fit are noise: 6 for independent fits, twice that, twice.
NOISE_SHARE = np.float32(32.0)
# Planes of the fits: offset of the window's centre, the same without ripple and curvature, mean, amplitude, variance of
# the residual, slope of the offset along the row and down the column.
OFFSET, CARRIED, BACKGROUND, AMPLITUDE, VARIANCE, ALONG, DOWN, PLANES = range(8)


@njit(**LEAF_FAST)
def finish_row(limit, half_width, samples, bend, planes, y, start):  # type: ignore[no-untyped-def]
    """Slope along the row, and the offset without ripple and curvature, into the planes.

    ``bend`` (2, n): the phase that a slope adds, and room for the offsets without it.
    """
    end = start + limit.size
    offset, variance, along = planes[OFFSET, y], planes[VARIANCE, y], planes[ALONG, y][start:end]
    smooth = bend[1][: limit.size]
    row_slopes(offset, variance, start, (half_width + 1) // 2, along)
    straighten(offset[start:], bend[0], limit, along, smooth)
    size = 2 * half_width + 1
    share = np.float32((size * size - 1) / (24.0 * half_width * half_width))
    noise_share = NOISE_SHARE * share * share / np.float32(samples)
    carried, variance, amplitude = planes[CARRIED, y][start:end], variance[start:], planes[AMPLITUDE, y][start:]
    # Too close to the border for a curvature.
    copy(smooth, carried[:half_width])
    copy(smooth[smooth.size - half_width :], carried[carried.size - half_width :])
    without_bias(
        smooth, smooth[half_width:], smooth[2 * half_width :], variance, variance[half_width:],
        variance[2 * half_width :], amplitude[half_width:], share, noise_share, carried[half_width : -half_width],
    )  # fmt: skip


@njit(**LEAF_FAST)
def row_slopes(offset, variance, start, quarter, along):  # type: ignore[no-untyped-def]
    """Slope of the offset along a padded row, over half a period, where the ripple of a detuned fit cancels."""
    far, near = start - 2 * quarter, start - quarter
    after, farther = start + quarter, start + 2 * quarter
    slopes(
        offset[far:], offset[near:], offset[start:], offset[after:], offset[farther:],
        variance[far:], variance[near:], variance[start:], variance[after:], variance[farther:],
        np.float32(0.5 / quarter), along,
    )  # fmt: skip


@njit(**LEAF_FAST)
def straighten(offset, bend, limit, along, smooth):  # type: ignore[no-untyped-def]
    """Limit the slopes, and fill the offsets without the ripple that they make."""
    for x in range(smooth.size):
        along[x] = min(max(along[x], -limit[x]), limit[x])
        smooth[x] = offset[x] + along[x] * bend[x]


@njit(**LEAF_FAST)
def slope_down(planes, y, step):  # type: ignore[no-untyped-def]
    """Fill row y of the plane DOWN, derivative of the offset along y, from windows one and two steps away."""
    offset, variance, rows = planes[OFFSET], planes[VARIANCE], planes.shape[1]
    far, near, here = (y - 2 * step) % rows, (y - step) % rows, y % rows
    after, farther = (y + step) % rows, (y + 2 * step) % rows
    slopes(
        offset[far], offset[near], offset[here], offset[after], offset[farther],
        variance[far], variance[near], variance[here], variance[after], variance[farther],
        np.float32(0.5 / step), planes[DOWN, here],
    )  # fmt: skip


@njit(**LEAF_FAST)
def slopes(before2, before, here, after, after2, var_b2, var_b, var_h, var_a, var_a2, per_px, slope):  # type: ignore[no-untyped-def]
    """Phase per pixel from the pair of windows whose worse fit is best, around, before or after; 0 if none fits."""
    for x in range(slope.size):
        far, near, middle, next_, farther = before2[x], before[x], here[x], after[x], after2[x]
        centred = max(var_b[x], var_a[x])
        left = np.float32(1.5) * max(var_b2[x], var_h[x])
        right = np.float32(1.5) * max(var_h[x], var_a2[x])
        best = min(centred, min(left, right))
        first, last = (far, middle) if left <= right else (middle, farther)
        first, last = (near, next_) if best == centred else (first, last)
        along = wrap(last - first) * per_px
        slope[x] = along if best <= np.float32(4.0) * var_h[x] + np.float32(4.0) else ZERO


@njit(**LEAF_FAST)
def without_bias(  # type: ignore[no-untyped-def]
    before, here, after, var_b, var_h, var_a, amplitude, share, noise_share, carried
):
    """Offset less the bias that curvature gives a mean over the window, as far as noise alone would not give it.

    A phase with second derivative k reads k <t^2> / 2 too high. The second difference of three fits half a window
    apart tells k, where all three fit equally well.
    """
    for x in range(carried.size):
        second = wrap(after[x] - here[x]) - wrap(here[x] - before[x])
        worst = max(var_b[x], var_a[x])
        bias = share * second if worst <= np.float32(4.0) * var_h[x] + np.float32(4.0) else ZERO
        noise = noise_share * var_h[x] / (amplitude[x] * amplitude[x] + ONE)
        power = bias * bias
        carried[x] = here[x] - bias * max(power - noise, ZERO) / max(power, np.float32(1e-12))
