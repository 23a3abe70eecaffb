"""Help text of a node (`--help`), generated from its declarations."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from importlib import import_module

from delta_calibration.ros.inventory import NODES, Inventory
from delta_calibration.ros.lifecycle import AUTOSTART
from delta_calibration.ros.parameters import DATA_DIR, Spec
from delta_calibration.ros.peers import SERVICES

ASKED = ("--help", "-h")
WIDTH = 99
KINDS = {bool: "true or false", int: "whole number", float: "decimal number", str: "text"}


def asks_for_help(argv: Sequence[str]) -> bool:
    """Whether a command line, program name first, asks for help outside its ROS arguments."""
    own = argv[1 : argv.index("--ros-args")] if "--ros-args" in argv else argv[1:]
    return any(word in ASKED for word in own)


def help_text(name: str) -> str:
    """Help text of a node: purpose, example, topics and services, and parameters.

    Args:
        name: name of the executable.
    """
    module, inventory = import_module(f"delta_calibration.ros.{name}"), NODES[name]
    return "\n".join(
        [
            f"{name}: {inspect.cleandoc(module.__doc__ or '')}",
            "",
            "Example:",
            f"    ros2 run delta_calibration {name} {inventory.example}",
            "",
            "Topics and services (~ is the node's name; a namespace goes before all but /...):",
            *_ends(inventory),
            "",
            "Parameters (behind --ros-args: -p NAME:=VALUE, or --params-file FILE):",
            *(line for spec in specs_of(name) for line in _parameter(spec)),
            "",
        ]
    )


def specs_of(name: str) -> tuple[Spec, ...]:
    """All parameters that a node declares."""
    specs = tuple(import_module(f"delta_calibration.ros.{name}").SPECS)
    if any(spec.path for spec in specs):
        specs = (DATA_DIR, *specs)
    own = (AUTOSTART,) if name == "calibration_node" else ()
    return (*specs, *own, SERVICES)


def _ends(inventory: Inventory) -> Iterator[str]:
    for does in ("subscribes", "publishes", "serves", "calls"):
        for name, kind in getattr(inventory, does).items():
            yield f"    {does:<10}  {name:<38}  {kind}"
    for part, parameter in inventory.named.items():
        yield f"    {part}: given by the parameter {parameter}; not used if it is empty"


def _parameter(spec: Spec) -> Iterator[str]:
    when = ", at the start only" if spec.read_only else ""
    yield f"    {spec.name} = {_yaml(spec.default)}  ({_allowed(spec)}{when})"
    indent = 8 * " "
    yield from textwrap.wrap(
        spec.description, WIDTH, initial_indent=indent, subsequent_indent=indent
    )


def _allowed(spec: Spec) -> str:
    """Type and allowed values, in words."""
    many = isinstance(spec.default, tuple)
    kind = KINDS[type(spec.default[0] if isinstance(spec.default, tuple) else spec.default)]
    allowed = f"list of {kind}s" if many else kind
    if spec.range is not None:
        allowed += f" from {spec.range[0]:.10g} to {spec.range[1]:.10g}"
    if spec.choices:
        allowed += f": {', '.join(map(_yaml, spec.choices))}"
    return allowed


def _yaml(value: object) -> str:
    """Format a value as on a command line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Iterable) and not isinstance(value, str):
        return f"[{', '.join(map(_yaml, value))}]"
    return str(value) if value != "" else "''"
