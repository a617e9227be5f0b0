"""The report of a demo: one HTML file with table, pictures and a point cloud to turn; needs no network."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tools.demo.pictures import View, span
from tools.demo.score import SceneResult
from tools.demo.table import Outcome, cells, columns

TEMPLATE = Path(__file__).with_name("report.html")
# Every second row and column: 77 000 points turn smoothly on a canvas.
STRIDE = 2
POINT_UNIT_M = 1e-4


def write_report(output: Path, outcomes: Sequence[tuple[Outcome, View]]) -> Path:
    """Write ``report.html`` into the output folder and return its path."""
    rows = [outcome for outcome, _ in outcomes]
    page = TEMPLATE.read_text()
    parts = {
        "VERDICT": verdict(rows),
        "TABLE": table_html(rows),
        "SECTIONS": "\n".join(section_html(output, outcome) for outcome, _ in outcomes),
        "CLOUDS": json.dumps([cloud_json(view) for _, view in outcomes]),
    }
    for name, content in parts.items():
        page = page.replace(f"<!--{name}-->", content)
    path = output / "report.html"
    path.write_text(page)
    return path


def verdict(outcomes: Sequence[Outcome]) -> str:
    """Say in a sentence whether everything is right, and how it is meant."""
    wrong = [outcome.run.name for outcome in outcomes if outcome.complaints]
    head = f"Not right: {', '.join(wrong)}." if wrong else f"All {len(outcomes)} runs are right."
    return html.escape(head)


def table_html(outcomes: Sequence[Outcome]) -> str:
    """Return the table of all runs."""
    heading = "".join(f"<th>{html.escape(name)}</th>" for name in columns(outcomes))
    rows = (
        f"<tr class={'wrong' if outcome.complaints else 'right'}>"
        + "".join(f"<td>{html.escape(text)}</td>" for text in cells(outcome))
        + "</tr>"
        for outcome in outcomes
    )
    return f"<table><thead><tr>{heading}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def section_html(output: Path, outcome: Outcome) -> str:
    """Return heading, sentence and picture of one run."""
    name = html.escape(outcome.run.name)
    picture = base64.b64encode((output / outcome.run.name / "overview.png").read_bytes()).decode()
    complaints = "".join(f"<p class=wrong>{html.escape(text)}</p>" for text in outcome.complaints)
    return (
        f"<h2>{name}</h2><p>{html.escape(sentence(outcome))}</p>{complaints}"
        f'<img alt="{name}: left and right image, fringe order, depth, error and 3-D view" '
        f'src="data:image/png;base64,{picture}">'
    )


def sentence(outcome: Outcome) -> str:
    """Say the result of one run in words."""
    result = outcome.result
    if isinstance(result, SceneResult):
        return (
            f"The worst of {len(result.scores)} depth images has a depth on {result.completeness:.1%} of the pixels "
            f"that the projector lights and both cameras see; {result.outlier_share:.2%} of them are off by more than "
            f"one pixel of disparity; the median error is {result.median_error_mm:.2f} mm scaled to 1 m."
        )
    return (
        f"Depth on {result.coverage:.1%} of the pixels with strong fringes, between {result.nearest_m * 1e3:.0f} and "
        f"{result.farthest_m * 1e3:.0f} mm (1st to 99th percentile); {result.rough_share:.2%} of it is more than 5 mm "
        "from the median of its surroundings."
    )


def cloud_json(view: View) -> dict[str, Any]:
    """Return the points as base64 of int16 in units of 0.1 mm, with grey levels of the left image as uint8."""
    points_m = view.points_m[::STRIDE, ::STRIDE].reshape(-1, 3)
    grey = view.left[::STRIDE, ::STRIDE].reshape(-1)
    known = np.isfinite(points_m[:, 2]) & (np.abs(points_m) < 32767 * POINT_UNIT_M).all(axis=1)
    packed = np.round(points_m[known] / POINT_UNIT_M).astype("<i2")
    shades = (grey[known] * (255.0 / np.iinfo(grey.dtype).max)).astype(np.uint8)
    return {
        "title": view.title,
        "unit_m": POINT_UNIT_M,
        "relief_m": float(np.ptp(span(view.depth_m, 0.5))),
        "points": base64.b64encode(packed.tobytes()).decode(),
        "grey": base64.b64encode(shades.tobytes()).decode(),
    }
