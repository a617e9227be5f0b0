"""The demo's table: one row a run, for the terminal and for the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from moire_sensor.ros.reconstruction_report import GATHERING, RECONSTRUCTED, SUPERSEDED
from tools.demo.record import Recording, Run
from tools.demo.score import CaptureResult, SceneResult

COMMON = ("run", "method", "published", "matched", "reconstructed", "superseded", "latency p50 ms", "latency p99 ms")
SCENE_COLUMNS = (*COMMON, "completeness", "off > 1 px", "median error mm at 1 m", "verdict")
CAPTURE_COLUMNS = (*COMMON, "coverage", "nearest m", "farthest m", "rough share", "verdict")


@dataclass(frozen=True)
class Outcome:
    """A finished run: what was recorded, its result, and everything that is not as it should be."""

    run: Run
    recording: Recording
    result: SceneResult | CaptureResult
    complaints: tuple[str, ...]


def lost_sets(run: Run, recording: Recording) -> list[str]:
    """Say whether a set was lost on its way; frames that only begin a phase-shift programme are not lost."""
    counts = recording.counts
    done = counts[RECONSTRUCTED] + counts[GATHERING]
    if recording.published == run.exposures == counts["matched"] == done:
        return []
    return [f"sets were lost: {run.exposures} exposures, {recording.published} published, counts {counts}"]


def columns(outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    """Return the headings that fit these runs."""
    return SCENE_COLUMNS if isinstance(outcomes[0].result, SceneResult) else CAPTURE_COLUMNS


def cells(outcome: Outcome) -> list[str]:
    """Return one row as text."""
    run, recording, result = outcome.run, outcome.recording, outcome.result
    p50, p99 = np.percentile(recording.latencies_s, [50, 99]) * 1e3 if recording.latencies_s else (np.nan, np.nan)
    counts = recording.counts
    row = [run.name, run.method, str(recording.published), str(counts["matched"]), str(counts[RECONSTRUCTED])]
    row += [str(counts[SUPERSEDED]), f"{p50:.0f}", f"{p99:.0f}"]
    if isinstance(result, SceneResult):
        row += [f"{result.completeness:.4f}", f"{result.outlier_share:.4f}", f"{result.median_error_mm:.3f}"]
    else:
        row += [f"{result.coverage:.4f}", f"{result.nearest_m:.3f}", f"{result.farthest_m:.3f}"]
        row += [f"{result.rough_share:.4f}"]
    return [*row, "wrong" if outcome.complaints else "right"]


def as_text(outcomes: Sequence[Outcome]) -> str:
    """Return the table for a terminal, columns aligned."""
    rows = [list(columns(outcomes)), *map(cells, outcomes)]
    widths = [max(len(row[index]) for row in rows) for index in range(len(rows[0]))]
    lines = ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)
