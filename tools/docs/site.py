"""MkDocs hook: the README as the first page, and every file of the repository that a page links to as a page."""

from __future__ import annotations

import ast
import re
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
# Pages of the site that lie elsewhere in the repository.
MOVED = {"README.md": "index.md", "CHANGELOG.md": "changes.md"}
LINK = re.compile(r"(?<=\]\()(?![a-z]+://|mailto:|#)([^)\s#]+)(#[^)\s]*)?(?=\))")
CODE = re.compile(r"(```.*?```)", re.DOTALL)
LANGUAGES = {".py": "python", ".yaml": "yaml", ".xml": "xml", ".json": "json"}
# The text of a file stays out of the search.
SOURCE_HEAD = "---\nsearch:\n  exclude: true\n---\n\n# {name}\n"
BLOCK = "\n````{language} linenums=\"{first}\"\n{text}\n````\n"


def on_files(files: Files, *, config: Any) -> Files:
    """Add the pages made of the repository's files."""
    for name, uri in MOVED.items():
        files.append(File.generated(config, uri, content=(ROOT / name).read_text(encoding="utf-8")))
    pages = {file.src_uri: file.content_string for file in files.documentation_pages()}
    linked = {target for uri, text in pages.items() for target in sources_of(uri, text)}
    for name in sorted(linked):
        files.append(File.generated(config, source_uri(name), content=source_page(name)))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Point the links of a page into the site."""
    return in_site(page.file.src_uri, markdown)


def home_of(uri: str) -> str:
    """Return where a page of the site lies in the repository."""
    return next((name for name, moved in MOVED.items() if moved == uri), f"docs/{uri}")


def target_of(uri: str, link: str) -> str:
    """Return the file of the repository that a page's link means."""
    return normpath(str(PurePosixPath(home_of(uri)).parent / link))


def sources_of(uri: str, text: str) -> set[str]:
    """Return the files of the repository that a page links to and that are no part of the site."""
    targets = {target_of(uri, match[1]) for part in CODE.split(text)[::2] for match in LINK.finditer(part)}
    return {name for name in targets if name not in MOVED and not name.startswith("docs/") and (ROOT / name).is_file()}


def in_site(uri: str, text: str) -> str:
    """Return the text of a page with its links to files of the repository pointing to their pages in the site."""

    def moved(match: re.Match[str]) -> str:
        name, fragment = target_of(uri, match[1]), match[2] or ""
        if name.startswith("docs/"):
            place = name.removeprefix("docs/")
        elif name in MOVED:
            place = MOVED[name]
        elif (ROOT / name).is_file():
            place = source_uri(name)
        else:
            return match[0]
        return relpath(place, str(PurePosixPath(uri).parent)) + fragment

    parts = CODE.split(text)
    return "".join(part if number % 2 else LINK.sub(moved, part) for number, part in enumerate(parts))


def source_uri(name: str) -> str:
    """Return the page that shows a file."""
    return f"source/{name}.md"


def source_page(name: str) -> str:
    """Return the page of a file, its lines numbered, a heading before each test to link to."""
    lines = (ROOT / name).read_text(encoding="utf-8").rstrip().split("\n")
    language = LANGUAGES.get(Path(name).suffix, "text")
    starts = tests_of("\n".join(lines)) if language == "python" else {}
    parts = [SOURCE_HEAD.format(name=name)]
    begins = [1, *starts]
    for begin, end in zip(begins, [*begins[1:], len(lines) + 1], strict=True):
        if begin in starts:
            parts.append(f"\n## {starts[begin]}\n")
        text = "\n".join(lines[begin - 1 : end - 1]).rstrip()
        parts.append(BLOCK.format(language=language, first=begin, text=text))
    return "".join(parts)


def tests_of(code: str) -> dict[int, str]:
    """Return the names of the tests of a file by the line where each begins, its decorators included."""
    functions = [node for node in ast.parse(code).body if isinstance(node, ast.FunctionDef)]
    return {
        min([node.lineno, *(one.lineno for one in node.decorator_list)]): node.name
        for node in functions
        if node.name.startswith("test_")
    }
