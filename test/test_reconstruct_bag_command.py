"""The command reconstruct_bag: arguments, exit codes, many bags at once, signals, a full disk, a cluster."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest
from bag_runs import DEPTH, copy_bag, first_sets, of_topic
from rosbags.rosbag2 import Reader
from small_disk import start_on_small_disk

from moire_sensor.ros.bag_options import read_arguments
from moire_sensor.ros.bag_reader import Bag

COMMAND = str(Path(sysconfig.get_path("scripts")) / "reconstruct_bag")
# A bound for a hang, not a measurement; kernels may have to be compiled first.
TIMEOUT_S = 180.0
QUICK = ("--topics", "depth/image_rect")


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )


@pytest.fixture(scope="module")
def two_sets(dense_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_bag(dense_bag, tmp_path_factory.mktemp("two") / "good", first_sets(2))


def row(output: str, bag: Path) -> list[str]:
    """The cells of a bag in the table."""
    return next(line.split() for line in output.splitlines() if line.startswith(f"{bag} "))[1:]


def wait_for(happened: Callable[[], object], process: subprocess.Popen[str]) -> None:
    """Wait until something happened while a process runs."""
    deadline = time.monotonic() + TIMEOUT_S
    while not happened():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_good_and_bad_bags_together(dense_bag: Path, two_sets: Path, tmp_path: Path) -> None:
    cut = copy_bag(dense_bag, tmp_path / "cut", first_sets(4))
    with (cut / "cut.mcap").open("r+b") as stream:
        stream.truncate(2_000_000)
    lone = shutil.copy(two_sets / "good.mcap", tmp_path / "lone.mcap")
    text = tmp_path / "text.mcap"
    text.write_text("no bag")
    done = run(cut, text, two_sets, lone, "--out", tmp_path / "out", "--jobs", "2", *QUICK)
    assert done.returncode == 1, done
    assert row(done.stdout, cut)[:4] == ["damaged", "3", "3", "0"]
    assert row(done.stdout, text)[:4] == ["failed", "0", "0", "0"]
    assert row(done.stdout, two_sets)[:4] == row(done.stdout, Path(lone))[:4] == ["whole", "2", "2", "0"]
    assert f"{cut}: cut.mcap: no whole record at byte" in done.stdout
    assert f"{text}: cannot read the bag {text}" in done.stdout
    assert "Traceback" not in done.stderr
    for name in ("good", "lone"):
        assert len(of_topic(tmp_path / "out" / name, DEPTH)) == 2
    again = run(two_sets, lone, cut, "--out", tmp_path / "out", *QUICK)
    assert again.returncode == 2, again
    assert again.stdout.count("whole, done before") == 2
    assert f"{cut}: cut.mcap: no whole record at byte" in again.stdout


def children(process: subprocess.Popen[str]) -> list[int]:
    """Process ids of those that work on a bag."""
    found = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [pid for pid in map(int, found) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]


def test_a_process_that_dies_takes_no_other_bag_with_it(dense_bag: Path, two_sets: Path, tmp_path: Path) -> None:
    long = copy_bag(dense_bag, tmp_path / "long", first_sets(5))
    process = subprocess.Popen(
        [COMMAND, long, two_sets, "--out", tmp_path / "out", "--jobs", "2"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        # The first process has the first bag; it is killed once that bag is begun.
        wait_for((tmp_path / "out" / "long" / "metadata.yaml").exists, process)
        os.kill(children(process)[0], signal.SIGKILL)
        output, errors = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert process.returncode == 1, errors
    assert row(output, two_sets)[:3] == ["whole", "2", "2"]
    assert row(output, long)[0] == "failed"
    assert f"{long}: its process ended with code -9; run again to go on" in output
    done = run(long, "--out", tmp_path / "out")
    assert row(done.stdout, long)[:3] == ["whole", "5", "5"]
    assert len(of_topic(tmp_path / "out" / "long", DEPTH)) == 5


@pytest.mark.parametrize(("number", "count"), [(signal.SIGINT, 1), (signal.SIGTERM, 2)])
def test_a_signal_ends_in_order_and_the_next_run_goes_on(
    dense_bag: Path, tmp_path: Path, number: signal.Signals, count: int
) -> None:
    bags = [copy_bag(dense_bag, tmp_path / f"bag{index}") for index in range(count)]
    command = [COMMAND, *map(str, bags), "--out", str(tmp_path / "out"), "--part-mb", "2"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        wait_for((tmp_path / "out" / "bag0" / "bag0_1.mcap").exists, process)
        process.send_signal(number)
        output, errors = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert row(output, bags[0])[0] == "interrupted"
    assert f"{bags[0]}: interrupted: give the same command again to go on" in output
    done = run(*command[1:])
    assert done.returncode == 0, done
    assert row(done.stdout, bags[0])[:3] == ["whole", "10", "10"]
    for bag in bags:
        # The signal may find any bag but the first whole already.
        assert " ".join(row(done.stdout, bag)).startswith(("whole 10 10", "whole, done before"))
        stamps = [one.header.stamp for one in of_topic(tmp_path / "out" / bag.name, DEPTH)]
        assert stamps == [one.header.stamp for one in of_topic(dense_bag, DEPTH)]


def test_a_full_disk_is_told_and_the_bag_so_far_whole(dense_bag: Path, tmp_path: Path) -> None:
    bag = copy_bag(dense_bag, tmp_path / "bag")
    disk = tmp_path / "disk"
    # A first result needs 32 MB of room, later ones twice what one took, 9 MB.
    process = start_on_small_disk(disk, 80, [COMMAND, str(bag), "--out", f"{disk}/out", "--reserve-mb", "8"])
    output = process.communicate(timeout=TIMEOUT_S)[0]
    assert process.returncode == 1, output
    assert f"{bag}: the disk of {disk}/out/bag is full" in output
    written = len(of_topic(disk / "out" / "bag", DEPTH))
    assert 2 <= written <= 7
    with Reader(disk / "out" / "bag") as reader:
        assert sum(connection.topic == DEPTH for connection, _, _ in reader.messages()) == written
    # With room again, the rest follows.
    done = run(bag, "--out", disk / "out")
    assert done.returncode == 0, done
    assert len(of_topic(disk / "out" / "bag", DEPTH)) == 10


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "the following arguments are required: IN, --out"),
        (("bag",), "the following arguments are required: --out"),
        (("bag", "--out", "o", "--mehtod", "dense"), "unrecognized arguments: --mehtod"),
        (("bag", "--out", "o", "--method", "magic"), "parameter method is 'magic'; allowed are dense, phase_shift"),
        (("bag", "--out", "o", "--min-depth-m", "-1"), "it must be a number from 0 to 100"),
        (("bag", "--out", "o", "--min-depth-m", "2", "--max-depth-m", "1"), "the nearest must be the smaller"),
        (("bag", "--out", "o", "--topics", "depth,color"), "depth color is no result; allowed are depth/image_rect"),
        (("bag", "--out", "o", "--jobs", "0"), "0 is not from 1 to 1024"),
        (("a/bag", "b/bag.mcap", "--out", "o"), "would both become"),
        (("o/bag", "--out", "o"), "would be overwritten; choose another --out"),
        (("bag", "--out", "o", "--ros-args", "-p", "metod:=dense"), "unknown parameter metod"),
        (("bag", "--out", "o", "--ros-args", "--params-file", "none.yaml"), "cannot read the parameter file none.yaml"),
        (("bag", "--out", "o", "--ros-args", "-r", "a:=b"), "unknown argument -r a:=b"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(
    arguments: tuple[str, ...], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run(*arguments)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert says in done.stderr
    assert not list(tmp_path.iterdir())


def test_settings_come_from_options_parameters_and_files(tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(
        "/**/reconstruction:\n  ros__parameters:\n    method: phase_shift\n    min_depth_m: 0.4\n    queue_depth: 5\n"
        "virtual_head:\n  ros__parameters:\n    scene: moon\n"
    )
    options = read_arguments(
        ["bag.db3.zstd", "--max-depth-m", "3", "--out", str(tmp_path), "--ros-args", "--params-file", str(file), "-p",
         "min_amplitude:=5"]
    )  # fmt: skip
    values = options.tasks[0].values
    assert (values["method"], values["min_depth_m"], values["max_depth_m"]) == ("phase_shift", 0.4, 3.0)
    assert values["min_amplitude"] == 5.0
    assert options.tasks[0].target == tmp_path / "bag"


def test_help_tells_settings_and_exit_codes() -> None:
    done = run("--help")
    assert done.returncode == 0
    for text in ("--half-height-px", "--scheduler", "Exit code: 0"):
        assert text in done.stdout


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """A Dask scheduler and one worker as processes; yields the address."""
    address = folder / "scheduler.json"
    programs = [["scheduler", "--host", "127.0.0.1", "--port", "0"], ["worker", "--nthreads", "2"]]
    processes: list[subprocess.Popen[bytes]] = []
    try:
        for program in programs:
            command = [sys.executable, "-m", f"distributed.cli.dask_{program[0]}", *program[1:], "--no-dashboard"]
            command += ["--scheduler-file", str(address)]
            with (folder / f"{program[0]}.log").open("wb") as log:
                processes.append(subprocess.Popen(command, cwd=folder, stdout=log, stderr=subprocess.STDOUT))
        deadline = time.monotonic() + TIMEOUT_S
        while not address.exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield json.loads(address.read_text())["address"]
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(TIMEOUT_S)


@pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not installed: pip install distributed")
def test_a_cluster_works_on_the_bags(dense_bag: Path, two_sets: Path, tmp_path: Path) -> None:
    text = tmp_path / "text.mcap"
    text.write_text("no bag")
    other = copy_bag(dense_bag, tmp_path / "other", first_sets(3))
    with cluster(tmp_path) as address:
        done = run(two_sets, text, other, "--out", tmp_path / "out", "--scheduler", address, *QUICK)
    assert done.returncode == 1, done
    assert row(done.stdout, two_sets)[:3] == ["whole", "2", "2"]
    assert row(done.stdout, other)[:3] == ["whole", "3", "3"]
    assert row(done.stdout, text)[0] == "failed"
    with Bag(tmp_path / "out" / "other") as bag:
        assert sum(1 for _ in bag.messages([DEPTH])) == 3


def test_a_cluster_that_is_not_there_is_told(two_sets: Path, tmp_path: Path) -> None:
    done = run(two_sets, "--out", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("error: ")
    assert "Dask" in done.stderr.splitlines()[-1]
