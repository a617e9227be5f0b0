"""Figures 5 and 7: the 2 pi ambiguity of one pixel, and how the second camera settles it."""

from __future__ import annotations

import string
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from moire_sensor.paper_rig import PERIOD_PX, PROJECTOR_X_M, RIGHT_X_M, paper_pattern
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.reference_phase import fringe_signal
from moire_sensor.reference_ray import disparity_on_ray_px, phase_seen_rad
from moire_sensor.rig import StereoRig
from moire_sim import VirtualHead
from tools.bench.tables import Table
from tools.figures.drawing import BLUE, GREEN, GREY, ORANGE
from tools.figures.page import Claim, Experiment
from tools.figures.stage import TURN, Array, middle_row, plane_phase_rad, rig_of_rows
from tools.small_png import save

BOARD_M = 1.0
DEPTH_RANGE_M = (0.5, 2.0)
NEAR_COLUMN = 300


@dataclass(frozen=True, eq=False)
class OnePixel:
    """Candidates of a right pixel, the farthest first; arrays (K,).

    Attributes
    ----------
    column_px, row_px : the pixel, the darkest near the middle of the right image.
    orders : fringe orders from the true one, k.
    depth_m, left_px : where the candidate lies and where the left camera would see it.
    mismatch_deg : phase that the left picture shows there minus the pixel's, -180 to 180 degrees.
    expected_deg : the same from the geometry of the board.
    """

    column_px: int
    row_px: int
    orders: Array
    depth_m: Array
    left_px: Array
    mismatch_deg: Array
    expected_deg: Array

    @property
    def chosen(self) -> int:
        """Candidate that the left picture agrees with best."""
        return int(np.argmin(np.abs(self.mismatch_deg)))


def measure(rig: StereoRig | None = None, seed: int = 0) -> OnePixel:
    """Photograph a flat board and list the candidates of one pixel, from the noisy pictures alone."""
    rig = rig or rig_of_rows()
    with VirtualHead(f"flat_board:distance_m={BOARD_M}", seed=seed, rig=rig) as head:
        capture = head.capture(paper_pattern())
    row = middle_row(rig)
    near = slice(NEAR_COLUMN, NEAR_COLUMN + round(PERIOD_PX))
    column = NEAR_COLUMN + int(np.argmin(capture.right[:, near].astype(float).mean(axis=0)))
    left_rad = phase_image_rad(capture.left, plane_phase_rad(rig, "left", BOARD_M))
    right_rad = phase_image_rad(capture.right, plane_phase_rad(rig, "right", BOARD_M))
    return candidates_of(rig, column, row, float(right_rad[row, column]), left_rad[row])


def phase_image_rad(picture: Any, carrier_rad: Array) -> Array:
    """Wrapped phase (H, W) of a picture."""
    fringe = fringe_signal(picture.astype(np.float64), carrier_rad, PERIOD_PX)
    return np.asarray(np.angle(fringe * np.exp(1j * carrier_rad)))


def candidates_of(rig: StereoRig, column: int, row: int, phase_rad: float, left_row_rad: Array) -> OnePixel:
    """All points on the ray that show the phase (equation 7), and what the left row says of each."""
    projector = ProjectorMap.build(rig, paper_pattern())
    x, y = np.array(float(column)), np.array(float(row))
    board_px = float(rig.disparity_px(BOARD_M))
    true_turns = float(phase_seen_rad(projector, "right", x, y, board_px)) / TURN
    turns = phase_rad / TURN + np.arange(-200.0, 200.0)
    depth = rig.depth_m(disparity_on_ray_px(projector, "right", x, y, TURN * turns))
    inside = (depth >= DEPTH_RANGE_M[0]) & (depth <= DEPTH_RANGE_M[1])
    turns, depth = turns[inside], depth[inside]
    left = column + rig.disparity_px(depth)
    # The whole row's phase, unwrapped, is straight between neighbouring pixels.
    seen = np.interp(left, np.arange(left_row_rad.size), np.unwrap(left_row_rad))
    exact_rad = TURN * (true_turns + np.round(turns - true_turns))
    exact_left = x + disparity_on_ray_px(projector, "right", x, y, exact_rad)
    geometry = phase_seen_rad(projector, "left", exact_left, np.full_like(left, y), board_px)
    return OnePixel(
        column_px=column,
        row_px=row,
        orders=np.round(turns - true_turns) + 0.0,
        depth_m=depth,
        left_px=left,
        mismatch_deg=wrapped_deg(seen - phase_rad),
        expected_deg=wrapped_deg(geometry - TURN * true_turns),
    )


def wrapped_deg(phase_rad: Array) -> Array:
    """Angle within -180 to 180 degrees."""
    return np.asarray(np.degrees(np.angle(np.exp(1j * phase_rad))))


def draw_pixel(result: OnePixel, path: Path) -> None:
    """Rays and light sheets in plan, and how far off the left camera's phase is at each candidate."""
    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    plan, bars = figure.subplots(1, 2, width_ratios=(3, 2))
    rig = rig_of_rows()
    x = rig.points(np.full((480, 640), 1.0, np.float32))[0, :, 0]
    at_left = np.interp(result.left_px, np.arange(640), x)
    places = at_left * result.depth_m
    far = 1.6
    ray = RIGHT_X_M + (result.column_px - rig.centre_px[0]) / rig.fx_px * far
    plan.plot([RIGHT_X_M * 1e3, ray * 1e3], [0, far * 1e3], color=ORANGE, label="ray of the right pixel")
    for number, (place, depth) in enumerate(zip(places, result.depth_m, strict=True)):
        sheet = PROJECTOR_X_M + (place - PROJECTOR_X_M) / depth * far
        label = {"label": "light of the same phase"} if number == 0 else {}
        plan.plot([PROJECTOR_X_M * 1e3, sheet * 1e3], [0, far * 1e3], color=GREEN, lw=0.9, **label)
        label = {"label": "where the left camera looks"} if number == 0 else {}
        plan.plot([0, place * 1e3], [0, depth * 1e3], color=BLUE, lw=0.9, ls=":", **label)
        plan.plot(place * 1e3, depth * 1e3, "ko" if number == result.chosen else "kx")
        plan.annotate(f" {string.ascii_uppercase[number]}", (place * 1e3 + 3, depth * 1e3 - 5))
    plan.axhline(BOARD_M * 1e3, color=GREY, ls="--", lw=0.8)
    plan.set(title="plan (x stretched)", xlabel="x (mm)", ylabel="z (mm)", xlim=(-30, 150), ylim=(0, 1600))
    plan.legend(fontsize=8, loc="lower right")
    names = [f"{string.ascii_uppercase[i]}\n{z * 1e3:.0f} mm" for i, z in enumerate(result.depth_m)]
    bars.bar(
        names, np.abs(result.mismatch_deg), color=[BLUE if i == result.chosen else GREY for i in range(len(names))]
    )
    bars.plot(names, np.abs(result.expected_deg), "k_", ms=22, label="from the geometry")
    bars.set(title="left picture's phase against the pixel's", ylabel="|mismatch| (degrees)", ylim=(0, 180))
    bars.tick_params(axis="x", labelsize=8)
    bars.legend(fontsize=8)
    save(figure, path)


def experiment(result: OnePixel) -> Experiment:
    """Tell the candidates."""
    rows = tuple(
        (letter, f"{k:+.0f}", f"{z * 1e3:.1f}", f"{left:.1f}", f"{mismatch:+.1f}", f"{expected:+.1f}")
        for letter, k, z, left, mismatch, expected in zip(
            string.ascii_uppercase, result.orders, result.depth_m, result.left_px, result.mismatch_deg,
            result.expected_deg, strict=False,
        )
    )  # fmt: skip
    columns = ("candidate", "order off", "depth mm", "left column px", "mismatch deg", "from geometry deg")
    note = "The left picture is read where it would show the candidate; one candidate has the phase of the right pixel."
    table = Table("Candidates", note, columns, rows)
    chosen = string.ascii_uppercase[result.chosen]
    depth_mm = result.depth_m[result.chosen] * 1e3
    others = np.delete(np.abs(result.mismatch_deg), result.chosen)
    text = (
        f"The darkest pixel near the middle of the right picture of a board at {BOARD_M * 1e3:.0f} mm (column "
        f"{result.column_px}, row {result.row_px}). Between {DEPTH_RANGE_M[0] * 1e3:.0f} and "
        f"{DEPTH_RANGE_M[1] * 1e3:.0f} mm its phase fits {len(result.depth_m)} depths. The left picture is "
        f"{abs(result.mismatch_deg[result.chosen]):.1f} degrees off at {chosen} and {others.min():.0f} degrees or more "
        "at the others."
    )
    claims = (
        Claim(
            "5", "one camera's phase fits depths A, B, C, D, ..., equation (7)", f"{len(result.depth_m)} depths", "yes"
        ),
        Claim(
            "7", "the left camera tells which, equations (8) to (12)", f"{chosen}, {depth_mm:.1f} mm for 1000", "yes"
        ),
    )
    title = "Figures 5 and 7: candidates of one pixel"
    return Experiment("fig05_candidates", title, text, (table,), claims, lambda path: draw_pixel(result, path))
