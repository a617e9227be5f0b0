"""One line of a dynamic programme over the orders, 64 lanes of it at a time."""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.angles import TURNS_PER_RAD
from moire_sensor.apart import LEAF
from moire_sensor.order_tiles import LANES
from moire_sensor.order_weigh import UNITS

NEVER = np.int16(20000)
# Instead of a label step: one of the two phases is unknown, begin anew.
ANEW = np.int8(2)
# No programme speaks more than a full mismatch against an order, so that what three of them say fits into a byte.
MOST = np.int16(UNITS)
# What a programme does with what others said before it: forget it or add to it.
FIRST, MORE = np.uint8(0), np.uint8(255)
PROGRAMMES = np.int16(4)


@njit(**LEAF)
def steps_between(here, before, steps):  # type: ignore[no-untyped-def]
    """Fill a line of label steps."""
    for lane in range(steps.size):
        steps[lane] = label_step(here[lane], before[lane])


@njit(**LEAF)
def label_step(here, before):  # type: ignore[no-untyped-def]
    """Label of the pixel before minus label here on one surface, -1 to 1, or ANEW."""
    turns = (here - before) * TURNS_PER_RAD
    step = np.int8(1) if turns >= np.float32(0.5) else np.int8(0)
    step = np.int8(-1) if turns < np.float32(-0.5) else step
    return step if turns == turns else ANEW


@njit(**LEAF)
def advance(cost, steps, turn, jump, keep, before, lowest_before, state, lowest, rises):  # type: ignore[no-untyped-def]
    """One step of a programme: states (labels + 2, LANES) of a line and the lowest from those of the line before.

    Label l lies in state l + 1 between two that are never the cheapest. ``turn`` is -1 for a programme against the
    direction of the label steps, 1 otherwise. How far each state rises above its cost goes into ``rises`` (labels,
    LANES). The choice is by the sign of a step, from three values that are read first: the compiler would else fetch
    lane by lane.
    """
    for lane in range(LANES):
        lowest[lane] = NEVER
    for label in range(cost.shape[0]):
        below, same, above = before[label + 1 - turn], before[label + 1], before[label + 1 + turn]
        own, now, rise = cost[label], state[label + 1], rises[label]
        for lane in range(LANES):
            step, down, straight, up = steps[lane], below[lane], same[lane], above[lane]
            chosen = up if step > 0 else straight
            chosen = down if step < 0 else chosen
            more = np.int16(chosen - lowest_before[lane])
            limit = np.int16(0) if step == ANEW else jump
            more = more if more < limit else limit
            value = np.int16(own[lane] + more)
            now[lane] = value
            lowest[lane] = value if value < lowest[lane] else lowest[lane]
            said = more if more < MOST else MOST
            rise[lane] = np.uint8(np.uint8(rise[lane] & keep) + np.uint8(said))


@njit(**LEAF)
def rank(cost, rises, last_rises, best, second, label, runner_up):  # type: ignore[no-untyped-def]
    """Fill the two lowest totals of a line's lanes and their labels; of equals the lower label is first."""
    for lane in range(LANES):
        best[lane], second[lane] = NEVER, NEVER
        label[lane], runner_up[lane] = -1, -1
    for candidate in range(cost.shape[0]):
        own, rise, last = cost[candidate], rises[candidate], last_rises[candidate]
        for lane in range(LANES):
            total = np.int16(PROGRAMMES * np.int16(own[lane]) + np.int16(rise[lane]) + np.int16(last[lane]))
            low, next_, first, other = best[lane], second[lane], label[lane], runner_up[lane]
            other = np.int8(candidate) if total < next_ else other
            runner_up[lane] = first if total < low else other
            label[lane] = np.int8(candidate) if total < low else first
            next_ = total if total < next_ else next_
            second[lane] = low if total < low else next_
            best[lane] = total if total < low else low


@njit(**LEAF)
def take(best, second, first, other, offset, label, runner_up, margin):  # type: ignore[no-untyped-def]
    """Fill the results where the phase is known: labels, and how far the second total lies above the lowest."""
    for lane in range(label.size):
        known = offset[lane] == offset[lane]
        above = np.float32(np.int32(second[lane]) - np.int32(best[lane])) * (np.float32(1.0) / UNITS)
        label[lane] = first[lane] if known else np.int8(-1)
        runner_up[lane] = other[lane] if known else np.int8(-1)
        margin[lane] = above if known else np.float32(0.0)
