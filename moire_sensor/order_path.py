"""Choice of the fringe order: dynamic programmes along rows and columns over the few candidates.

The paper's row programme (section 3.4) sees one epipolar line and needs order along it, which thin things before a far
background break. Here four programmes, left, right, up and down, charge every depth jump once and are added up, so a
pixel's order is also decided by the rows above and below, and no ordering is assumed. One step of a programme is

    state[label] = cost[label] + min(before[label + t] - min(before), jump)

with t the label step from the pixel to the one before on one surface. It is done for a whole line of pixels at once: a
row for the programmes up and down; for those to the left and right a column, in blocks of rows that are transposed.
What counts of a programme is how far it lets a state rise above its cost.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import get_num_threads, njit, prange

from moire_sensor.apart import UNCOUNTED
from moire_sensor.order_step import ANEW, FIRST, MORE, NEVER, advance, rank, steps_between, take
from moire_sensor.order_tiles import LANES, put_line, strips_of, tiles_for
from moire_sensor.order_transpose import WORDS, transpose
from moire_sensor.order_weigh import UNITS
from moire_sensor.phase_carrier import Float32

Int8 = npt.NDArray[np.int8]


class OrderPaths:
    """Cheapest order of every pixel by four programmes; owns all the memory it needs.

    Parameters
    ----------
    rows, width : the number of rows that the programmes see, and their width, pixels.
    labels : number of candidate orders, at most 127.
    jump_cost : cost of leaving the surface, in units of a full mismatch. No programme speaks more than one full
        mismatch against an order; a jump beyond that only binds each programme by itself.

    Attributes
    ----------
    cost : (strips, lines, labels, LANES) uint8 as :mod:`moire_sensor.order_tiles` lays them out, in 1/85, to be filled
        before :meth:`solve`.
    """

    def __init__(self, rows: int, width: int, labels: int, jump_cost: float) -> None:
        height, strips, workers = rows, strips_of(width), get_num_threads()
        columns = LANES * strips
        self._jump = np.int16(round(float(UNITS) * jump_cost))
        self.cost, self._rises = tiles_for(height, width, labels), tiles_for(height, width, labels)
        self._down, self._across = (np.full_like(tiles_for(height, width, 1), ANEW).view(np.int8) for _ in range(2))
        self._steps = np.full((workers, 1, strips, LANES), ANEW, dtype=np.int8)
        self._block_cost, self._block_rises = np.zeros((2, workers, columns, labels, LANES), dtype=np.uint8)
        self._block_across = np.zeros((workers, columns, 1, LANES), dtype=np.int8)
        self._room = np.zeros((workers, WORDS, WORDS, WORDS), dtype=np.uint64)
        self._states = np.zeros((max(workers, strips), 2, labels + 2, LANES), dtype=np.int16)
        self._lowest = np.zeros((max(workers, strips), 2, LANES), dtype=np.int16)
        self._last = np.zeros((strips, labels, LANES), dtype=np.uint8)
        self._totals = np.zeros((strips, 2, LANES), dtype=np.int16)
        self._ranked = np.zeros((strips, 2, LANES), dtype=np.int8)
        self._label, self._runner_up = np.zeros((2, height, width), dtype=np.int8)
        self._margin = np.zeros((height, width), dtype=np.float32)

    def solve(self, offset_rad: Float32) -> tuple[Int8, Int8, Float32]:
        """Return the cheapest label, the second cheapest, and by how much it costs more, for :attr:`cost`.

        Parameters
        ----------
        offset_rad : (n, W) float32 wrapped phase offset, NaN where unknown; tells which labels of neighbours continue
            one surface.

        Returns
        -------
        (n, W) int8 labels, -1 where the phase is unknown; (n, W) int8, -1 also where there is one label only;
        (n, W) float32, 0 where the phase is unknown. The next call overwrites them.
        """
        words = np.uint64
        fill_steps(offset_rad, self._steps, self._across, self._down)
        say_along_rows(
            self.cost.view(words), self._across.view(words), self._label.shape[1], self._block_cost,
            self._block_cost.view(words), self._block_across, self._block_across.view(words), self._block_rises,
            self._block_rises.view(words), self._room, self._states, self._lowest, self._jump, self._rises.view(words),
        )  # fmt: skip
        choose_by_columns(
            self.cost, self._rises, self._down, offset_rad, self._states, self._lowest, self._last,
            self._totals, self._ranked, self._jump, self._label, self._runner_up, self._margin,
        )  # fmt: skip
        return self._label, self._runner_up, self._margin


@njit(parallel=True, cache=True)
def fill_steps(offset, lines, across, down):  # type: ignore[no-untyped-def]
    """Fill the label steps from every pixel to its left and to its upper neighbour; the image's borders stay ANEW."""
    workers, rows, width = lines.shape[0], offset.shape[0], offset.shape[1]
    for number in prange(workers):
        worker = np.int64(number)
        line = lines[worker]
        steps = line.reshape(line.size)
        for index in range(worker * rows // workers, (worker + 1) * rows // workers):
            here = offset[index]
            steps[0] = ANEW
            steps_between(here[1:], here[:-1], steps[1:width])
            put_line(line, across[:, index])
            if index > 0:
                steps_between(here, offset[index - 1], steps[:width])
                put_line(line, down[:, index])


@njit(parallel=True, cache=True)
def say_along_rows(  # type: ignore[no-untyped-def]
    cost, across, width, block_cost, cost_in, block_across, across_in, block_rises, rises_out, room, states, lowest,
    jump, rises,
):  # fmt: skip
    """Fill ``rises`` with what the programmes to the right and left say, a block of LANES rows at a time.

    The block's arrays hold one for each worker, (workers, columns, labels, LANES), as numbers and as words.
    """
    workers = room.shape[0]
    for number in prange(workers):
        worker = np.int64(number)
        for block in range(worker, cost.shape[1] // LANES, workers):
            rows = slice(block * LANES, (block + 1) * LANES)
            for strip in range(cost.shape[0]):
                columns = slice(strip * LANES, (strip + 1) * LANES)
                transpose(across[strip, rows], room[worker], across_in[worker, columns])
                transpose(cost[strip, rows], room[worker], cost_in[worker, columns])
            along_rows(
                block_cost[worker], block_across[worker, :, 0], width, states[worker], lowest[worker], jump,
                block_rises[worker],
            )  # fmt: skip
            for strip in range(cost.shape[0]):
                columns = slice(strip * LANES, (strip + 1) * LANES)
                transpose(rises_out[worker, columns], room[worker], rises[strip, rows])


@njit(**UNCOUNTED)
def along_rows(cost, across, width, states, lowest, jump, rises):  # type: ignore[no-untyped-def]
    """Fill ``rises`` (columns, labels, LANES) of one block; before the first column of each way none is cheap."""
    states[:] = NEVER
    lowest[:] = NEVER
    for x in range(width):
        now, before = x % 2, (x + 1) % 2
        advance(
            cost[x], across[x], 1, jump, FIRST, states[before], lowest[before], states[now], lowest[now], rises[x]
        )  # fmt: skip
    states[:] = NEVER
    lowest[:] = NEVER
    for x in range(width - 1, -1, -1):
        now, before = x % 2, (x + 1) % 2
        advance(
            cost[x], across[min(x + 1, width - 1)], -1, jump, MORE, states[before], lowest[before], states[now],
            lowest[now], rises[x],
        )  # fmt: skip


@njit(parallel=True, cache=True)
def choose_by_columns(  # type: ignore[no-untyped-def]
    cost, rises, down, offset, states, lowest, last, totals, ranked, jump, label, runner_up, margin
):
    """Fill the results, a strip of columns at a time: the programmes downwards and upwards, added to ``rises``."""
    for number in prange(cost.shape[0]):
        strip = np.int64(number)
        say_downwards(cost[strip], down[strip, :, 0], states[strip], lowest[strip], jump, rises[strip], offset.shape[0])
        choose_upwards(
            cost[strip], rises[strip], down[strip, :, 0], offset, states[strip], lowest[strip], last[strip],
            totals[strip], ranked[strip], jump, strip * LANES, label, runner_up, margin,
        )  # fmt: skip


@njit(**UNCOUNTED)
def say_downwards(cost, down, states, lowest, jump, rises, count):  # type: ignore[no-untyped-def]
    """Add what the programme downwards says to ``rises`` (lines, labels, LANES)."""
    states[:] = NEVER
    lowest[:] = NEVER
    for y in range(count):
        now, before = y % 2, (y + 1) % 2
        advance(cost[y], down[y], 1, jump, MORE, states[before], lowest[before], states[now], lowest[now], rises[y])


@njit(**UNCOUNTED)
def choose_upwards(  # type: ignore[no-untyped-def]
    cost, rises, down, offset, states, lowest, last, totals, ranked, jump, first, label, runner_up, margin
):
    """Finish with the programme upwards, line by line, and choose; columns from ``first`` on."""
    states[:] = NEVER
    lowest[:] = NEVER
    height, end = label.shape[0], min(first + LANES, label.shape[1])
    for y in range(height - 1, -1, -1):
        now, before = y % 2, (y + 1) % 2
        advance(
            cost[y], down[min(y + 1, height - 1)], -1, jump, FIRST, states[before], lowest[before], states[now],
            lowest[now], last,
        )  # fmt: skip
        rank(cost[y], rises[y], last, totals[0], totals[1], ranked[0], ranked[1])
        take(
            totals[0], totals[1], ranked[0], ranked[1], offset[y, first:end], label[y, first:end],
            runner_up[y, first:end], margin[y, first:end],
        )  # fmt: skip
