"""Threads that work on the newest jobs, so that subscriptions keep flowing; no ROS needed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from threading import Condition, Thread
from typing import Generic, TypeVar

Job = TypeVar("Job")


class Worker(Generic[Job]):
    """Run ``work(job)()`` in a thread, in order; when more wait than may, the oldest are superseded.

    After as many of these as may wait, the thread is behind: only the newest waits until it has caught up. With more
    work than it can do, a longer queue would make every result later and none more.

    Parameters
    ----------
    work : called in the thread; with more threads, for several jobs at a time. What it returns is called in the same
        thread, one at a time and in the order of the jobs. Both must handle their own errors.
    superseded : called with the number of jobs that a newer one pushed out.
    queue_depth : jobs that may wait, at least 1.
    prepare : called first, in one of the threads.
    threads : how many, at least 1.
    """

    def __init__(
        self,
        work: Callable[[Job], Callable[[], None]],
        superseded: Callable[[int], None],
        queue_depth: int,
        prepare: Callable[[], None] | None = None,
        threads: int = 1,
    ) -> None:
        self._prepare = prepare
        self._prepared: Future[None] = Future()
        self._work = work
        self._superseded = superseded
        self._queue_depth = queue_depth
        self._waiting: deque[Job] = deque()
        self._changed = Condition()
        self._begun = self._ended = 0
        self._lost = 0
        self._stopped = False
        first = Thread(target=self._run_first, name="reconstruction", daemon=True)
        others = [Thread(target=self._run, name=f"reconstruction {n}", daemon=True) for n in range(2, threads + 1)]
        self._threads = [first, *others]
        for thread in self._threads:
            thread.start()

    def is_prepared(self) -> bool:
        """Tell whether ``prepare`` is over."""
        return self._prepared.done()

    def wait_prepared(self, seconds: float) -> bool:
        """Wait until ``prepare`` is over and raise what it raised; False when it takes longer than ``seconds``."""
        try:
            self._prepared.result(seconds)
        except TimeoutError:
            if self._prepared.done():
                raise
            return False
        return True

    def set_queue_depth(self, queue_depth: int) -> None:
        """Let another number of jobs wait, from the next submission on."""
        with self._changed:
            self._queue_depth = queue_depth

    def submit(self, job: Job) -> None:
        """Queue a job; never blocks."""
        with self._changed:
            self._waiting.append(job)
            pushed_out = max(len(self._waiting) - self._queue_depth, 0)
            self._lost += pushed_out
            if self._lost >= self._queue_depth:
                pushed_out = len(self._waiting) - 1
            for _ in range(pushed_out):
                self._waiting.popleft()
            self._changed.notify_all()
        if pushed_out:
            self._superseded(pushed_out)

    def has_waiting(self) -> bool:
        """Tell whether jobs wait behind the one under way."""
        with self._changed:
            return bool(self._waiting)

    def under_way(self) -> int:
        """Return how many jobs are under way."""
        with self._changed:
            return self._begun - self._ended

    def is_idle(self) -> bool:
        """Tell whether nothing waits and nothing is under way."""
        with self._changed:
            return not self._waiting and self._begun == self._ended

    def drain(self, patience_s: float | None = None) -> bool:
        """Take no more of what waits, superseded by the pause, and wait for the end of what is under way.

        Returns False when that takes longer than ``patience_s``.
        """
        with self._changed:
            left_over = len(self._waiting)
            self._waiting.clear()
            idle = self._changed.wait_for(lambda: self._begun == self._ended, patience_s)
        if left_over:
            self._superseded(left_over)
        return idle

    def stop(self, patience_s: float | None = None) -> bool:
        """End after the jobs under way; waiting jobs are superseded by the end.

        Returns False when what is under way takes longer than ``patience_s``.
        """
        until_s = None if patience_s is None else time.monotonic() + patience_s
        with self._changed:
            self._stopped = True
            left_over = len(self._waiting)
            self._waiting.clear()
            self._changed.notify_all()
        for thread in self._threads:
            thread.join(None if until_s is None else max(until_s - time.monotonic(), 0.0))
        if left_over:
            self._superseded(left_over)
        return not any(thread.is_alive() for thread in self._threads)

    def _run_first(self) -> None:
        try:
            if self._prepare is not None:
                self._prepare()
        except Exception as error:
            with self._changed:
                self._stopped = True
                self._changed.notify_all()
            self._prepared.set_exception(error)
            return
        with self._changed:
            self._prepared.set_result(None)
            self._changed.notify_all()
        self._run()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._lost = self._lost if self._waiting else 0
                self._changed.wait_for(lambda: self._stopped or (bool(self._waiting) and self._prepared.done()))
                if self._stopped:
                    return
                job, turn = self._waiting.popleft(), self._begun
                self._begun += 1
            deliver = self._work(job)
            self._await_turn(turn)
            deliver()
            with self._changed:
                self._ended += 1
                self._changed.notify_all()

    def _await_turn(self, turn: int) -> None:
        """Wait until all jobs before have ended."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended == turn)
