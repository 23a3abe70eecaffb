"""A stand-in for `launch` and `launch_ros`, which are not on PyPI: what a launch file starts.

It keeps what is built from them and evaluates it by their documented rules: substitutions are
joined to texts, parameter values are coerced as YAML to their `value_type`, which must be one of
`typing`'s, and a package that is not installed raises `ament_index_python`'s error. Functions are
called with a context; what they raise is raised by `started`, with nothing started. No process is
started.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, List  # noqa: UP035

from ruamel.yaml import YAML

KINDS = (int, float, bool, str, *(List[kind] for kind in (int, float, bool, str)))  # noqa: UP006
INSTALLED = frozenset({"delta_calibration", "robot_state_publisher", "rviz2", "foxglove_bridge"})


class PackageNotFoundError(KeyError):
    """Like that of `ament_index_python`."""


class SubstitutionFailure(RuntimeError):  # noqa: N818  launch's name
    """Like that of launch."""


@dataclass(frozen=True)
class LaunchContext:
    """Arguments of the launch file, and the packages installed on this machine."""

    launch_configurations: dict[str, str]
    installed: frozenset[str] = INSTALLED


@dataclass
class LaunchConfiguration:
    name: str

    def perform(self, context: LaunchContext) -> str:
        return context.launch_configurations[self.name]


@dataclass
class PathJoinSubstitution:
    parts: list[Any]

    def perform(self, context: LaunchContext) -> str:
        return str(Path(*(joined([part], context) for part in self.parts)))


@dataclass
class Command:
    """A command whose text is returned instead of its output."""

    command: list[Any]
    on_stderr: str = "fail"

    def __post_init__(self) -> None:
        assert self.on_stderr in ("fail", "ignore", "warn", "capture")

    def perform(self, context: LaunchContext) -> str:
        return shlex.join(shlex.split(joined(self.command, context)))


@dataclass
class FindPackageShare:
    package: str

    def perform(self, context: LaunchContext) -> str:
        _require(self.package, context)
        return f"/opt/share/{self.package}"


@dataclass
class ExecutableInPackage:
    executable: str
    package: str

    def perform(self, context: LaunchContext) -> str:
        _require(self.package, context)
        return f"/opt/lib/{self.package}/{self.executable}"


def _require(package: str, context: LaunchContext) -> None:
    if package not in context.installed:
        raise PackageNotFoundError(package)


def joined(parts: Any, context: LaunchContext) -> str:
    """Texts and substitutions, concatenated."""
    return "".join(part if isinstance(part, str) else part.perform(context) for part in parts)


class ParameterValue:
    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        assert value_type in KINDS, f"launch knows no {value_type}"
        self.value, self.kind = value, value_type

    def perform(self, context: LaunchContext) -> Any:
        text = joined([self.value], context)
        if self.kind in (str, int, float):
            return self.kind(text)
        found = YAML(typ="safe").load(text)
        inside = getattr(self.kind, "__args__", None)
        if inside is None:
            assert isinstance(found, self.kind)
        else:
            assert isinstance(found, list)
            assert all(isinstance(entry, inside[0]) for entry in found)
        return found


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: str | None = None
    description: str = ""
    choices: list[str] | None = None

    def __post_init__(self) -> None:
        assert self.choices is None or self.default_value in self.choices


@dataclass
class OpaqueFunction:
    function: Callable[[LaunchContext], list[Node]]


@dataclass(kw_only=True)
class Shutdown:
    """Stops everything that was launched."""

    reason: str


@dataclass(kw_only=True)
class Node:
    package: str
    executable: str
    namespace: str | None = None
    parameters: list[str | dict[str, Any]] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    arguments: list[Any] = field(default_factory=list)
    output: str = "log"
    on_exit: Shutdown | None = None
    sigterm_timeout: str = "5"

    @property
    def files(self) -> list[str]:
        """Parameter files, which are read before the values."""
        return [entry for entry in self.parameters if isinstance(entry, str)]

    def values(self, context: LaunchContext) -> dict[str, Any]:
        """Parameters that the node would get, without those of files."""
        return {
            name: value.perform(context) if isinstance(value, ParameterValue) else value
            for table in self.parameters
            if isinstance(table, dict)
            for name, value in table.items()
        }


class LaunchDescription:
    def __init__(self, entities: list[Any]) -> None:
        self.arguments = [e for e in entities if isinstance(e, DeclareLaunchArgument)]
        (self.function,) = entities[len(self.arguments) :]

    def context(
        self, chosen: dict[str, str], installed: frozenset[str] = INSTALLED
    ) -> LaunchContext:
        """The arguments: those chosen, and defaults for the others."""
        known = {argument.name: argument for argument in self.arguments}
        assert set(chosen) <= set(known)
        for name, value in chosen.items():
            assert known[name].choices is None or value in known[name].choices, name
        defaults = {name: str(argument.default_value) for name, argument in known.items()}
        return LaunchContext(defaults | chosen, installed)

    def started(
        self, installed: frozenset[str] = INSTALLED, **chosen: str
    ) -> dict[str, tuple[Node, dict[str, Any]]]:
        """Nodes that these arguments start, with their parameters, by executable."""
        context = self.context(chosen, installed)
        nodes = self.function.function(context)
        return {node.executable: (node, node.values(context)) for node in nodes}


MODULES: dict[str, dict[str, Any]] = {
    "ament_index_python": {},
    "ament_index_python.packages": {"PackageNotFoundError": PackageNotFoundError},
    "launch": {"LaunchContext": LaunchContext, "LaunchDescription": LaunchDescription},
    "launch.actions": {
        kind.__name__: kind for kind in (DeclareLaunchArgument, OpaqueFunction, Shutdown)
    },
    "launch.substitutions": {
        kind.__name__: kind
        for kind in (Command, LaunchConfiguration, PathJoinSubstitution, SubstitutionFailure)
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": Node},
    "launch_ros.parameter_descriptions": {"ParameterValue": ParameterValue},
    "launch_ros.substitutions": {
        kind.__name__: kind for kind in (ExecutableInPackage, FindPackageShare)
    },
}


@contextmanager
def standing_in() -> Iterator[None]:
    """Context in which importing launch gives this stand-in."""
    before = {name: sys.modules.get(name) for name in MODULES}
    for name, content in MODULES.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        sys.modules[name] = module
    yield
    for name, module in before.items():
        if module is None:
            del sys.modules[name]
        else:
            sys.modules[name] = module


def load(path: Path) -> LaunchDescription:
    """Load the description of a launch file."""
    with standing_in():
        names: dict[str, Any] = {"__name__": "launch_file", "__file__": str(path)}
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
        return names["generate_launch_description"]()
