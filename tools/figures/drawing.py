"""Drawing that the figures share: colour-blind-safe maps, a unit on every axis, small files."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tools.demo.pictures import DEPTH_MAP, ERROR_MAP, LEAST_AXIS_M, UNKNOWN_COLOUR, span

__all__ = ["BLUE", "DEPTH_MAP", "ERROR_MAP", "GREEN", "GREY", "ORANGE", "PURPLE", "draw_cloud", "draw_panel"]

# Okabe and Ito's colours, told apart by colour-blind readers.
BLUE, ORANGE, GREEN, PURPLE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "0.45"
CLOUD_POINTS = 12000


def draw_panel(
    axes: Any,
    values: npt.NDArray[Any],
    title: str,
    limits: tuple[float, float],
    colours: str = "gray",
    unit: str | None = None,
) -> None:
    """Draw an image (H, W), NaN in grey, with a colour bar where a unit is given."""
    colour_map = mpl.colormaps[colours].with_extremes(bad=UNKNOWN_COLOUR)
    drawn = axes.imshow(values, cmap=colour_map, vmin=limits[0], vmax=limits[1], interpolation="nearest")
    axes.set(xlabel="column (px)", ylabel="row (px)")
    axes.set_title(title, fontsize=10)
    if unit:
        axes.figure.colorbar(drawn, ax=axes, label=unit, shrink=0.8)


def draw_cloud(
    figure: Figure, place: Any, points_m: npt.NDArray[Any], title: str, depth_limits_m: tuple[float, float]
) -> None:
    """Draw points (..., 3) in place of an empty panel, at most ``CLOUD_POINTS`` of them, coloured by depth."""
    axes: Any = figure.add_subplot(place.get_subplotspec(), projection="3d")
    place.remove()
    points = points_m.reshape(-1, 3)
    points = points[(points[:, 2] >= depth_limits_m[0]) & (points[:, 2] <= depth_limits_m[1])]
    chosen = np.random.default_rng(0).permutation(len(points))[:CLOUD_POINTS]
    if len(chosen):
        x, y, z = points[chosen].T
        near, far = depth_limits_m
        axes.scatter(x, z, -y, c=z, s=1.2, cmap=DEPTH_MAP, vmin=near, vmax=far, linewidths=0, depthshade=False)
        limits = [span(x, 0.0, LEAST_AXIS_M), depth_limits_m, span(-y, 0.0, LEAST_AXIS_M)]
        axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
        axes.set_box_aspect([high - low for low, high in limits], zoom=0.85)
    else:
        axes.text2D(0.5, 0.5, "all points lie outside", transform=axes.transAxes, ha="center")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(3))
        axis.set_tick_params(labelsize=7)
    axes.set_title(title, fontsize=10)
    axes.set(xlabel="x (m)", ylabel="z (m)", zlabel="-y (m)")
    axes.view_init(elev=28, azim=-62)
