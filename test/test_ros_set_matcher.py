"""The exact-stamp matcher: order, loss, repetition, loops and seeks, without ROS."""

from __future__ import annotations

import itertools
import random

import pytest

from moire_sensor.errors import SettingsError
from moire_sensor.ros.set_matcher import MatchedSet, SetMatcher

STREAMS = ("left", "right", "state")


def matcher(**options: int) -> SetMatcher[str]:
    return SetMatcher(STREAMS, **options)


def feed(to: SetMatcher[str], stamps: list[int] | range, streams: tuple[str, ...] = STREAMS) -> list[int]:
    """Send whole sets, stream by stream; return the stamps handed out."""
    handed = [to.add(name, stamp, f"{name}{stamp}") for stamp in stamps for name in streams]
    return [one.stamp_ns for one in handed if one is not None]


def test_a_set_is_handed_out_with_its_last_message_and_holds_the_right_items() -> None:
    under_test = matcher()
    assert under_test.add("left", 5, "l") is None
    assert under_test.add("state", 5, "s") is None
    assert under_test.add("right", 5, "r") == MatchedSet(5, {"left": "l", "state": "s", "right": "r"})
    assert under_test.counts.matched == 1
    assert under_test.counts.received == {"left": 1, "right": 1, "state": 1}
    assert under_test.open_count == 0


@pytest.mark.parametrize("order", list(itertools.permutations(STREAMS)))
def test_any_order_of_arrival_matches_every_set_once(order: tuple[str, ...]) -> None:
    under_test = matcher()
    assert feed(under_test, range(1, 50), order) == list(range(1, 50))
    assert under_test.counts.dropped == {}


@pytest.mark.parametrize("lost", STREAMS)
def test_a_lost_message_drops_its_set_with_the_stream_named_and_nothing_else(lost: str) -> None:
    under_test = matcher(patience=2)
    for name in STREAMS:
        if name != lost:
            under_test.add(name, 3, name)
    assert feed(under_test, [4, 5, 6, 7]) == [4, 5, 6, 7]
    assert under_test.counts.dropped == {f"missing {lost}": 1}
    assert under_test.open_count == 0


def test_near_stamps_do_not_match() -> None:
    under_test = matcher()
    for offset, name in enumerate(STREAMS):
        assert under_test.add(name, 1_000_000 + offset, name) is None
    assert under_test.counts.matched == 0


def test_a_silent_stream_keeps_memory_bounded_and_counts_every_set() -> None:
    under_test = matcher(capacity=8)
    for stamp in range(1000):
        under_test.add("left", stamp, "l")
        under_test.add("state", stamp, "s")
        assert under_test.open_count <= 2 * 9
    assert under_test.counts.dropped == {"missing right": 1000 - 8}


def test_one_stream_running_ahead_within_the_capacity_loses_nothing() -> None:
    under_test = matcher(capacity=8)
    for stamp in range(8):
        under_test.add("left", stamp, "l")
    assert feed(under_test, range(8), ("right", "state")) == list(range(8))


def test_a_lagging_stream_at_the_start_is_not_taken_for_a_jump() -> None:
    under_test = matcher()
    under_test.add("right", 2, "r")
    under_test.add("left", 1, "l")
    under_test.add("left", 2, "l")
    matched = under_test.add("state", 2, "s")
    assert matched is not None
    assert (matched.stamp_ns, matched.after_jump) == (2, False)
    assert under_test.counts.jumps == 0


def test_an_older_whole_set_after_a_newer_one_is_superseded() -> None:
    under_test = matcher()
    feed(under_test, [1, 2])
    under_test.add("left", 3, "l")
    assert feed(under_test, [4]) == [4]
    assert under_test.add("right", 3, "r") is None
    assert under_test.add("state", 3, "s") is None
    counts = under_test.counts
    assert (counts.matched, counts.superseded, counts.dropped) == (3, 1, {})


def test_repeated_messages_change_nothing_but_a_count() -> None:
    under_test = matcher()
    handed = [
        under_test.add(name, stamp, f"{name}{stamp}")
        for stamp in range(10) for name in STREAMS for _ in range(2)
    ]
    assert [one.stamp_ns for one in handed if one is not None] == list(range(10))
    assert under_test.counts.repeated == 30
    assert under_test.counts.jumps == 0


def test_a_repeated_older_message_does_not_disturb_open_sets() -> None:
    under_test = matcher()
    feed(under_test, range(5))
    under_test.add("left", 5, "l")
    under_test.add("left", 2, "again")
    assert feed(under_test, [5], ("right", "state")) == [5]
    assert under_test.counts.jumps == 0


@pytest.mark.parametrize("length", [2, 3, 5, 7, 8, 9, 10, 16, 100])
def test_every_round_of_a_loop_yields_the_same_sets(length: int) -> None:
    under_test = matcher(capacity=8)
    stamps = list(range(100, 100 + length))
    for _ in range(4):
        assert feed(under_test, stamps) == stamps
    counts = under_test.counts
    assert (counts.matched, counts.jumps, counts.superseded) == (4 * length, 3, 0)
    assert counts.dropped == {}


@pytest.mark.parametrize("length", [3, 8, 30])
def test_loops_also_survive_streams_that_arrive_in_blocks(length: int) -> None:
    """Each stream delivers two messages at a time, so rounds overlap at the seam."""
    under_test = matcher(capacity=8)
    stamps = list(range(10, 10 + 2 * length)) * 3
    handed = []
    for pair in zip(stamps[::2], stamps[1::2], strict=True):
        handed += [under_test.add(name, stamp, name) for name in STREAMS for stamp in pair]
    assert [one.stamp_ns for one in handed if one is not None] == stamps


def test_the_first_set_after_a_jump_says_so() -> None:
    under_test = matcher()
    flags = [
        under_test.add(name, stamp, name) for stamp in (50, 51, 10, 11) for name in STREAMS
    ]
    assert [one.after_jump for one in flags if one is not None] == [False, False, True, False]


def test_a_seek_back_drops_open_sets_and_goes_on() -> None:
    under_test = matcher()
    feed(under_test, range(1000, 1020))
    under_test.add("left", 1020, "l")
    assert feed(under_test, range(10, 15)) == list(range(10, 15))
    assert under_test.counts.dropped == {"stamps jumped back": 1}
    assert under_test.counts.jumps == 1


def test_a_straggler_from_before_the_jump_does_no_harm() -> None:
    under_test = matcher()
    feed(under_test, range(100, 120))
    for stamp in (120, 1):
        under_test.add("left", stamp, "l")
    for name in ("right", "state"):
        under_test.add(name, 120, name)
    assert feed(under_test, [1], ("right", "state")) == [1]
    assert feed(under_test, range(2, 40)) == list(range(2, 40))
    assert under_test.counts.matched == 20 + 39


def test_clear_counts_under_the_given_reason_and_forgets_stamps() -> None:
    under_test = matcher()
    feed(under_test, [7, 8])
    under_test.add("left", 9, "l")
    under_test.clear("the clock jumped")
    assert under_test.counts.dropped == {"the clock jumped": 1}
    assert feed(under_test, [7]) == [7]


@pytest.mark.parametrize("seed", range(20))
def test_random_loss_repetition_and_delay_account_for_every_set(seed: int) -> None:
    """Streams keep their own order, as DDS does, but interleave freely; a message may be lost or repeated."""
    random_source = random.Random(seed)
    queues = {}
    whole = set(range(200))
    for name in STREAMS:
        queue = []
        for stamp in range(200):
            if random_source.random() < 0.05:
                whole.discard(stamp)
                continue
            queue += [stamp] * (2 if random_source.random() < 0.05 else 1)
        queues[name] = queue
    under_test = matcher(capacity=16, patience=15)
    handed = []
    while any(queues.values()):
        lag = {name: queue[0] for name, queue in queues.items() if queue}
        name = random_source.choice([name for name in lag if lag[name] <= min(lag.values()) + 4])
        one = under_test.add(name, queues[name][0], name)
        queues[name].pop(0)
        handed += [one.stamp_ns] if one is not None else []
    counts = under_test.counts
    assert handed == sorted(set(handed))
    assert set(handed) <= whole
    assert len(handed) + counts.superseded == len(whole)
    assert counts.jumps == 0
    assert under_test.open_count <= 3 * 16


@pytest.mark.parametrize(("capacity", "patience"), [(1, 1), (8, 0)])
def test_useless_limits_are_refused(capacity: int, patience: int) -> None:
    with pytest.raises(SettingsError, match="at least 2 and 1"):
        matcher(capacity=capacity, patience=patience)
