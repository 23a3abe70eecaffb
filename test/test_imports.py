"""Imports go one way through the layers; ROS, plotting and command line stay in their folders.

Imports are read from the source, so imports inside functions are checked too.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = "delta_calibration"
ROOT = Path(__file__).parents[1] / PACKAGE

# A module may import those before it in this list, and its own.
LAYERS = [
    "errors",
    "bounds",
    "files",
    "loading",
    "lazy",
    "model",
    "processes",
    "threads",
    "texts",
    "documents",
    "tables",
    "parameters",
    "theta",
    "sections",
    "registry",
    "geometry",
    "data",
    "mechanisms",
    "robot",
    "effects",
    "laws",
    "wording",
    "chain",
    "region",
    "uncertainty",
    "estimation",
    "papers",
    "doctor",
    "calibration",
    "description",
    "diagnosis",
    "iso9283",
    "plans",
    "drafting",
    "accuracy",
    "circle_test",
    "compensation",
    "commands",
    "calibration_file",
    "export",
    "simulation",
    "trial",
    "recording",
    "history",
    "fleet",
    "cell",
    "report",
    "notebook",
    "access",
    "bench",
    "cli",
    "ros",
]
ONLY_IN = {
    "ros": re.compile(r"rclpy|\w+_msgs|\w+_interfaces|std_srvs|(rosidl|ament|tf2)_\w+|launch"),
    "report": re.compile(r"matplotlib|plotly|seaborn|bokeh|altair|pyvista"),
    "history": re.compile(r"sqlalchemy"),
    "fleet": re.compile(r"dask|distributed"),
    "bench": re.compile(r"starlette|uvicorn|fastapi|flask|multipart"),
    "cli": re.compile(r"click|argparse|optparse|getopt|typer|rich"),
}


def layer_of(path: Path) -> str:
    """`ros` for ros/node.py, `chain` for chain.py, empty for the package itself."""
    name = path.relative_to(ROOT).parts[0].removesuffix(".py")
    return "" if name == "__init__" else name


def imported_modules(tree: ast.Module, path: Path) -> Iterator[str]:
    """Full dotted names of everything that a file imports, with relative imports resolved."""
    here = [PACKAGE, *path.relative_to(ROOT).parent.parts]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield from (f"{module}.{alias.name}" for alias in node.names)


def violations(source: str, path: Path) -> list[str]:
    """Violations of the rules by this source as a file at this path."""
    tree = ast.parse(source)
    layer = layer_of(path)
    found = []
    for name in imported_modules(tree, path):
        top, *rest = name.split(".")
        if top == PACKAGE and rest and rest[0] in LAYERS:
            allowed = LAYERS[: LAYERS.index(layer) + 1] if layer in LAYERS else []
            if rest[0] not in allowed:
                found.append(f"{layer or PACKAGE} imports {rest[0]}, which is not below it")
        found += [
            f"{top} is imported outside {home}/"
            for home, libraries in ONLY_IN.items()
            if layer != home and libraries.fullmatch(top)
        ]
    prints = (
        isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
        for node in ast.walk(tree)
    )
    if layer != "cli" and any(prints):
        found.append("print outside cli/")
    return found


SOURCES = sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_run_down_the_layers(path: Path) -> None:
    assert violations(path.read_text(encoding="utf-8"), path) == []


def test_every_module_has_a_layer() -> None:
    assert {layer_of(path) for path in SOURCES} - {""} <= set(LAYERS)


@pytest.mark.parametrize(
    ("source", "place", "finding"),
    [
        ("from delta_calibration.chain import x", "data/streams.py", "imports chain, which"),
        ("from ..chain import Chain", "mechanisms/delta.py", "imports chain, which"),
        ("import delta_calibration.cli.main", "robot.py", "imports cli, which"),
        ("from delta_calibration import ros", "cli/replay.py", "imports ros, which"),
        ("from .errors import InputError", "__init__.py", "imports errors, which"),
        ("def f():\n    import rclpy", "cli/replay.py", "rclpy is imported outside ros/"),
        ("from sensor_msgs.msg import JointState", "recording/mcap.py", "sensor_msgs is imported"),
        ("import matplotlib.pyplot as plt", "cli/fit.py", "imported outside report/"),
        ("import argparse", "ros/node.py", "argparse is imported outside cli/"),
        ("from starlette.routing import Route", "cli/serve.py", "imported outside bench/"),
        ("from ..cli.fit import describe", "bench/pages.py", "imports cli, which"),
        ("print('x')", "ros/node.py", "print outside cli/"),
    ],
)
def test_a_breach_is_found(source: str, place: str, finding: str) -> None:
    assert any(finding in found for found in violations(source, ROOT / place))


@pytest.mark.parametrize(
    ("source", "place"),
    [
        ("from ..errors import InputError", "mechanisms/delta.py"),
        ("from .base import Mechanism", "mechanisms/delta.py"),
        ("from delta_calibration import __version__", "calibration_file.py"),
        ("from rosbags.typesys import Stores", "recording/mcap.py"),
        ("import rclpy", "ros/node.py"),
        ("import click\nprint('x')", "cli/fit.py"),
    ],
)
def test_what_is_allowed_passes(source: str, place: str) -> None:
    assert violations(source, ROOT / place) == []
