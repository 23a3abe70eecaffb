"""A stand-in for `launch` and `launch_ros`, which are not on PyPI: what a launch file would start.

Holds what is built of them and evaluates it by their rules as documented: substitutions are
joined to texts, values of parameters are coerced as YAML to their `value_type`, which must be one
of `typing`'s, and a condition is a text that says true or false. No process is started.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, List  # noqa: UP035

from ruamel.yaml import YAML

KINDS = (int, float, bool, str, *(List[kind] for kind in (int, float, bool, str)))  # noqa: UP006
Given = Mapping[str, str]  # arguments of the launch file


@dataclass
class LaunchConfiguration:
    name: str

    def perform(self, given: Given) -> str:
        return given[self.name]


@dataclass
class PythonExpression:
    expression: list[Any]

    def perform(self, given: Given) -> str:
        return str(eval(joined(self.expression, given), {}, {}))


@dataclass
class PathJoinSubstitution:
    parts: list[Any]

    def perform(self, given: Given) -> str:
        return str(Path(*(joined([part], given) for part in self.parts)))


@dataclass
class Command:
    """What is run is told, and not run."""

    command: list[Any]
    on_stderr: str = "fail"

    def __post_init__(self) -> None:
        assert self.on_stderr in ("fail", "ignore", "warn", "capture")

    def perform(self, given: Given) -> str:
        return shlex.join(shlex.split(joined(self.command, given)))


@dataclass
class FindPackageShare:
    package: str

    def perform(self, given: Given) -> str:
        return f"/opt/share/{self.package}"


@dataclass
class ExecutableInPackage:
    executable: str
    package: str

    def perform(self, given: Given) -> str:
        return f"/opt/lib/{self.package}/{self.executable}"


def joined(parts: Any, given: Given) -> str:
    """Texts and substitutions, one after the other."""
    return "".join(part if isinstance(part, str) else part.perform(given) for part in parts)


@dataclass
class IfCondition:
    predicate: Any

    def evaluate(self, given: Given) -> bool:
        text = joined([self.predicate], given).lower()
        assert text in ("true", "1", "false", "0"), text
        return text in ("true", "1")


class ParameterValue:
    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        assert any(value_type is kind for kind in KINDS), f"launch knows no {value_type}"
        self.value, self.kind = value, value_type

    def perform(self, given: Given) -> Any:
        text = joined([self.value], given)
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


@dataclass(kw_only=True)
class Node:
    package: str
    executable: str
    parameters: list[dict[str, Any]] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    arguments: list[Any] = field(default_factory=list)
    output: str = "log"
    condition: IfCondition | None = None

    def values(self, given: Given) -> dict[str, Any]:
        """Parameters as the node would get them."""
        return {
            name: value.perform(given) if isinstance(value, ParameterValue) else value
            for table in self.parameters
            for name, value in table.items()
        }


class LaunchDescription:
    def __init__(self, entities: list[Any]) -> None:
        self.arguments = [e for e in entities if isinstance(e, DeclareLaunchArgument)]
        self.nodes = [e for e in entities if isinstance(e, Node)]
        assert len(self.arguments) + len(self.nodes) == len(entities)

    def given(self, **chosen: str) -> Given:
        """The arguments: those chosen, the others by their defaults."""
        known = {a.name: a.default_value for a in self.arguments}
        assert set(chosen) <= set(known)
        return {**known, **chosen}

    def started(self, **chosen: str) -> dict[str, tuple[Node, dict[str, Any]]]:
        """Nodes that these arguments start, with their parameters, by executable."""
        given = self.given(**chosen)
        return {
            node.executable: (node, node.values(given))
            for node in self.nodes
            if node.condition is None or node.condition.evaluate(given)
        }


MODULES: dict[str, dict[str, Any]] = {
    "launch": {"LaunchDescription": LaunchDescription},
    "launch.actions": {"DeclareLaunchArgument": DeclareLaunchArgument},
    "launch.conditions": {"IfCondition": IfCondition},
    "launch.substitutions": {
        kind.__name__: kind
        for kind in (Command, LaunchConfiguration, PathJoinSubstitution, PythonExpression)
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
    """While it lasts, importing launch gives this."""
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
    """What a launch file describes."""
    with standing_in():
        names: dict[str, Any] = {"__name__": "launch_file", "__file__": str(path)}
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
        return names["generate_launch_description"]()
