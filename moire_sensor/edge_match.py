"""The cost of matching fringe edges, and the correspondences of least cost (section 3.4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from moire_sensor.edge_candidates import RANGE_MARGIN_PX, Candidates
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_programme import BIN_PX, SIDE_BY_SIDE, Work, match_rows
from moire_sensor.edge_settings import EdgeSettings

# Rows are dealt out to lanes with work tables each: a fixed number, so that the result never depends on the machine.
LANES = 4


class EdgeMatch(NamedTuple):
    """Correspondence of each left edge, (H, E) int32.

    Attributes
    ----------
    partner : number of the right edge in its row, -1 where there is none.
    candidate : which candidate of that right edge the left edge confirms.
    """

    partner: npt.NDArray[np.int32]
    candidate: npt.NDArray[np.int32]


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


def matching_rules(
    disparity_range_px: tuple[float, float], period_px: float, settings: EdgeSettings
) -> Rules:
    """Rules where fringes are ``period_px`` wide, for the compiled kernels."""
    costs = (settings.lambda_oc, settings.lambda_r, settings.lambda_mat, settings.lambda_off)
    return Rules(
        disparity_range_px[0] - RANGE_MARGIN_PX,
        disparity_range_px[1] + RANGE_MARGIN_PX,
        settings.same_side_periods * period_px,
        settings.same_height,
        *costs,
    )


def room_for_matches(left: EdgeRows) -> EdgeMatch:
    """Memory for the correspondences of the left edges."""
    return EdgeMatch(*(np.empty(left.x_px.shape, dtype=np.int32) for _ in range(2)))


def room_for_work(left: EdgeRows, right: EdgeRows) -> Work:
    """Tables of the dynamic programme, one a lane."""
    most = max(left.x_px.shape[1], right.x_px.shape[1])

    def reals(*shape: int) -> npt.NDArray[np.float32]:
        return np.empty((LANES, *shape, SIDE_BY_SIDE), dtype=np.float32)

    def paths(*shape: int) -> npt.NDArray[np.int64]:
        return np.empty((LANES, *shape, SIDE_BY_SIDE), dtype=np.int64)

    return Work(
        reals(most), reals(most), reals(most), reals(most), paths(), paths(), paths(most), paths(most + 1, most + 1),
        paths(most + 1), paths(), paths(), np.empty((LANES, SIDE_BY_SIDE, 2 * most // BIN_PX + 1), dtype=np.int64),
    )  # fmt: skip


def match_edges(
    left: EdgeRows,
    right: EdgeRows,
    candidates: Candidates,
    rules: Rules,
    every_row: int = 1,
    room: tuple[EdgeMatch, Work] | None = None,
) -> EdgeMatch:
    """Choose, on every ``every_row``-th row, the matches of least cost J.

    ``J = N_oc lambda_oc - N_m lambda_r + sum d(x_i, y_i)`` with one occlusion for each run of unmatched edges. Only
    matches with d < ``lambda_mat`` are correspondences; one of which just the side agrees bridges the ordering, without
    depth.
    """
    match, work = room or (room_for_matches(left), room_for_work(left, right))
    match.partner[:] = -1
    match_rows(left, right, candidates.left_x_px, rules, every_row, work, match.partner, match.candidate)
    return match
