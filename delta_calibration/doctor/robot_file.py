"""Hypotheses of a robot file with numbers in a wrong unit, or of another robot's file."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from delta_calibration.data import JointStream, Session
from delta_calibration.doctor.change import COMMAND, ROBOT_FILE, STATES, Change, of_joints
from delta_calibration.documents import Document
from delta_calibration.errors import CalibrationError
from delta_calibration.robot import Robot, known_robots, load_robot, robot_from

Path = tuple[Any, ...]

_DEG = 180 / np.pi
# unit in the key: units that the numbers may have instead, and the factors that correct them
_OTHER = {
    "mm": (("m", 1e3), ("inch", 25.4), ("um", 1e-3), ("cm", 10.0)),
    "deg": (("rad", _DEG), ("mrad", _DEG / 1e3)),
}
_SECTIONS = ("geometry", "joints", "tool")


def edited_files(data: Document, source: str) -> Iterator[Change]:
    """Yield valid robot files in which some numbers are taken to be in another unit.

    In geometry and tool: one entry, all entries of a unit, or all with the same key. In joints:
    the limits, the zeros, or both.
    """
    for paths in _groups(data):
        unit = _unit(paths[0])
        for other, factor in _OTHER[unit]:
            edited = _times(data, paths, factor)
            try:
                robot = robot_from(edited, source)
            except (CalibrationError, ValueError, ArithmeticError, TypeError):
                continue
            first = _said(edited, paths[0])
            more = f" and {len(paths) - 1} more of its lines" if len(paths) > 1 else ""
            yield Change(
                "robot_file_unit",
                (ROBOT_FILE,),
                lambda session: session,
                f"write `{first}`{more} in {source}",
                part=_name(paths[0]) if len(paths) == 1 else _name(paths[0][:-1]) or None,
                value=factor,
                unit=f"{unit}/{other}",
                robot=robot,
                document=edited,
            )


def other_robots(robot: Robot) -> Iterator[Change]:
    """Robots of the package with the same number and unit of joints, as hypotheses."""
    for other in robots_that_come():
        alike = (
            other.hash != robot.hash
            and len(other.joints.names) == len(robot.joints.names)
            and other.joints.unit == robot.joints.unit
        )
        if alike:
            yield Change(
                "wrong_robot",
                (ROBOT_FILE,),
                _renamed(other.joints.names),
                f"`--robot {other.name}`",
                part=other.name,
                robot=other,
            )


@cache
def robots_that_come() -> tuple[Robot, ...]:
    """The robots that come with the package."""
    return tuple(load_robot(name) for name in known_robots())


def _renamed(names: tuple[str, ...]) -> Callable[[Session], Session]:
    def rename(stream: JointStream) -> JointStream:
        return JointStream(stream.stamp_ns, names, stream.position)

    return of_joints((COMMAND, STATES), rename)


def _groups(data: Document) -> list[list[Path]]:
    """Groups of entries that one mistake may affect together."""
    found: list[list[Path]] = []
    for section in _SECTIONS:
        entries = [(section, *path) for path in _entries(data.get(section, {}))]
        if section == "joints":
            limits = [p for p in entries if str(p[-1]).startswith(("lower_", "upper_"))]
            zeros = [p for p in entries if str(p[-1]).startswith("zero_")]
            found += [limits] if limits else []
            found += [zeros, limits + zeros] if zeros else []
            continue
        found += [[path] for path in entries]
        for unit in _OTHER:
            alike = [path for path in entries if _unit(path) == unit]
            if len(alike) > 1:
                found.append(alike)
            keys = dict.fromkeys(path[-1] for path in alike)
            for key in keys if len(keys) > 1 else ():
                same = [path for path in alike if path[-1] == key]
                if len(same) > 1:
                    found.append(same)
    return found


def _entries(value: Any, path: Path = ()) -> Iterator[Path]:
    """Paths of numbers and lists of numbers whose keys end in one of the units of `_OTHER`."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if isinstance(item, Mapping) or (_is_list_of_mappings(item)):
                yield from _entries(item, (*path, key))
            elif _unit((key,)) in _OTHER and _is_number(item) and np.any(np.asarray(item)):
                yield (*path, key)
    elif isinstance(value, list):
        for row, item in enumerate(value):
            yield from _entries(item, (*path, row))


def _is_list_of_mappings(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _is_number(value: Any) -> bool:
    try:
        return bool(np.asarray(value, dtype=float).size)
    except (TypeError, ValueError):
        return False


def _unit(path: Path) -> str:
    return str(path[-1]).rsplit("_", 1)[-1]


def _times(data: Document, paths: list[Path], factor: float) -> dict[str, Any]:
    edited = copy.deepcopy(dict(data))
    for path in paths:
        inside: Any = edited
        for key in path[:-1]:
            inside = inside[key]
        inside[path[-1]] = (np.asarray(inside[path[-1]], dtype=float) * factor).tolist()
    return edited


def _name(path: Path) -> str:
    parts = (f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    return "".join(parts).removeprefix(".")


def _said(data: Document, path: Path) -> str:
    value: Any = data
    for key in path:
        value = value[key]
    return f"{_name(path)}: {_short(value)}"


def _short(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_short(item) for item in value)}]"
    return f"{float(value):.10g}"
