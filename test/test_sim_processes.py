"""A moving head rendered in several processes: the same pictures, and no process left behind."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sim_rigs import QUARTER_PROJECTOR, quarter_pattern, quarter_rig, real_options

from moire_sensor.errors import SettingsError
from moire_sim import HeadOptions, SimulatorError, VirtualHead
from moire_sim.open_renderer import processes_to_render
from moire_sim.parallel_renderer import ParallelRenderer
from moire_sim.render_worker import Job, RenderWorker

ROOT = Path(__file__).parents[1]
TIMEOUT_S = 60.0
CLEAN = HeadOptions(projector_size=QUARTER_PROJECTOR)
# Lines of a user's program that is stopped while three processes render.
PROGRAM = """
import sys
sys.path[:0] = ["test"]
from test_sim_processes import moving, workers_of
head = moving(3)
print(*(worker.pid for worker in workers_of(head)), flush=True)
sys.stdin.readline()
"""


def moving(processes: int, options: HeadOptions = CLEAN) -> VirtualHead:
    """A head that has moved once, with all its processes ready."""
    head = VirtualHead("corridor_drive", 3, quarter_rig(), replace(options, render_processes=processes))
    head.expose(quarter_pattern())
    head.set_head(0.01, 0.0)
    head.expose(quarter_pattern())
    for worker in workers_of(head):
        worker.wait_until_ready()
    return head


def workers_of(head: VirtualHead) -> list[RenderWorker]:
    renderer = head._renderer
    return renderer._workers if isinstance(renderer, ParallelRenderer) else []


def pictures(head: VirtualHead) -> list[np.ndarray]:
    """Both pictures and the truth of two moments of a head that turns and drives."""
    found = []
    for number in range(2):
        head.set_head(0.02 * number, -0.01 * number)
        head.set_time(0.5 * number)
        found += [*head.expose(quarter_pattern(), 0, number), head.depth_m]
    return found


@pytest.mark.parametrize(("options", "processes"), [(CLEAN, 2), (real_options(), 3)])
def test_pictures_are_the_same_to_the_bit_whoever_renders_them(options: HeadOptions, processes: int) -> None:
    with moving(1, options) as alone, moving(processes, options) as head:
        assert len(workers_of(head)) == processes - 1
        for found, wanted in zip(pictures(head), pictures(alone), strict=True):
            np.testing.assert_array_equal(found, wanted)


def test_no_process_is_started_while_everything_stands_still() -> None:
    options = replace(CLEAN, render_processes=3)
    with VirtualHead("flat_board", rig=quarter_rig(), options=options) as head:
        head.set_head(0.02, 0.0)
        for index in range(2):
            head.set_head(0.02, 0.0)
            head.set_time(0.1 * index)
            head.expose(quarter_pattern(), 0, index)
        assert not workers_of(head)
        head.set_head(0.03, 0.0)
        head.expose(quarter_pattern())
        started = workers_of(head)
        assert len(started) == 2
    assert all(worker.exit_code is not None for worker in started)


def test_the_processes_end_with_their_owner_even_when_it_is_killed() -> None:
    owner = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert owner.stdout is not None
    watched = [os.pidfd_open(int(word)) for word in owner.stdout.readline().split()]
    owner.kill()
    owner.communicate()
    assert len(watched) == 2
    for one in watched:
        # A descriptor of a process can be read when the process has ended.
        assert select.select([one], [], [], TIMEOUT_S)[0], "a process that renders has outlived its owner"
        os.close(one)


def test_a_lost_process_is_one_clear_line() -> None:
    with moving(2) as head:
        (worker,) = workers_of(head)
        os.kill(worker.pid, signal.SIGKILL)
        head.set_head(0.05, 0.0)
        with pytest.raises(SimulatorError, match=r"process that renders has ended with -9; .* render_processes 1$"):
            head.expose(quarter_pattern())


def test_what_was_begun_before_an_interrupt_does_not_answer_for_what_comes_after() -> None:
    with moving(2) as head:
        (worker,) = workers_of(head)
        renderer, view = head._renderer, head._views[0]
        first, second = Job(head._moment, view, False), Job(head._moment._replace(pan_rad=0.1), view, False)
        worker.begin(first)
        worker.begin(second)
        found = worker.result(second)
        renderer.go_to(second.moment)
        np.testing.assert_array_equal(found.depth_m, renderer.render(view).depth_m)


def test_how_many_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0})
    assert (processes_to_render(0), processes_to_render(2)) == (1, 2)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    assert processes_to_render(0) == 3
    with pytest.raises(SettingsError, match="render_processes is 4; it must be 0 to 3"):
        HeadOptions(render_processes=4)
