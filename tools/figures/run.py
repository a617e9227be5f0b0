"""``make figures``: the paper's experiments, each a picture with its numbers, in one run."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from tqdm import tqdm

from moire_sensor.errors import MoireError
from moire_sensor.idle_threads import let_idle_threads_sleep
from tools.figures import (
    board_shift,
    candidates,
    convex,
    free_form,
    gratings,
    real_capture,
    rig_plan,
    small_board,
    solids,
    speed_up,
)
from tools.figures.page import HEAD, Experiment, write_page

Job = tuple[str, Callable[[], Experiment]]
PAPER: tuple[Job, ...] = (
    ("rig", lambda: rig_plan.experiment(rig_plan.measure())),
    ("gratings", lambda: gratings.experiment(gratings.measure())),
    ("candidates", lambda: candidates.experiment(candidates.measure())),
    ("board", lambda: board_shift.experiment(board_shift.measure())),
    ("small board", lambda: small_board.experiment(small_board.measure())),
    ("convex", lambda: convex.experiment(convex.measure())),
    ("free form", lambda: free_form.experiment(free_form.measure())),
    ("solids", lambda: solids.experiment(solids.measure())),
    ("rows", lambda: speed_up.experiment(speed_up.measure())),
)
DOCS, CAPTURE_OUTPUT = Path("docs"), Path("demo") / "figures"
CAPTURE_HEAD = "# A recorded capture\n\nWritten by `make figures`. Grey: unknown.\n\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, draw, and write figures.md with its pictures; 0 when all was written."""
    options = parse(arguments)
    let_idle_threads_sleep()
    begin = time.monotonic()
    jobs, head = PAPER, HEAD
    if options.capture:
        jobs, head = (("capture", partial(of_capture, options.capture)),), CAPTURE_HEAD
    folder = options.output or (CAPTURE_OUTPUT if options.capture else DOCS)
    try:
        experiments = made(jobs)
    except MoireError as error:
        print(f"figures: {error}", file=sys.stderr)
        return 1
    write_page(experiments, folder, head)
    for one in experiments:
        print(f"\n{one.title}\n{one.text}")
        for table in one.tables:
            print(table.as_text())
    print(f"\nwritten: {folder / 'figures.md'} and its pictures, in {time.monotonic() - begin:.0f} s")
    return 0


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.figures.run", description=__doc__)
    parser.add_argument(
        "--capture", type=Path, metavar="FOLDER", help="a recorded capture in place of the paper's experiments"
    )
    parser.add_argument(
        "--output", type=Path, metavar="FOLDER", help=f"default: {DOCS}, for a capture {CAPTURE_OUTPUT}"
    )
    return parser.parse_args(arguments)


def of_capture(folder: Path) -> Experiment:
    """Reconstruct a capture."""
    return real_capture.experiment(real_capture.measure(folder))


def made(jobs: Sequence[Job]) -> list[Experiment]:
    """Do the jobs; a progress bar names each."""
    experiments = []
    with tqdm(total=len(jobs), unit="figure", dynamic_ncols=True) as bar:
        for name, job in jobs:
            bar.set_description(name.ljust(12))
            experiments.append(job())
            bar.update()
    return experiments


if __name__ == "__main__":
    raise SystemExit(main())
