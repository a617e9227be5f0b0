"""The worker thread and the shared counters, without a node."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from threading import Event, Semaphore, Thread

import pytest

from moire_sensor.errors import MoireError
from moire_sensor.ros.tally import Tally
from moire_sensor.ros.worker import Worker

TIMEOUT_S = 30.0


def nothing() -> None:
    """Deliver nothing."""


def idle(_: object) -> Callable[[], None]:
    """Work on nothing."""
    return nothing


class Held:
    """Work that waits for a sign, what was done, and what was pushed out; it tells when one of ``last`` is done."""

    def __init__(self, *last: int) -> None:
        self.begun, self.go_on, self.ended = Event(), Event(), Event()
        self.done: list[int] = []
        self.pushed_out: list[int] = []
        self._last = last

    def worker(self, queue_depth: int) -> Worker[int]:
        return Worker(self.work, self.pushed_out.append, queue_depth)

    def work(self, job: int) -> Callable[[], None]:
        self.begun.set()
        assert self.go_on.wait(TIMEOUT_S)
        self.done.append(job)
        if job in self._last:
            self.ended.set()
        return nothing


def test_below_capacity_every_job_is_done_in_order() -> None:
    done: list[int] = []
    last = Event()

    def work(job: int) -> Callable[[], None]:
        done.append(job)
        if job == 99:
            last.set()
        return nothing

    pushed_out: list[int] = []
    worker = Worker(work, pushed_out.append, queue_depth=100)
    for job in range(100):
        worker.submit(job)
    assert last.wait(TIMEOUT_S)
    worker.stop()
    assert done == list(range(100))
    assert pushed_out == []
    assert worker.is_idle()


def test_above_capacity_the_newest_is_done_and_the_rest_counted() -> None:
    held = Held(49, 52)
    worker = held.worker(2)
    worker.submit(0)
    assert held.begun.wait(TIMEOUT_S)
    for job in range(1, 50):
        worker.submit(job)
    assert not worker.is_idle()
    held.go_on.set()
    assert held.ended.wait(TIMEOUT_S)
    assert held.done == [0, 49]
    assert sum(held.pushed_out) == 48
    # Once it has caught up, as many may wait as before.
    assert worker.drain(TIMEOUT_S)
    held.begun.clear()
    held.go_on.clear()
    held.ended.clear()
    for job in (50, 51, 52):
        worker.submit(job)
        assert held.begun.wait(TIMEOUT_S)
    held.go_on.set()
    assert held.ended.wait(TIMEOUT_S)
    worker.stop()
    assert held.done == [0, 49, 50, 51, 52]


def test_stop_finishes_the_job_under_way_and_counts_the_waiting_ones() -> None:
    started, go_on = Event(), Event()
    done: list[int] = []

    def work(job: int) -> Callable[[], None]:
        started.set()
        assert go_on.wait(TIMEOUT_S)
        done.append(job)
        return nothing

    pushed_out: list[int] = []
    worker = Worker(work, pushed_out.append, queue_depth=10)
    worker.submit(1)
    assert started.wait(TIMEOUT_S)
    assert not worker.has_waiting()
    worker.submit(2)
    assert worker.has_waiting()
    worker.submit(3)
    stopper = Thread(target=worker.stop)
    stopper.start()
    go_on.set()
    stopper.join(TIMEOUT_S)
    assert not stopper.is_alive()
    assert len(done) + sum(pushed_out) == 3
    assert done[0] == 1


def test_tally_counts_from_several_threads_and_keeps_the_last_text() -> None:
    tally = Tally()
    threads = [Thread(target=lambda: [tally.count("seen", "again") for _ in range(1000)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    snapshot = tally.snapshot()
    assert snapshot.counts == {"seen": 4000}
    assert snapshot.texts == {"seen": "again"}
    assert math.isnan(snapshot.latency_s(50))
    for value in (0.1, 0.2, 0.3):
        tally.add_latency(value)
    assert tally.snapshot().latency_s(50) == 0.2


def test_drain_ends_after_the_job_under_way_and_leaves_out_what_waits() -> None:
    held = Held()
    worker = held.worker(5)
    for job in range(3):
        worker.submit(job)
    assert held.begun.wait(TIMEOUT_S)
    assert not worker.drain(0.0)
    held.go_on.set()
    assert worker.drain(10.0)
    assert (held.done, held.pushed_out) == ([0], [2])
    worker.submit(9)
    assert worker.stop(10.0)


def test_waiting_for_the_preparation_tells_when_it_is_over_and_what_it_raised() -> None:
    go_on = Event()

    def prepare() -> None:
        assert go_on.wait(TIMEOUT_S)
        raise MoireError("no kernels")

    worker: Worker[int] = Worker(idle, idle, 1, prepare)
    assert not worker.wait_prepared(0.0)
    go_on.set()
    with pytest.raises(MoireError, match="no kernels"):
        worker.wait_prepared(10.0)


def test_a_smaller_queue_holds_less_from_the_next_job_on() -> None:
    go_on = Event()
    pushed_out: list[int] = []

    def prepare() -> None:
        assert go_on.wait(TIMEOUT_S)

    worker: Worker[int] = Worker(idle, pushed_out.append, 5, prepare)
    for job in range(5):
        worker.submit(job)
    worker.set_queue_depth(2)
    worker.submit(5)
    assert pushed_out == [5]
    go_on.set()
    assert worker.stop(10.0)


def test_a_burst_loses_no_more_than_what_does_not_fit() -> None:
    held = Held(13)
    worker = held.worker(10)
    worker.submit(0)
    assert held.begun.wait(TIMEOUT_S)
    for job in range(1, 14):
        worker.submit(job)
    held.go_on.set()
    assert held.ended.wait(TIMEOUT_S)
    assert worker.stop(10.0)
    assert held.done == [0, *range(4, 14)]
    assert sum(held.pushed_out) == 3


def test_two_threads_work_at_a_time_and_deliver_in_order() -> None:
    second_worked, second_delivered = Event(), Event()
    under_way: list[int] = []
    delivered: list[int] = []

    def work(job: int) -> Callable[[], None]:
        if job == 0:
            assert second_worked.wait(TIMEOUT_S)
            under_way.append(worker.under_way())
        else:
            second_worked.set()
        return partial(deliver, job)

    def deliver(job: int) -> None:
        delivered.append(job)
        if job == 1:
            second_delivered.set()

    pushed_out: list[int] = []
    worker: Worker[int] = Worker(work, pushed_out.append, 5, threads=2)
    worker.submit(0)
    worker.submit(1)
    assert second_delivered.wait(TIMEOUT_S)
    assert (delivered, under_way, pushed_out) == ([0, 1], [2], [])
    assert worker.drain(TIMEOUT_S)
    assert worker.under_way() == 0
    assert worker.stop(TIMEOUT_S)


def test_two_threads_leave_as_much_waiting_as_one() -> None:
    all_begun, go_on = Semaphore(0), Event()
    delivered: list[int] = []
    pushed_out: list[int] = []

    def work(job: int) -> Callable[[], None]:
        all_begun.release()
        assert go_on.wait(TIMEOUT_S)
        return partial(delivered.append, job)

    worker: Worker[int] = Worker(work, pushed_out.append, 2, threads=2)
    for job in range(2):
        worker.submit(job)
        assert all_begun.acquire(timeout=TIMEOUT_S)
    for job in range(2, 5):
        worker.submit(job)
    assert not worker.drain(0.0)
    go_on.set()
    assert worker.stop(TIMEOUT_S)
    assert delivered == [0, 1]
    assert sum(pushed_out) == 3


def test_a_preparation_that_fails_ends_all_threads() -> None:
    def prepare() -> None:
        raise MoireError("no kernels")

    worker: Worker[int] = Worker(idle, idle, 1, prepare, threads=3)
    with pytest.raises(MoireError, match="no kernels"):
        worker.wait_prepared(TIMEOUT_S)
    assert worker.stop(TIMEOUT_S)
