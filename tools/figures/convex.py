"""Figure 10 (c, d): the local period of the fringes on a convex surface."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from moire_sensor.paper_rig import PERIOD_PX, PROJECTOR_SIZE, REFERENCE_DEPTH_M, paper_pattern
from moire_sensor.reference_phase import low_passed
from moire_sensor.rig import StereoRig
from moire_sim.analytic_scenes import AnalyticScene
from moire_sim.analytic_surfaces import Cylinder, Relief, Surface
from moire_sim.analytic_view import sample
from moire_sim.capture import Grey
from moire_sim.fringe_image import Light
from tools.bench.tables import Table
from tools.figures.drawing import BLUE, GREY, ORANGE, draw_panel
from tools.figures.page import Claim, Experiment
from tools.figures.stage import TURN, Array, middle_row, plane_phase_rad, relative_phase_rad, rig_of_rows
from tools.small_png import save

APEX_M, RADIUS_M = 1.1, 0.2
SURFACES: tuple[Surface, ...] = (
    Relief(REFERENCE_DEPTH_M),
    Cylinder(0.047, APEX_M + RADIUS_M, RADIUS_M, -1.0, 1.0),
)
# Background and fringe filter reach a period each to either side, over the limb; what they mix there is left out.
REACH_PX = 2 * round(PERIOD_PX)
SLOPES = (-1.0, -0.5, 0.0, 0.5, 1.0)


@dataclass(frozen=True, eq=False)
class ConvexSurface:
    """Local periods on a cylinder in the right picture; arrays (W,), NaN off the cylinder and near its limbs.

    Attributes
    ----------
    picture : (H, W).
    slope : dz/dx of the surface.
    measured_px : local period, the mean over the rows.
    expected_px : the same from rays to the exact surface.
    """

    picture: Grey
    slope: Array
    measured_px: Array
    expected_px: Array

    def at(self, slope: float, values: Array) -> float:
        """Value where the surface has a slope."""
        known = np.isfinite(self.measured_px)
        return float(np.interp(slope, self.slope[known], values[known]))


def measure(rig: StereoRig | None = None, seed: int = 0) -> ConvexSurface:
    """Photograph the cylinder with the right camera, with noise; local periods are one over the phase's slope."""
    rig = rig or rig_of_rows()
    light = Light(blur_px=0.5)
    _, right = AnalyticScene.of(SURFACES, rig=rig, projector_size=PROJECTOR_SIZE).images(
        paper_pattern(), [light], seed=seed
    )
    columns, slope, on_cylinder = exact(rig)
    plane_rad = plane_phase_rad(rig, "right", REFERENCE_DEPTH_M)
    delta_rad = np.unwrap(relative_phase_rad(right, plane_rad), axis=1).mean(axis=0)
    phase_rad = delta_rad + plane_rad.mean(axis=0)
    # Frequencies in periods a pixel; the exact ones pass the same low pass as the measured.
    frequency = np.gradient(phase_rad) / TURN
    exact_frequency = low_passed((np.gradient(columns) / PERIOD_PX)[None], PERIOD_PX)[0].real
    inside = np.convolve(on_cylinder, np.ones(2 * REACH_PX + 1), "same") == 2 * REACH_PX + 1
    return ConvexSurface(
        right,
        np.where(inside, slope, np.nan),
        np.where(inside, 1.0 / frequency, np.nan),
        np.where(inside, 1.0 / exact_frequency, np.nan),
    )


def exact(rig: StereoRig) -> tuple[Array, Array, Array]:
    """Projector column, slope dz/dx and whether on the cylinder, along the right picture's middle row."""
    columns = np.arange(float(rig.image_size[0]))
    rows = np.full_like(columns, float(middle_row(rig)))
    seen = sample(SURFACES, rig, rig.P_right, columns, rows, 0.0, PROJECTOR_SIZE)
    slope = np.zeros_like(columns)
    on_cylinder = seen.surface == 1
    normals = SURFACES[1].normal(seen.points_m[:, on_cylinder])
    slope[on_cylinder] = -normals[0] / normals[2]
    return seen.projector_px[:, 0], slope, on_cylinder.astype(np.float64)


def draw_periods(result: ConvexSurface, path: Path) -> None:
    """Right picture above the local periods."""
    figure = Figure(figsize=(7.5, 8.0), layout="constrained")
    picture, period = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    draw_panel(picture, result.picture, "right camera, convex surface before the plane", (0, 190))
    picture.set_aspect("auto")
    columns = np.arange(result.measured_px.size)
    period.plot(columns, result.measured_px, color=BLUE, label="measured")
    period.plot(columns, result.expected_px, color=ORANGE, ls="--", label="rays to the exact surface")
    period.axhline(PERIOD_PX, color=GREY, lw=0.9, label="on the plane")
    period.set(xlabel="column (px)", ylabel="local period (px)")
    period.legend(fontsize=8)
    save(figure, path)


def experiment(result: ConvexSurface) -> Experiment:
    """Tell the periods by slope."""
    slopes = [slope for slope in SLOPES if np.nanmin(result.slope) <= slope <= np.nanmax(result.slope)]
    rows = tuple(
        (f"{slope:+.1f}", f"{result.at(slope, result.measured_px):.3f}", f"{result.at(slope, result.expected_px):.3f}")
        for slope in slopes
    )
    note = f"On the plane, and on any surface that faces the head, it is {PERIOD_PX:.3f} px."
    table = Table("Local period on the convex surface", note, ("slope dz/dx", "measured px", "exact px"), rows)
    least, most = np.nanmin(result.measured_px), np.nanmax(result.measured_px)
    off = np.nanmax(np.abs(result.measured_px / result.expected_px - 1.0))
    text = (
        f"A ray-traced cylinder of {RADIUS_M * 1e3:.0f} mm radius, its apex at {APEX_M * 1e3:.0f} mm. Left of the apex "
        f"the period falls to {least:.2f} px, right of it it grows to {most:.2f} px; the measurement follows the exact "
        f"rays to {100 * off:.1f} %. The change is small, 41 mm / z times the slope, which is why a fixed carrier is a "
        "good start."
    )
    claim = Claim(
        "10 d",
        'convex: on the right "frequency is longer" than on the plane, on the left shorter (read: the period)',
        f"{most:.2f} px right, {least:.2f} px left, {PERIOD_PX:.2f} px on the plane",
        "yes",
    )
    title = "Figure 10 (c, d): a convex surface"
    return Experiment("fig10_convex", title, text, (table,), (claim,), lambda path: draw_periods(result, path))
