"""The points of a row, measured and put on their pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import Apart
from moire_sensor.edge_lanes import lane_rows
from moire_sensor.edge_points import depth_of, order_of, sigma_of
from moire_sensor.edge_spread import drop_loners
from moire_sensor.shot import UNKNOWN_ORDER, Status

OK = np.uint8(Status.OK)
UNKNOWN, NO_ORDER, ZERO, HALF = np.float32(np.nan), np.int16(UNKNOWN_ORDER), np.float32(0.0), np.float32(0.5)
# Mismatches are counted in shares of the largest.
BINS = 1024


@njit(error_model="numpy")
def place_lane(left, right, candidates, match, min_run, limits, lens, step_turns, grid, counts, lane):  # type: ignore[no-untyped-def]
    """Put the points of a lane's rows into the grid."""
    # Taken out of the tuples once: numba counts references each time.
    left_x, left_sigma, left_number, partners = left.x_px, left.sigma_px, left.number, match.partner
    right_x, right_sigma, numbers = right.x_px, right.sigma_px, match.candidate
    columns, half_orders = candidates.left_x_px, candidates.half_order
    depth, sigma, disparity, confidence = grid.depth_m, grid.depth_sigma_m, grid.disparity_px, grid.confidence
    order, status = grid.fringe_order, grid.status
    rows, most = lane_rows(lane, status.shape[0]), partners.shape[1]
    whole, real = np.empty((3, most), dtype=np.int32), np.empty((4, most), dtype=np.float32)
    orders, edges = np.empty(most, dtype=np.int16), whole[0]
    forget(depth, sigma, disparity, confidence, order, *rows)
    for y in range(*rows):
        partner, number = partners[y, : left_number[y]], numbers[y]
        drop_loners(partner, number, half_orders[y], min_run, edges)
        found = list_matches(partner, edges)
        measure_points(
            edges[:found], partner, number, left_x[y], right_x[y], left_sigma[y], right_sigma[y], columns[y],
            half_orders[y], limits.off_px, lens, step_turns, whole[1], whole[2], real[0], real[1], real[2], real[3],
            orders,
        )  # fmt: skip
        put(whole[1, :found], real[0], real[1], real[2], depth[y], sigma[y], disparity[y])
        put_trust(whole[1, :found], whole[2], real[3], orders, confidence[y], order[y], status[y], counts)


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
    pixels = rows.reshape(rows.size)
    for place in range(pixels.size):
        pixels[place] = value


@njit
def list_matches(partner, edges):  # type: ignore[no-untyped-def]
    """Numbers of the matched edges, and how many there are. All are written down and the matched ones counted."""
    found = np.uint64(0)
    for i in range(np.uint64(partner.size)):
        edges[found] = i
        found += np.uint64(partner[i] >= 0)
    return np.int64(found)


@njit(error_model="numpy", pipeline_class=Apart)
def measure_points(  # type: ignore[no-untyped-def]
    edges, partner, number, left_x, right_x, left_sigma, right_sigma, columns, half_order, off_px, lens, step_turns,
    pixel, share, depth, sigma, disparity, confidence, order,
):  # fmt: skip
    """Fill the pixel and the numbers of each matched edge of a row; ``share`` is its mismatch of the largest."""
    for point in range(edges.size):
        i = edges[point]
        j, x = partner[i], np.float64(left_x[i])
        apart = x - np.float64(right_x[j])
        off = abs(np.float64(columns[number[i], j]) - x) / off_px
        far = depth_of(apart, lens)
        pixel[point] = np.int32(left_x[i] + HALF)
        disparity[point], depth[point] = apart, far
        sigma[point] = sigma_of(far, left_sigma[i], right_sigma[j], lens)
        confidence[point] = max(1.0 - off, 0.0)
        share[point] = np.int32(min(off * BINS, np.float64(BINS)))
        order[point] = order_of(half_order[j] + 2 * number[i], step_turns)


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
