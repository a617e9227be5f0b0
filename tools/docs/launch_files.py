"""Arguments of the launch files, read from their code: the library that runs them is not needed."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LOOPS = (ast.GeneratorExp, ast.ListComp)


@dataclass(frozen=True)
class Argument:
    """An argument of a launch file; ``default`` is None where it must be given."""

    name: str
    default: str | None
    text: str


def arguments_of(path: Path) -> list[Argument]:
    """Return the arguments that a launch file declares, in the order of its code.

    They are declared one by one, or in a loop over the items of a dictionary of the file.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    loops = [node for node in ast.walk(tree) if isinstance(node, LOOPS) and declares(node.elt)]
    looped = {id(loop.elt) for loop in loops}
    single = [node for node in ast.walk(tree) if declares(node) and id(node) not in looped]
    names = constants_of(tree)
    found = [argument_of(call, names) for call in single]
    for loop in loops:
        found += [argument_of(loop.elt, names | turn) for turn in turns_of(loop, names)]
    return found


def declares(node: ast.AST) -> bool:
    """Tell whether a node declares an argument."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "DeclareLaunchArgument"


def constants_of(tree: ast.Module) -> dict[str, Any]:
    """Return the names that stand for literals in a file, and for the file's parts of this package, their names."""
    found: dict[str, Any] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            try:
                found[node.targets[0].id] = ast.literal_eval(node.value)
            except ValueError:
                found[node.targets[0].id] = last_text(node.value)
    return found


def turns_of(loop: ast.GeneratorExp | ast.ListComp, names: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield what the names of a loop over ``NAME.items()`` stand for, turn by turn."""
    (over,) = loop.generators
    table = names[ast.unparse(over.iter).removesuffix(".items()")]
    assert isinstance(over.target, ast.Tuple)
    key, value = over.target.elts
    for name, content in table.items():
        parts = dict(zip(map(ast.unparse, value.elts), content, strict=True)) if isinstance(value, ast.Tuple) else {}
        yield {ast.unparse(key): name, ast.unparse(value): content, **parts}


def argument_of(call: ast.AST, names: Mapping[str, Any]) -> Argument:
    """Return the argument that a call declares."""
    assert isinstance(call, ast.Call)
    given = {one.arg: text_of(one.value, names) for one in call.keywords}
    return Argument(text_of(call.args[0], names), given.get("default_value"), given["description"])


def text_of(node: ast.expr, names: Mapping[str, Any]) -> str:
    """Return what an expression of texts and names says; of a path of this package, its last part."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.Name):
        return str(names[node.id])
    if isinstance(node, ast.JoinedStr):
        parts = (part.value if isinstance(part, ast.FormattedValue) else part for part in node.values)
        return "".join(text_of(part, names) for part in parts)
    return last_text(node)


def last_text(node: ast.AST) -> str:
    """Return the last text in an expression, such as the file's name of a path that is put together."""
    texts = [one.value for one in ast.walk(node) if isinstance(one, ast.Constant) and isinstance(one.value, str)]
    named = [text for text in texts if "." in text]
    return (named or texts or [""])[-1]
