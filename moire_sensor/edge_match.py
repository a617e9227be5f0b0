"""The correspondences of least cost between the fringe edges of both images (section 3.4)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from moire_sensor.edge_candidates import Candidates
from moire_sensor.edge_confirm import Sides
from moire_sensor.edge_cost import Rules
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_lanes import LANES
from moire_sensor.edge_programme import MOST_EDGES, Work, match_rows

# Edges are two pixels apart.
WIDEST_PX = 2 * MOST_EDGES


class EdgeMatch(NamedTuple):
    """Correspondence of each left edge, (H, E) int32.

    Attributes
    ----------
    partner : number of the right edge in its row, -1 where there is none.
    candidate : which candidate of that right edge the left edge confirms.
    """

    partner: npt.NDArray[np.int32]
    candidate: npt.NDArray[np.int32]


def room_for_matches(left: EdgeRows) -> EdgeMatch:
    """Memory for the correspondences of the left edges."""
    return EdgeMatch(*(np.empty(left.x_px.shape, dtype=np.int32) for _ in range(2)))


def room_for_work(left: EdgeRows, right: EdgeRows, candidates: int, width_px: int = WIDEST_PX) -> tuple[Sides, Work]:
    """Tables of the dynamic programme, one a lane, for so many ``candidates`` of a right edge."""
    most = max(left.x_px.shape[1], right.x_px.shape[1])

    def table(*shape: int, dtype: type[np.generic]) -> npt.NDArray[Any]:
        return np.empty((LANES, *shape), dtype=dtype)

    sides = Sides(
        x_px=table(2, most + 1, dtype=np.float32),
        height=table(2, most + 1, dtype=np.float32),
        edge=table(2, most + 1, dtype=np.uint32),
        before=table(2, width_px // 2 + 2, dtype=np.uint32),
        candidate=table(candidates * most + 1, dtype=np.uint32),
        at=table(candidates * most + 1, dtype=np.uint32),
        first=table(most + 1, dtype=np.uint32),
    )
    work = Work(
        added=table(most, dtype=np.int64),
        path=table(most, dtype=np.int64),
        skipped=table(most + 1, dtype=np.int64),
        previous=table(most, most, dtype=np.int32),
    )
    return sides, work


def match_edges(
    left: EdgeRows,
    right: EdgeRows,
    candidates: Candidates,
    rules: Rules,
    every_row: int = 1,
    room: tuple[EdgeMatch, tuple[Sides, Work]] | None = None,
) -> EdgeMatch:
    """Choose, on every ``every_row``-th row, the matches of least cost J.

    ``J = N_oc lambda_oc - N_m lambda_r + sum d(x_i, y_i)`` with one occlusion for each run of unmatched edges. Only
    matches with d < ``lambda_mat`` are correspondences; one of which just the side agrees bridges the ordering, without
    depth.
    """
    match, work = room or (room_for_matches(left), room_for_work(left, right, candidates.left_x_px.shape[1]))
    match.partner[:] = -1
    match_rows(left, right, candidates.left_x_px, rules, every_row, *work, match.partner, match.candidate)
    return match
