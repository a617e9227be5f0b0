"""What stands in a scene file, read field by field; everything wrong is one line that names the place."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from moire_sensor.errors import quoted
from moire_sim.errors import SceneError

OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Eq: operator.eq, ast.NotEq: operator.ne,
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
}  # fmt: skip
MAX_EXPRESSION = 200


@dataclass(frozen=True)
class Fields:
    """The fields of one mapping of a scene file; ``place`` names it in errors, ``options`` are the scene's numbers.

    A number may be an expression in the options: ``distance_m + 0.005``, with + - * / and brackets.
    """

    place: str
    values: Mapping[str, Any]
    options: Mapping[str, float]
    used: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, place: str, values: Any, options: Mapping[str, float]) -> Fields:
        """Raise SceneError unless it is a mapping with names."""
        if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
            raise SceneError(f"{place} is {quoted(str(values))}; give fields, as name: value")
        return cls(place, values, options)

    def finish(self) -> None:
        """Raise SceneError for a field that nothing has asked for."""
        for name in self.values:
            if name not in self.used:
                known = ", ".join(sorted(self.used))
                raise SceneError(f"{self.place} has the field {quoted(name)}; the fields are {known}")

    def get(self, name: str, default: Any = None) -> Any:
        """Return a field as it stands."""
        self.used.add(name)
        return self.values.get(name, default)

    def wanted(self, name: str, default: Any = None) -> Any:
        """Return a field; raises SceneError where it is missing and has no default."""
        value = self.get(name, default)
        if value is None:
            given = ", ".join(quoted(one) for one in self.values) or "no field"
            raise SceneError(f"{self.place}: {name} is missing; given is {given}")
        return value

    def inner(self, name: str) -> Fields | None:
        """Return the fields within a field, None where it is not there."""
        values = self.get(name)
        return None if values is None else Fields.of(f"{self.place}, {name}", values, self.options)

    def number(self, name: str, default: float | None = None, low: float = -1e3, high: float = 1e3) -> float:
        """Return a number or the value of an expression."""
        return self._number(name, self.wanted(name, default), low, high)

    def vector(
        self, name: str, count: int, default: tuple[float, ...] | None = None, low: float = -1e3, high: float = 1e3
    ) -> tuple[float, ...]:
        """Return ``count`` numbers."""
        return self._vector(name, self.wanted(name, default), count, low, high)

    def vectors(self, name: str, count: int) -> tuple[tuple[float, ...], ...]:
        """Return a list of lists of ``count`` numbers each; endless (.inf) is a number here."""
        return tuple(self._vector(name, one, count, -math.inf, math.inf) for one in self._items(name))

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return a list of numbers."""
        return tuple(self._number(name, one, -1e6, 1e6) for one in self._items(name))

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text."""
        value = self.wanted(name, default)
        if not isinstance(value, str):
            raise SceneError(f"{self.place}: {name} is {quoted(str(value))}; give a text")
        return value

    def truth(self, name: str, default: bool) -> bool:
        """Return true, false, or what a comparison of options says."""
        value = self.get(name, default)
        if isinstance(value, str):
            value = self._evaluated(name, value)
        if not isinstance(value, bool):
            raise SceneError(f"{self.place}: {name} is {quoted(str(value))}; give true, false or a comparison")
        return value

    def _items(self, name: str) -> list[Any]:
        values = self.wanted(name)
        if not isinstance(values, list):
            raise SceneError(f"{self.place}: {name} is {quoted(str(values))}; give a list")
        return values

    def _vector(self, name: str, value: Any, count: int, low: float, high: float) -> tuple[float, ...]:
        if not isinstance(value, (list, tuple)) or len(value) != count:
            raise SceneError(f"{self.place}: {name} is {quoted(str(value))}; give {count} numbers: [1.0, ...]")
        return tuple(self._number(name, one, low, high) for one in value)

    def _number(self, name: str, value: Any, low: float, high: float) -> float:
        if isinstance(value, str):
            value = self._evaluated(name, value)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise SceneError(f"{self.place}: {name} is {quoted(str(value))}; give a number from {low:g} to {high:g}")
        return float(value)

    def _evaluated(self, name: str, text: str) -> Any:
        try:
            if len(text) > MAX_EXPRESSION:
                raise ValueError
            return self._value(ast.parse(text, mode="eval").body)
        except (ValueError, SyntaxError, ArithmeticError, RecursionError, KeyError, TypeError):
            known = ", ".join(self.options) or "none here"
            raise SceneError(
                f"{self.place}: {name} is {quoted(text)}; give a number, or + - * / and comparisons of numbers and the "
                f"scene's options ({known})"
            ) from None

    def _value(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return node.value
        if isinstance(node, ast.Name):
            return self.options[node.id]
        if isinstance(node, ast.UnaryOp):
            return OPERATORS[type(node.op)](self._value(node.operand))
        if isinstance(node, ast.BinOp):
            return OPERATORS[type(node.op)](self._value(node.left), self._value(node.right))
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            return OPERATORS[type(node.ops[0])](self._value(node.left), self._value(node.comparators[0]))
        raise ValueError
