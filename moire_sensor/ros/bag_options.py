"""The command line of reconstruct_bag: bags, how to work on them, and every setting of the reconstruction node."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import yaml

from moire_sensor.errors import SettingsError
from moire_sensor.ros.bag_reader import PACKED, STORAGES
from moire_sensor.ros.bag_task import DEFAULT_TOPICS, BagTask
from moire_sensor.ros.bag_writer import MEGABYTE, Limits
from moire_sensor.ros.bag_writer import STORAGES as WRITTEN
from moire_sensor.ros.parameters import ParameterSpec
from moire_sensor.ros.reconstruction_settings import SPECS
from moire_sensor.ros.result_messages import TOPICS

NODE = "reconstruction"
# What concerns a node alone: there is no queue and nothing to subscribe to here.
ONLY_LIVE = frozenset(("queue_depth", "autostart", "reliable_input"))
SETTINGS = {spec.name: spec for spec in SPECS if spec.name not in ONLY_LIVE}
ABOUT = """\
Reconstructs recorded bags: any rosbag2 with a head's topics in, a bag with depth, sigma, confidence, status, fringe
order, cloud, camera info and /diagnostics out. No DDS, as fast as the machine goes, same bits as the node gives.
An interrupted run goes on where it was when the same command is given again; a finished bag is left as it is.
"""
AFTER = """\
Settings may also be given as for a node: --ros-args -p NAME:=VALUE --params-file FILE.
Exit code: 0, every bag was whole (or a signal ended the run: give the command again to go on); 1, wrong arguments, or
a bag that could not be reconstructed or written; 2, every bag was reconstructed, damaged ones as far as readable.
"""


class Parser(argparse.ArgumentParser):
    """Refuses in one line, as the other executables do."""

    def error(self, message: str) -> NoReturn:
        """Raise SettingsError with argparse's words."""
        raise SettingsError(f"{message}; see --help")


def read_arguments(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options; ``values`` holds those of the node, ``tasks`` one task for each bag.

    Raises
    ------
    SettingsError
        Unknown options, values out of range, or two bags of one name.
    """
    own, ros = split_ros_arguments(arguments)
    options = make_parser().parse_args(own)
    values: dict[str, Any] = {spec.name: spec.default for spec in SPECS}
    values |= ros_values(ros)
    values |= {name: value for name in SETTINGS if (value := getattr(options, name)) is not None}
    options.values = values
    options.tasks = make_tasks(options)
    return options


def make_parser() -> argparse.ArgumentParser:
    """Return the parser, with an option for each setting."""
    parser = Parser(
        "reconstruct_bag", description=ABOUT, epilog=AFTER, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bags", nargs="+", type=Path, metavar="IN", help="bag: a folder, or a lone .mcap or .db3 file")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the bags that are written")
    parser.add_argument(
        "--topics", type=topic_names, default=DEFAULT_TOPICS, metavar="NAMES",
        help=f"results to write besides /diagnostics, separated by commas, of {', '.join(TOPICS)}; default "
        f"{','.join(DEFAULT_TOPICS)}",
    )  # fmt: skip
    parser.add_argument("--storage", choices=WRITTEN, default="mcap", help="storage format of the written bags")
    parser.add_argument("--jobs", type=whole_number(1, 1024), default=cpu_count(), help="bags at the same time")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask cluster to work on, such as tcp://host:8786")
    parser.add_argument("--part-mb", type=whole_number(1, 1 << 20), default=1024, help="size of a part of a bag, MB")
    parser.add_argument("--reserve-mb", type=whole_number(1, 1 << 20), default=64, help="disk space kept free, MB")
    group = parser.add_argument_group("settings of the reconstruction")
    for spec in SETTINGS.values():
        group.add_argument(
            "--" + spec.name.replace("_", "-"), dest=spec.name, type=reader_of(spec), metavar="VALUE",
            help=f"{spec.descriptor().description} ({spec.default})".replace("%", "%%"),
        )  # fmt: skip
    return parser


def topic_names(text: str) -> tuple[str, ...]:
    """Return the names of result topics."""
    names = tuple(text.replace(",", " ").split())
    unknown = [name for name in names if name not in TOPICS]
    if unknown or not names:
        given = " ".join(unknown) or "nothing"
        raise argparse.ArgumentTypeError(f"{given} is no result; allowed are {', '.join(TOPICS)}")
    return names


def cpu_count() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0))


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return a reader of whole numbers in a range."""

    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from error
        if not low <= number <= high:
            raise argparse.ArgumentTypeError(f"{number} is not from {low} to {high}")
        return number

    return read


def reader_of(spec: ParameterSpec) -> Callable[[str], Any]:
    """Return a reader of a setting, checked as the node does."""

    def read(text: str) -> Any:
        return spec.check(text if isinstance(spec.default, str) else yaml.safe_load(text))

    return read


def split_ros_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return our arguments and those between ``--ros-args`` and ``--`` or the end."""
    own: list[str] = []
    ros: list[str] = []
    into = own
    for argument in arguments:
        if argument == "--ros-args":
            into = ros
        elif argument == "--" and into is ros:
            into = own
        else:
            into.append(argument)
    return own, ros


def ros_values(arguments: Sequence[str]) -> dict[str, Any]:
    """Return the settings that ``-p NAME:=VALUE`` and ``--params-file FILE`` give; raises SettingsError."""
    values: dict[str, Any] = {}
    rest = iter(arguments)
    for option in rest:
        given = next(rest, "")
        if option in ("-p", "--param") and ":=" in given:
            name, _, text = given.partition(":=")
            found = {name: yaml.safe_load(text)}
        elif option == "--params-file":
            found = file_values(Path(given))
        else:
            raise SettingsError(f"unknown argument {option} {given}; give -p NAME:=VALUE or --params-file FILE")
        for name, value in found.items():
            if name in ONLY_LIVE or name.startswith("qos_overrides"):
                continue
            if name not in SETTINGS:
                raise SettingsError(f"unknown parameter {name}; the parameters are {', '.join(SETTINGS)}")
            values[name] = SETTINGS[name].check(value)
    return values


def file_values(path: Path) -> dict[str, Any]:
    """Return the parameters that a ROS parameter file gives to the reconstruction node."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        nodes = content.items()
        found: dict[str, Any] = {}
        for name, node in nodes:
            if name.rpartition("/")[2] in (NODE, "*", "**"):
                found |= flat(node["ros__parameters"])
    except (OSError, ValueError, AttributeError, KeyError, TypeError, yaml.YAMLError) as error:
        raise SettingsError(f"cannot read the parameter file {path}: {error}") from error
    return found


def flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested parameters under their full names."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        found |= flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def make_tasks(options: argparse.Namespace) -> list[BagTask]:
    """Return one task for each bag; each writes a bag of the same name."""
    limits = Limits(options.part_mb * MEGABYTE, options.reserve_mb * MEGABYTE)
    tasks: dict[Path, BagTask] = {}
    for bag in options.bags:
        source = bag.resolve()
        target = options.out.resolve() / name_of(source)
        if target in tasks:
            raise SettingsError(f"{source} and {tasks[target].source} would both become {target}; choose two --out")
        if target == source:
            raise SettingsError(f"{source} would be overwritten; choose another --out")
        tasks[target] = BagTask(source, target, options.values, options.topics, options.storage, limits)
    return list(tasks.values())


def name_of(source: Path) -> str:
    """Return the name of a bag: that of its folder, or of its file without the endings of bags."""
    name = source.name
    for ending in (PACKED, *STORAGES):
        name = name.removesuffix(ending)
    return name or "bag"
