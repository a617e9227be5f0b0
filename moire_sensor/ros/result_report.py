"""The statuses that tell what the last result looks like: light, order, rows and period."""

from __future__ import annotations

import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from moire_sensor.ros.diagnostics import OK, WARN, status_of
from moire_sensor.ros.thresholds import Thresholds

# Concern, fact, limit, and what to do about it.
SHARES = (
    ("unknown pixels", "unknown share", "warn_unknown_share", "have no depth: see the other statuses, or the range"),
    ("order ambiguity", "ambiguous share", "warn_ambiguous_share", "are of doubtful order: narrow the depth range"),
    ("saturation", "saturated share", "warn_saturated_share", "are saturated: shorten the exposure"),
    ("darkness", "dark share", "warn_dark_share", "show no fringes: lengthen the exposure or dim other light"),
)
# Almost nowhere fringes, and yet the picture is not dark: the projector does not light what the cameras see.
NO_FRINGES_SHARE = 0.95
BRIGHT_GREY = 30.0


def result_statuses(
    facts: dict[str, Any], is_fresh: bool, laser_on: bool | None, limits: Thresholds
) -> list[DiagnosticStatus]:
    """Return one status for each concern; ``facts`` are those of :func:`shot_facts` and of the last check.

    A concern is OK and ``not measured`` while there is no fresh result.
    """
    facts = facts if is_fresh else {}
    return [
        *(share_status(*share, facts, limits) for share in SHARES),
        laser_status(facts, laser_on),
        row_status(facts, limits),
        period_status(facts, limits),
    ]


def share_status(
    concern: str, name: str, limit_name: str, complaint: str, facts: dict[str, Any], limits: Thresholds
) -> DiagnosticStatus:
    """Return the status of a share of pixels that should be small."""
    limit: float = getattr(limits, limit_name)
    if name not in facts:
        return status_of(concern, OK, "not measured: no result lately", {limit_name: limit})
    share: float = facts[name]
    values = {name: share, limit_name: limit}
    if share > limit:
        return status_of(concern, WARN, f"{share:.0%} of the pixels {complaint}", values)
    return status_of(concern, OK, f"{share:.1%}", values)


def laser_status(facts: dict[str, Any], laser_on: bool | None) -> DiagnosticStatus:
    """Return whether the projector is on, as its state says and as the images show."""
    values = {"laser on": "unknown" if laser_on is None else laser_on}
    if laser_on is None:
        return status_of("laser", OK, "not known: no projector state yet", values)
    if not laser_on:
        return status_of("laser", WARN, "the projector is off; switch it on with projector/enable", values)
    values |= {name: facts[name] for name in ("dark share", "background") if name in facts}
    if facts and facts["dark share"] > NO_FRINGES_SHARE and facts["background"] > BRIGHT_GREY:
        text = "the projector is said to be on, but a bright picture shows no fringes: look at projector and focus"
        return status_of("laser", WARN, text, values)
    return status_of("laser", OK, "on", values)


def row_status(facts: dict[str, Any], limits: Thresholds) -> DiagnosticStatus:
    """Return whether left and right rows agree, as the last check found."""
    offset_px = facts.get("row offset px", math.nan)
    values = {"row offset px": offset_px, "warn_row_offset_px": limits.warn_row_offset_px}
    if math.isnan(offset_px):
        return status_of("row misalignment", OK, "not measured: too little texture, or no result lately", values)
    if abs(offset_px) > limits.warn_row_offset_px:
        text = f"the right image lies {offset_px:+.2f} rows below the left one: calibrate the pair anew"
        return status_of("row misalignment", WARN, text, values)
    return status_of("row misalignment", OK, f"{offset_px:+.2f} px", values)


def period_status(facts: dict[str, Any], limits: Thresholds) -> DiagnosticStatus:
    """Return whether the fringes have the period that projector/state tells, as the last check found.

    A period one percent off already makes the views disagree everywhere, so that all depth is refused; the size of the
    error is then known to some percent only.
    """
    error = facts.get("period error", math.nan)
    values = {"period error": error, "warn_period_error": limits.warn_period_error}
    values |= {name: facts[name] for name in ("phase mismatch rad", "fringe period px") if name in facts}
    if facts.get("ambiguous share") == 1.0 or abs(error) > limits.warn_period_error:
        text = f"the fringes seem {error:+.1%} longer than projector/state tells: check its period, or the calibration"
        if not abs(error) > limits.warn_period_error:
            text = "left, right and projector do not fit each other: check period, calibration, and for swapped cameras"
        return status_of("period mismatch", WARN, text, values)
    if math.isnan(error):
        return status_of("period mismatch", OK, "not measured: no result lately, or no fringes", values)
    return status_of("period mismatch", OK, f"{error:+.2%}", values)
