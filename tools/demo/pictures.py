"""Pictures of one run: what the cameras saw, what came out, how far it is from the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from moire_sensor.shot import UNKNOWN_ORDER

# Both maps are safe for colour-blind readers; unknown pixels are grey.
DEPTH_MAP, ERROR_MAP, UNKNOWN_COLOUR = "cividis", "PuOr", "0.75"
POINT_STRIDE = 4
# A flat thing gets one colour, not the colours of its noise.
LEAST_RELIEF_M = 0.02
LEAST_AXIS_M = 0.15


@dataclass(frozen=True)
class View:
    """The images of one exposure, all (H, W), and the points (H, W, 3) in metres, left optical frame."""

    title: str
    left: npt.NDArray[Any]
    right: npt.NDArray[Any]
    fringe_order: npt.NDArray[np.int16]
    depth_m: npt.NDArray[np.float32]
    error_mm: npt.NDArray[np.floating[Any]]
    error_title: str
    error_limit_mm: float
    points_m: npt.NDArray[np.float32]


def draw_overview(view: View, path: Path) -> None:
    """Write one picture with six panels: left, right, fringe order, depth, error, 3-D view."""
    figure = Figure(figsize=(16, 8), layout="constrained")
    figure.suptitle(f"{view.title}   (grey: unknown)", fontsize=14)
    axes = figure.subplots(2, 3)
    order = np.where(view.fringe_order == UNKNOWN_ORDER, np.nan, view.fringe_order.astype(np.float32))
    draw_image(axes[0, 0], view.left, "left camera", "grey level", "gray", (0, saturation(view.left)))
    draw_image(axes[0, 1], view.right, "right camera", "grey level", "gray", (0, saturation(view.right)))
    draw_image(axes[0, 2], order, "fringe order", "projector period (number)", "viridis", span(order, 0))
    draw_image(axes[1, 0], view.depth_m, "depth", "z (m)", DEPTH_MAP, span(view.depth_m, 0.5, LEAST_RELIEF_M))
    limits = (-view.error_limit_mm, view.error_limit_mm)
    draw_image(axes[1, 1], view.error_mm, view.error_title, "mm", ERROR_MAP, limits)
    draw_points(figure, axes[1, 2], view.points_m)
    figure.savefig(path, dpi=90)


def draw_image(
    axes: Any, values: npt.NDArray[Any], title: str, unit: str, colours: str, limits: tuple[float, float]
) -> None:
    """Draw one image with its colour bar; NaN in grey."""
    colour_map = mpl.colormaps[colours].with_extremes(bad=UNKNOWN_COLOUR)
    drawn = axes.imshow(values, cmap=colour_map, vmin=limits[0], vmax=limits[1], interpolation="nearest")
    axes.set(title=title, xlabel="column (px)", ylabel="row (px)")
    axes.figure.colorbar(drawn, ax=axes, label=unit, shrink=0.85)


def draw_points(figure: Figure, place: Any, points_m: npt.NDArray[np.float32]) -> None:
    """Draw the points from the upper right in place of an empty panel, coloured by depth."""
    axes: Any = figure.add_subplot(place.get_subplotspec(), projection="3d")
    place.remove()
    grid = points_m[::POINT_STRIDE, ::POINT_STRIDE].reshape(-1, 3)
    near, far = span(grid[:, 2], 0.5, LEAST_RELIEF_M)
    shown = grid[(grid[:, 2] >= near) & (grid[:, 2] <= far)]
    if len(shown):
        x, y, z = shown.T
        axes.scatter(x, z, -y, c=z, s=1.5, cmap=DEPTH_MAP, vmin=near, vmax=far, linewidths=0, depthshade=False)
        limits = [span(values, 0.0, LEAST_AXIS_M) for values in (x, z, -y)]
        axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
        axes.set_box_aspect([high - low for low, high in limits])
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    axes.set(title="3-D view", xlabel="x (m)", ylabel="z (m)", zlabel="-y (m)")
    axes.view_init(elev=22, azim=-62)


def span(values: npt.NDArray[Any], percent: float, least: float = 0.0) -> tuple[float, float]:
    """Lower and upper limit of the known values, without ``percent`` at each end, ``least`` apart or more."""
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = np.percentile(known, [percent, 100 - percent])
    spare = max(0.0, least - (high - low)) / 2
    return float(low - spare), float(high + spare)


def saturation(image: npt.NDArray[Any]) -> float:
    """Largest grey level of an integer image's type."""
    return float(np.iinfo(image.dtype).max)
