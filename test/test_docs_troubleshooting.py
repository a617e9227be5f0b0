"""What docs/troubleshooting.md says that the programs say, they say."""

from __future__ import annotations

import ast
import re
from functools import cache

import pytest
from source_scan import ROOT

PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
ANY = "…"
SECTION = re.compile(r"^\| it says \|.*?\n\|[-|]+\n((?:\|.*\n)+)", re.MULTILINE)
# Names of concerns, counts and statuses are words of a message's values; a message has more than that.
SHORTEST_MESSAGE = 12


def quoted() -> list[str]:
    """Messages in the first column of the tables "it says"."""
    rows = [row for table in SECTION.findall(PAGE) for row in table.splitlines()]
    return [text for row in rows for text in re.findall(r"`([^`]+)`", row.split("|")[1])]


@cache
def texts() -> tuple[str, ...]:
    """Every text in the code, ANY for what is put into it; docstrings too, which no message is likely to match."""
    found = []
    for folder in ("moire_sensor", "moire_sim", "tools"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    parts = [str(part.value) if isinstance(part, ast.Constant) else ANY for part in node.values]
                    found.append("".join(parts))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append(re.sub(r"\{[^{}]*\}", ANY, node.value))
    return tuple(found)


def test_the_page_quotes_many_messages() -> None:
    assert sum(len(text) > SHORTEST_MESSAGE for text in quoted()) > 40


@pytest.mark.parametrize("message", quoted())
def test_the_code_says_it(message: str) -> None:
    parts = [re.escape(part.strip()) for part in message.split(ANY)]
    wanted = re.compile(".*?".join(parts), re.DOTALL)
    assert any(wanted.search(text) for text in texts()), message


def test_a_message_that_nobody_says_is_found_out() -> None:
    with pytest.raises(AssertionError):
        test_the_code_says_it("the right image lies … rows above the left one")
