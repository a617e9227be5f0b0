"""Sub-pixel phase from one exposure: least squares over windows one period wide that avoid edges.

Every pixel has one fit of ``a + b cos(carrier + offset)`` over the window centred on it. A pixel then takes the fit of
whichever window that contains it fits best (symmetric multiple windows, reference [15] of the paper), so that no window
straddles a depth or shadow edge, and carries that phase to itself along the local slope.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.angles import fast_atan2, wrap, wrapped
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.settings import Settings
from moire_sensor.shot import Status

BAND_ROWS = 32
# A shifted window is taken only when it fits clearly better: the variance of a fit over 85 samples scatters by 16 %.
SHIFT_PENALTY = (1.0, 1.5, 2.0)
GOOD_SHARE = 1.3
UNUSABLE = np.float32(1e30)
# Squared second differences below this many variances of a fit are noise: 6 for independent fits, twice that, twice.
NOISE_SHARE = np.float32(32.0)
LARGEST_DETUNING = np.float32(0.6)


def phase_from_single(image: Float32, carrier: Carrier, step_rad: float, settings: Settings) -> PhaseImage:
    """Phase of every pixel of one fringe image.

    Parameters
    ----------
    image : (H, W) float32, grey levels scaled to 255 at saturation.
    carrier : the camera's carrier.
    step_rad : phase that the projector adds in this exposure.

    Returns
    -------
    PhaseImage
        NaN phase where the fringe amplitude is below ``settings.min_amplitude`` or the window is saturated.
    """
    shape = image.shape
    half_width, half_height = carrier.half_width_px, carrier.half_height_px
    samples = (2 * half_width + 1) * (2 * half_height + 1)
    # Zeros, not whatever memory held: windows that leave the image are not fitted, yet their neighbours look at them.
    fit = np.zeros((4, *shape), dtype=np.float32)
    fit_windows(
        image, carrier.cos, carrier.sin, carrier.rad_per_px, carrier.inverse, carrier.detuned, half_width, half_height,
        fit,
    )  # fmt: skip
    offset, slope = np.empty(shape, dtype=np.float32), np.empty((2, *shape), dtype=np.float32)
    remove_ripple(
        fit, carrier.phase_rad, carrier.rad_per_px, half_width, half_height, np.float32(carrier.ripple), offset, slope
    )
    picked = np.empty((4, *shape), dtype=np.float32)
    good = np.float32(GOOD_SHARE * np.median(fit[3, half_height::11, half_width::7]))
    pick_windows(fit, offset, slope, half_width, half_height, samples, good, picked)
    return to_phase_image(image, picked, step_rad, samples, settings)


def to_phase_image(
    image: Float32, picked: Float32, step_rad: float, samples: int, settings: Settings
) -> PhaseImage:
    """Wrap the picked fits into a PhaseImage, marking dark and saturated pixels."""
    background, amplitude, variance = picked[1], picked[2], picked[3]
    offset = wrapped(picked[0] - np.float32(step_rad))
    status = np.zeros(image.shape, dtype=np.uint8)
    noise = np.sqrt(np.maximum(variance, 0.0))
    unlit = ~(amplitude > np.maximum(settings.min_amplitude, settings.min_amplitude_to_noise * noise))
    status[unlit] = Status.UNLIT
    status[(image >= 254.5) & unlit] = Status.SATURATED
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = noise / amplitude * np.float32(np.sqrt(2.0 / samples))
    offset = np.where(status == 0, offset, np.float32(np.nan))
    return PhaseImage(offset, amplitude, background, sigma, status)


@njit(parallel=True, fastmath=True, cache=True)
def fit_windows(image, cos, sin, rad_per_px, inverse, detuned, half_width, half_height, fit):  # type: ignore[no-untyped-def]
    """Fill ``fit`` (4, H, W): offset_rad, background, amplitude, residual variance of the window centred there."""
    height, width = image.shape
    bands = (height + BAND_ROWS - 1) // BAND_ROWS
    for band in prange(bands):
        column = np.zeros((4, width), dtype=np.float32)
        start = np.int64(band) * BAND_ROWS
        first = max(start, half_height)
        last = min(start + BAND_ROWS, height - half_height)
        for y in range(start, min(start + BAND_ROWS, height)):
            if y < half_height or y >= height - half_height:
                fit[3, y, :] = UNUSABLE
        if first < last:
            for y in range(first - half_height, first + half_height):
                add_row(column, image[y], cos[y], sin[y], np.float32(1.0))
        for y in range(first, last):
            below = y + half_height
            add_row(column, image[below], cos[below], sin[below], np.float32(1.0))
            fit_row(column, cos[y], sin[y], rad_per_px[y], inverse[y], detuned, half_width, half_height, fit[:, y])
            above = y - half_height
            add_row(column, image[above], cos[above], sin[above], np.float32(-1.0))


@njit(inline="always", fastmath=True)
def add_row(column, values, cos, sin, sign):  # type: ignore[no-untyped-def]
    """Add one image row to the column sums of I, I cos, I sin, I^2."""
    for x in range(values.size):
        value = values[x] - np.float32(128.0)
        column[0, x] += sign * value
        column[1, x] += sign * value * cos[x]
        column[2, x] += sign * value * sin[x]
        column[3, x] += sign * value * value


@njit(inline="always", fastmath=True)
def fit_row(column, cos, sin, rad_per_px, inverse, detuned, half_width, half_height, fit):  # type: ignore[no-untyped-def]
    """Fit every window of one row from the column sums."""
    width = column.shape[1]
    half = np.float32(half_width)
    samples = np.float32((2 * half_width + 1) * (2 * half_height + 1))
    for x in range(half_width):
        fit[3, x] = UNUSABLE
        fit[3, width - 1 - x] = UNUSABLE
    s0 = s1 = s2 = s3 = t1 = t2 = np.float32(0.0)
    for x in range(2 * half_width):
        s0 += column[0, x]
        s1 += column[1, x]
        s2 += column[2, x]
        s3 += column[3, x]
        t1 += np.float32(x - half_width) * column[1, x]
        t2 += np.float32(x - half_width) * column[2, x]
    for x in range(half_width, width - half_width):
        new, old = x + half_width, x - half_width
        s0 += column[0, new]
        s1 += column[1, new]
        s2 += column[2, new]
        s3 += column[3, new]
        t1 += half * column[1, new]
        t2 += half * column[2, new]
        i = inverse[x]
        mean = i[0] * s0 + i[1] * s1 - i[2] * s2
        real = i[1] * s0 + i[3] * s1 - i[4] * s2
        imaginary = i[2] * s0 + i[4] * s1 - i[5] * s2
        left_over = s3 - mean * s0 - real * s1 + imaginary * s2
        left_over -= detuning_power(mean, real, imaginary, t1, t2, cos[x], sin[x], rad_per_px[x], detuned)
        fit[0, x] = fast_atan2(imaginary, real)
        fit[1, x] = mean + np.float32(128.0)
        fit[2, x] = np.sqrt(real * real + imaginary * imaginary)
        fit[3, x] = max(left_over, np.float32(0.0)) / (samples - np.float32(4.0))
        s0 -= column[0, old]
        s1 -= column[1, old]
        s2 -= column[2, old]
        s3 -= column[3, old]
        t1 += half * column[1, old] - s1
        t2 += half * column[2, old] - s2


@njit(inline="always", fastmath=True)
def detuning_power(mean, real, imaginary, t1, t2, cos, sin, rad_per_px, detuned):  # type: ignore[no-untyped-def]
    """Part of the squared residual that a fringe slightly off the carrier's frequency explains.

    With the fit C cos + D sin about the window's centre, a frequency off by e adds e t (D cos - C sin); what of that
    column is square to (1, cos, sin) meets the residual.
    """
    low, high = detuned[0, 0], detuned[detuned.shape[0] - 1, 0]
    part = (abs(rad_per_px) - low) / max(high - low, np.float32(1e-9)) * np.float32(detuned.shape[0] - 1)
    k = detuned[min(max(int(part + np.float32(0.5)), 0), detuned.shape[0] - 1)]
    sign = np.float32(1.0) if rad_per_px > np.float32(0.0) else np.float32(-1.0)
    c, d = real * cos - imaginary * sin, -(imaginary * cos + real * sin)
    along_1, along_c, along_s = -c * k[1], -c * k[2], d * k[2]
    bound = along_1 * (k[5] * along_1 + np.float32(2.0) * k[6] * along_c) + k[7] * along_c * along_c
    free = d * d * k[3] + c * c * k[4] - bound - k[8] * along_s * along_s
    t_cos, t_sin = sign * (t1 * cos + t2 * sin), sign * (t2 * cos - t1 * sin)
    met = d * t_cos - c * t_sin - mean * along_1 - c * along_c - d * along_s
    return met * met / max(free, np.float32(1.0))


@njit(inline="always", fastmath=True)
def slope_along(before2, before, here, after, after2, var_b2, var_b, var_h, var_a, var_a2, span):  # type: ignore[no-untyped-def]
    """Phase per pixel from the pair of windows, ``span`` pixels apart, whose worse fit is best."""
    centred = max(var_b, var_a)
    left = max(var_b2, var_h) * np.float32(1.5)
    right = max(var_h, var_a2) * np.float32(1.5)
    best = min(centred, min(left, right))
    if best > np.float32(4.0) * var_h + np.float32(4.0):
        return np.float32(0.0)
    if best == centred:
        return wrap(after - before) / span
    return wrap(here - before2) / span if best == left else wrap(after2 - here) / span


@njit(inline="always", fastmath=True)
def rough_sine(angle):  # type: ignore[no-untyped-def]
    """Sine to 1e-3: it only scales a correction of at most a few hundredths of a radian."""
    x = wrap(angle)
    curve = np.float32(1.27323954) * x - np.float32(0.405284735) * x * abs(x)
    return np.float32(0.775) * curve + np.float32(0.225) * curve * abs(curve)


@njit(parallel=True, fastmath=True, cache=True)
def remove_ripple(fit, carrier_rad, rad_per_px, half_width, half_height, ripple, offset, slope):  # type: ignore[no-untyped-def]
    """Fill ``slope`` (2, H, W), derivative of the offset along x and y, and ``offset`` (H, W) without ripple.

    Slopes are taken on the fit's own side of edges, over half a period, where the ripple of a detuned fit cancels; the
    slope along the row then tells the first-order phase error of a fringe finer or coarser than the carrier.
    """
    height, width = fit.shape[1:]
    quarter = (half_width + 1) // 2
    step = max(half_height, 1)
    for row in prange(height):
        y = np.int64(row)
        y0, y1 = max(y - 2 * step, 0), max(y - step, 0)
        y3, y4 = min(y + step, height - 1), min(y + 2 * step, height - 1)
        for x in range(width):
            x0, x1 = max(x - 2 * quarter, 0), max(x - quarter, 0)
            x3, x4 = min(x + quarter, width - 1), min(x + 2 * quarter, width - 1)
            along = slope_along(
                fit[0, y, x0], fit[0, y, x1], fit[0, y, x], fit[0, y, x3], fit[0, y, x4],
                fit[3, y, x0], fit[3, y, x1], fit[3, y, x], fit[3, y, x3], fit[3, y, x4], np.float32(2 * quarter),
            )  # fmt: skip
            limit = LARGEST_DETUNING * abs(rad_per_px[y, x])
            along = min(max(along, -limit), limit)
            slope[0, y, x] = along
            slope[1, y, x] = slope_along(
                fit[0, y0, x], fit[0, y1, x], fit[0, y, x], fit[0, y3, x], fit[0, y4, x],
                fit[3, y0, x], fit[3, y1, x], fit[3, y, x], fit[3, y3, x], fit[3, y4, x], np.float32(2 * step),
            )  # fmt: skip
            double = np.float32(2.0) * (carrier_rad[y, x] + fit[0, y, x])
            offset[y, x] = fit[0, y, x] - ripple * along / rad_per_px[y, x] * rough_sine(double)


@njit(inline="always", fastmath=True)
def without_curvature(fit, offset, y, x, half_width, share, samples):  # type: ignore[no-untyped-def]
    """Offset less the bias that curvature gives a mean over the window.

    A phase with second derivative k reads k <t^2> / 2 too high. The second difference of three fits half a window
    apart tells k, where all three fit equally well; what noise alone would give is left out.
    """
    here = offset[y, x]
    if x < 2 * half_width or x >= offset.shape[1] - 2 * half_width:
        return here
    worst = max(fit[3, y, x - half_width], fit[3, y, x + half_width])
    if worst > np.float32(4.0) * fit[3, y, x] + np.float32(4.0):
        return here
    bias = share * (wrap(offset[y, x + half_width] - here) - wrap(here - offset[y, x - half_width]))
    noise2 = fit[3, y, x] / (fit[2, y, x] * fit[2, y, x] + np.float32(1.0)) / np.float32(samples)
    floor = NOISE_SHARE * share * share * noise2
    power = bias * bias
    return here - bias * max(power - floor, np.float32(0.0)) / max(power, np.float32(1e-12))


@njit(inline="always", fastmath=True)
def best_window(fit, y, x, half_width, half_height):  # type: ignore[no-untyped-def]
    """Row and column of the window containing the pixel that fits best; a shifted one only if clearly better."""
    height, width = fit.shape[1:]
    quarter = (half_width + 1) // 2
    best, best_y, best_x = UNUSABLE, y, x
    for shift_y in range(-1, 2):
        yy = y + shift_y * half_height
        if yy < 0 or yy >= height:
            continue
        for shift_x in range(-2, 3):
            xx = x + (half_width if shift_x == 2 else -half_width if shift_x == -2 else shift_x * quarter)
            if xx < 0 or xx >= width:
                continue
            score = fit[3, yy, xx] * SHIFT_PENALTY[max(abs(shift_x), abs(shift_y))]
            if score < best:
                best, best_y, best_x = score, yy, xx
    return best_y, best_x


@njit(parallel=True, fastmath=True, cache=True)
def pick_windows(fit, offset, slope, half_width, half_height, samples, good, picked):  # type: ignore[no-untyped-def]
    """Fill ``picked`` (4, H, W): offset, background, amplitude, variance of the best window around a pixel.

    A window centred on the pixel whose variance is below ``good`` needs no rival.
    """
    height, width = offset.shape
    share = np.float32((2 * half_width + 1) ** 2 - 1) / np.float32(24.0 * half_width * half_width)
    for row in prange(height):
        y = np.int64(row)
        for x in range(width):
            at_y, at_x = y, x
            if fit[3, y, x] > good:
                at_y, at_x = best_window(fit, y, x, half_width, half_height)
            carried = without_curvature(fit, offset, at_y, at_x, half_width, share, samples)
            carried += slope[0, at_y, at_x] * np.float32(x - at_x) + slope[1, at_y, at_x] * np.float32(y - at_y)
            variance = fit[3, at_y, at_x]
            picked[0, y, x] = wrap(carried)
            picked[1, y, x] = fit[1, at_y, at_x]
            picked[2, y, x] = fit[2, at_y, at_x] if variance < UNUSABLE else np.float32(0.0)
            picked[3, y, x] = variance
