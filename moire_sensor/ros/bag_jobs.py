"""Many bags at once: a process for each, or the workers of a Dask cluster; one bad bag stops none of the others."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import FrameType
from typing import Any

import numba

from moire_sensor.errors import SettingsError
from moire_sensor.ros.bag_reconstruction import reconstruct_bag
from moire_sensor.ros.bag_task import BagOutcome, BagTask
from moire_sensor.ros.executable import keep_freed_memory

SIGNALS = (signal.SIGINT, signal.SIGTERM)
# How long a signal may go unnoticed while nothing is heard from the processes.
WAKE_UP_S = 0.2
# Without OpenMP and TBB, the kernels of one process must not be entered by two tasks at once (kernel_threads).
_KERNELS = threading.Lock()
Progress = Callable[[int], object]


class StopFlag:
    """Becomes true with SIGINT or SIGTERM; made in the main thread of a process."""

    def __init__(self) -> None:
        self._asked = False
        for number in SIGNALS:
            signal.signal(number, self._ask)

    def __call__(self) -> bool:
        """Tell whether a signal came."""
        return self._asked

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self._asked = True


def run_here(task: BagTask, progress: Progress, stop: Callable[[], bool]) -> BagOutcome:
    """Work on one bag in this process."""
    keep_freed_memory()
    with _KERNELS:
        if task.threads:
            numba.set_num_threads(min(task.threads, numba.config.NUMBA_NUM_THREADS))
        return reconstruct_bag(task, progress, stop)


def run_in_processes(
    tasks: Sequence[BagTask], jobs: int, progress: Progress, stop: Callable[[], bool]
) -> list[BagOutcome]:
    """Work on the bags, each in a process of its own, ``jobs`` at a time; the outcomes in the order of the tasks."""
    threads = max(1, len(os.sched_getaffinity(0)) // min(jobs, len(tasks)))
    waiting = [(number, replace(task, threads=threads)) for number, task in enumerate(tasks)]
    outcomes = {number: BagOutcome(str(task.source), "interrupted") for number, task in waiting}
    running: list[_Process] = []
    while running or (waiting and not stop()):
        while waiting and len(running) < jobs and not stop():
            running.append(_Process(*waiting.pop(0)))
        wait([process.pipe for process in running], WAKE_UP_S)
        for process in running:
            progress(process.listen())
            if stop():
                process.ask_to_stop()
        for process in [one for one in running if one.is_over]:
            outcomes[process.number] = process.outcome
            running.remove(process)
    return [outcomes[number] for number in range(len(tasks))]


class _Process:
    """One bag in a process; its end, whatever the reason, gives an outcome."""

    def __init__(self, number: int, task: BagTask) -> None:
        self.number = number
        self.outcome = BagOutcome(str(task.source))
        self.is_over = False
        self._told = False
        context = get_context("spawn")
        self.pipe, other = context.Pipe(duplex=False)
        self._process = context.Process(target=_child, args=(task, other))
        self._process.start()
        other.close()

    def listen(self) -> int:
        """Take what the process sent; return how many sets it has gone on."""
        sets = 0
        try:
            while self.pipe.poll():
                message = self.pipe.recv()
                if isinstance(message, BagOutcome):
                    self.outcome, self._told = message, True
                else:
                    sets += message
        except EOFError:
            self._process.join()
            self.is_over = True
            if not self._told:
                self.outcome.error = f"its process ended with code {self._process.exitcode}; run again to go on"
        return sets

    def ask_to_stop(self) -> None:
        """Let the process complete its part and end."""
        self._process.terminate()


def _child(task: BagTask, pipe: Connection[Any, Any]) -> None:
    """In the process: work, and send progress and outcome."""
    stop = StopFlag()
    pipe.send(run_here(task, pipe.send, stop))
    pipe.close()


def run_on_cluster(
    tasks: Sequence[BagTask], address: str, progress: Progress, stop: Callable[[], bool]
) -> list[BagOutcome]:
    """Work on the bags with the workers of a Dask cluster, which see the same files under the same paths.

    Bags under way when ``stop`` comes true are still finished by their workers.

    Raises
    ------
    SettingsError
        Dask is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client
        from distributed import wait as wait_for
    except ImportError as error:
        raise SettingsError("--scheduler needs Dask: pip install distributed, here and on the workers") from error
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise SettingsError(f"no Dask scheduler answers at {address}: {error}") from error
    outcomes = {task.source: BagOutcome(str(task.source), "interrupted") for task in tasks}
    with client:
        waiting = {client.submit(run_on_worker, task, pure=False, retries=0): task.source for task in tasks}
        while waiting and not stop():
            with suppress(TimeoutError):
                wait_for(list(waiting), timeout=WAKE_UP_S, return_when="FIRST_COMPLETED")
            for future in [one for one in waiting if one.done()]:
                source = waiting.pop(future)
                outcomes[source] = _outcome_of(future, source)
                progress(outcomes[source].sets)
        client.cancel(list(waiting))
    return [outcomes[task.source] for task in tasks]


def _outcome_of(future: Any, source: Path) -> BagOutcome:
    """Return the outcome of a bag that a cluster is done with, also where its worker died."""
    error = future.exception()
    if error is None:
        outcome: BagOutcome = future.result()
        return outcome
    return BagOutcome(str(source), error=f"the cluster gave up: {error}")


def run_on_worker(task: BagTask) -> BagOutcome:
    """Work on one bag on a worker of a cluster."""
    return run_here(task, int, bool)
