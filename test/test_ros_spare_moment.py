"""What can wait is done in a spare moment, and not put off for ever."""

from __future__ import annotations

from moire_sensor.ros.spare_moment import SpareMoment


def test_idle_it_is_done_at_once_and_then_once_in_a_period() -> None:
    moment = SpareMoment()
    assert [now_s for now_s in range(100, 112) if moment.is_now(now_s, 5.0, busy=False)] == [100, 105, 110]


def test_while_work_waits_it_is_put_off_until_none_does() -> None:
    moment = SpareMoment()
    assert not moment.is_now(0.1, 5.0, busy=True)
    assert moment.is_now(0.2, 5.0, busy=False)
    assert not moment.is_now(5.3, 5.0, busy=True)
    assert moment.is_now(5.4, 5.0, busy=False)


def test_where_work_always_waits_it_is_put_off_by_a_period() -> None:
    moment = SpareMoment()
    assert [now_s for now_s in range(32) if moment.is_now(now_s, 5.0, busy=True)] == [5, 15, 25]


def test_a_shorter_period_counts_at_once() -> None:
    moment = SpareMoment()
    assert moment.is_now(0.0, 3600.0, busy=False)
    assert not moment.is_now(10.0, 3600.0, busy=False)
    assert moment.is_now(10.0, 5.0, busy=False)
