"""Tables for the terminal and for docs/bench.md."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Title, an explaining sentence or two, and text cells; the first column is aligned left, the rest right."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def as_text(self) -> str:
        """Return aligned columns for a terminal."""
        grid = [self.columns, *self.rows]
        widths = [max(len(row[index]) for row in grid) for index in range(len(self.columns))]
        lines = ["  ".join(aligned(row, widths)).rstrip() for row in grid]
        lines.insert(1, "  ".join("-" * width for width in widths))
        return "\n".join([f"\n{self.title}", *lines])

    def as_markdown(self) -> str:
        """Return a section with the note and the table."""
        marks = ["---", *["---:"] * (len(self.columns) - 1)]
        lines = ["| " + " | ".join(row) + " |" for row in (self.columns, marks, *self.rows)]
        return "\n".join([f"## {self.title}", "", self.note, "", *lines, ""])


def aligned(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    """Pad the cells of a row."""
    return [text.ljust(width) if index == 0 else text.rjust(width) for index, (text, width) in
            enumerate(zip(row, widths, strict=True))]


def percent(share: float) -> str:
    """Return a share in percent with two decimals."""
    return "-" if math.isnan(share) else f"{100.0 * share:.2f}"


def number(value: float, digits: int = 3) -> str:
    """Return a number, or a dash for NaN."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
