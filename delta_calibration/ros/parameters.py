"""Declaration and check of a node's parameters from a table: default, meaning, range, choices.

ROS checks the type and, for numbers that are not NaN, the range; choices, arrays and finiteness
are checked here, at the start and at every later change. A value is refused with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from delta_calibration.errors import InputError
from delta_calibration.robot import known_robots
from delta_calibration.ros.data_dir import DataFolder

Value = bool | int | float | str | Sequence[str] | Sequence[float]


@dataclass(frozen=True)
class Spec:
    """Specification of a parameter; its type is that of the default.

    Attributes:
        name: name as on the command line.
        default: default value; a tuple for an array, which must not be empty.
        description: meaning, with unit.
        range: lowest and highest value of a number, or of each number of an array.
        choices: allowed texts; of an array, allowed entries.
        read_only: whether it can be given at the start only.
        path: whether it names a file, which has to lie in `data_dir` (data_dir.py).
        names: allowed texts that are not files, such as the robots of the package.
    """

    name: str
    default: Value
    description: str
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False
    path: bool = False
    names: tuple[str, ...] = ()

    def reason_against(self, value: Any) -> str | None:
        """Reason why a value is refused, with the allowed values; None if it is accepted."""
        for entry in _entries(value):
            if isinstance(entry, float) and not math.isfinite(entry):
                return f"{self.name}: {entry} is not a finite number"
            if self.range is not None and not self.range[0] <= entry <= self.range[1]:
                return f"{self.name}: {entry} is not in [{self.range[0]}, {self.range[1]}]"
            if self.choices and entry not in self.choices:
                return f"{self.name}: {entry!r} is not one of {', '.join(self.choices)}"
        return None

    def descriptor(self) -> ParameterDescriptor:
        """ROS descriptor, as shown by `ros2 param describe`."""
        choices = f"one of: {', '.join(self.choices)}" if self.choices else ""
        descriptor = ParameterDescriptor(
            name=self.name,
            description=self.description,
            read_only=self.read_only,
            additional_constraints=choices,
        )
        if self.range is not None and isinstance(self.default, float):
            low, high = map(float, self.range)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif self.range is not None and isinstance(self.default, int):
            first, last = map(int, self.range)
            descriptor.integer_range = [IntegerRange(from_value=first, to_value=last)]
        return descriptor


DATA_DIR = Spec(
    "data_dir",
    "",
    "folder that contains all files named by parameters; empty for the working folder",
    read_only=True,
)
ROBOT = Spec(
    "robot",
    "srbd",
    "robot file, or the name of a robot of the package",
    read_only=True,
    path=True,
    names=known_robots(),
)

# Parameters of every node that sends joint commands to a cell.
RATE = Spec("rate", 50.0, "rate [Hz] of the commands", range=(1.0, 1000.0), read_only=True)
SUBSCRIBERS = Spec(
    "subscribers",
    1,
    "number of subscribers to wait for: the cell, and the recorder if there is one",
    range=(1, 100),
    read_only=True,
)
WAIT_FOR_SUBSCRIBER = Spec(
    "wait_for_subscriber",
    10.0,
    "time [s] to wait for a subscriber of the commands and its joint states",
    range=(0.0, 3600.0),
    read_only=True,
)


# Parameter of every node that uses frame names.
FRAME_PREFIX = Spec(
    "frame_prefix",
    "",
    "prefix of the frame names, such as left/ for left/base_link, for one of several robots",
    read_only=True,
)


class ParameterTable:
    """The declared parameters of one node.

    Args:
        node: node that owns them.
        specs: parameters to declare.
        on_change: callback after a change at run time, with the names that changed.

    Raises:
        InputError: a value given at the start has the wrong type or is not allowed.
    """

    def __init__(
        self,
        node: Node,
        specs: Iterable[Spec],
        on_change: Callable[[tuple[str, ...]], None] | None = None,
    ) -> None:
        self._node = node
        self._specs = {spec.name: spec for spec in specs}
        paths = [spec for spec in self._specs.values() if spec.path]
        if paths:
            self._specs = {DATA_DIR.name: DATA_DIR, **self._specs}
        self._files: DataFolder | None = None  # anything may be named at the start
        node.add_on_set_parameters_callback(self._check)
        for spec in self._specs.values():
            self._declare(spec)
        if paths:
            self._bound(paths)
        if on_change is not None:
            self._on_change = on_change
            node.add_post_set_parameters_callback(self._report)

    def flag(self, name: str) -> bool:
        """Value of a parameter that is true or false."""
        return bool(self._value(name))

    def integer(self, name: str) -> int:
        """Value of a whole number."""
        return int(self._value(name))

    def number(self, name: str) -> float:
        """Value of a floating-point number."""
        return float(self._value(name))

    def text(self, name: str) -> str:
        """Value of a text."""
        return str(self._value(name))

    def path(self, name: str) -> Path | None:
        """File named by a parameter; None if it is empty.

        Raises:
            InputError: it lies outside `data_dir`.
        """
        text = self.text(name)
        assert self._files is not None
        return self._files.path(name, text) if text else None

    def named(self, name: str) -> str:
        """Value of a parameter if it is one of `Spec.names`, otherwise the path of its file.

        Raises:
            InputError: it lies outside `data_dir`.
        """
        text = self.text(name)
        return text if text in self._specs[name].names else str(self.path(name) or "")

    def _bound(self, paths: Iterable[Spec]) -> None:
        """Restrict files to `data_dir` from now on, except those named at the start."""
        files = DataFolder.of(self.text(DATA_DIR.name))
        known = frozenset(self.text(spec.name) for spec in paths)
        self._files = replace(files, known=known)
        for spec in paths:
            self.named(spec.name)

    def texts(self, name: str) -> tuple[str, ...]:
        """Non-empty texts of an array; [""] stands for an empty array, which YAML cannot type."""
        return tuple(str(entry) for entry in self._value(name) if entry)

    def numbers(self, name: str) -> tuple[float, ...]:
        """Value of an array of numbers."""
        return tuple(float(entry) for entry in self._value(name))

    def _value(self, name: str) -> Any:
        return self._node.get_parameter(name).value

    def _declare(self, spec: Spec) -> None:
        default = list(spec.default) if isinstance(spec.default, tuple) else spec.default
        try:
            self._node.declare_parameter(spec.name, default, spec.descriptor())
        except InvalidParameterTypeException as error:
            raise InputError(_type_message(spec, self._given(spec))) from error
        except InvalidParameterValueException as error:
            reason = spec.reason_against(self._given(spec))  # ROS repeats the name and the value
            raise InputError(f"parameter {reason or error}") from error

    def _given(self, spec: Spec) -> Any:
        override = self._node._parameter_overrides.get(spec.name)
        return None if override is None else override.value

    def _check(self, changed: list[Parameter]) -> SetParametersResult:
        for parameter in changed:
            spec = self._specs.get(parameter.name)
            reason = None if spec is None else self._reason_against(spec, parameter.value)
            if reason is not None:
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _reason_against(self, spec: Spec, value: Any) -> str | None:
        reason = spec.reason_against(value)
        if reason is None and spec.path and self._files and value and value not in spec.names:
            try:
                self._files.path(spec.name, value)
            except InputError as error:
                return str(error)
        return reason

    def _report(self, changed: list[Parameter]) -> None:
        names = tuple(p.name for p in changed if p.name in self._specs)
        if names:
            self._on_change(names)


def warn_of_unknown(node: Node) -> None:
    """Warn of parameters that were given but not declared, which ROS silently ignores."""
    for name in sorted(node._parameter_overrides):
        if not node.has_parameter(name) and not name.startswith("qos_overrides."):
            known = sorted(node.list_parameters([], 0).names)
            node.get_logger().warn(f"parameter {name!r} is not known here; known are {known}")


def _entries(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list | tuple) or hasattr(value, "typecode") else (value,)


def _type_message(spec: Spec, given: Any) -> str:
    kind = "array" if isinstance(spec.default, tuple) else type(spec.default).__name__
    message = f"parameter {spec.name}: {given!r} is not of type {kind}"
    if isinstance(spec.default, float) and isinstance(given, int):
        message += f"; write {float(given)}"
    return message
