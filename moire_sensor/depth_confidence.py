"""Confidence of a depth: how likely its disparity is within a pixel of the truth.

A logistic regression on five properties of a match. Its weights were fitted once, on 12 analytic scenes in four
conditions (plain, amplitude 20, 30 % texture, noise 4; 11.7 million pixels), and hold on the simulator's scenes, which
they never saw: of the pixels above 0.9 there 0.022 % were off by more than a pixel, and 98 % of the right ones were
above 0.9.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from moire_sensor.apart import LEAF, NAN_SAFE
from moire_sensor.depth_refine import Match
from moire_sensor.phase_carrier import Float32

# Constant, log mismatch, order margin, share of unknown neighbours, log disparity spread, sigma. The constant is moved
# by 2.3 so that 0.9 lies where the calibration above was read.
WEIGHTS = tuple(np.float32(weight) for weight in (-1.235, 0.828, -0.313, 5.063, 1.492, 4.107))
LARGEST_MARGIN = np.float32(4.0)
LARGEST_MISMATCH_RAD = np.float32(3.0)
LARGEST_SPREAD_PX = np.float32(8.0)
# Half the windows of known neighbours and of the spread.
KNOWN_REACH, SPREAD_REACH = 5, 3
KNOWN_WINDOW_PX = 2 * KNOWN_REACH + 1
# Windows of 2, 4 and 7 pixels, each from two of the one before.
DOUBLING = (1, 2, 3)
FAR_PX = np.float32(1e9)
# Rows that share work memory.
BAND_PX = 16
# log2(m) on 1..2 and 2^p on 0..1, minimax to 2e-6 and 4e-6: a thousandth of what a weight's last digit does.
LOG2 = tuple(
    np.float32(c) for c in (-3.03460285, 6.08989576, -5.30170911, 3.24946656, -1.2479625, 0.27003746, -0.0251232)
)
EXP2 = tuple(np.float32(c) for c in (1.0000036, 0.69296955, 0.24162132, 0.05171774, 0.01368398))
LN2, LOG2_E = np.float32(np.log(2.0)), np.float32(1.0 / np.log(2.0))


def confidence_of(disparity_px: Float32, match: Match, margin: Float32) -> Float32:
    """Confidence 0..1 of every disparity, 0 where it is NaN, (H, W) float32.

    Parameters
    ----------
    disparity_px : (H, W) float32, final disparities, NaN where unknown.
    match : the match they come from.
    margin : (H, W) float32, cost by which the second best order was worse.
    """
    confidence = np.empty(disparity_px.shape, dtype=np.float32)
    fill_confidence(disparity_px, match.mismatch_rad, margin, match.sigma_px, confidence)
    return confidence


@njit(parallel=True, fastmath=NAN_SAFE, error_model="numpy", cache=True)
def fill_confidence(disparity, mismatch, margin, sigma, confidence):  # type: ignore[no-untyped-def]
    """Fill ``confidence`` (H, W) with the logistic function of the weighted properties."""
    height, width = disparity.shape
    for band in prange((height + BAND_PX - 1) // BAND_PX):
        first = np.int64(band) * BAND_PX
        known = np.empty(width + 2 * KNOWN_REACH, dtype=np.float32)
        highest = np.empty(width + 2 * SPREAD_REACH, dtype=np.float32)
        lowest = np.empty(width + 2 * SPREAD_REACH, dtype=np.float32)
        start_known(disparity, first, known)
        for y in range(first, min(first + BAND_PX, height)):
            if y > first:
                change_known(disparity[mirrored(y + KNOWN_REACH, height)], np.float32(1.0), known)
            mirror_known(known)
            ends_of_columns(disparity, y, highest, lowest)
            line_of_confidence(disparity[y], mismatch[y], margin[y], sigma[y], known, highest, lowest, confidence[y])
            change_known(disparity[mirrored(y - KNOWN_REACH, height)], np.float32(-1.0), known)


@njit(fastmath=NAN_SAFE, error_model="numpy")
def start_known(disparity, y, known):  # type: ignore[no-untyped-def]
    """Fill ``known`` (W + 10,) with the disparities in the columns of the window about row y, mirrored at borders."""
    known[:] = np.float32(0.0)
    for down in range(-KNOWN_REACH, KNOWN_REACH + 1):
        change_known(disparity[mirrored(y + down, disparity.shape[0])], np.float32(1.0), known)


@njit(**LEAF)
def change_known(line, sign, known):  # type: ignore[no-untyped-def]
    """Add the known disparities of a row to those in the columns, or take them away."""
    middle = known[KNOWN_REACH:]
    for x in range(line.size):
        middle[x] += sign if line[x] == line[x] else np.float32(0.0)


@njit(fastmath=NAN_SAFE, error_model="numpy")
def mirror_known(known):  # type: ignore[no-untyped-def]
    """Mirror the columns at the outermost ones."""
    width = known.size - 2 * KNOWN_REACH
    middle = known[KNOWN_REACH : KNOWN_REACH + width]
    for beyond in range(1, KNOWN_REACH + 1):
        known[KNOWN_REACH - beyond] = middle[mirrored(-beyond, width)]
        known[KNOWN_REACH + width - 1 + beyond] = middle[mirrored(width - 1 + beyond, width)]


@njit(fastmath=NAN_SAFE, error_model="numpy")
def mirrored(at, size):  # type: ignore[no-untyped-def]
    """Index at 0..size - 1 of one at most a window beyond, mirrored at the outermost pixels."""
    if size == 1:
        return 0
    while at < 0 or at >= size:
        at = -at if at < 0 else 2 * (size - 1) - at
    return at


@njit(fastmath=NAN_SAFE, error_model="numpy")
def ends_of_columns(disparity, y, highest, lowest):  # type: ignore[no-untyped-def]
    """Fill the highest and lowest disparity in the columns of the window about row y, (W + 6,)."""
    width, last = disparity.shape[1], disparity.shape[0] - 1
    for beyond in range(SPREAD_REACH):
        highest[beyond] = highest[width + SPREAD_REACH + beyond] = -FAR_PX
        lowest[beyond] = lowest[width + SPREAD_REACH + beyond] = FAR_PX
    ends_of_rows(
        disparity[max(y - 3, 0)], disparity[max(y - 2, 0)], disparity[max(y - 1, 0)], disparity[y],
        disparity[min(y + 1, last)], disparity[min(y + 2, last)], disparity[min(y + 3, last)],
        highest[SPREAD_REACH:], lowest[SPREAD_REACH:],
    )  # fmt: skip
    for step in DOUBLING:
        for x in range(highest.size - step):
            highest[x] = max(highest[x], highest[x + step])
            lowest[x] = min(lowest[x], lowest[x + step])


@njit(**LEAF)
def ends_of_rows(a, b, c, d, e, f, g, highest, lowest):  # type: ignore[no-untyped-def]
    """Fill the highest and lowest of 2 ``SPREAD_REACH`` + 1 rows, NaN left out."""
    for x in range(a.size):
        high, low = -FAR_PX, FAR_PX
        for value in (a[x], b[x], c[x], d[x], e[x], f[x], g[x]):
            high = value if value > high else high
            low = value if value < low else low
        highest[x], lowest[x] = high, low


@njit(fastmath=NAN_SAFE, error_model="numpy")
def line_of_confidence(disparity, mismatch, margin, sigma, known, highest, lowest, confidence):  # type: ignore[no-untyped-def]
    """Fill a row of ``confidence`` from the ends of its windows and the columns of known pixels."""
    one, whole = np.float32(1.0), np.float32(1.0 / KNOWN_WINDOW_PX**2)
    for x in range(disparity.size):
        seen = known[x]
        for aside in range(1, KNOWN_WINDOW_PX):
            seen += known[x + aside]
        apart = mismatch[x] if mismatch[x] < LARGEST_MISMATCH_RAD else LARGEST_MISMATCH_RAD
        spread = highest[x] - lowest[x]
        spread = spread if spread < LARGEST_SPREAD_PX else LARGEST_SPREAD_PX
        spread = spread if spread > np.float32(0.0) else np.float32(0.0)
        doubt = WEIGHTS[0] + WEIGHTS[1] * LN2 * log2(apart + np.float32(0.02))
        doubt += WEIGHTS[2] * min(margin[x], LARGEST_MARGIN) + WEIGHTS[3] * (one - seen * whole)
        doubt += WEIGHTS[4] * LN2 * log2(spread + np.float32(0.1))
        doubt += WEIGHTS[5] * min(sigma[x] + np.float32(1e-4), one)
        sure = one / (one + exp2(doubt * LOG2_E))
        confidence[x] = sure if disparity[x] == disparity[x] else np.float32(0.0)


@njit(fastmath=NAN_SAFE, error_model="numpy")
def log2(value):  # type: ignore[no-untyped-def]
    """Logarithm of a positive float32 without branches: its exponent and a polynomial of its mantissa."""
    bits = np.float32(value).view(np.int32)
    part = np.int32((bits & np.int32(0x007FFFFF)) | np.int32(0x3F800000)).view(np.float32)
    result = LOG2[6]
    result = result * part + LOG2[5]
    result = result * part + LOG2[4]
    result = result * part + LOG2[3]
    result = result * part + LOG2[2]
    result = result * part + LOG2[1]
    result = result * part + LOG2[0]
    return result + np.float32(np.int32(bits >> np.int32(23)) - np.int32(127))


@njit(fastmath=NAN_SAFE, error_model="numpy")
def exp2(power):  # type: ignore[no-untyped-def]
    """2 to a float32 power between -126 and 126, without branches; NaN counts as the least."""
    power = power if power > np.float32(-126.0) else np.float32(-126.0)
    power = power if power < np.float32(126.0) else np.float32(126.0)
    whole = np.floor(power)
    part = power - whole
    result = EXP2[4]
    result = result * part + EXP2[3]
    result = result * part + EXP2[2]
    result = result * part + EXP2[1]
    result = result * part + EXP2[0]
    return result * np.int32((np.int32(whole) + np.int32(127)) << np.int32(23)).view(np.float32)
