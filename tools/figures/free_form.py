"""Figure 11: the free-form sine surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from moire_sensor.rig import StereoRig
from tools.bench.tables import Table, number
from tools.figures.page import Claim, Experiment
from tools.figures.shapes import sine_amplitudes_mm
from tools.figures.surface_methods import WAYS, Outcome, SurfaceResult, Way
from tools.figures.surface_methods import measure as measure_scene
from tools.figures.surface_table import draw_result, score_table

SCENE = "free_form"
# The surface of that scene: a sine of 40 mm along x, one of 16 mm along y.
LENGTHS_M, AMPLITUDES_MM = (0.30, 0.45), (40.0, 16.0)
# Half a fringe of the left camera reaches from 0.97 to 1.28 m about this plane: the whole surface.
MIDDLE_M = 1.1
MIDDLE = Way("reference_plane at 1.1 m", "reference_plane", MIDDLE_M)


def measure(rig: StereoRig | None = None, seed: int = 0) -> SurfaceResult:
    """All methods, and the classic one with its plane laid through the surface."""
    return measure_scene(SCENE, rig, (WAYS[0], MIDDLE, *WAYS[1:]), seed)


def amplitudes_mm(result: SurfaceResult, outcome: Outcome) -> tuple[float, float]:
    """Amplitudes along x and y of what a method measured where it can be known."""
    depth = np.where(result.capture.covisible, outcome.shot.depth_m, np.nan)
    return sine_amplitudes_mm(result.capture.rig.points(depth), LENGTHS_M)


def draw(result: SurfaceResult, path: Path) -> None:
    """Write the sheet of all methods."""
    draw_result(result, path, (1.02, 1.18))


def experiment(result: SurfaceResult) -> Experiment:
    """Tell scores and the shape."""
    rows = []
    for outcome in result.outcomes:
        across, along = amplitudes_mm(result, outcome)
        rows.append((outcome.way.label, number(across, 2), number(along, 2)))
    note = (
        f"Amplitudes of the sine along x and along y, fitted to the points; true: {AMPLITUDES_MM[0]:.0f} and "
        f"{AMPLITUDES_MM[1]:.0f} mm."
    )
    shape = Table("Shape of the surface", note, ("method", "along x mm", "along y mm"), tuple(rows))
    edges, plane = result.outcome("fringe_edges"), result.outcome("reference_plane")
    dense = amplitudes_mm(result, result.outcome("dense"))
    sparse = amplitudes_mm(result, edges)
    text = (
        f"A sine surface about {MIDDLE_M * 1e3:.0f} mm (scene `{SCENE}`). Against the paper's plane at 1500 mm the "
        f"classic method is off on {100 * plane.score.outlier_share:.0f} % of the pixels, "
        f"{100 * plane.whole_orders:.0f} % of these by whole fringe orders; with its plane laid through the surface it "
        "is right, for all of it lies within half a fringe. `fringe_edges` gives points on "
        f"{100 * edges.score.completeness:.0f} % of the pixels, the spaces of the paper's cloud."
    )
    claims = (
        Claim(
            "11",
            "the 3-D result shows the sine shape clearly",
            f"amplitude {sparse[0]:.1f} mm by the paper's method, {dense[0]:.1f} by `dense`, true 40",
            "yes",
        ),
        Claim(
            "11",
            "the result is a point cloud with spaces",
            f"points on {100 * edges.score.completeness:.0f} % of the pixels; `dense` "
            f"{100 * result.outcome('dense').score.completeness:.1f} %",
            "yes; the spaces need not be",
        ),
    )
    title = "Figure 11: free-form surface"
    tables = (score_table(result), shape)
    return Experiment("fig11_free_form", title, text, tables, claims, lambda path: draw(result, path))
