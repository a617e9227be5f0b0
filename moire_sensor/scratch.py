"""Work memory that reconstructors of one thread share, so that one for every phase step costs no more than one."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

T = TypeVar("T")
# Phases, programmes and matches of one image size, of single shots (some rows, then all) and of phase steps, its grey
# levels and borders.
KEPT = 12


class Pools(threading.local):
    """One pool of work memory a thread, least recently used first."""

    def __init__(self) -> None:
        self.kept: OrderedDict[Hashable, Any] = OrderedDict()


_pools = Pools()


def scratch(key: Hashable, make: Callable[[], T]) -> T:
    """Return this thread's work memory of a key, made when it is first wanted.

    What it holds is only good until somebody else in the thread asks for the same key: nothing that a user keeps may
    live there.
    """
    kept = _pools.kept
    if key not in kept:
        kept[key] = make()
    kept.move_to_end(key)
    if len(kept) > KEPT:
        kept.popitem(last=False)
    value: T = kept[key]
    return value
