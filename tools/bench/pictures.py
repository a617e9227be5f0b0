"""Error maps: every scene, every method, in one scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from tools.bench.accuracy import Record
from tools.bench.conditions import DEFAULT
from tools.bench.speed import SpeedRecord
from tools.small_png import save

# Disparity error in pixels: up to 0.05 it is noise of the best, beyond 1 it is wrong.
LEVELS_PX = (-1.0, -0.3, -0.1, -0.05, 0.05, 0.1, 0.3, 1.0)
UNKNOWN_COLOUR = "0.55"
STRIDE = 2  # Of every 2 x 2 pixels the first is shown.
MARKERS = ("o", "s", "^", "v", "D", "P")


def draw_errors(records: Sequence[Record], scene: str, path: Path) -> None:
    """Write the error maps of all methods on one scene, side by side."""
    own = [one for one in records if one.scene == scene and one.condition == DEFAULT.name]
    errors = [(one.method, one.error_px) for one in own if one.error_px is not None]
    count = len(errors)
    figure = Figure(figsize=(2.75 * count + 1.0, 2.75), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, count, sharey=True))
    colours = ListedColormap(mpl.colormaps["PuOr"](np.linspace(0.0, 1.0, len(LEVELS_PX) + 1))).with_extremes(
        bad=UNKNOWN_COLOUR
    )
    norm = BoundaryNorm(LEVELS_PX, len(LEVELS_PX) + 1, extend="both")
    for place, (method, error_px) in zip(axes, errors, strict=True):
        height, width = error_px.shape
        place.imshow(
            error_px[::STRIDE, ::STRIDE],
            cmap=colours,
            norm=norm,
            interpolation="nearest",
            extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        )
        place.set(xlabel="column (px)", xticks=(0, 200, 400, 600))
        place.set_title(method, fontsize=10)
    axes[0].set_ylabel(f"{scene}\nrow (px)")
    bar = figure.colorbar(axes[0].images[0], ax=axes, pad=0.01, fraction=0.02, aspect=12, ticks=LEVELS_PX)
    bar.set_label("disparity error (px)")
    save(figure, path)


def draw_speed(records: Sequence[SpeedRecord], path: Path) -> None:
    """Write time against image size, one line a method, one panel a number of threads."""
    threads = sorted({one.case.threads for one in records})
    figure = Figure(figsize=(4.0 * len(threads) + 1.4, 3.4), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(threads), sharey=True))
    usual = records[0].case.depth_range_m
    for place, count in zip(axes, threads, strict=True):
        own = [one for one in records if one.case.threads == count and one.case.depth_range_m == usual]
        for number, method in enumerate(dict.fromkeys(one.method for one in own)):
            line = [one for one in own if one.method == method]
            points = [(one.case.image_size[0] * one.case.image_size[1] / 1e6, one.milliseconds) for one in line]
            colour = mpl.colormaps["viridis"](number / 6.5)
            place.plot(*zip(*points, strict=True), marker=MARKERS[number % len(MARKERS)], color=colour, label=method)
        place.set(xscale="log", yscale="log", xlabel="pixels (million)", title=f"threads: {count}")
        place.grid(True, alpha=0.3)
    axes[0].set_ylabel("time of one pair (ms)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", fontsize=7)
    save(figure, path)
