"""Matched fringe edges on the pixel grid of the left image."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit, prange

from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_noise import Grey
from moire_sensor.edge_points import EdgePoints
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.rig import Array
from moire_sensor.shot import UNKNOWN_ORDER, Shot, Status

OK, UNLIT, SATURATED = np.uint8(Status.OK), np.uint8(Status.UNLIT), np.uint8(Status.SATURATED)
OCCLUDED, AMBIGUOUS = np.uint8(Status.OCCLUDED), np.uint8(Status.AMBIGUOUS)


def on_left_grid(
    points: EdgePoints,
    image: Grey,
    saturation_level: float,
    edges: EdgeRows,
    period_px: float,
    settings: EdgeSettings,
) -> Shot:
    """Put each point on the left pixel nearest to it; fringes are about ``period_px`` wide."""
    shape = image.shape
    depth, sigma, disparity, confidence = (np.empty(shape, dtype=np.float32) for _ in range(4))
    order, status = np.empty(shape, dtype=np.int16), np.empty(shape, dtype=np.uint8)
    window = (2 * round(0.5 * period_px) + 1, 1)
    kernel = np.ones(window[::-1], dtype=np.uint8)
    scale = 255.0 / saturation_level
    background = np.asarray(cv2.boxFilter(image, cv2.CV_32F, window), dtype=np.float32)
    if scale != 1.0:
        background *= np.float32(scale)
    first = np.searchsorted(points.row, np.arange(shape[0] + 1))
    unlit_below = 2.0 * settings.min_amplitude / scale
    fill_status(
        image, cv2.dilate(image, kernel), cv2.erode(image, kernel), unlit_below, saturation_level, edges, status
    )
    off_px = settings.same_side_periods * period_px
    place_points(
        points, points.disparity_px, first, off_px, UNKNOWN_ORDER, depth, sigma, disparity, confidence, order, status
    )
    typical_rad = 2.0 * np.pi / period_px * upper_quartile(points.mismatch_px)
    return Shot(depth, sigma, disparity, order, confidence, status, background, typical_rad)


def upper_quartile(values: Array) -> float:
    """Upper quartile of values (N,); NaN of none."""
    return float(np.percentile(values, 75.0)) if values.size else float("nan")


@njit(parallel=True, cache=True)
def fill_status(image, brightest, darkest, unlit_below, saturated, edges, status):  # type: ignore[no-untyped-def]
    """Status (H, W) as it would be without any match."""
    for row in prange(image.shape[0]):
        y = np.int64(row)
        for x in range(image.shape[1]):
            contrast = np.float32(brightest[y, x]) - np.float32(darkest[y, x])
            status[y, x] = UNLIT if contrast < unlit_below else AMBIGUOUS
        for number in range(edges.number[y]):
            status[y, np.int64(edges.x_px[y, number] + 0.5)] = OCCLUDED
        for x in range(image.shape[1]):
            status[y, x] = SATURATED if image[y, x] >= saturated else status[y, x]


@njit(parallel=True, cache=True)
def place_points(  # type: ignore[no-untyped-def]
    points, disparities, first, off_px, unknown_order, depth, sigma, disparity, confidence, order, status
):
    """Fill all images but the background; the points of row y are those from ``first[y]``."""
    for row in prange(depth.shape[0]):
        y = np.int64(row)
        depth[y], sigma[y], disparity[y] = np.nan, np.nan, np.nan
        confidence[y], order[y] = 0.0, unknown_order
        for number in range(first[y], first[y + 1]):
            x = np.int64(points.left_x_px[number] + 0.5)
            depth[y, x], sigma[y, x] = points.depth_m[number], points.depth_sigma_m[number]
            disparity[y, x] = disparities[number]
            confidence[y, x] = max(1.0 - points.mismatch_px[number] / off_px, 0.0)
            order[y, x], status[y, x] = points.fringe_order[number], OK
