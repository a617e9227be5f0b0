"""The same work for both cameras at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")


def for_both(work: Callable[..., Result], *arguments: Iterable[object]) -> tuple[Result, Result]:
    """Return ``work`` of the left and of the right camera; each of ``arguments`` has a value for either.

    The kernels, numpy and OpenCV let go of the interpreter while they compute, so a second thread is a second core's.
    """
    of_left, of_right = zip(*arguments, strict=True)
    with ThreadPoolExecutor(max_workers=1) as second:
        right = second.submit(work, *of_right)
        left = work(*of_left)
        return left, right.result()
