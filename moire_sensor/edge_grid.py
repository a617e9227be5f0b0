"""Matched fringe edges on the pixel grid of the left image."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.edge_find import EdgeRows, Float32
from moire_sensor.edge_points import EdgePoints
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.rig import Array
from moire_sensor.shot import UNKNOWN_ORDER, Shot, Status


def on_left_grid(
    points: EdgePoints,
    picture: Float32,
    edges: EdgeRows,
    period_px: float,
    settings: EdgeSettings,
) -> Shot:
    """Put each point on the left pixel nearest to it; fringes are about ``period_px`` wide."""
    at = (points.row, nearest_pixel(points.left_x_px))
    order = np.full(picture.shape, UNKNOWN_ORDER, dtype=np.int16)
    order[at] = points.fringe_order
    window = (2 * round(0.5 * period_px) + 1, 1)
    status = edge_status(picture, edges, window, settings)
    status[at] = Status.OK

    def placed(values: Array, empty: float) -> Float32:
        image = np.full(picture.shape, empty, dtype=np.float32)
        image[at] = values
        return image

    return Shot(
        depth_m=placed(points.depth_m, np.nan),
        depth_sigma_m=placed(points.depth_sigma_m, np.nan),
        disparity_px=placed(points.disparity_px, np.nan),
        fringe_order=order,
        confidence=placed(1.0 - points.mismatch_px / (settings.same_side_periods * period_px), 0.0),
        status=status,
        background=np.asarray(cv2.blur(picture, window), dtype=np.float32),
        typical_mismatch_rad=2.0 * np.pi / period_px * upper_quartile(points.mismatch_px),
    )


def upper_quartile(values: Array) -> float:
    """Upper quartile of values (N,); NaN of none."""
    return float(np.percentile(values, 75.0)) if values.size else float("nan")


def nearest_pixel(x_px: npt.NDArray[np.floating]) -> npt.NDArray[np.int64]:
    """Column of the pixel whose centre is nearest to x (any shape)."""
    return np.asarray(np.floor(x_px + 0.5), dtype=np.int64)


def edge_status(
    picture: Float32, edges: EdgeRows, window: tuple[int, int], settings: EdgeSettings
) -> npt.NDArray[np.uint8]:
    """Status (H, W) as it would be without any match."""
    kernel = np.ones(window[::-1], dtype=np.uint8)
    contrast = cv2.dilate(picture, kernel) - cv2.erode(picture, kernel)
    status = np.where(contrast < 2.0 * settings.min_amplitude, Status.UNLIT, Status.AMBIGUOUS).astype(np.uint8)
    row, number = np.nonzero(edges.side)
    status[row, nearest_pixel(edges.x_px[row, number])] = Status.OCCLUDED
    status[picture >= 255.0] = Status.SATURATED
    return status
