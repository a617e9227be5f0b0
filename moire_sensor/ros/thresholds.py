"""From where on the diagnostics warn."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from moire_sensor.settings import check_ranges, setting


@dataclass(frozen=True)
class Thresholds:
    """Limits of the diagnostics; every default once, with its unit and range.

    Raises
    ------
    SettingsError
        A value outside its range; the message names it.
    """

    silent_after_s: float = setting(1.0, 0.1, 60.0, "time that a topic may lag behind the others before it is named, s")
    warn_rate_hz: float = setting(0.0, 0.0, 1000.0, "rate of whole sets below which to warn, Hz; 0: never")
    warn_superseded_share: float = setting(0.1, 0.0, 1.0, "share of sets that newer ones overtook from which to warn")
    warn_latency_s: float = setting(0.5, 0.001, 60.0, "time from a whole set to its published result to warn from, s")
    warn_unknown_share: float = setting(0.5, 0.0, 1.0, "share of pixels without depth from which to warn")
    warn_ambiguous_share: float = setting(0.1, 0.0, 1.0, "share of lit pixels of doubtful fringe order to warn from")
    warn_saturated_share: float = setting(0.05, 0.0, 1.0, "share of saturated pixels from which to warn")
    warn_dark_share: float = setting(0.5, 0.0, 1.0, "share of pixels without visible fringes from which to warn")
    warn_row_offset_px: float = setting(0.5, 0.05, 10.0, "offset of the rows of left and right to warn from, pixels")
    warn_period_error: float = setting(0.04, 0.001, 1.0, "relative error of the fringe period from which to warn")
    check_period_s: float = setting(5.0, 0.1, 3600.0, "time between measurements of row offset and fringe period, s")

    def __post_init__(self) -> None:
        check_ranges(self)


def read_thresholds(values: dict[str, Any]) -> Thresholds:
    """Return the thresholds of a node's parameter values."""
    return Thresholds(**{item.name: values[item.name] for item in fields(Thresholds)})
