"""From the edges of both images to the points: what can be done row by row, in one go.

A block of rows goes through all of it before the next one begins, so that it stays in the processor's cache.
"""

from __future__ import annotations

from numba import njit, prange

from moire_sensor.edge_candidates import intersect_rows
from moire_sensor.edge_grid import light_rows
from moire_sensor.edge_lanes import LANES, block_rows, lane_blocks
from moire_sensor.edge_place import place_rows
from moire_sensor.edge_programme import match_block


@njit(parallel=True, cache=True, error_model="numpy")
def solve_image(  # type: ignore[no-untyped-def]
    left, right, projector, ends, up_rad, step_rad, candidates, rules, sides, near, lefts, rights, band, work, match,
    image, limits, lens, step_turns, levels, sums, grid, counts,
):  # fmt: skip
    """Fill candidates (section 3.3), matches (section 3.4) and the grid; ``counts`` tells mismatches lane by lane."""
    height = image.shape[0]
    for index in prange(LANES):
        first, last = lane_blocks(index, height, rules.rows)
        for block in range(first, last):
            begin, behind = block_rows(block, height, rules.rows)
            intersect_rows(right, begin, behind, projector, ends, up_rad, step_rad, candidates)
            match_block(begin, behind, left, right, candidates, rules, sides, near, lefts, rights, band, work, match)
            light_rows(left, match, image, begin, behind, limits, levels[index], sums[index], grid)
            place_rows(left, right, candidates, match, begin, behind, limits, lens, step_turns, grid, counts[index])
