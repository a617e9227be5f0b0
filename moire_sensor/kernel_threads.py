"""Kernels that several threads of a program start: who gets how many threads."""

from __future__ import annotations

from numba import config, set_num_threads, threading_layer

from moire_sensor.errors import SettingsError


def share_kernel_threads(among: int) -> None:
    """Give the kernels that the calling thread starts its share of the threads, as one of so many that start some."""
    set_num_threads(max(config.NUMBA_NUM_THREADS // max(among, 1), 1))


def check_parallel_kernels() -> None:
    """Raise SettingsError where kernels must not run from two threads at a time; to be called after some kernel ran."""
    if threading_layer() == "workqueue":
        raise SettingsError(
            "numba found neither OpenMP nor TBB, and its own threads serve one set at a time only: install libgomp1 "
            "(apt), or set parallel_sets to 1"
        )
