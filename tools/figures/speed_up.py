"""The conclusion's speed-up: some rows solved, the others follow their neighbours."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numba import get_num_threads, set_num_threads

from moire_sensor.edge_depth import FringeEdges, fringe_edges
from moire_sensor.edge_match import EdgeMatch, match_edges
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.paper_rig import paper_pattern
from moire_sensor.rig import StereoRig
from moire_sim import VirtualHead
from moire_sim.capture import HeadCapture
from moire_sim.score import Score, score
from tools.bench.tables import Table, number, percent
from tools.figures.drawing import BLUE, ORANGE
from tools.figures.page import Claim, Experiment
from tools.figures.surface_methods import DEPTH_RANGE_M
from tools.small_png import save

SCENE = "cylinder_and_box"
ROWS = (1, 2, 4, 8, 16)
REPEATS = 15


@dataclass(frozen=True)
class SpeedUp:
    """Scores and processor times of one setting; ``points`` are counted, times are in milliseconds.

    Attributes
    ----------
    rows : every rows-th row is solved.
    points, agree : points found; share of them that solving all rows finds too, at the same order.
    whole_ms, match_ms : the whole method, and matching with propagation alone.
    """

    rows: int
    score: Score
    points: int
    agree: float
    whole_ms: float = float("nan")
    match_ms: float = float("nan")


def measure(
    rig: StereoRig | None = None, rows: Sequence[int] = ROWS, repeats: int = REPEATS, seed: int = 0
) -> list[SpeedUp]:
    """Score every setting, and time them turn by turn (not at all with 0 repeats)."""
    with VirtualHead(SCENE, seed=seed, rig=rig) as head:
        capture = head.capture(paper_pattern())
    everything = solved(capture, 1)
    results = []
    for every in rows:
        order = everything if every == 1 else solved(capture, every)
        found = order.fringe_order != np.iinfo(np.int16).min
        same = order.fringe_order == everything.fringe_order
        agree = float(np.count_nonzero(found & same)) / max(int(found.sum()), 1)
        results.append(SpeedUp(every, score(order, capture), int(found.sum()), agree))
    if repeats:
        times = processor_times_ms(capture, rows, repeats)
        results = [
            replace(one, whole_ms=whole, match_ms=match) for one, (whole, match) in zip(results, times, strict=True)
        ]
    return results


def solved(capture: HeadCapture, rows: int) -> Any:
    """Shot of the paper's method with every ``rows``-th row solved."""
    return fringe_edges(
        capture.left, capture.right, capture.rig, capture.pattern, DEPTH_RANGE_M, EdgeSettings(rows=rows)
    ).shot


def processor_times_ms(capture: HeadCapture, rows: Sequence[int], repeats: int) -> list[tuple[float, float]]:
    """Medians of processor time on one thread, whole method and matching alone, the settings turn by turn."""
    threads = get_num_threads()
    set_num_threads(1)
    try:
        jobs: list[Callable[[], object]] = []
        for every in rows:
            jobs += [lambda every=every: solved(capture, every), matching(capture, every)]  # type: ignore[misc]
        taken = np.empty((repeats + 1, len(jobs)))
        for turn in range(repeats + 1):
            for number_, job in enumerate(jobs):
                begin = time.process_time()
                job()
                taken[turn, number_] = time.process_time() - begin
    finally:
        set_num_threads(threads)
    # The first turn loads the kernels.
    medians = 1e3 * np.median(taken[1:], axis=0)
    return [(float(whole), float(match)) for whole, match in medians.reshape(-1, 2)]


def matching(capture: HeadCapture, rows: int) -> Callable[[], EdgeMatch]:
    """Return the matching of a capture's edges as a job of its own: dynamic programme and propagation."""
    method = FringeEdges(capture.rig, capture.pattern, DEPTH_RANGE_M, EdgeSettings(rows=rows))
    room = method.room(capture.left.dtype)
    method.find((capture.left, capture.right), room)
    method.solve(capture.left, 0.0, room)
    edges = room.left, room.right, room.candidates
    return lambda: match_edges(*edges, method.rules, (room.match, room.tables))


def draw_times(results: Sequence[SpeedUp], path: Path) -> None:
    """Times and points against the setting."""
    figure = Figure(figsize=(8.5, 3.4), layout="constrained")
    times, points = figure.subplots(1, 2)
    rows = [str(one.rows) for one in results]
    times.plot(rows, [one.whole_ms for one in results], "o-", color=BLUE, label="whole method")
    times.plot(rows, [one.match_ms for one in results], "s--", color=ORANGE, label="matching alone")
    times.set(xlabel="one row solved of (rows)", ylabel="processor time (ms)", ylim=(0, None))
    times.legend(fontsize=8)
    points.plot(rows, [1e-3 * one.points for one in results], "o-", color=BLUE)
    points.set(
        xlabel="one row solved of (rows)", ylabel="points found (thousand)", ylim=(0, 1.2e-3 * results[0].points)
    )
    for axes in (times, points):
        axes.grid(True, alpha=0.3)
    save(figure, path)


def experiment(results: Sequence[SpeedUp]) -> Experiment:
    """Tell times and scores."""
    rows = tuple(
        (
            f"1 of {one.rows}", number(one.whole_ms, 1), number(one.match_ms, 2), f"{one.points}", percent(one.agree),
            percent(one.score.outlier_share), number(one.score.median_error_mm),
        )
        for one in results
    )  # fmt: skip
    columns = (
        "rows solved",
        "whole ms",
        "matching ms",
        "points",
        "as with all rows %",
        "off > 1 px %",
        "median error mm",
    )
    note = (
        "Processor time on one thread, medians of runs turn by turn. As with all rows: share of the points that solving"
        " every row finds as well, at the same fringe order."
    )
    table = Table("Propagation between rows", note, columns, rows)
    all_rows, best = results[0], min(results, key=lambda one: one.match_ms)
    last = min(results, key=lambda one: one.whole_ms)
    matching_gain, whole_gain = all_rows.match_ms / best.match_ms, all_rows.whole_ms / last.whole_ms
    text = (
        f"`fringe_edges` on `{SCENE}` with every row solved, and with some rows solved and the others taking over "
        f"their neighbours' matches. Matching alone becomes up to {matching_gain:.1f} times as fast, the whole method "
        f"{whole_gain:.2f} times: with compiled code the dynamic programme is "
        f"{100 * all_rows.match_ms / all_rows.whole_ms:.0f} % of the time, finding edges and candidates is the rest. "
        "Small parts between solved rows are lost."
    )
    claim = Claim(
        "conclusion",
        "solving some rows and comparing neighbours improves the sensing speed",
        f"matching {matching_gain:.1f} x, whole method {whole_gain:.2f} x, "
        f"{100 * (1 - best.points / all_rows.points):.1f} % fewer points at 1 of {best.rows}",
        "yes" if whole_gain > 1.2 else "no",
    )
    title = "Conclusion: propagation between rows"
    return Experiment("conclusion_rows", title, text, (table,), (claim,), lambda path: draw_times(results, path))
