"""One line of a dynamic programme over the orders; every loop runs over the lanes of a line."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import TURNS_PER_RAD
from moire_sensor.apart import ROW
from moire_sensor.order_cost import UNITS

NEVER = np.int16(20000)
# Instead of a label step: one of the two phases is unknown, begin anew.
ANEW = np.int8(2)
# Best and second best are ranked by total * RANKS + label.
RANKS = np.int32(128)
NO_RANK = np.int32(2**31 - 1)


@njit(**ROW)
def steps_between(here, before, steps):  # type: ignore[no-untyped-def]
    """Fill a line of label steps."""
    for lane in range(steps.size):
        steps[lane] = label_step(here[lane], before[lane])


@njit(**ROW)
def label_step(here, before):  # type: ignore[no-untyped-def]
    """Label of the pixel before minus label here on one surface, -1 to 1, or ANEW."""
    turns = (here - before) * TURNS_PER_RAD
    step = np.int8(1) if turns >= np.float32(0.5) else np.int8(0)
    step = np.int8(-1) if turns < np.float32(-0.5) else step
    return step if turns == turns else ANEW


@njit(**ROW)
def advance(cost, steps, turn, jump, before, state):  # type: ignore[no-untyped-def]
    """One step of a programme: all states (labels + 3, lanes) of a line from those of the line before.

    Label l lies in state l + 1 between two that are never the cheapest; the last holds the lowest. ``turn`` is -1 for a
    programme against the direction of the label steps, 1 otherwise.
    """
    labels = cost.shape[0]
    state[labels + 2, :] = NEVER
    for label in range(1, labels + 1):
        advance_label(
            cost[label - 1], steps, jump, before[label - turn], before[label], before[label + turn],
            before[labels + 2], state[label],
        )  # fmt: skip
        keep_lowest(state[label], state[labels + 2])


@njit(**ROW)
def advance_label(cost, steps, jump, below, same, above, lowest, state):  # type: ignore[no-untyped-def]
    """Fill one label's states of a line from those of the line before: of the label below, the same and above.

    The choice is by the sign of a step: asked for 1 and -1 the compiler fetches lane by lane, six times slower.
    """
    for lane in range(state.size):
        step, down, straight, up = steps[lane], below[lane], same[lane], above[lane]
        chosen = up if step > 0 else straight
        chosen = down if step < 0 else chosen
        rise = np.int16(chosen - lowest[lane])
        limit = np.int16(0) if step == ANEW else jump
        rise = rise if rise < limit else limit
        state[lane] = np.int16(cost[lane] + rise)


@njit(**ROW)
def keep_lowest(state, lowest):  # type: ignore[no-untyped-def]
    """Lower ``lowest`` to the states that lie below it."""
    for lane in range(lowest.size):
        value = state[lane]
        lowest[lane] = value if value < lowest[lane] else lowest[lane]


@njit(**ROW)
def add(state, total):  # type: ignore[no-untyped-def]
    """Add a line of states to the total."""
    for lane in range(total.size):
        total[lane] = np.int16(total[lane] + state[lane])


@njit(**ROW)
def rank(state, total, label, best, second):  # type: ignore[no-untyped-def]
    """Put one label's final totals where they belong among the two lowest."""
    for lane in range(best.size):
        place = np.int32(np.int32(np.int32(np.int16(state[lane] + total[lane])) * RANKS) + label)
        worse = place if place > best[lane] else best[lane]
        best[lane] = place if place < best[lane] else best[lane]
        second[lane] = worse if worse < second[lane] else second[lane]


@njit(**ROW)
def take_best(best, second, offset, label, margin):  # type: ignore[no-untyped-def]
    """Labels of the lowest totals and how far the second lie above them."""
    for lane in range(label.size):
        known = offset[lane] == offset[lane]
        above = np.int32(np.int32(second[lane] // RANKS) - np.int32(best[lane] // RANKS))
        label[lane] = np.int8(best[lane] % RANKS) if known else np.int8(-1)
        margin[lane] = np.float32(above) / UNITS if known else np.float32(0.0)


@njit(**ROW)
def take_second(second, offset, runner_up):  # type: ignore[no-untyped-def]
    """Labels of the second lowest totals."""
    for lane in range(runner_up.size):
        known = offset[lane] == offset[lane] and second[lane] != NO_RANK
        runner_up[lane] = np.int8(second[lane] % RANKS) if known else np.int8(-1)
