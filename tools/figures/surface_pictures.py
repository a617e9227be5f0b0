"""Pictures of the methods side by side: what the cameras saw, depth, error, cloud."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from moire_sensor.rig import StereoRig
from tools.figures.drawing import DEPTH_MAP, ERROR_MAP, draw_cloud, draw_panel
from tools.small_png import save

# Points of the sparse method are drawn this wide, or nothing would be seen of them.
POINT_PX = 5
STRIDE = 2


@dataclass(frozen=True, eq=False)
class Column:
    """One method's images (H, W): depth in metres, error in millimetres; NaN where unknown."""

    title: str
    depth_m: npt.NDArray[Any]
    error_mm: npt.NDArray[Any]
    sparse: bool


@dataclass(frozen=True, eq=False)
class Sheet:
    """A picture: left and right camera, truth or None, and the methods."""

    left: npt.NDArray[Any]
    right: npt.NDArray[Any]
    truth_m: npt.NDArray[Any] | None
    columns: Sequence[Column]
    rig: StereoRig
    limits_m: tuple[float, float]
    error_limit_mm: float
    error_title: str


def draw_sheet(sheet: Sheet, path: Path) -> None:
    """Write the picture: methods from left to right, a first column for the cameras and the truth."""
    count = len(sheet.columns) + 1
    figure = Figure(figsize=(3.3 * count, 8.4), layout="constrained")
    axes = figure.subplots(3, count)
    grey = (0.0, float(np.percentile(sheet.left, 99.5)))
    draw_panel(axes[0, 0], sheet.left, "left camera", grey)
    draw_panel(axes[1, 0], sheet.right, "right camera", grey)
    if sheet.truth_m is None:
        axes[2, 0].set_axis_off()
    else:
        points = sheet.rig.points(sheet.truth_m)
        draw_cloud(figure, axes[2, 0], points, "truth", sheet.limits_m)
    for number, column in enumerate(sheet.columns, start=1):
        draw_column(figure, axes[:, number], column, sheet)
    depth_bar = axes[0, -1].images[0]
    figure.colorbar(depth_bar, ax=axes[0, :], label="depth z (m)", shrink=0.9, aspect=12)
    figure.colorbar(axes[1, -1].images[0], ax=axes[1, :], label=f"{sheet.error_title} (mm)", shrink=0.9, aspect=12)
    save(figure, path)


def draw_column(figure: Figure, axes: Any, column: Column, sheet: Sheet) -> None:
    """Depth, error and cloud of one method."""
    depth, error = column.depth_m, column.error_mm
    if column.sparse:
        depth, error = widened(depth), widened(error)
    draw_panel(axes[0], shown(depth), f"{column.title}: depth", sheet.limits_m, DEPTH_MAP)
    limit = sheet.error_limit_mm
    draw_panel(axes[1], shown(error), sheet.error_title, (-limit, limit), ERROR_MAP)
    for place in axes[:2]:
        height, width = column.depth_m.shape
        place.images[0].set_extent((-0.5, width - 0.5, height - 0.5, -0.5))
    draw_cloud(figure, axes[2], sheet.rig.points(column.depth_m), "3-D view", sheet.limits_m)


def shown(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Every second row and column: panels have fewer pixels than images."""
    return image[::STRIDE, ::STRIDE]


def widened(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Spread the known pixels of a row over ``POINT_PX`` columns; for drawing only."""
    # Far below any value: the larger of two neighbours wins, unknown never does.
    lowest = np.float32(-1e9)
    spread = cv2.dilate(
        np.where(np.isfinite(image), image, lowest).astype(np.float32), np.ones((1, POINT_PX), np.uint8)
    )
    return np.where(spread > lowest / 2, spread, np.nan)
