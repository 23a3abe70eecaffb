"""Presets for the tables of known programs, and mappings made from one or two of them.

A preset is a YAML file of `presets/`. It says how the file is written (`table`) and what its
columns are: the joints, or the measured points. A mapping needs both, and a preset gives only one
of them; a second table with its own preset gives the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from os.path import relpath
from pathlib import Path
from typing import Any

from delta_calibration.documents import parse_yaml
from delta_calibration.errors import InputError
from delta_calibration.robot import Robot

_SIDES = ("joints", "points")


@dataclass(frozen=True)
class Other:
    """Second table, and how its rows are joined to those of the first.

    Attributes:
        file: of the second table.
        preset: name of the preset that describes it.
        by: `row`, `name` or `nearest`.
        within: [s] largest time difference of rows joined by `nearest`.
        shift: [s] added to the times of the second table.
    """

    file: Path
    preset: str
    by: str
    within: float = 0.05
    shift: float = 0.0


@cache
def presets() -> Mapping[str, Mapping[str, Any]]:
    """All presets by name."""
    folder = files("delta_calibration") / "presets"
    found = sorted(
        (file for file in folder.iterdir() if file.name.endswith(".yaml")), key=lambda f: f.name
    )
    return {
        file.name.removesuffix(".yaml"): parse_yaml(file.read_text(encoding="utf-8"), file.name)
        for file in found
    }


def preset(name: str) -> Mapping[str, Any]:
    """The preset of a name.

    Raises:
        InputError: there is no preset of that name.
    """
    if name not in presets():
        raise InputError(f"preset {name!r} is not known; choose from: {', '.join(presets())}")
    return presets()[name]


def overview() -> list[tuple[str, str, str]]:
    """Name, columns given (`joints` or `points`) and description of each preset."""
    return [(name, each["gives"], each["about"]) for name, each in presets().items()]


def mapping_of(
    name: str, robot: Robot, other: Other | None, unit: str | None, beside: Path
) -> dict[str, Any]:
    """Complete mapping, from a preset and that of the second table.

    Args:
        name: of the preset.
        robot: whose joints are in the table.
        other: the second table; None if there is none.
        unit: of the positions, instead of the preset's.
        beside: file that the mapping will be written to; paths are relative to its folder.

    Raises:
        InputError: a preset that does not exist, or presets that do not give joints and points
            together, or no column to join by, or fewer joints than the robot has.
    """
    sides = [preset(name)] + ([] if other is None else [preset(other.preset)])
    given = [each["gives"] for each in sides]
    if sorted(given) != sorted(_SIDES):
        lacking = next((side for side in _SIDES if side not in given), "nothing")
        raise InputError(
            f"preset {name} gives {given[0]}; {lacking} are missing: give the table that "
            "contains them with --join FILE --join-preset NAME"
            if other is None
            else f"presets {name} and {other.preset} both give {given[0]}; one of joints and one "
            "of points are expected"
        )
    joints, points = sorted(sides, key=lambda each: str(each["gives"]))
    streams = [each.get("rows", "stops") for each in sides]
    position = dict(points["position"], **({"unit": unit} if unit else {}))
    mapping: dict[str, Any] = {
        "schema": 1,
        "rows": "stream" if streams == ["stream"] * len(streams) else "stops",
        "table": {"preset": name},
        "commands": _joints(joints["commands"], robot, name),
        "position": position,
    }
    for key in ("time", "rotation"):
        owner = next((each for each in sides if key in each), None)
        if owner is not None:
            mapping[key] = dict(owner[key])
    if "encoders" in joints:
        mapping["encoders"] = _joints(joints["encoders"], robot, name)
    if other is not None:
        mapping["join"] = _join(sides[0], sides[1], other, beside)
    return mapping


def _joints(entry: Mapping[str, Any], robot: Robot, name: str) -> list[dict[str, Any]]:
    names, columns = robot.joints.names, entry["columns"]
    if len(columns) < len(names):
        raise InputError(
            f"preset {name} has {len(columns)} joints, robot {robot.name} {len(names)}"
        )
    return [
        {"joint": joint, "column": column, "unit": entry["unit"]}
        for joint, column in zip(names, columns, strict=False)
    ]


def _join(
    left: Mapping[str, Any], right: Mapping[str, Any], other: Other, beside: Path
) -> dict[str, Any]:
    file = relpath(other.file.absolute(), beside.absolute().parent)
    join = {"file": file, "by": other.by, "table": {"preset": other.preset}}
    if other.by == "row":
        return join
    if other.by == "name":
        columns = [each.get("name", "") for each in (left, right)]
        if not all(columns):
            raise InputError(
                f"--by name: {other.preset} or the other preset has no names; row or nearest"
            )
        return {**join, "by": "column", "left": columns[0], "right": columns[1]}
    columns = [each.get("time", {}).get("column", "") for each in (left, right)]
    if not all(columns):
        raise InputError(
            f"--by nearest: {other.preset} or the other preset has no times; row or name"
        )
    near = {"left": columns[0], "right": columns[1], "within": other.within}
    return {**join, **near, **({"shift": other.shift} if other.shift else {})}
