"""The accuracy part cut into tasks, done by one process a core."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, TypeVar

import cv2
import numba
from tqdm import tqdm

Result = TypeVar("Result")
Task = tuple[Callable[..., list[Result]], tuple[Any, ...]]
MAX_PROCESSES = 2


def one_thread() -> None:
    """Keep a process to one core."""
    cv2.setNumThreads(1)
    numba.set_num_threads(1)


def done(tasks: Sequence[Task[Result]], title: str) -> list[Result]:
    """Do all tasks, with a progress bar, and return their results in the tasks' order."""
    # Spawned, not forked: the threads of numba and OpenCV do not survive a fork.
    context = multiprocessing.get_context("spawn")
    processes = min(MAX_PROCESSES, os.cpu_count() or 1, max(len(tasks), 1))
    with ProcessPoolExecutor(processes, mp_context=context, initializer=one_thread) as pool:
        futures = [pool.submit(function, *arguments) for function, arguments in tasks]
        for _ in progress(as_completed(futures), title, len(futures)):
            pass
        return [result for future in futures for result in future.result()]


def progress(items: Any, title: str, count: int) -> Iterator[Any]:
    """Show a bar while going through items."""
    yield from tqdm(items, desc=title.ljust(12), total=count, unit="task", dynamic_ncols=True)
