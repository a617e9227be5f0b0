"""Choice of the fringe order: dynamic programmes along rows and columns over the few candidates.

The paper's row programme (section 3.4) sees one epipolar line and needs order along it, which thin things before a far
background break. Here four programmes, left, right, up and down, charge every depth jump once and are added up, so a
pixel's order is also decided by the rows above and below, and no ordering is assumed. One step of a programme is

    state[label] = cost[label] + min(before[label + t] - min(before), jump)

with t the label step from the pixel to the one before on one surface. It is done for a whole line of pixels at once: a
row for the programmes up and down; for those to the left and right a column, in blocks of rows that are transposed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import get_num_threads, njit, prange

from moire_sensor.order_cost import UNITS
from moire_sensor.order_step import (
    ANEW,
    NEVER,
    NO_RANK,
    add,
    advance,
    rank,
    steps_between,
    take_best,
    take_second,
)
from moire_sensor.order_transpose import transpose_back, transpose_bytes
from moire_sensor.phase_carrier import Float32

Int8 = npt.NDArray[np.int8]
UInt8 = npt.NDArray[np.uint8]
# So large that a block stays in a core's cache, and a stripe's states in its fastest.
BLOCK_ROWS = 64
STRIPE_COLUMNS = 640


class OrderPaths:
    """Cheapest order of every pixel by four programmes; owns all the memory it needs.

    Parameters
    ----------
    rows, width : (n,) the rows of the image that the programmes see, and its width, pixels.
    labels : number of candidate orders, at most 127.
    jump_cost : cost of leaving the surface, in units of a full mismatch.

    Attributes
    ----------
    rows : as given.
    cost : (lines, labels, columns) uint8, in 1/85, to be filled before :meth:`solve`. Larger than the rows seen by a
        margin that the programmes need: fill ``cost[:n, :, :width]``.
    """

    def __init__(self, rows: npt.NDArray[np.int64], width: int, labels: int, jump_cost: float) -> None:
        height = rows.size
        columns, lines = 8 * (width // 8 + 1), 8 * (height // 8 + 1)
        lanes = min(BLOCK_ROWS, lines)
        workers = get_num_threads()
        self.rows = rows
        self._jump = np.int16(round(float(UNITS) * jump_cost))
        # Between rows that each speak for several a jump weighs less against what they cost, as between rows of each.
        self._jump_down = np.int16(round(float(UNITS) * jump_cost / float(np.diff(rows).max(initial=1))))
        self.cost = np.zeros((lines, labels, columns), dtype=np.uint8)
        self._total = np.zeros((lines, labels, columns), dtype=np.int16)
        self._down = np.full((lines, width), ANEW, dtype=np.int8)
        self._across = np.full((lines, columns), ANEW, dtype=np.int8)
        self._block_cost = np.zeros((workers, columns, labels, lanes), dtype=np.uint8)
        self._block_across = np.zeros((workers, columns, lanes), dtype=np.int8)
        self._block_total = np.full((workers, columns, labels + 3, lanes), NEVER, dtype=np.int16)
        self._block_states = np.zeros((workers, 2, labels + 3, lanes), dtype=np.int16)
        stripes = min(max(-(-width // STRIPE_COLUMNS), workers), width)
        stripe = -(-width // stripes)
        self._stripe_states = np.zeros((stripes, 2, labels + 3, stripe), dtype=np.int16)
        self._stripe_ranks = np.zeros((stripes, 2, stripe), dtype=np.int32)
        self._label, self._runner_up = np.zeros((2, height, width), dtype=np.int8)
        self._margin = np.zeros((height, width), dtype=np.float32)

    def solve(self, offset_rad: Float32) -> tuple[Int8, Int8, Float32]:
        """Return the cheapest label, the second cheapest, and by how much it costs more, for :attr:`cost`.

        Parameters
        ----------
        offset_rad : (H, W) float32 wrapped phase offset, NaN where unknown; tells which labels of neighbours continue
            one surface.

        Returns
        -------
        (n, W) int8 labels, -1 where the phase is unknown; (n, W) int8, -1 also where there is one label only;
        (n, W) float32, 0 where the phase is unknown. The next call overwrites them.
        """
        fill_steps(offset_rad, self.rows, self._across, self._down)
        fill_row_paths(
            self.cost.view(np.uint64), self._across.view(np.uint64), self._block_cost, self._block_cost.view(np.uint64),
            self._block_across, self._block_across.view(np.uint64), self._block_total,
            self._block_total.view(np.uint64), self._block_states, self._jump, self._total.view(np.uint64),
        )  # fmt: skip
        choose_by_columns(
            self.cost, self._total, self._down, offset_rad, self.rows, self._stripe_states, self._stripe_ranks,
            self._jump_down, self._label, self._runner_up, self._margin,
        )  # fmt: skip
        return self._label, self._runner_up, self._margin


@njit(parallel=True, cache=True)
def fill_steps(offset, rows, across, down):  # type: ignore[no-untyped-def]
    """Fill the label steps from every pixel to its left and to its upper neighbour; the image's borders stay ANEW."""
    for number in prange(rows.size):
        line = np.int64(number)
        here = offset[rows[line]]
        steps_between(here[1:], here[:-1], across[line, 1 : here.size])
        if line > 0:
            steps_between(here, offset[rows[line - 1]], down[line])


@njit(parallel=True, cache=True)
def fill_row_paths(  # type: ignore[no-untyped-def]
    cost_words, across_words, cost, cost_in, across, across_in, total, total_words, states, jump, total_out
):
    """Fill ``total_out`` with the programmes to the right and left, a block of rows at a time.

    The middle arguments hold one block for each worker: (workers, columns, labels, lanes), as numbers and as words.
    """
    rows, workers, lanes = total_out.shape[0], cost.shape[0], cost.shape[3]
    for number in prange(workers):
        worker = np.int64(number)
        for block in range(worker, (rows + lanes - 1) // lanes, workers):
            first = min(block * lanes, rows - lanes)
            transpose_bytes(across_words, first, across_in[worker])
            for label in range(cost.shape[2]):
                transpose_bytes(cost_words[:, label], first, cost_in[worker, :, label])
            row_paths(cost[worker], across[worker], states[worker], jump, total[worker])
            for label in range(cost.shape[2]):
                transpose_back(total_words[worker, :, label + 1], total_out[:, label], first)


@njit(cache=True)
def row_paths(cost, across, states, jump, total):  # type: ignore[no-untyped-def]
    """Fill ``total`` (columns, labels + 3, lanes) of one block, laid out as states; its last column is margin.

    The programme to the right keeps its states there, beginning from the margin; that to the left adds its own.
    """
    columns, labels = cost.shape[:2]
    for x in range(columns - 1):
        advance(cost[x], across[x], 1, jump, total[x - 1], total[x])
    states[:] = NEVER
    for x in range(columns - 2, -1, -1):
        state = states[x % 2]
        advance(cost[x], across[x + 1], -1, jump, states[(x + 1) % 2], state)
        for label in range(1, labels + 1):
            add(state[label], total[x, label])


@njit(parallel=True, cache=True)
def choose_by_columns(  # type: ignore[no-untyped-def]
    cost, total, down, offset, rows, states, ranks, jump, label, runner_up, margin
):
    """Fill the results: the programmes downwards and upwards, a stripe of columns at a time, added to ``total``."""
    width = label.shape[1]
    for number in prange(states.shape[0]):
        stripe = np.int64(number)
        first = stripe * states.shape[3]
        last = min(first + states.shape[3], width)
        add_downwards(cost, total, down, states[stripe], jump, first, last)
        choose_upwards(
            cost, total, down, offset, rows, states[stripe], ranks[stripe], jump, first, last, label, runner_up,
            margin,
        )  # fmt: skip


@njit(cache=True)
def add_downwards(cost, total, down, states, jump, first, last):  # type: ignore[no-untyped-def]
    """Add the programme downwards to ``total``, columns first to last - 1."""
    states[:] = NEVER
    for y in range(cost.shape[0] - 1):
        state = states[y % 2]
        advance(cost[y, :, first:last], down[y, first:last], 1, jump, states[(y + 1) % 2], state)
        for label in range(cost.shape[1]):
            add(state[label + 1], total[y, label, first:last])


@njit(cache=True)
def choose_upwards(  # type: ignore[no-untyped-def]
    cost, total, down, offset, rows, states, ranks, jump, first, last, label, runner_up, margin
):
    """Finish ``total`` with the programme upwards, line by line, and choose; columns first to last - 1."""
    states[:] = NEVER
    best, second = ranks[0, : last - first], ranks[1, : last - first]
    for y in range(label.shape[0] - 1, -1, -1):
        state = states[y % 2]
        advance(cost[y, :, first:last], down[y + 1, first:last], -1, jump, states[(y + 1) % 2], state)
        ranks[:] = NO_RANK
        for candidate in range(cost.shape[1]):
            rank(state[candidate + 1], total[y, candidate, first:last], np.int32(candidate), best, second)
        known = offset[rows[y], first:last]
        take_best(best, second, known, label[y, first:last], margin[y, first:last])
        take_second(second, known, runner_up[y, first:last])
