"""What one experiment hands in, and the page made of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.bench.tables import Table

HEAD = """# The paper's experiments

Written by `make figures`: do not edit. The rig is the paper's (section 4): 640x480 pixels, f = 1250 px, the projector
53 mm and the right camera 94 mm right of the left camera, fringes of 20 mm at 1500 mm. Pictures come from the virtual
head or, where named, from ray-traced surfaces, with noise of 1.5 grey levels and lens blur; every depth is compared
with the exact truth. "Median error" is scaled to 1 m by the square of the depth; "off" is more than 1 px of disparity
(`moire_sim.score`). The paper shows pictures without numbers: the numbers are ours. In depth and error maps grey is
unknown, and points of the sparse method are drawn wider than they are.

"""
CLAIM_NOTE = "What the paper says of its figures, and what comes out here."


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, what was measured, and whether the two agree, with the reason where they do not."""

    figure: str
    says: str
    measured: str
    verdict: str


@dataclass(frozen=True)
class Experiment:
    """A reproduced figure: text, tables, and how its picture is drawn into a file."""

    name: str
    title: str
    text: str
    tables: tuple[Table, ...]
    claims: tuple[Claim, ...]
    draw: Callable[[Path], None]


def write_page(experiments: Sequence[Experiment], folder: Path, head: str = HEAD) -> None:
    """Write ``figures.md`` and ``images/figures/*.png`` into a folder."""
    images = folder / "images" / "figures"
    images.mkdir(parents=True, exist_ok=True)
    parts = [head]
    claims = [claim for one in experiments for claim in one.claims]
    if claims:
        parts.append(claim_table(claims).as_markdown().replace("---:", "---") + "\n")
    for one in experiments:
        path = images / f"{one.name}.png"
        one.draw(path)
        tables = "".join(f"\n{table.as_markdown().replace('## ', '### ', 1)}" for table in one.tables)
        parts.append(f"## {one.title}\n\n{one.text}\n\n![{one.title}](images/figures/{path.name})\n{tables}\n")
    (folder / "figures.md").write_text("".join(parts).rstrip() + "\n", encoding="utf-8")


def claim_table(claims: Sequence[Claim]) -> Table:
    """Lay the claims out, one a row."""
    rows = tuple((claim.figure, claim.says, claim.measured, claim.verdict) for claim in claims)
    return Table("Claims", CLAIM_NOTE, ("figure", "the paper says", "measured", "agrees"), rows)
