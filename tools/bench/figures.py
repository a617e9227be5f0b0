"""Records to tables: which figures are shown, how they are averaged, and where we are not ahead."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tools.bench.accuracy import Record
from tools.bench.conditions import DEFAULT
from tools.bench.confidence import TrustRecord
from tools.bench.dot_scan import Trial
from tools.bench.growth import GrowthRecord, MemoryRecord
from tools.bench.latency import LatencyRecord
from tools.bench.makers import MakerRecord
from tools.bench.speed import THREADS, SpeedRecord
from tools.bench.stages import StageRecord
from tools.bench.tables import Table, number, percent

# (field of Score, heading, larger is better, what counts as equal)
FIGURES = (
    ("completeness", "complete %", True, 5e-4),
    ("completeness_away", "complete away %", True, 5e-4),
    ("right_share", "right %", True, 5e-4),
    ("outlier_share", "off > 1 px %", False, 5e-4),
    ("outlier_share_away", "away from edges %", False, 5e-4),
    ("outlier_share_near", "near edges %", False, 5e-4),
    ("median_error_mm", "median mm", False, 5e-3),
    ("ghost_share", "ghosts %", False, 5e-4),
)
# What fringe_edges is judged by: it is sparse on purpose.
DENSE_METHODS = ("dense", "phase_shift")


@dataclass(frozen=True)
class Row:
    """Figures of one method in one place (a scene or a condition)."""

    place: str
    method: str
    values: tuple[float, ...]


def scene_rows(records: Sequence[Record]) -> list[Row]:
    """Return one row a scene and method, default condition."""
    return [
        Row(one.scene, one.method, tuple(getattr(one.score, name) for name, *_ in FIGURES))
        for one in records
        if one.condition == DEFAULT.name
    ]


def condition_rows(records: Sequence[Record]) -> list[Row]:
    """Return one row a condition and method: means over the whole scenes, and the median of their medians."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for one in records:
        if one.part_of_scene:
            continue
        groups.setdefault((one.condition, one.method), []).append(one)
    rows = []
    for (condition, method), group in groups.items():
        values = [known([getattr(one.score, name) for one in group], name == "median_error_mm") for name, *_ in FIGURES]
        rows.append(Row(condition, method, tuple(values)))
    return rows


def known(values: Iterable[float], median: bool) -> float:
    """Mean or median of the values that are not NaN; NaN when there are none."""
    finite = [value for value in values if not math.isnan(value)]
    if not finite:
        return float("nan")
    return float(np.median(finite) if median else np.mean(finite))


def score_table(title: str, note: str, place: str, rows: Sequence[Row]) -> Table:
    """Lay rows out, the place told once."""
    cells = []
    last = ""
    for row in rows:
        shown = [shown_as(name)(value) for value, (name, *_) in zip(row.values, FIGURES, strict=True)]
        cells.append((row.place if row.place != last else "", row.method, *shown))
        last = row.place
    return Table(title, note, (place, "method", *(heading for _, heading, *_ in FIGURES)), tuple(cells))


def shown_as(figure: str) -> Callable[[float], str]:
    """Return how a figure is written."""
    return number if figure == "median_error_mm" else percent


def not_ahead(title: str, note: str, place: str, rows: Sequence[Row], peers: Sequence[str]) -> Table:
    """List every figure in which a peer beats ``dense`` or ``phase_shift``; an asterisk marks who is behind."""
    cells = []
    for here in dict.fromkeys(row.place for row in rows):
        by_method = {row.method: row.values for row in rows if row.place == here}
        for index, (name, heading, larger, equal) in enumerate(FIGURES):
            sign = 1.0 if larger else -1.0
            rivals = {peer: sign * by_method[peer][index] for peer in peers if peer in by_method}
            rivals = {peer: value for peer, value in rivals.items() if not math.isnan(value)}
            if not rivals:
                continue
            best = max(rivals, key=lambda peer: rivals[peer])
            show = shown_as(name)
            own, behind = [], False
            for method in DENSE_METHODS:
                value = by_method.get(method, (math.nan,) * len(FIGURES))[index]
                late = method in by_method and not rivals[best] - sign * value <= equal
                behind |= late
                own.append(show(value) + (" *" if late else ""))
            if behind:
                cells.append((here, heading, *own, show(sign * rivals[best]), best))
    return Table(title, note, (place, "figure", *DENSE_METHODS, "best peer", "which"), tuple(cells))


def trust_table(records: Sequence[TrustRecord], note: str) -> Table:
    """Lay out how far confidence and predicted errors can be believed."""
    rows = [
        (
            one.place,
            one.method,
            number(100.0 * one.off_of_sure),
            percent(one.sure_of_right),
            number(one.error_by_sigma, 2),
        )
        for one in records
    ]
    columns = ("place", "method", "off > 1 px of the confident %", "confident of the right %", "error / sigma")
    return Table("Confidence", note, columns, tuple(rows))


def maker_table(records: Sequence[MakerRecord], note: str) -> Table:
    """Lay out point precision, planarity and trueness by distance."""
    rows = [
        (
            f"{one.distance_m:g}",
            one.method,
            number(one.precision_mm),
            number(one.planarity_mm),
            number(one.distance_error_mm),
            number(one.step_error_mm),
            number(one.width_error_mm, 2),
        )
        for one in sorted(records, key=lambda one: one.distance_m)
    ]
    figures = ("precision", "planarity", "distance error", "step error", "width error")
    columns = ("distance m", "method", *(f"{figure} mm" for figure in figures))
    return Table("Point precision, planarity, trueness", note, columns, tuple(rows))


def speed_table(records: Sequence[SpeedRecord], note: str) -> Table:
    """Lay out the ratios to StereoBM of the same run, one row a method and size, threads side by side."""
    keys = dict.fromkeys((one.case.image_size, one.case.depth_range_m, one.method) for one in records)
    threads = sorted({one.case.threads for one in records})
    rows = []
    for size, (near, far), method in keys:
        row = [f"{size[0]}x{size[1]}, {near:g}-{far:g} m", method]
        for count in threads:
            found = [
                one
                for one in records
                if (one.case.image_size, one.case.depth_range_m, one.method, one.case.threads)
                == (size, (near, far), method, count)
            ]
            row += [number(found[0].milliseconds, 1), number(found[0].ratio, 2)] if found else ["-", "-"]
        rows.append(tuple(row))
    columns = [text for count in threads for text in (f"ms, {count} thread{'s' * (count > 1)}", "ratio")]
    return Table("Speed", note, ("images, depth range", "method", *columns), tuple(rows))


def stage_table(records: Sequence[StageRecord], note: str) -> Table:
    """Lay out what each stage of ``dense`` takes, and the whole."""
    rows = [(one.name, *(number(ms, 2) for ms in one.milliseconds)) for one in records]
    whole = np.sum([one.milliseconds for one in records], axis=0)
    rows.append(("the whole", *(number(float(ms), 2) for ms in whole)))
    columns = tuple(f"ms, {count} thread{'s' * (count > 1)}" for count in THREADS)
    return Table("Stages", note, ("stage", *columns), tuple(rows))


def growth_table(records: Sequence[GrowthRecord], note: str) -> Table:
    """Lay out how time grows."""
    rows = [
        (one.method, str(one.threads), number(one.by_pixels, 2), number(one.by_range, 2)) for one in records
    ]
    columns = ("method", "threads", "time per pixel, 1920x1080 to 640x480", "time, 0.3-3 m to 0.5-2 m")
    return Table("Growth", note, columns, tuple(rows))


def memory_table(records: Sequence[MemoryRecord], note: str) -> Table:
    """Lay out peaks of memory."""
    rows = [
        ("x".join(str(length) for length in one.image_size), one.method, number(one.peak_mb, 0),
         number(one.peak_mb - one.imports_mb, 0))
        for one in records
    ]  # fmt: skip
    return Table("Memory", note, ("images", "method", "peak MB", "without imports MB"), tuple(rows))


def latency_table(records: Sequence[LatencyRecord], note: str) -> Table:
    """Lay out what became of the sets, and how late the results came."""
    rows = [
        (
            one.case.name,
            *(str(count) for count in (one.exposures, one.results, one.lost, one.superseded)),
            number(one.hz, 1),
            number(one.latency_ms(50.0), 1),
            number(one.latency_ms(99.0), 1),
        )
        for one in records
    ]
    columns = ("subscribed", "sets", "results", "lost", "superseded", "Hz", "p50 ms", "p99 ms")
    return Table("Over DDS", note, columns, tuple(rows))


def scan_table(trials: Sequence[Trial], note: str) -> Table:
    """Lay out the merit of every dot size and window."""
    dots = sorted({trial.method.dot_px for trial in trials})
    keys = dict.fromkeys((trial.method.kind, trial.method.window_px) for trial in trials)
    merits = {trial.method: trial.merit for trial in trials}
    rows = []
    for kind, window in keys:
        own = {m.dot_px: merit for m, merit in merits.items() if (m.kind, m.window_px) == (kind, window)}
        rows.append((f"{kind}, window {window} px", *(number(own.get(dot, math.nan)) for dot in dots)))
    return Table("Dot size and window", note, ("matcher", *(f"dots of {dot:g} px" for dot in dots)), tuple(rows))
