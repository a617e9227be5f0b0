"""The simulator's parts of the report: agreement with ray-traced truth, and real optics beside ideal ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from moire_sim.scenes import scene_names
from tools.bench.pictures import LEVELS_PX, STRIDE, UNKNOWN_COLOUR
from tools.bench.realism import (
    ALLOWED_RATIO,
    FLAW_SCENE,
    FLAWS,
    NO_FALL_OFF,
    RealismRecord,
    flaw_records,
    ratio,
    realism_records,
)
from tools.bench.tables import Table, number, percent
from tools.bench.tasks import done
from tools.bench.validation import (
    CASES,
    DEPTH_LIMIT_MM,
    EDGE_LIMIT_PX,
    PHASE_LIMIT_PX,
    Agreement,
    NoiseFigure,
    agreements,
    noise_figures,
)
from tools.small_png import save

# In pictures: near and far, round, moving, in a room.
SHOWN_SCENES = ("cylinder_and_box", "room", "kitchen_counter", "person_crossing", "corridor_drive")
VALIDATION_NOTE = (
    "The virtual head's pictures (rendered meshes) against ray-traced ones, both without noise, four phase steps:"
    " largest difference of the fringes' phase in both views, in projector columns, away from edges by 4 px; farthest"
    " pixel that is lit in one of them only, from the true border of light; largest depth error, scaled to 1 m. Through"
    f" bent lenses: rectified as the reconstruction does. Allowed: {PHASE_LIMIT_PX} px, {EDGE_LIMIT_PX:g} px,"
    f" {DEPTH_LIMIT_MM} mm."
)
NOISE_NOTE = "A realistic chip under even light of 120 grey levels, 40 exposures: measured, and by its model."
REALISM_NOTE = (
    "`dense` on the virtual head's scenes with `optics:=clean` and `optics:=realistic`, the latter rectified; moving"
    " scenes at 1.6 s. Depth range 0.5 to 2 m, in rooms to 4.5 m. Ratio: of the medians, allowed is"
    f" {ALLOWED_RATIO:g}; an asterisk marks more. Predicted: the ratio of the errors that `dense` itself predicts from"
    " the amplitude and the noise that it measures. Where both agree, light is all that is missing: the projector's"
    " light falls off with the square of the distance, so where something near sets the exposure, a far wall is dark."
    " Ideal optics light it as if it were near. Even light: the ratio under a projector that does the same, all other"
    " flaws as they are, for the scenes with an asterisk."
)
FLAW_NOTE = (
    f"What each flaw costs in `{FLAW_SCENE}`: the realistic preset with one flaw left out at a time. What is left out"
    " where the median falls most costs most."
)


@dataclass
class SimulatorResults:
    """Everything measured of the simulator; a part that was not asked for is empty."""

    agreements: list[Agreement] = field(default_factory=list)
    noise: list[NoiseFigure] = field(default_factory=list)
    realism: list[RealismRecord] = field(default_factory=list)
    flaws: list[RealismRecord] = field(default_factory=list)


def measure_simulator(parts: Sequence[str]) -> SimulatorResults:
    """Do the parts ``validation`` and ``realistic`` where they are asked for."""
    results = SimulatorResults()
    if "validation" in parts:
        results.agreements = done([(agreements, (case,)) for case in CASES], "validation")
        results.noise = noise_figures()
    if "realistic" in parts:
        results.realism = done([(realism_records, (scene,)) for scene in scene_names()], "realistic")
        results.flaws = done([(flaw_records, (name,)) for name in FLAWS], "flaws")
    return results


def simulator_tables(results: SimulatorResults) -> list[Table]:
    """Return the tables of what was measured."""
    tables = []
    if results.agreements:
        columns = ("scene", "phase px", "edge of light px", "depth mm", "judged %")
        rows = tuple(
            (one.name, number(one.phase_px, 4), number(one.edge_px, 1), number(one.depth_mm, 4), percent(one.judged))
            for one in results.agreements
        )
        tables.append(Table("Simulator: agreement with ray-traced truth", VALIDATION_NOTE, columns, rows))
    if results.noise:
        figures = tuple((one.name, number(one.measured, 4), number(one.model, 4)) for one in results.noise)
        tables.append(Table("Simulator: noise", NOISE_NOTE, ("noise", "measured", "model"), figures))
    if results.realism:
        tables.append(realism_table(results.realism))
    if results.flaws:
        tables.append(flaw_table(results.flaws))
    return tables


def realism_table(records: Sequence[RealismRecord]) -> Table:
    """Return one row a scene, both optics side by side."""
    columns = (
        "scene", "complete % clean", "realistic", "off > 1 px % clean", "realistic", "median mm clean", "realistic",
        "ratio", "predicted", "even light",
    )  # fmt: skip
    rows = []
    for clean, real in pairs_of(records):
        cells = [
            text(getattr(one.score, name))
            for name, text in (("completeness", percent), ("outlier_share", percent), ("median_error_mm", number))
            for one in (clean, real)
        ]
        mark = " *" if ratio(clean, real) > ALLOWED_RATIO else ""
        even = "".join(
            number(ratio(clean, one), 1) for one in records if (one.scene, one.optics) == (clean.scene, NO_FALL_OFF)
        )
        predicted = number(real.sigma_mm / clean.sigma_mm, 1)
        rows.append((clean.scene, *cells, number(ratio(clean, real), 1) + mark, predicted, even))
    return Table("Simulator: real optics beside ideal ones", REALISM_NOTE, columns, tuple(rows))


def flaw_table(records: Sequence[RealismRecord]) -> Table:
    """Return one row a flaw left out."""
    columns = ("left out", "complete %", "off > 1 px %", "median mm", "predicted mm")
    rows = tuple(
        (
            one.optics, percent(one.score.completeness), percent(one.score.outlier_share),
            number(one.score.median_error_mm), number(one.sigma_mm),
        )
        for one in records
    )  # fmt: skip
    return Table("Simulator: what each flaw costs", FLAW_NOTE, columns, rows)


def pairs_of(records: Sequence[RealismRecord]) -> list[tuple[RealismRecord, RealismRecord]]:
    """Return clean and realistic record of each scene."""
    by_key = {(one.scene, one.optics): one for one in records}
    scenes = dict.fromkeys(one.scene for one in records)
    return [(by_key[scene, "clean"], by_key[scene, "realistic"]) for scene in scenes]


def draw_realism(records: Sequence[RealismRecord], path: Path) -> None:
    """Write the pictures and error maps of some scenes, clean and realistic side by side."""
    pairs = pairs_of(records)
    figure = Figure(figsize=(11.0, 2.15 * len(pairs)), layout="constrained")
    places = np.atleast_2d(figure.subplots(len(pairs), 4, sharex=True, sharey=True))
    colours = ListedColormap(mpl.colormaps["PuOr"](np.linspace(0.0, 1.0, len(LEVELS_PX) + 1))).with_extremes(
        bad=UNKNOWN_COLOUR
    )
    norm = BoundaryNorm(LEVELS_PX, len(LEVELS_PX) + 1, extend="both")
    for row, pair in zip(places, pairs, strict=True):
        for number_, one in enumerate(pair):
            row[2 * number_].imshow(one.picture[::STRIDE, ::STRIDE], cmap="gray", vmin=0, vmax=255)
            row[2 * number_ + 1].imshow(
                one.error_px[::STRIDE, ::STRIDE], cmap=colours, norm=norm, interpolation="nearest"
            )
        row[0].set_ylabel(pair[0].scene, fontsize=8)
    for place, title in zip(places[0], ("clean", "error", "realistic", "error"), strict=True):
        place.set_title(title, fontsize=10)
    for place in places.flat:
        place.set(xticks=(), yticks=())
    bar = figure.colorbar(places[0, 1].images[0], ax=places, pad=0.01, fraction=0.02, aspect=40, ticks=LEVELS_PX)
    bar.set_label("disparity error (px)")
    save(figure, path)
