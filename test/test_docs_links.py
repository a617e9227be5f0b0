"""What README and docs name exists: links, tests, commands, topics, parameters, launch files and their arguments."""

from __future__ import annotations

import ast
import re
from dataclasses import fields
from functools import cache
from pathlib import Path

import pytest
from source_scan import ROOT
from test_ros_diagnostics import CONCERNS

from moire_sensor.ros import bag_recorder, bag_topics, capture_player_node, reconstruction_settings, viewer_node
from moire_sensor.ros.result_messages import TOPICS
from moire_sensor.ros.thresholds import Thresholds
from moire_sim import virtual_head_node

PAGES = sorted(str(path.relative_to(ROOT)) for path in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")))
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
PARAMETERS = {
    spec.name
    for specs in (
        virtual_head_node.SPECS, reconstruction_settings.SPECS, capture_player_node.SPECS, bag_recorder.PARAMETERS,
        viewer_node.SPECS,
    )
    for spec in specs
}  # fmt: skip
LAUNCH_LINE = re.compile(r"ros2 launch moire_sensor (\w+\.launch\.py)((?: +\w+:=\S+)*)")


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def links_of(page: str) -> list[tuple[Path, str]]:
    """File and fragment of every link of a page that stays in the repository."""
    found = []
    for target in LINK.findall(re.sub(r"```.*?```", "", text_of(page), flags=re.DOTALL)):
        if "://" not in target:
            name, _, fragment = target.partition("#")
            found.append(((ROOT / page).parent / name if name else ROOT / page, fragment))
    return found


@cache
def functions_of(path: Path) -> set[str]:
    return {node.name for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)}


@cache
def headings_of(path: Path) -> set[str]:
    """Headings of a page as they stand in links: small letters, hyphens for spaces, no punctuation."""
    lines = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


@pytest.mark.parametrize("page", PAGES)
def test_every_link_resolves_and_every_test_that_is_named_exists(page: str) -> None:
    for path, fragment in links_of(page):
        assert path.exists(), f"{page} names {path}"
        if fragment:
            known = functions_of(path) if path.suffix == ".py" else headings_of(path)
            assert fragment in known, f"{page} names {fragment} in {path.name}"


@pytest.mark.parametrize("page", PAGES)
def test_every_test_file_that_is_named_exists(page: str) -> None:
    for name in re.findall(r"\btest_\w+\.py\b", text_of(page)):
        assert (ROOT / "test" / name).is_file(), f"{page} names {name}"


def test_each_of_our_cells_of_the_comparison_is_backed() -> None:
    """A row: feature, our cell, five peers. Ours links to a test or a file, or says that we have no such thing."""
    rows = [line for line in text_of("docs/comparison.md").splitlines() if re.match(r"\| *[a-zA-Z]", line)]
    assert len(rows) > 30
    for row in rows:
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert len(cells) == 7, row
        assert LINK.search(cells[1]) or cells[1] == "no", row
        assert all(cells), row


def test_the_readme_names_every_executable_and_no_other() -> None:
    section = text_of("README.md").partition("## Executables")[2].partition("\n## ")[0]
    named = set(re.findall(r"^\| `(\w+)` \|", section, flags=re.MULTILINE))
    installed = re.findall(r'"(\w+) = [\w.]+:\w+"', (ROOT / "setup.py").read_text())
    assert named == set(installed)


def test_the_readme_names_every_topic() -> None:
    section = text_of("README.md").partition("## Topics")[2].partition("\n## ")[0]
    named = set(re.findall(r"`([\w/]+)`", section))
    assert set(TOPICS) <= named
    for group in bag_topics.GROUPS.values():
        assert {topic.name for topic in group} <= named


def test_the_page_of_the_node_names_what_cannot_change_every_concern_and_every_threshold() -> None:
    page = text_of("docs/node.md")
    section = page.partition("## Parameters")[2].partition("\n## ")[0]
    assert set(re.findall(r"`(\w+)`", section)) - {"qos_overrides"} == {
        spec.name for spec in reconstruction_settings.SPECS if spec.read_only
    }
    section = page.partition("## Diagnostics")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `([\w ]+)` \|", section, flags=re.MULTILINE)) == set(CONCERNS)
    assert {item.name for item in fields(Thresholds)} <= set(re.findall(r"`(\w+)`", section))


@pytest.mark.parametrize("page", PAGES)
def test_every_parameter_that_is_set_exists(page: str) -> None:
    for name in re.findall(r"-p ([a-z]\w*):=", text_of(page)):
        assert name in PARAMETERS, f"{page} sets {name}"


@pytest.mark.parametrize("page", PAGES)
def test_every_launch_line_names_a_file_and_arguments_that_it_has(page: str) -> None:
    for name, given in LAUNCH_LINE.findall(text_of(page)):
        texts = arguments_of(name)
        for argument in re.findall(r"(\w+):=", given):
            assert argument in texts, f"{page} gives {argument} to {name}"


def arguments_of(name: str) -> set[str]:
    """Every text of a launch file and of those that it includes, among them the names of its arguments."""
    tree = ast.parse((ROOT / "launch" / name).read_text())
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    included = [text for text in texts if text.endswith(".launch.py") and text != name and "/" not in text]
    return texts.union(*map(arguments_of, included))
