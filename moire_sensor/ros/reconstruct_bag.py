"""Executable ``reconstruct_bag``: recorded bags in, bags with depth out; no DDS."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from tqdm import tqdm

from moire_sensor.errors import CaptureError, MoireError
from moire_sensor.idle_threads import let_idle_threads_sleep
from moire_sensor.ros.bag_jobs import StopFlag, run_here, run_in_processes, run_on_cluster
from moire_sensor.ros.bag_metadata import read_metadata
from moire_sensor.ros.bag_options import read_arguments
from moire_sensor.ros.bag_task import BagOutcome, BagTask
from moire_sensor.ros.head_sets import STREAM_TOPICS
from moire_sensor.ros.reconstruction_settings import read_settings

WHOLE, FAILED, DAMAGED = 0, 1, 2
HEADER = ("bag", "outcome", "sets", "results", "refused", "x real time")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the executable; returns its exit code."""
    let_idle_threads_sleep()
    stop = StopFlag()
    try:
        options = read_arguments(sys.argv[1:] if arguments is None else arguments)
        read_settings(options.values)
        outcomes = run(options.tasks, options.jobs, options.scheduler, stop)
    except MoireError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return FAILED
    print(table(outcomes))
    return exit_code(outcomes)


def run(tasks: Sequence[BagTask], jobs: int, scheduler: str | None, stop: StopFlag) -> list[BagOutcome]:
    """Work on all bags, with a progress bar where there is a terminal."""
    with tqdm(total=promised_sets(tasks), unit="set", disable=None) as bar:
        if scheduler:
            return run_on_cluster(tasks, scheduler, bar.update, stop)
        if len(tasks) == 1:
            return [run_here(tasks[0], bar.update, stop)]
        return run_in_processes(tasks, jobs, bar.update, stop)


def promised_sets(tasks: Sequence[BagTask]) -> int | None:
    """Return how many sets the bags say they hold, None where one does not say."""
    state = "/" + STREAM_TOPICS["state"][0]
    total = 0
    for task in tasks:
        try:
            counts = read_metadata(task.source).counts
        except CaptureError:
            return None
        found = [number for topic, number in counts.items() if topic.endswith(state)]
        total += sum(found)
    return total


def table(outcomes: Sequence[BagOutcome]) -> str:
    """Return one line a bag, and below it what was wrong with each."""
    rows = [HEADER, *map(row_of, outcomes)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
    lines = ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    for outcome in outcomes:
        problems = [*outcome.damages, *([outcome.error] if outcome.error else [])]
        problems += [f"refused, {reason}: {number}" for reason, number in outcome.refused.items()]
        if outcome.state == "interrupted":
            problems.append("interrupted: give the same command again to go on")
        lines += [f"{outcome.source}: {' '.join(text.split())}" for text in problems]
    return "\n".join(lines)


def row_of(outcome: BagOutcome) -> tuple[str, ...]:
    """Return the cells of one bag."""
    state = f"{outcome.state}, done before" if outcome.done_before else outcome.state
    speed = f"{outcome.bag_s / outcome.wall_s:.2f}" if outcome.bag_s and outcome.wall_s else "-"
    numbers = (outcome.sets, outcome.results, sum(outcome.refused.values()))
    return (outcome.source, state, *map(str, numbers), speed)


def exit_code(outcomes: Sequence[BagOutcome]) -> int:
    """Return 0 for whole bags, and for those that a signal left for the next run; 1 for failed, 2 for damaged ones."""
    states = {outcome.state for outcome in outcomes}
    if "failed" in states:
        return FAILED
    return DAMAGED if "damaged" in states else WHOLE


if __name__ == "__main__":
    raise SystemExit(main())
