"""The points of a row, measured and put on their pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import EXACT, UNCOUNTED
from moire_sensor.edge_lanes import TOGETHER, vectors_of
from moire_sensor.edge_points import depth_of, order_of, sigma_of
from moire_sensor.edge_spread import drop_loners
from moire_sensor.shot import UNKNOWN_ORDER, Status

OK = np.uint8(Status.OK)
UNKNOWN, NO_ORDER, ZERO, HALF = np.float32(np.nan), np.int16(UNKNOWN_ORDER), np.float32(0.0), np.float32(0.5)
# Mismatches are counted in shares of the largest.
BINS = 1024


@njit(error_model="numpy")
def place_rows(left, right, candidates, match, begin, behind, limits, lens, step_turns, grid, counts):  # type: ignore[no-untyped-def]
    """Put the points of some rows into the grid."""
    # Taken out of the tuples once: numba counts references each time.
    partners, numbers, half_orders, left_number = match.partner, match.candidate, candidates.half_order, left.number
    left_x, left_sigma, right_x, right_sigma = left.x_px, left.sigma_px, right.x_px, right.sigma_px
    columns, status = candidates.left_x_px, grid.status
    depth, sigma, disparity, confidence = grid.depth_m, grid.depth_sigma_m, grid.disparity_px, grid.confidence
    order = grid.fringe_order
    most = partners.shape[1]
    whole, real, orders = np.empty((2, most), np.int32), np.empty((4, most), np.float32), np.empty(most, np.int16)
    forget(depth, sigma, disparity, confidence, order, begin, behind)
    for y in range(begin, behind):
        n = left_number[y]
        drop_loners(partners[y, :n], numbers[y], half_orders[y], limits.min_run, whole[0], whole[1])
        place_row(
            partners[y, :n], partners[y], numbers[y], left_x[y], right_x[y], left_sigma[y], right_sigma[y], columns[y],
            half_orders[y], limits.off_px, lens, step_turns, whole, real, orders, depth[y], sigma[y], disparity[y],
            confidence[y], order[y], status[y], counts,
        )  # fmt: skip


@njit(**UNCOUNTED)
def place_row(  # type: ignore[no-untyped-def]
    matched, partner, number, left_x, right_x, left_sigma, right_sigma, columns, half_order, off_px, lens, step_turns,
    whole, real, orders, depth, sigma, disparity, confidence, order, status, counts,
):  # fmt: skip
    """Put the points of a row into the rows of the grid; ``matched`` is the part of ``partner`` that has edges."""
    measure_points(
        partner, number, left_x, right_x, left_sigma, right_sigma, columns, half_order, off_px, lens, step_turns,
        vectors_of(matched.size), whole[0], whole[1], real[0], real[1], real[2], real[3], orders,
    )  # fmt: skip
    put(matched, whole[0], real[0], real[1], real[2], depth, sigma, disparity)
    put_trust(matched, whole[0], whole[1], real[3], orders, confidence, order, status, counts)


@njit(inline="always")
def in_line(image):  # type: ignore[no-untyped-def]
    """All numbers of an array, one behind the other."""
    return image.reshape(image.size)


@njit
def forget(depth, sigma, disparity, confidence, order, first, behind):  # type: ignore[no-untyped-def]
    """Rows without any point."""
    for image in (depth, sigma, disparity):
        fill(image[first:behind], UNKNOWN)
    fill(confidence[first:behind], ZERO)
    fill(order[first:behind], NO_ORDER)


@njit
def fill(rows, value):  # type: ignore[no-untyped-def]
    """Set all pixels of some rows."""
    pixels = in_line(rows)
    for place in range(pixels.size):
        pixels[place] = value


@njit(**EXACT)
def measure_points(  # type: ignore[no-untyped-def]
    partner, number, left_x, right_x, left_sigma, right_sigma, columns, half_order, off_px, lens, step_turns, vectors,
    pixel, share, depth, sigma, disparity, confidence, order,
):  # fmt: skip
    """Fill the pixel and the numbers of each edge, which mean something where it is matched; ``share`` is its mismatch
    of the largest. Whole vectors of edges: the row has room for them, and no partners there."""
    for vector in range(vectors):
        for lane in range(TOGETHER):
            i = np.uint64(TOGETHER * vector + lane)
            known = partner[i] >= 0
            j, k = np.uint32(partner[i] if known else 0), np.uint32(number[i] if known else 0)
            x = np.float64(left_x[i])
            apart = x - np.float64(right_x[j])
            off = abs(np.float64(columns[k, j]) - x) / off_px
            far = depth_of(apart, lens)
            pixel[i] = np.int32(left_x[i] + HALF)
            disparity[i], depth[i] = apart, far
            sigma[i] = sigma_of(far, left_sigma[i], right_sigma[j], lens)
            confidence[i] = max(1.0 - off, 0.0)
            share[i] = np.int32(min(off * BINS, np.float64(BINS)))
            order[i] = order_of(half_order[j] + 2 * number[i], step_turns)


@njit(**UNCOUNTED)
def put(partner, pixel, depth, sigma, disparity, to_depth, to_sigma, to_disparity):  # type: ignore[no-untyped-def]
    """Put what the points of a row measure on their pixels."""
    for i in range(np.uint64(partner.size)):
        if partner[i] >= 0:
            x = np.uint64(pixel[i])
            to_depth[x], to_sigma[x], to_disparity[x] = depth[i], sigma[i], disparity[i]


@njit(**UNCOUNTED)
def put_trust(partner, pixel, share, confidence, order, to_confidence, to_order, status, counts):  # type: ignore[no-untyped-def]
    """Put the rest on the pixels of the points, and count the mismatches."""
    for i in range(np.uint64(partner.size)):
        if partner[i] >= 0:
            x = np.uint64(pixel[i])
            to_confidence[x], to_order[x], status[x] = confidence[i], order[i], OK
            counts[np.uint64(share[i])] += 1
