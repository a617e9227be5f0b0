"""Figure 10 (a, b): a small board before the reference plane; fringes go left and vanish."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from moire_sensor.paper_rig import FX_PX, PERIOD_PX, REFERENCE_DEPTH_M, RIGHT_X_M, paper_pattern
from moire_sensor.rig import StereoRig
from moire_sim import VirtualHead
from moire_sim.capture import Grey
from tools.bench.tables import Table
from tools.figures.drawing import BLUE, GREY, ORANGE, draw_panel
from tools.figures.page import Claim, Experiment
from tools.figures.stage import TURN, Array, middle_row, plane_phase_rad, relative_phase_rad, rig_of_rows, shift_px
from tools.small_png import save

DISTANCES_M = (1.35, 1.2, 1.0)
# The board of the scene "board_before_plane", across: centre 30 mm, 240 mm wide; 180 mm high.
BOARD_X_M, BOARD_HALF_HEIGHT_M = (-0.09, 0.15), 0.09
MARGIN_PX = 2 * round(PERIOD_PX)
# The board's light, blurred by 0.55 px, is over so many pixels beyond its edge. The shadow, 17 px at most, ends before
# the last half of those looked at.
NEAR_PX, FAR_PX = 2, 60
# Light of the virtual head in a shadow on the plane: ambient 20, albedo 0.85.
SHADOW_GREY = 0.85 * 20.0


@dataclass(frozen=True, eq=False)
class SmallBoard:
    """One distance of the board, as the right camera sees it.

    Attributes
    ----------
    picture : (H, W); ``edges_px`` are the columns of the board's left and right edge.
    shift_px : shift of its fringes to the left of the plane's, whole periods chosen by the geometry.
    shadow_px : width of the dark band on the plane beside the board.
    period_px : mean local period of the fringes on the board.
    """

    distance_m: float
    picture: Grey
    edges_px: tuple[float, float]
    shift_px: float
    shadow_px: float
    period_px: float

    @property
    def expected_px(self) -> float:
        """Shift from the geometry, and the width of the shadow too: both are 41 mm f (1/z - 1/1500 mm)."""
        return float(shift_px(self.distance_m, REFERENCE_DEPTH_M))


def measure(
    rig: StereoRig | None = None, distances_m: tuple[float, ...] = DISTANCES_M, seed: int = 0
) -> list[SmallBoard]:
    """Photograph the board at each distance and measure fringes and shadow in the right picture."""
    rig = rig or rig_of_rows()
    plane_rad = plane_phase_rad(rig, "right", REFERENCE_DEPTH_M)
    with VirtualHead(f"flat_board:distance_m={REFERENCE_DEPTH_M}", seed=seed, rig=rig) as head:
        plane = head.capture(paper_pattern()).right
    results = []
    for number, distance in enumerate(distances_m):
        with VirtualHead(f"board_before_plane:distance_m={distance}", seed=seed + number, rig=rig) as head:
            picture = head.capture(paper_pattern()).right
        results.append(measured(rig, distance, picture, plane, plane_rad))
    return results


def measured(rig: StereoRig, distance_m: float, picture: Grey, plane: Grey, plane_rad: Array) -> SmallBoard:
    """Take the numbers from one picture and that of the plane alone, on rows well inside the board."""
    left, right = (FX_PX * (x - RIGHT_X_M) / distance_m + rig.centre_px[0] for x in BOARD_X_M)
    half = int(0.8 * BOARD_HALF_HEIGHT_M * rig.fy_px / distance_m)
    rows = slice(max(middle_row(rig) - half, 0), middle_row(rig) + half)
    inside = slice(int(left) + MARGIN_PX, int(right) - MARGIN_PX)
    delta_rad = relative_phase_rad(picture[rows], plane_rad[rows])[:, inside]
    expected = float(shift_px(distance_m, REFERENCE_DEPTH_M))
    residual = np.angle(np.exp(1j * (delta_rad - TURN * expected / PERIOD_PX)).mean()) / TURN * PERIOD_PX
    phase_rad = np.unwrap(delta_rad, axis=1) + plane_rad[rows, inside]
    slope = np.polyfit(np.arange(phase_rad.shape[1]), phase_rad.mean(axis=0), 1)[0]
    # The shadow falls to the right of the board, for the projector stands to the left of the right camera. As far as
    # the board's own light reaches, all is taken as dark.
    first = int(np.ceil(right)) + NEAR_PX
    beside, lit = (view[rows, first : first + FAR_PX].astype(float).mean(axis=0) for view in (picture, plane))
    shadow = first - 0.5 - right + lacking_px(beside, lit)
    return SmallBoard(distance_m, picture, (left, right), expected + float(residual), shadow, float(TURN / slope))


def lacking_px(profile: Array, lit: Array) -> float:
    """How many pixels of a profile (n,) the projector does not light, beside the same one without a shadow.

    A pixel counts by the share of the projector's light that it lacks: neither blur nor a dark fringe at the end of the
    shadow makes it wider. The last half of the profile, which has no shadow, tells how much brighter the other is.
    """
    beyond = slice(profile.size // 2, None)
    lit = lit * (profile[beyond].sum() / lit[beyond].sum())
    return float(np.sum((lit - profile)[: beyond.start] / (lit - SHADOW_GREY)[: beyond.start]))


def draw_boards(results: list[SmallBoard], path: Path) -> None:
    """Right pictures, the board's edges and its shadow marked, and a row of each."""
    figure = Figure(figsize=(4.0 * len(results), 6.4), layout="constrained")
    pictures, profiles = figure.subplots(2, len(results), height_ratios=(3, 2))
    for axes, profile, one in zip(pictures, profiles, results, strict=True):
        draw_panel(axes, one.picture, f"right camera, board at {one.distance_m * 1e3:.0f} mm", (0, 190))
        for edge in one.edges_px:
            axes.axvline(edge, color=ORANGE, lw=0.9, ls="--")
        middle = one.picture.shape[0] // 2
        row = one.picture[middle - 10 : middle + 10].astype(float).mean(axis=0)
        start, stop = one.edges_px[1] - 70, one.edges_px[1] + 70
        profile.plot(np.arange(row.size), row, color=BLUE)
        profile.axvline(one.edges_px[1], color=ORANGE, lw=0.9, ls="--")
        profile.axvspan(one.edges_px[1], one.edges_px[1] + one.expected_px, color=GREY, alpha=0.3, lw=0)
        profile.set(xlim=(start, stop), ylim=(0, 190), xlabel="column (px)", ylabel="grey level (1)")
        profile.set_title("board's right edge; shadow by the geometry in grey", fontsize=9)
    save(figure, path)


def experiment(results: list[SmallBoard]) -> Experiment:
    """Tell shifts and shadows."""
    rows = tuple(
        (
            f"{one.distance_m * 1e3:.0f}", f"{one.shift_px:.3f}", f"{one.expected_px:.3f}", f"{one.shadow_px:.1f}",
            f"{one.period_px:.3f}",
        )
        for one in results
    )  # fmt: skip
    columns = ("board mm", "fringe shift px", "geometry px", "shadow px", "period on the board px")
    note = (
        "Shift to the left of the plane's fringes, known from the picture but for whole periods; the shadow is as "
        "wide as the shift, for both are the parallax between projector and right camera."
    )
    table = Table("Board before the plane", note, columns, rows)
    nearest = results[-1]
    text = (
        "The board's fringes lie to the left of where the plane's would be; on its right a strip of the plane is "
        f"dark, on its left as wide a strip is lit but hidden. The period on the board stays {PERIOD_PX:.2f} px at "
        f"every distance: the projector lies in the cameras' plane. At {nearest.distance_m * 1e3:.0f} mm the shift is "
        f"{nearest.shift_px / PERIOD_PX:.2f} periods, so that the board's fringes nearly continue the plane's: the 2 "
        "pi ambiguity to the eye."
    )
    shifts = ", ".join(f"{one.shift_px:.2f}" for one in results)
    shadows = ", ".join(f"{one.shadow_px:.1f}" for one in results)
    claims = (
        Claim("10 b", "the fringes on a small object go to the left", f"by {shifts} px", "yes"),
        Claim("10 b", "fringes of the plane beside it disappear", f"dark strip of {shadows} px", "yes"),
    )
    title = "Figure 10 (a, b): a small board before the plane"
    return Experiment("fig10_board", title, text, (table,), claims, lambda path: draw_boards(results, path))
