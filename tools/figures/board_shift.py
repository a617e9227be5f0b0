"""Figure 9: a flat board from 1000 to 600 mm, and where its pattern repeats."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from moire_sensor.paper_rig import PERIOD_PX, REFERENCE_FRINGE_M, RIGHT_X_M, paper_pattern
from moire_sensor.rig import StereoRig
from moire_sim import VirtualHead
from moire_sim.capture import Grey
from tools.bench.tables import Table
from tools.figures.drawing import BLUE, GREY, ORANGE
from tools.figures.page import Claim, Experiment
from tools.figures.stage import RIGHT_BASE_M, TURN, mean_phase_rad, plane_phase_rad, rig_focal_px, rig_of_rows, shift_px
from tools.small_png import save

START_M = 1.0
DISTANCES_M = tuple(round(1.0 - 0.05 * step, 2) for step in range(9))
PAPER_REPEAT_M = 0.7
STRIP = slice(200, 440)


@dataclass(frozen=True, eq=False)
class BoardSeries:
    """One entry a distance.

    Attributes
    ----------
    distance_m : (N,), 1000 to 600 mm.
    pictures : right pictures (H, W).
    shift_px : (N,) measured shift of the fringes to the left since 1000 mm, followed from distance to distance.
    likeness : (N,) correlation of the picture with the one at 1000 mm, -1 to 1.
    """

    distance_m: npt.NDArray[np.float64]
    pictures: tuple[Grey, ...]
    shift_px: npt.NDArray[np.float64]
    likeness: npt.NDArray[np.float64]

    @property
    def expected_px(self) -> npt.NDArray[np.float64]:
        """41 mm x f x (1/z - 1/1000 mm)."""
        return shift_px(self.distance_m, START_M)

    def repeat_m(self, periods: int = 1) -> float:
        """Distance at which the measured shift is a number of periods; the shift is straight in 1/z."""
        return float(1.0 / np.interp(periods * PERIOD_PX, self.shift_px, 1.0 / self.distance_m))

    @property
    def likest_m(self) -> float:
        """Distance short of 1000 mm, on the paper's grid, whose picture is most like the first."""
        return float(self.distance_m[1:][np.argmax(self.likeness[1:])])


def measure(rig: StereoRig | None = None, distances_m: tuple[float, ...] = DISTANCES_M, seed: int = 0) -> BoardSeries:
    """Photograph the board at each distance with the right camera; distances fall, from 1000 mm."""
    rig = rig or rig_of_rows()
    pictures: list[Grey] = []
    for number, distance in enumerate(distances_m):
        with VirtualHead(f"flat_board:distance_m={distance}", seed=seed + number, rig=rig) as head:
            pictures.append(head.capture(paper_pattern()).right)
    start_rad = plane_phase_rad(rig, "right", START_M)
    phases = np.unwrap([mean_phase_rad(picture, start_rad) for picture in pictures])
    first = pictures[0].astype(float).ravel()
    likeness = [float(np.corrcoef(first, picture.astype(float).ravel())[0, 1]) for picture in pictures]
    shifts = (phases - phases[0]) / TURN * PERIOD_PX
    return BoardSeries(np.array(distances_m), tuple(pictures), shifts, np.array(likeness))


def draw_series(series: BoardSeries, path: Path) -> None:
    """Right pictures in strips, one below the other, and the shift against the distance."""
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=(3, 2))
    left, right = halves
    crest = first_crest_px(series.pictures[0])
    strips = left.subplots(len(series.pictures), 1, sharex=True)
    for axes, picture, distance, shift in zip(strips, series.pictures, series.distance_m, series.shift_px, strict=True):
        middle = picture.shape[0] // 2
        axes.imshow(picture[middle - 12 : middle + 12, STRIP], cmap="gray", aspect="auto", vmin=0, vmax=190,
                    extent=(STRIP.start - 0.5, STRIP.stop - 0.5, 24, 0))  # fmt: skip
        axes.set_yticks([])
        axes.set_ylabel(f"{distance * 1e3:.0f} mm", rotation=0, ha="right", va="center")
        axes.plot([crest - shift] * 2, [0, 24], color=ORANGE, lw=1.6)
        axes.set_xlim(STRIP.start - 0.5, STRIP.stop - 0.5)
    strips[0].set_title("right camera; the line follows one fringe", fontsize=10)
    strips[-1].set_xlabel("column (px)")
    shift, like = right.subplots(2, 1, sharex=True)
    fine = np.linspace(0.58, 1.0, 200)
    shift.plot(fine * 1e3, shift_px(fine, START_M), color=GREY, label="41 mm f (1/z - 1/1000 mm)")
    shift.plot(series.distance_m * 1e3, series.shift_px, "o", color=BLUE, label="measured")
    for periods in (1, 2):
        shift.axhline(periods * PERIOD_PX, color=ORANGE, ls="--", lw=0.9)
        shift.annotate(f"{periods} period{'s' * (periods > 1)}", (900, periods * PERIOD_PX + 0.5), color=ORANGE)
    shift.set(ylabel="shift to the left (px)")
    shift.legend(fontsize=8)
    like.plot(fine * 1e3, np.cos(TURN * shift_px(fine, START_M) / PERIOD_PX), color=GREY, label="cosine of the shift")
    like.plot(series.distance_m * 1e3, series.likeness, "o", color=BLUE, label="measured")
    like.set(xlabel="distance of the board (mm)", ylabel="correlation with 1000 mm (1)", ylim=(-1.15, 1.7))
    like.legend(fontsize=8, loc="upper left")
    save(figure, path)


def first_crest_px(picture: Grey) -> float:
    """Column of a bright fringe near the right end of the strip, to a pixel."""
    columns = picture[:, STRIP.stop - 40 : STRIP.stop - 40 + round(PERIOD_PX)].astype(float).mean(axis=0)
    return float(STRIP.stop - 40 + np.argmax(columns))


def experiment(series: BoardSeries) -> Experiment:
    """Tell the shifts and where the pattern repeats."""
    rows = tuple(
        (f"{z * 1e3:.0f}", f"{shift:.3f}", f"{expected:.3f}", f"{shift / PERIOD_PX:.3f}", f"{like:+.3f}")
        for z, shift, expected, like in zip(
            series.distance_m, series.shift_px, series.expected_px, series.likeness, strict=True
        )
    )
    columns = ("distance mm", "measured px", "geometry px", "periods", "correlation")
    note = (
        f"Shift to the left since 1000 mm; a period is {PERIOD_PX:.2f} px. Correlation of the pictures with the first."
    )
    table = Table("Shift of the right camera's fringes", note, columns, rows)
    off = float(np.abs(series.shift_px - series.expected_px).max())
    paper = float(shift_px(PAPER_REPEAT_M, START_M))
    claims = (
        Claim(
            "9", "the nearer the board, the further left the fringes", f"{series.shift_px[-1]:.1f} px at 600 mm", "yes"
        ),
        Claim(
            "9",
            "the pattern at 700 mm is similar to that at 1000 mm",
            f"it repeats at {series.repeat_m() * 1e3:.0f} mm (750 mm on the paper's grid); at 700 mm it is "
            f"{paper / PERIOD_PX:.2f} periods on",
            "no: the stated 41 mm and 20 mm give 750 mm, see below",
        ),
    )
    text = f"The shift follows the geometry to {off:.3f} px. {repeat_text(series)}"
    title = "Figure 9: a board that comes nearer"
    return Experiment("fig09_board", title, text, (table,), claims, lambda path: draw_series(series, path))


def repeat_text(series: BoardSeries) -> str:
    """Say where the pattern repeats and what would make it repeat at 700 mm."""
    per_period = 1.0 / PAPER_REPEAT_M - 1.0 / START_M
    base_mm = PERIOD_PX / (rig_focal_px() * per_period) * 1e3
    fringe_mm = REFERENCE_FRINGE_M * 1e3 * RIGHT_BASE_M * 1e3 / base_mm
    interval = START_M - PAPER_REPEAT_M
    gap = PERIOD_PX / (RIGHT_BASE_M * rig_focal_px())
    near = 0.5 * (np.sqrt(interval**2 + 4.0 * interval / gap) - interval)
    whole = RIGHT_X_M * rig_focal_px() * per_period / PERIOD_PX
    return (
        f"One period has gone by at {series.repeat_m() * 1e3:.1f} mm and two at {series.repeat_m(2) * 1e3:.1f} mm, so "
        f"of the distances photographed {series.likest_m * 1e3:.0f} mm looks most like 1000 mm, and 700 mm does not "
        f"(correlation {np.interp(-PAPER_REPEAT_M, -series.distance_m, series.likeness):+.2f}). For 700 mm to be one "
        f"period on, something stated must be otherwise: {base_mm:.1f} mm from projector to right camera in place of "
        f"41, or fringes of {fringe_mm:.1f} mm in place of 20, or distances told from a point "
        f"{(near - PAPER_REPEAT_M) * 1e3:.0f} mm in front of the cameras. With the projector at the left camera, 94 mm "
        f"away, {whole:.2f} periods go by. The paper does not say enough to tell which, or whether the pictures were "
        "only judged by eye."
    )
