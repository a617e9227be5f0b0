"""Write docs/reference.md: topics, services, parameters, launch files and frames, all read from the code."""

from __future__ import annotations

import argparse
import ast
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from pathlib import Path

import yaml

from moire_sensor.nav_cloud import NavSettings
from moire_sensor.ros import (
    bag_recorder,
    capture_player_node,
    projector_state,
    reconstruction_settings,
    viewer_inputs,
    viewer_node,
)
from moire_sensor.ros.bag_options import SETTINGS, make_parser
from moire_sensor.ros.parameters import ParameterSpec, specs_of
from moire_sensor.ros.thresholds import Thresholds
from moire_sensor.settings import Settings
from moire_sensor.shot import Status
from moire_sim import scene_names, virtual_head_node
from tools.docs.launch_files import arguments_of
from tools.docs.live_nodes import Channel, NodeFacts, facts_of_nodes
from tools.docs.meanings import SERVICES, STATE, STATUS, TOPICS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "reference.md"
HEAD = """# Reference

Written by `make docs` from the running nodes, their parameters, the launch files and the URDF: do not edit.

Names without a leading slash are in the namespace of the head, `/head` unless another is given. Every publisher and
subscription takes `qos_overrides.TOPIC.publisher` (or `subscription`) `.reliability`, `.durability`, `.history` and
`.depth` as parameters. Every node also has the services of ROS parameters.
"""
SCENES_NOTE = """
Options follow a colon: `scene:=flat_board:distance_m=0.8,slope=0.3`. A YAML file of your own, laid out as
[those that ship](../config/scenes/cylinder_and_box.yaml), or a URDF or SDF file is given by its path.
"""
ANY_TIME, AT_START = "any time", "start"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, or with ``--check`` return 1 if it is not what the code says."""
    parser = argparse.ArgumentParser(prog="python -m tools.docs.reference", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare only")
    page = page_of(facts_of_nodes())
    if not parser.parse_args(arguments).check:
        PAGE.write_text(page, encoding="utf-8")
    elif page != PAGE.read_text(encoding="utf-8"):
        print(f"{PAGE.relative_to(ROOT)} is not what the code says; write it anew with make docs", file=sys.stderr)
        return 1
    return 0


def page_of(nodes: dict[str, NodeFacts]) -> str:
    """Return the page."""
    parts = [HEAD, "\n## Topics\n"]
    for name, facts in nodes.items():
        parts += topics_section(f"{name} publishes", facts.publishes)
        parts += topics_section(f"{name} subscribes to", facts.subscribes)
    shown_topics = ", ".join(f"`{topic}`" for topic, _, _ in viewer_inputs.STREAMS.values())
    parts += ["\n`capture_player` publishes the images, camera infos and `projector/state` as `virtual_head` does.\n"]
    parts += [f"`moire_viewer` subscribes to {shown_topics} while a browser shows its page.\n"]
    parts += ["\n### Names in projector/state\n", *table(("name", "position"), state_rows())]
    parts += ["\n### Values of status/image\n", *table(("value", "name", "means"), status_rows())]
    parts += ["\n## Services\n", *table(("service", "type", "node", "does"), service_rows(nodes))]
    parts += ["\n## Parameters\n", "\n`moire_demo` takes those of `virtual_head` and `reconstruction`.\n"]
    for title, specs in parameter_groups():
        parts += [f"\n### {title}\n", *table(("name", "default", "allowed", "means", "set at"), map(spec_row, specs))]
    parts += ["\n### reconstruct_bag\n", "\nBesides these, each parameter of `reconstruction` as an option: "]
    parts += ["`--min-depth-m 0.4`.\n", *table(("option", "default", "means"), option_rows())]
    parts += ["\n## Scenes of the virtual head\n", SCENES_NOTE]
    parts += table(("scene", "shows", "options: default, range", "beyond 2 m, or moves"), scene_rows())
    parts += ["\n## Launch files\n", *launch_sections(), "\n## Frames\n"]
    parts += ["\n`frame_prefix` stands before each. Optical frames: x right, y down, z forward (REP 103).\n"]
    parts += table(("parent", "child", "joint", "place in the parent: m; rad", "limits"), frame_rows())
    return "".join(parts)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return a table with an empty line before it."""
    lines = [columns, ["---"] * len(columns), *rows]
    return ["\n", *(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |\n" for line in lines)]


def topics_section(title: str, topics: Sequence[Channel]) -> list[str]:
    """Return a heading and a table of topics."""
    rows = [(f"`{one.name}`", one.type_name, one.quality, TOPICS[one.name]) for one in topics]
    return [f"\n### {title}\n", *table(("topic", "type", "quality of service", "holds"), rows)]


def state_rows() -> list[tuple[str, str]]:
    """Return the names of a projector state; those that may be missing say so."""
    names = [*projector_state.REQUIRED, *projector_state.DEPTH_RANGE]
    may_miss = set(projector_state.DEPTH_RANGE)
    return [(f"`{name}`", STATE[name] + (" (may be missing)" if name in may_miss else "")) for name in names]


def status_rows() -> list[tuple[str, str, str]]:
    """Return the values of a pixel's status."""
    return [(str(int(status)), status.name.lower(), STATUS[status]) for status in Status]


def service_rows(nodes: dict[str, NodeFacts]) -> list[tuple[str, str, str, str]]:
    """Return the services of all nodes."""
    return [
        (f"`{one.name}`", one.type_name, name, SERVICES[one.name])
        for name, facts in nodes.items()
        for one in facts.serves
    ]


def parameter_groups() -> list[tuple[str, Sequence[ParameterSpec]]]:
    """Return titles and parameters of all executables; the reconstruction's many by what they are for."""
    tuned = {name: specs_of(kind) for name, kind in (("diagnostics", Thresholds), ("costmaps", NavSettings))}
    tuned["tuning"] = specs_of(Settings)
    rest = {spec.name for specs in tuned.values() for spec in specs}
    general = [spec for spec in reconstruction_settings.SPECS if spec.name not in rest]
    return [
        ("virtual_head", virtual_head_node.SPECS),
        ("reconstruction", general),
        *((f"reconstruction: {name}", specs) for name, specs in tuned.items()),
        ("capture_player", capture_player_node.SPECS),
        ("record_bag", bag_recorder.PARAMETERS),
        ("moire_viewer", viewer_node.SPECS),
    ]


def spec_row(spec: ParameterSpec) -> tuple[str, str, str, str, str]:
    """Return the row of one parameter."""
    allowed = ", ".join(spec.choices) or spec.allowed()
    if type(spec.default) is int:
        allowed = f"{int(spec.low or 0)} to {int(spec.high or 0)}"
    return f"`{spec.name}`", shown(spec.default), allowed, spec.text, AT_START if spec.read_only else ANY_TIME


def shown(value: object) -> str:
    """Return a default as one writes it on a command line."""
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else f"{value}"
    return f"`{text}`" if text else "empty"


def option_rows() -> list[tuple[str, str, str]]:
    """Return the options of reconstruct_bag that are no settings of the reconstruction."""
    actions = [one for one in make_parser()._actions if one.dest not in SETTINGS and one.dest != "help"]
    # The number of processors differs from machine to machine.
    defaults = {"jobs": "all processors", "topics": "see there"}
    return [
        (
            f"`{one.option_strings[0] if one.option_strings else one.metavar}`",
            "needed" if one.required else defaults.get(one.dest) or shown("" if one.default is None else one.default),
            one.help or "",
        )
        for one in actions
    ]


def scene_rows() -> list[tuple[str, str, str, str]]:
    """Return the scenes that ship."""
    rows = []
    for name in scene_names():
        content = yaml.safe_load((ROOT / "config" / "scenes" / f"{name}.yaml").read_text(encoding="utf-8"))
        options = content.get("options", {}).items()
        texts = [f"`{key}`: {one['default']:g}, {one['low']:g} to {one['high']:g}" for key, one in options]
        rows.append((f"`{name}`", content["about"], "; ".join(texts) or "-", "yes" if content.get("indoor") else "no"))
    return rows


def launch_sections() -> list[str]:
    """Return a heading, what it starts, and the arguments of each launch file."""
    parts = []
    for path in sorted((ROOT / "launch").glob("*.launch.py")):
        about = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
        parts.append(f"\n### {path.name}\n\n{about}\n")
        rows = [
            (f"`{one.name}`", "needed" if one.default is None else shown(one.default), one.text)
            for one in arguments_of(path)
        ]
        parts += table(("argument", "default", "means"), rows) if rows else []
    return parts


def frame_rows() -> list[tuple[str, str, str, str, str]]:
    """Return the joints of the URDF."""
    rows = []
    for joint in ET.parse(ROOT / "urdf" / "head.urdf").getroot().iter("joint"):
        parent, child = (joint.find(tag) for tag in ("parent", "child"))
        origin, limit = joint.find("origin"), joint.find("limit")
        assert parent is not None
        assert child is not None
        assert origin is not None
        place = f"{origin.get('xyz', '0 0 0')}; {rounded(origin.get('rpy', '0 0 0'))}"
        within = "-"
        if limit is not None:
            within = f"{limit.get('lower')} to {limit.get('upper')} rad, {limit.get('velocity')} rad/s"
        name = joint.get("name", "") if joint.get("type") != "fixed" else "fixed"
        rows.append((f"`{parent.get('link')}`", f"`{child.get('link')}`", name, place, within))
    return rows


def rounded(numbers: str) -> str:
    """Return angles with four decimals at most."""
    return " ".join(f"{round(float(number), 4):g}" for number in numbers.split())


if __name__ == "__main__":
    sys.exit(main())
