"""Steps of the least squares of both phases for a few pixels of one row: every step is a loop without a branch.

Disparities and phases of the projector are counted from the carrier's, where float32 tells them best. At D pixels from
the middle disparity a pixel shows the carrier's phase and S D / (1 + G D), as equation (11) is a ratio of two
straight lines; S and G follow from the matrices. A lens is looked up in its tables.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import wrap
from moire_sensor.apart import LEAF
from moire_sensor.projector_map import PLAIN, disparity_of_phase, phase_of_disparity

# Right phases that differ more between neighbours lie on either side of an edge.
EDGE_RAD = np.float32(0.5)
NAN, ZERO, HALF, ONE = np.float32(np.nan), np.float32(0.0), np.float32(0.5), np.float32(1.0)
LEAST_VARIANCE = np.float32(1e-10)


@njit(**LEAF)
def solve(  # type: ignore[no-untyped-def]
    map_, y, middle, seen, speed, far_sigma, misaligned, common, column, phase, noise, carrier, slope, steep, bent,
    expected, found, apart, spread,
):  # fmt: skip
    """Least squares of a few pixels: fill where they are found, how far apart the phases lie, and variances."""
    a2, g2 = misaligned * misaligned, common * common
    lens = map_.shape[0] > PLAIN
    if lens:
        place_lens(map_, y, middle, column, carrier, phase, found, slope)
    else:
        lines(map_, y, middle, column, steep, bent)
        place(phase, steep, bent, found, slope)
    meet(seen, speed, far_sigma, column, middle, phase, carrier, noise, phase, slope, a2, g2, found, apart, spread)
    if lens:
        expect_lens(map_, y, middle, column, carrier, found, expected, slope)
    else:
        expect(found, steep, bent, expected, slope)
    meet(seen, speed, far_sigma, column, middle, phase, carrier, noise, expected, slope, a2, g2, found, steep, spread)


@njit(**LEAF)
def speeds(offset, carrier_rad, seen, speed):  # type: ignore[no-untyped-def]
    """Fill the right phases, and how much each lies before that of the next pixel: the carrier's alone at an edge."""
    for x in range(offset.size):
        seen[x] = carrier_rad[x] + offset[x]
    speed[speed.size - 1] = NAN
    for x in range(offset.size - 1):
        turn = wrap(offset[x + 1] - offset[x])
        speed[x] = carrier_rad[x + 1] - carrier_rad[x] + (turn if abs(turn) <= EDGE_RAD else ZERO)


@njit(**LEAF)
def lines(map_, y, middle, column, steep, bent):  # type: ignore[no-untyped-def]
    """Fill S and G of the pixels."""
    above, above_x = np.float32(map_[0] + map_[2] * y + map_[3] * middle), np.float32(map_[1])
    below, below_x = np.float32(map_[4] + map_[6] * y + map_[7] * middle), np.float32(map_[5])
    above_d, below_d, rad_per_column = np.float32(map_[3]), np.float32(map_[7]), np.float32(map_[8])
    for n in range(column.size):
        down = ONE / (below + below_x * column[n])
        device = (above + above_x * column[n]) * down
        steep[n] = rad_per_column * (above_d - device * below_d) * down
        bent[n] = below_d * down


@njit(**LEAF)
def place(phase, steep, bent, found, slope):  # type: ignore[no-untyped-def]
    """Fill where the pixels' own phases lie on the projector's, and the derivative of its phase there."""
    for n in range(phase.size):
        found[n] = phase[n] / (steep[n] - bent[n] * phase[n])
        down = ONE / (ONE + bent[n] * found[n])
        slope[n] = steep[n] * down * down


@njit(**LEAF)
def expect(found, steep, bent, expected, slope):  # type: ignore[no-untyped-def]
    """Fill the projector's phase from the carrier's on, and its derivative."""
    for n in range(found.size):
        down = ONE / (ONE + bent[n] * found[n])
        expected[n] = steep[n] * found[n] * down
        slope[n] = steep[n] * down * down


@njit(**LEAF)
def place_lens(map_, y, middle, column, carrier, phase, found, slope):  # type: ignore[no-untyped-def]
    """The same as :func:`place` through a lens."""
    for n in range(column.size):
        exact = disparity_of_phase(map_, column[n], y, carrier[n] + phase[n])
        found[n] = np.float32(exact - middle)
        slope[n] = np.float32(phase_of_disparity(map_, column[n], y, exact)[1])


@njit(**LEAF)
def expect_lens(map_, y, middle, column, carrier, found, expected, slope):  # type: ignore[no-untyped-def]
    """The same as :func:`expect` through a lens."""
    for n in range(column.size):
        exact, along = phase_of_disparity(map_, column[n], y, middle + found[n])
        expected[n], slope[n] = np.float32(exact - carrier[n]), np.float32(along)


@njit(**LEAF)
def meet(  # type: ignore[no-untyped-def]
    seen, speed, sigma, column, middle, phase, carrier, noise, expected, slope, a2, g2, found, apart, spread
):
    """Move the disparities by one step of the least squares, and fill their variances by noise.

    ``apart`` takes by how much the phase expected there lies before the right one, folded; NaN where the right image
    does not reach. Of the right row that side of an edge counts which is nearer. The inverse covariance, but for its
    determinant, is [[w1, -g^2], [-g^2, w2]].
    """
    last = np.float32(seen.size - 1)
    for n in range(found.size):
        at = column[n] - middle - found[n]
        inside = at if at > ZERO else ZERO
        inside = inside if inside < last else last
        nearest = np.uint32(np.int32(inside + HALF))
        before = np.uint32(np.int32(inside if inside < last - ONE else last - ONE))
        along, far_noise = speed[before], sigma[nearest]
        reached = seen[nearest] + (at - np.float32(np.int32(nearest))) * along
        ahead = wrap(carrier[n] + expected[n] - reached)
        apart[n] = ahead if (at >= -HALF) & (at <= last + HALF) else NAN
        v1 = noise[n] * noise[n] + LEAST_VARIANCE
        v2 = far_noise * far_noise + LEAST_VARIANCE
        slope1, slope2 = slope[n], slope[n] + along
        gain1 = (v2 + a2 + g2) * slope1 - g2 * slope2
        gain2 = (v1 + g2) * slope2 - g2 * slope1
        norm = ONE / (gain1 * slope1 + gain2 * slope2)
        found[n] += (gain1 * (phase[n] - expected[n]) - gain2 * ahead) * norm
        spread[n] = (gain1 * gain1 * v1 + gain2 * gain2 * v2) * (norm * norm)
