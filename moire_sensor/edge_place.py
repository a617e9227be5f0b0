"""The points of a row, measured and put on their pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import EXACT
from moire_sensor.edge_points import depth_of, order_of, sigma_of
from moire_sensor.edge_spread import drop_loners
from moire_sensor.shot import UNKNOWN_ORDER, Status

OK = np.uint8(Status.OK)
UNKNOWN, NO_ORDER, ZERO, HALF = np.float32(np.nan), np.int16(UNKNOWN_ORDER), np.float32(0.0), np.float32(0.5)
# Mismatches are counted in shares of the largest.
BINS = 1024


@njit(error_model="numpy")
def place_rows(left, right, candidates, match, begin, behind, limits, lens, step_turns, grid, counts):  # type: ignore[no-untyped-def]
    """Put the points of some rows into the grid, all of them at a time: one row has too few to fill vectors."""
    # Taken out of the tuples once: numba counts references each time.
    partners, numbers, half_orders, left_number = match.partner, match.candidate, candidates.half_order, left.number
    left_x, left_sigma, right_x, right_sigma = left.x_px, left.sigma_px, right.x_px, right.sigma_px
    columns, status = candidates.left_x_px, grid.status
    depth, sigma, disparity, confidence = grid.depth_m, grid.depth_sigma_m, grid.disparity_px, grid.confidence
    order = grid.fringe_order
    most = (behind - begin) * partners.shape[1]
    whole, real = np.empty((4, most), dtype=np.int32), np.empty((4, most), dtype=np.float32)
    orders, found = np.empty(most, dtype=np.int16), np.uint64(0)
    forget(depth, sigma, disparity, confidence, order, begin, behind)
    for y in range(begin, behind):
        partner = partners[y, : left_number[y]]
        drop_loners(partner, numbers[y], half_orders[y], limits.min_run, whole[2], whole[3])
        found = list_matches(partner, y, found, whole[0], whole[1])
    measure_points(
        whole[0, :found], whole[1], partners, numbers, left_x, right_x, left_sigma, right_sigma, columns, half_orders,
        limits.off_px, lens, step_turns, status.shape[1], whole[2], whole[3], real[0], real[1], real[2], real[3],
        orders,
    )  # fmt: skip
    put(whole[2, :found], real[0], real[1], real[2], in_line(depth), in_line(sigma), in_line(disparity))
    put_trust(
        whole[2, :found], whole[3], real[3], orders, in_line(confidence), in_line(order), in_line(status), counts
    )


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


@njit
def list_matches(partner, y, found, row, edge):  # type: ignore[no-untyped-def]
    """Note the matched edges of row y behind the ``found`` ones; how many there are now.

    All are written down and the matched ones counted: there is no branch that the processor could guess wrong.
    """
    for i in range(np.uint64(partner.size)):
        row[found], edge[found] = y, i
        found += np.uint64(partner[i] >= 0)
    return found


@njit(**EXACT)
def measure_points(  # type: ignore[no-untyped-def]
    row, edge, partner, number, left_x, right_x, left_sigma, right_sigma, columns, half_order, off_px, lens, step_turns,
    width, pixel, share, depth, sigma, disparity, confidence, order,
):  # fmt: skip
    """Fill the pixel and the numbers of each matched edge; ``share`` is its mismatch of the largest."""
    for point in range(row.size):
        y, i = np.uint32(row[point]), np.uint32(edge[point])
        j, k = np.uint32(partner[y, i]), np.uint32(number[y, i])
        x = np.float64(left_x[y, i])
        apart = x - np.float64(right_x[y, j])
        off = abs(np.float64(columns[y, k, j]) - x) / off_px
        far = depth_of(apart, lens)
        pixel[point] = row[point] * width + np.int32(left_x[y, i] + HALF)
        disparity[point], depth[point] = apart, far
        sigma[point] = sigma_of(far, left_sigma[y, i], right_sigma[y, j], lens)
        confidence[point] = max(1.0 - off, 0.0)
        share[point] = np.int32(min(off * BINS, np.float64(BINS)))
        order[point] = order_of(half_order[y, j] + 2 * number[y, i], step_turns)


@njit
def put(pixel, depth, sigma, disparity, to_depth, to_sigma, to_disparity):  # type: ignore[no-untyped-def]
    """Put what the points measure on their pixels."""
    for point in range(pixel.size):
        x = np.uint64(pixel[point])
        to_depth[x], to_sigma[x], to_disparity[x] = depth[point], sigma[point], disparity[point]


@njit
def put_trust(pixel, share, confidence, order, to_confidence, to_order, status, counts):  # type: ignore[no-untyped-def]
    """Put the rest on the pixels of the points, and count the mismatches."""
    for point in range(pixel.size):
        x = np.uint64(pixel[point])
        to_confidence[x], to_order[x], status[x] = confidence[point], order[point], OK
        counts[np.uint64(share[point])] += 1
