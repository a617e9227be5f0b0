"""A stream that falls silent: when it is one, and when not; without ROS."""

from __future__ import annotations

import pytest

from moire_sensor.ros.silence import SilenceWatch

STREAMS = ("left", "right", "state")
AFTER_S = 1.0


def fed(stamps: dict[str, list[int]], period_s: float = 0.1) -> tuple[SilenceWatch, float]:
    """A watch after each stream brought its stamps, stamp n at n periods; and the time of the last message."""
    watch = SilenceWatch(STREAMS)
    last_s = 0.0
    for stamp in sorted({stamp for kept in stamps.values() for stamp in kept}):
        for stream in STREAMS:
            if stamp in stamps[stream]:
                last_s = stamp * period_s
                watch.note(stream, stamp, last_s)
    return watch, last_s


@pytest.mark.parametrize("lost", STREAMS)
def test_one_that_stops_is_named_a_second_after_it_is_missed_and_not_before(lost: str) -> None:
    stamps = {stream: list(range(5 if stream == lost else 40)) for stream in STREAMS}
    watch, _ = fed(stamps)
    missed_s = 0.5
    assert watch.silent(AFTER_S, missed_s + 0.99) == ()
    assert watch.silent(AFTER_S, missed_s + 1.01) == (lost,)


def test_one_that_never_came_is_named_too() -> None:
    watch, last_s = fed({"left": list(range(20)), "right": [], "state": list(range(20))})
    assert watch.silent(AFTER_S, last_s) == ("right",)


@pytest.mark.parametrize("period_s", [0.1, 10.0])
def test_a_head_that_pauses_as_a_whole_or_is_slow_is_not_silent(period_s: float) -> None:
    watch, last_s = fed({stream: list(range(6)) for stream in STREAMS}, period_s)
    assert watch.silent(AFTER_S, last_s + 1000.0) == ()


def test_one_that_is_back_is_no_longer_named() -> None:
    stamps = {stream: list(range(40)) for stream in STREAMS}
    stamps["right"] = [*range(5), 39]
    watch, last_s = fed(stamps)
    assert watch.silent(AFTER_S, last_s) == ()


def test_stamps_that_jump_back_begin_anew() -> None:
    watch, last_s = fed({stream: list(range(100, 120)) for stream in STREAMS})
    for stamp in range(20):
        for stream in ("left", "state"):
            watch.note(stream, stamp, last_s + 0.1 * stamp)
    assert watch.silent(AFTER_S, last_s + 0.9) == ()
    assert watch.silent(AFTER_S, last_s + 1.1) == ("right",)
    watch.note("right", 19, last_s + 2.0)
    assert watch.silent(AFTER_S, last_s + 100.0) == ()


def test_one_that_lags_by_a_few_exposures_is_not_silent() -> None:
    watch = SilenceWatch(STREAMS)
    for stamp in range(50):
        watch.note("left", stamp, 0.1 * stamp)
        watch.note("state", stamp, 0.1 * stamp)
        if stamp >= 5:
            watch.note("right", stamp - 5, 0.1 * stamp)
        assert watch.silent(AFTER_S, 0.1 * stamp) == ()
