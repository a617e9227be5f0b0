"""ROS parameters declared from one table, each with unit, range and description."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.parameter import Parameter

from moire_sensor.errors import SettingsError

Value = bool | int | float | str
QOS_PREFIX = "qos_overrides."
# rclpy itself answers another value with a traceback, or the middleware with its own words.
QOS_VALUES = {
    "history": ("keep_last", "keep_all", "system_default"),
    "reliability": ("reliable", "best_effort", "best_available", "system_default"),
    "durability": ("volatile", "transient_local", "best_available", "system_default"),
}
MAX_QOS_DEPTH = 10_000


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter: its default tells its type; ``low`` to ``high`` or ``choices`` what is allowed."""

    name: str
    default: Value
    text: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False

    def check(self, value: Any) -> Value:
        """Return the value in the parameter's type, or raise SettingsError naming what is allowed."""
        if isinstance(self.default, float) and type(value) is int:
            value = float(value)
        if self.choices and value not in self.choices:
            raise SettingsError(f"parameter {self.name} is {value!r}; allowed are {', '.join(self.choices)}")
        if type(value) is not type(self.default) or not self._in_range(value):
            raise SettingsError(f"parameter {self.name} is {value!r}; it must be {self.allowed()} ({self.text})")
        checked: Value = value
        return checked

    def _in_range(self, value: Any) -> bool:
        if self.low is None or self.high is None:
            return not isinstance(value, float) or math.isfinite(value)
        return bool(self.low <= value <= self.high)

    def allowed(self) -> str:
        """Return type and range in words."""
        kind = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}[type(self.default)]
        return kind if self.low is None else f"{kind} from {self.low:g} to {self.high:g}"

    def described(self) -> str:
        """Return what the parameter is for, with the choices where there are some."""
        return self.text + (f"; one of {', '.join(self.choices)}" if self.choices else "")

    def descriptor(self) -> ParameterDescriptor:
        """Return the descriptor for ``declare_parameter``."""
        message = ParameterDescriptor(name=self.name, description=self.described(), read_only=self.read_only)
        if self.low is not None and isinstance(self.default, float):
            message.floating_point_range = [FloatingPointRange(from_value=self.low, to_value=self.high)]
        elif self.low is not None:
            message.integer_range = [IntegerRange(from_value=int(self.low), to_value=int(self.high or 0), step=1)]
        return message


def help_text(specs: Sequence[ParameterSpec]) -> str:
    """Return a line for each parameter: its name, its default, and what it is for."""
    lines = []
    for spec in specs:
        default = str(spec.default).lower() if isinstance(spec.default, bool) else spec.default
        lines.append(f"  {f'{spec.name}:={default}':<32} {spec.described()}")
    return "\n".join(["parameters, each given as -p NAME:=VALUE, with their defaults:", *lines])


def specs_of(settings_type: type) -> tuple[ParameterSpec, ...]:
    """Return a parameter for each field of one of the core's settings, whose metadata hold range and text."""
    specs = []
    for item in fields(settings_type):
        default: Any = item.default
        meta = item.metadata
        specs.append(ParameterSpec(item.name, default, meta["text"], meta["low"], meta["high"]))
    return tuple(specs)


def declare(node: Any, specs: Sequence[ParameterSpec]) -> dict[str, Any]:
    """Declare all parameters and return their values; a whole number is accepted for a float.

    Raises
    ------
    SettingsError
        A value of a wrong type or outside its range.
    """
    overrides: dict[str, Parameter] = node._parameter_overrides
    values: dict[str, Any] = {}
    for spec in specs:
        if spec.name in overrides:
            value = spec.check(overrides[spec.name].value)
            overrides[spec.name] = Parameter(spec.name, value=value)
        try:
            values[spec.name] = node.declare_parameter(spec.name, spec.default, spec.descriptor()).value
        except InvalidParameterTypeException as error:
            raise SettingsError(f"parameter {spec.name} must be {spec.allowed()} ({spec.text})") from error
    return values


def refuse_unknown(node: Any, qos: bool = False, others: Collection[str] = ()) -> None:
    """Raise SettingsError if a value was given for a parameter that the node does not have.

    ``others`` are names of parameters of other nodes of the same process, which get all values too. ``qos`` looks at
    the names of qos_overrides alone, which are known once the node's topics are; their values are checked without it,
    before a topic is made with them.
    """
    if not qos:
        check_qos_values(node)
    for name in node._parameter_overrides:
        if not (node.has_parameter(name) or name in others) and name.startswith(QOS_PREFIX) == qos:
            known = [known for known in node._parameters if known.startswith(QOS_PREFIX) == qos]
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            names = f"{QOS_PREFIX}TOPIC.publisher (or subscription).POLICY" if qos else ", ".join(sorted(known))
            raise SettingsError(f"unknown parameter {name}; {hint}the parameters are {names}")


def check_qos_values(node: Any) -> None:
    """Raise SettingsError for a value of a qos_overrides parameter that the middleware cannot take."""
    for name, parameter in node._parameter_overrides.items():
        policy, value = name.rpartition(".")[2], parameter.value
        if not name.startswith(QOS_PREFIX):
            continue
        if policy in QOS_VALUES and value not in QOS_VALUES[policy]:
            raise SettingsError(f"parameter {name} is {value!r}; allowed are {', '.join(QOS_VALUES[policy])}")
        if policy == "depth" and not (type(value) is int and 1 <= value <= MAX_QOS_DEPTH):
            raise SettingsError(f"parameter {name} is {value!r}; it must be a whole number from 1 to {MAX_QOS_DEPTH}")


def changed_values(
    specs: Sequence[ParameterSpec], current: Mapping[str, Any], parameters: Sequence[Any]
) -> dict[str, Any]:
    """Return ``current`` with the changes that a set_parameters call asks for; raises SettingsError."""
    by_name = {spec.name: spec for spec in specs}
    changes = {one.name: by_name[one.name].check(one.value) for one in parameters if one.name in by_name}
    return {**current, **changes}
