"""The correspondences of least cost between the fringe edges of both images (section 3.4)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import config

from moire_sensor.edge_abreast import Abreast, Band, rows_abreast
from moire_sensor.edge_candidates import Candidates
from moire_sensor.edge_confirm import Near, Sides, pixels_in_reach
from moire_sensor.edge_cost import MOST_EDGES, Rules
from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_lanes import ABREAST, whole_vectors
from moire_sensor.edge_programme import Work, match_rows

# Edges are two pixels apart.
WIDEST_PX = 2 * MOST_EDGES
# Tables of each thread stay in its cache from one block of rows to the next.
THREADS = config.NUMBA_NUM_THREADS
# The left and the right rows side by side, and where in them to look.
Tables = tuple[Sides, Near, Abreast, Abreast, Band, Work]


class EdgeMatch(NamedTuple):
    """Correspondence of each left edge, (H, E) int32.

    Attributes
    ----------
    partner : number of the right edge in its row, -1 where there is none, -2 where two fringe orders fit.
    candidate : which candidate of that right edge the left edge confirms.
    """

    partner: npt.NDArray[np.int32]
    candidate: npt.NDArray[np.int32]


def room_for_matches(left: EdgeRows) -> EdgeMatch:
    """Memory for the correspondences of the left edges."""
    return EdgeMatch(*(np.empty(left.x_px.shape, dtype=np.int32) for _ in range(2)))


def room_for_work(edges: int, candidates: int, reach_px: float, width_px: int = WIDEST_PX) -> Tables:
    """Tables of the dynamic programme, one a thread, for so many ``edges`` of a row and ``candidates`` of each."""

    def table(*shape: int, dtype: type[np.generic]) -> npt.NDArray[Any]:
        return np.empty((THREADS, *shape), dtype=dtype)

    # Edges of one side are a pixel apart or more.
    edges = whole_vectors(edges)
    near, split = (ABREAST, edges * candidates * (int(2.0 * reach_px) + 3)), 2 * (edges + 1)
    return (
        Sides(
            x_px=table(split, dtype=np.float32),
            height=table(split, dtype=np.float32),
            edge=table(split, dtype=np.int32),
            seen=table(2 * (width_px + pixels_in_reach(reach_px) + 1), dtype=np.int32),
        ),
        Near(
            at=table(edges, dtype=np.int32),
            found=table(edges, dtype=np.int32),
            column=table(edges, dtype=np.float32),
            right=table(*near, dtype=np.int32),
            number=table(*near, dtype=np.int32),
            left=table(*near, dtype=np.int32),
            away_px=table(*near, dtype=np.float32),
            cost=table(*near, dtype=np.int32),
            entries=table(ABREAST, dtype=np.int64),
        ),
        rows_abreast((THREADS, edges)),
        rows_abreast((THREADS, edges)),
        Band(*(table(edges, dtype=np.int64) for _ in range(3))),
        Work(
            path=table(edges, ABREAST, dtype=np.int64),
            skipped=table(edges + 1, ABREAST, dtype=np.int64),
            state=table(4, ABREAST, dtype=np.int64),
            table=table(edges * edges + 1, ABREAST, dtype=np.int32),
            least_px=table(edges, dtype=np.float32),
            shift=table(edges, dtype=np.int32),
        ),
    )


def match_edges(
    left: EdgeRows,
    right: EdgeRows,
    candidates: Candidates,
    rules: Rules,
    room: tuple[EdgeMatch, Tables] | None = None,
) -> EdgeMatch:
    """Choose, on every ``rules.rows``-th row, the matches of least cost J; the rows between follow (conclusion).

    ``J = N_oc lambda_oc - N_m lambda_r + sum d(x_i, y_i)`` with one occlusion for each run of unmatched edges. Only
    matches with d < ``lambda_mat`` are correspondences; one of which just the side agrees bridges the ordering, without
    depth.
    """
    if room is None:
        most = max(left.x_px.shape[1], right.x_px.shape[1])
        work = room_for_work(most, candidates.left_x_px.shape[1], rules.same_side_px)
        room = room_for_matches(left), work
    match, work = room
    match_rows(left, right, candidates, rules, *work, match)
    return match
