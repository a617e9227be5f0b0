"""Table and picture that figures 11 and 12 have in common."""

from __future__ import annotations

from pathlib import Path

from tools.bench.tables import Table, number, percent
from tools.figures.surface_methods import SurfaceResult
from tools.figures.surface_pictures import Column, Sheet, draw_sheet

ERROR_LIMIT_MM = 3.0
NOTE = (
    "Shares of the pixels that the projector lights and both cameras see. Whole orders: of the depths that are off, the"
    " share whose phase is whole periods from the true one. `fringe_edges` is sparse on purpose."
)


def score_table(result: SurfaceResult) -> Table:
    """Lay the scores out, one method a row."""
    rows = tuple(
        (
            one.way.label,
            percent(one.score.completeness),
            percent(one.score.outlier_share),
            percent(one.whole_orders),
            number(one.score.median_error_mm),
            percent(one.score.ghost_share),
        )
        for one in result.outcomes
    )
    columns = ("method", "complete %", "off > 1 px %", "whole orders %", "median error mm", "ghosts %")
    return Table("Methods", NOTE, columns, rows)


def draw_result(result: SurfaceResult, path: Path, limits_m: tuple[float, float]) -> None:
    """Write the sheet of all methods."""
    columns = [
        Column(one.way.label, one.shot.depth_m, one.error_mm, one.way.method == "fringe_edges")
        for one in result.outcomes
    ]
    capture = result.capture
    sheet = Sheet(
        capture.left, capture.right, capture.depth_m, columns, capture.rig, limits_m, ERROR_LIMIT_MM, "depth error"
    )
    draw_sheet(sheet, path)
