"""Draw the stages of one exposure: docs/images/method/*.png."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from tools.docs.stages import Stages
from tools.figures.drawing import DEPTH_MAP, ERROR_MAP, ORANGE, draw_panel
from tools.small_png import save

ERROR_LIMIT_MM = 2.0
FULL_COST = 1.0


def draw_stages(stages: Stages, folder: Path) -> None:
    """Write one picture a stage."""
    for name, draw in PICTURES.items():
        figure = Figure(figsize=SIZES.get(name, (10.0, 4.0)), layout="constrained")
        draw(figure, stages)
        save(figure, folder / f"{name}.png")


def draw_fringes(figure: Figure, stages: Stages) -> None:
    """Both pictures, and the grey levels along a row."""
    views, section = figure.subplots(2, 1, height_ratios=(3, 1.3)), figure.axes[1]
    places = views[0].get_subplotspec().subgridspec(1, 2)
    views[0].remove()
    for number, (side, image) in enumerate((("left", stages.capture.left), ("right", stages.capture.right))):
        axes = figure.add_subplot(places[number])
        draw_panel(axes, image, f"{side} camera", (0.0, 255.0))
        axes.axhline(stages.row, color=ORANGE, linewidth=1.0)
    section.plot(stages.capture.left[stages.row], color="0.1", linewidth=0.8, label="left")
    section.plot(stages.capture.right[stages.row], color=ORANGE, linewidth=0.8, label="right")
    section.set(xlim=(0, stages.capture.left.shape[1] - 1), xlabel="column (px)", ylabel="grey level")
    section.set_title(f"row {stages.row}", fontsize=10)
    section.legend(loc="upper left", ncols=2, fontsize=8)


def draw_phase(figure: Figure, stages: Stages) -> None:
    """Wrapped phase and amplitude."""
    phase, amplitude = figure.subplots(1, 2)
    draw_panel(phase, stages.phase_rad, "phase, wrapped", (-np.pi, np.pi), "twilight", "rad")
    draw_panel(amplitude, stages.amplitude, "fringe amplitude", (0.0, 100.0), "cividis", "grey levels of 255")


def draw_candidates(figure: Figure, stages: Stages) -> None:
    """Depth of every candidate along a row, by its cost, with the truth."""
    axes: Any = figure.subplots()
    depth, cost = stages.depth_of_label_m, stages.cost[stages.row]
    columns = np.broadcast_to(np.arange(depth.shape[1]), depth.shape)
    axes.plot(stages.capture.depth_m[stages.row], color=ORANGE, linewidth=5.0, alpha=0.45, label="truth", zorder=1)
    shades = {"cmap": "Greys_r", "vmin": 0.0, "vmax": FULL_COST}
    drawn = axes.scatter(columns, depth, c=cost, s=3.0, linewidths=0, zorder=2, **shades)
    axes.set(xlim=(0, depth.shape[1] - 1), ylim=(2.0, 0.5), xlabel="column (px)", ylabel="depth z (m)")
    axes.set_title(f"candidates of row {stages.row}: black where the right camera agrees", fontsize=10)
    axes.legend(loc="lower right")
    figure.colorbar(drawn, ax=axes, label="cost (full mismatches)", shrink=0.8)


def draw_orders(figure: Figure, stages: Stages) -> None:
    """Cheapest candidate of each pixel by itself, and after the neighbours had their say."""
    limits = (-0.5, stages.cost.shape[1] - 0.5)
    panels = figure.subplots(1, 2)
    for axes, image, title in zip(
        panels, (stages.alone, stages.agreed), ("each pixel by itself", "agreed with its neighbours"), strict=True
    ):
        draw_panel(axes, image, title, limits, "viridis")
    figure.colorbar(panels[1].images[0], ax=panels, label="candidate, 0 the nearest", shrink=0.8)


def draw_errors(figure: Figure, stages: Stages) -> None:
    """Depth error of phases alone and of the result."""
    limits = (-ERROR_LIMIT_MM, ERROR_LIMIT_MM)
    panels = figure.subplots(1, 2)
    for axes, depth, title in zip(
        panels, (stages.by_phases_m, stages.shot.depth_m), ("by phases", "after grey levels and borders"), strict=True
    ):
        error = error_mm(stages, depth)
        draw_panel(axes, error, f"{title}: median {np.nanmedian(np.abs(error)):.2f} mm", limits, ERROR_MAP)
    figure.colorbar(panels[1].images[0], ax=panels, label="depth minus truth (mm)", shrink=0.8)


def draw_result(figure: Figure, stages: Stages) -> None:
    """Disparity, depth, predicted error and confidence."""
    shot, panels = stages.shot, figure.subplots(2, 2).ravel()
    known = shot.disparity_px[np.isfinite(shot.disparity_px)]
    draw_panel(panels[0], shot.disparity_px, "disparity", (float(known.min()), float(known.max())), "viridis", "px")
    draw_panel(panels[1], shot.depth_m, "depth", (1.0, 1.55), DEPTH_MAP, "z (m)")
    sigma_mm = shot.depth_sigma_m * 1e3
    draw_panel(panels[2], sigma_mm, "predicted error", (0.0, 0.5), "cividis", "standard deviation (mm)")
    draw_panel(panels[3], shot.confidence, "confidence", (0.0, 1.0), "cividis", "within 1 px of the truth")


def error_mm(stages: Stages, depth_m: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return depth minus truth (H, W) where both cameras see a lit surface, NaN elsewhere."""
    error = (depth_m - stages.capture.depth_m) * np.float32(1e3)
    return np.where(stages.capture.covisible, error, np.float32(np.nan))


PICTURES: dict[str, Callable[[Figure, Stages], None]] = {
    "1_fringes": draw_fringes,
    "2_phase": draw_phase,
    "3_candidates": draw_candidates,
    "4_orders": draw_orders,
    "5_errors": draw_errors,
    "6_result": draw_result,
}
SIZES = {"1_fringes": (10.0, 5.6), "6_result": (10.0, 7.4)}
