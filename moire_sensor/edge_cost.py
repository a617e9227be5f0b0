"""The cost of a match of two fringe edges (section 3.4), and how paths of the dynamic programme count it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from moire_sensor.edge_candidates import RANGE_MARGIN_PX
from moire_sensor.edge_settings import EdgeSettings

# A path is one number, so that the least is the cheapest: J in units of 2^-18 from bit 24 on, its last match below.
PLACE_BITS, UNITS = 24, 2.0**18
COST = ~np.int64((1 << PLACE_BITS) - 1)
ENDLESS, NO_MATCH = np.int64(1 << 60), np.int32((1 << 31) - 1)
# A match of left edge i and right edge j has place j 2^12 + i + 1, the start place 0.
EDGE_BITS = 12
MOST_EDGES = (1 << EDGE_BITS) - 1
# Among paths of equal J, common beside occlusions, the one that meets its candidates best is taken.
TIE_BREAK = 1e-3
# Share of the largest distance from a candidate at which lambda_off has grown to its whole.
NEAR = 0.2


class Rules(NamedTuple):
    """Limits and costs of a match.

    Attributes
    ----------
    farthest, nearest : least and most disparity, pixels: constraint 1, with the depth range in place of "not negative".
    same_side_px : largest distance of a left edge from a candidate.
    The others are those of :class:`EdgeSettings`.
    """

    farthest: float
    nearest: float
    same_side_px: float
    same_height: float
    lambda_oc: float
    lambda_r: float
    lambda_mat: float
    lambda_off: float
    doubtful_share: float
    rows: int
    follow_px: float


def matching_rules(disparity_range_px: tuple[float, float], period_px: float, settings: EdgeSettings) -> Rules:
    """Rules where fringes are ``period_px`` wide, for the compiled kernels."""
    costs = (settings.lambda_oc, settings.lambda_r, settings.lambda_mat, settings.lambda_off)
    return Rules(
        disparity_range_px[0] - RANGE_MARGIN_PX,
        disparity_range_px[1] + RANGE_MARGIN_PX,
        settings.same_side_periods * period_px,
        settings.same_height,
        *costs,
        settings.doubtful_share,
        int(settings.rows),
        settings.follow_px,
    )


@njit(inline="always")
def alike(left_side, left_height, right_side, right_height, rules):  # type: ignore[no-untyped-def]
    """Whether two edges are of the same side and about the same height."""
    higher, lower = max(left_height, right_height), min(left_height, right_height)
    return left_side == right_side and higher <= rules.same_height * lower


@njit(inline="always")
def match_cost(away_px, rules):  # type: ignore[no-untyped-def]
    """What a match adds to J whose left edge lies ``away_px`` from a candidate: d of section 3.4, less the reward."""
    off = away_px * np.float32(1.0 / rules.same_side_px)
    far = min(off * np.float32(1.0 / NEAR), np.float32(1.0))
    return TIE_BREAK * off + rules.lambda_off * far * far - rules.lambda_r


@njit(inline="always")
def in_units(cost):  # type: ignore[no-untyped-def]
    """A cost in the units of a path, below ``NO_MATCH``: settings allow 1e3."""
    return np.int32(np.rint(cost * UNITS))


@njit(inline="always")
def on_path(units):  # type: ignore[no-untyped-def]
    """A cost in units, as it is added to a path."""
    return np.int64(units) << PLACE_BITS
