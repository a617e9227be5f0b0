"""Runs of a row, pixels side by side on one surface, and the gaps between them: what mending starts from.

Nearly everything there is to mend lies at the ends of runs, so rows are searched for those first, many pixels at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from moire_sensor.apart import NAN_SAFE, ROW

# Marks are looked for so many at a time.
WORD = 8
# Tasks that rows are dealt out to in turn, so that busy parts of an image fall to all threads; each has its own memory.
TASKS = 32


@njit
def marks_for(size):  # type: ignore[no-untyped-def]
    """Memory for ``size`` marks: whole words of bytes, a byte at least beyond the last mark, all zero."""
    return np.zeros(size // WORD * WORD + WORD, dtype=np.uint8)


@njit(fastmath=NAN_SAFE)
def list_edges(line, limit, marks, edges):  # type: ignore[no-untyped-def]
    """Fill the first columns of the runs and gaps of a row, and its length after the last; return how many.

    Within a run neighbours lie at most ``limit`` pixels apart. ``marks`` is memory of :func:`marks_for`, zero beyond
    the row; ``edges`` is memory for W + 1 columns.
    """
    mark_edges(line, limit, marks)
    count = list_marked(marks, edges)
    edges[count] = line.size
    return count


@njit(fastmath=NAN_SAFE)
def list_marked(marks, places):  # type: ignore[no-untyped-def]
    """Fill the places of the marks that are set, in order, and return how many; marks as of :func:`list_edges`."""
    words, count = marks.view(np.uint64), 0
    for word in range(words.size):
        if words[word] > 0:
            for x in range(word * WORD, (word + 1) * WORD):
                if marks[x]:
                    places[count] = x
                    count += 1
    return count


@njit(**ROW)
def mark_edges(line, limit, marks):  # type: ignore[no-untyped-def]
    """Mark the pixels of a row that begin a run or a gap between runs."""
    marks[0] = 1
    for x in range(1, line.size):
        here, before = line[x], line[x - 1]
        known = (here == here) | (before == before)
        marks[x] = known & (not abs(here - before) <= limit)
