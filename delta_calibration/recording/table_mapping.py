"""Mapping file: meaning and unit of every column of a user's table.

A joint is (scale * number + offset) times its unit; any other quantity is number times unit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delta_calibration.documents import Document, load_schema, read_document
from delta_calibration.errors import ConfigError
from delta_calibration.recording.table_source import Form, Join
from delta_calibration.robot import Robot

ANGLES = {"urad": 1e-6, "mrad": 1e-3, "rad": 1.0, "deg": np.pi / 180, "turn": 2 * np.pi}
LENGTHS = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 25.4e-3}
MASSES = {"g": 1e-3, "kg": 1.0}
TIMES = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
KELVIN = {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5 / 9, -160 / 9)}  # to deg C
PAUSE = 1.1  # [s] stops closer in time could not be distinguished from a stream
_STEPS = "microsteps"
_THIN = 1e-3  # [m] least second singular value of the reflectors' places: else they are collinear


@dataclass(frozen=True)
class Column:
    """A column of numbers and its conversion to SI."""

    name: str
    unit: str
    factor: float  # SI of one unit
    scale: float = 1.0
    offset: float = 0.0  # in the column's unit
    plus: tuple[tuple[str, float], ...] = ()  # other columns to add, in the same unit; factors


@dataclass(frozen=True)
class Turn:
    """Columns of a measured rotation."""

    columns: tuple[Column, ...]
    form: str
    axes: str  # order of the axes of roll, pitch, yaw; small letters: about fixed axes


@dataclass(frozen=True)
class Reflector:
    """One of several reflectors on the platform."""

    columns: tuple[Column, ...]  # (3,) measured
    place: tuple[float, float, float]  # [m] in the platform's frame


@dataclass(frozen=True)
class TableMapping:
    """Content of a mapping file, with its joints in the robot's order."""

    source: str
    stream: bool  # rows are samples of a motion, not stops
    form: Form  # how the file is written
    join: Join | None  # a second file beside it
    skip_missing: bool
    repeated: str  # refuse, skip, keep
    time: Column | None
    time_format: str
    row_interval: float | None  # [s] from row to row, stated instead of times
    commands: tuple[Column, ...]  # (m,)
    encoders: tuple[Column, ...]  # (m,) or none
    position: tuple[Column, ...]  # (3,)
    turn: Turn | None
    reflectors: tuple[Reflector, ...]  # all of them, the one of `position` first; or none
    same_command: str
    payload: Column | None
    temperature: tuple[tuple[str, Column], ...]  # part and its column
    direction: tuple[str, ...]  # one column for all joints, or (m,)
    moving: str
    at_rest: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All columns that are read."""
        turns = self.turn.columns if self.turn else ()
        some = (self.time, self.payload, *(c for _, c in self.temperature))
        others = [c for reflector in self.reflectors for c in reflector.columns]
        numbers = (*self.commands, *self.encoders, *self.position, *others, *turns, *some)
        texts = (self.same_command, *self.direction, self.moving)
        single = [c.name for c in numbers if c]
        added = [name for c in numbers if c for name, _ in c.plus]
        return tuple(dict.fromkeys([*single, *added, *(t for t in texts if t)]))


def read_mapping(path: Path, robot: Robot) -> TableMapping:
    """Read a mapping file.

    Raises:
        ConfigError: no such file, an entry that is missing, unknown or not allowed, joints other
            than the robot's, or units of another kind than its joints have.
    """
    return mapping_from(read_document(path, lambda _: load_schema("mapping")), path, robot)


def mapping_from(document: Document, path: Path, robot: Robot) -> TableMapping:
    """Mapping from a document that keeps to the schema.

    Args:
        document: the entries.
        path: file of the document, existing or not: names of other files are relative to it.
        robot: whose joints it names.

    Raises:
        ConfigError: joints other than the robot's, units of another kind than its joints have, or
            entries that do not go together.
    """
    data = _bare(document)
    time, moving = data.get("time"), data.get("moving", {})
    mapping = TableMapping(
        source=str(path),
        stream=data["rows"] == "stream",
        form=Form.of(data.get("table", {}), data.get("delimiter", ","), f"{path}: table"),
        join=_join(data.get("join"), path),
        skip_missing=data.get("missing") == "skip",
        repeated=data.get("repeated", "refuse"),
        time=time and Column(time["column"], time["unit"], TIMES.get(time["unit"], 1.0)),
        time_format=(time or {}).get("format", ""),
        row_interval=data.get("row_interval_s"),
        commands=_joints(data["commands"], robot, f"{path}: commands"),
        encoders=_joints(data.get("encoders", ()), robot, f"{path}: encoders"),
        position=_places(data["position"], f"{path}: position"),
        turn=_turn(data.get("rotation"), f"{path}: rotation"),
        reflectors=_reflectors(data, f"{path}: reflectors"),
        same_command=data.get("same_command", ""),
        payload=_one(data.get("payload"), MASSES),
        temperature=tuple(
            (t["part"], Column(t["column"], t["unit"], 1.0)) for t in data.get("temperature", ())
        ),
        direction=tuple(data.get("direction", ())),
        moving=moving.get("column", ""),
        at_rest=tuple(moving.get("at_rest", ())),
    )
    _require_whole(mapping, len(robot.joints.names))
    _require_apart(mapping, robot.joints.names)
    return mapping


def _bare(value: Any) -> Any:
    """Strip blanks around all texts of a document, because names of columns are stripped too."""
    if isinstance(value, Mapping):
        return {key: _bare(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_bare(item) for item in value]
    return (value.strip() or value) if isinstance(value, str) else value


def _require_whole(mapping: TableMapping, joints: int) -> None:
    """Refuse entries that do not go together."""
    path, time = mapping.source, mapping.time
    if time is not None and (time.unit == "format") != bool(mapping.time_format):
        raise ConfigError(
            f"{path}: time: unit {time.unit!r} with format {mapping.time_format!r} is not "
            "allowed; a format, such as '%Y-%m-%d %H:%M:%S', needs unit format, and unit format "
            "needs one"
        )
    interval = mapping.row_interval
    if time is not None and interval is not None:
        raise ConfigError(f"{path}: row_interval_s is not allowed together with time: one of them")
    if mapping.stream and time is None and interval is None:
        raise ConfigError(
            f"{path}: missing key time: rows of a stream need one, or row_interval_s"
        )
    if not mapping.stream and interval is not None and interval < PAUSE:
        raise ConfigError(
            f"{path}: row_interval_s: {interval:g} is not allowed with rows: stops; they are "
            f"{PAUSE:g} s apart or more"
        )
    if mapping.stream and (mapping.moving or mapping.direction):
        raise ConfigError(
            f"{path}: moving and direction are not allowed with rows: stream; both are found from "
            "the joints there"
        )
    if len(mapping.direction) not in (0, 1, joints):
        raise ConfigError(
            f"{path}: direction: {len(mapping.direction)} values found, 1 or {joints} are expected"
        )


def _require_apart(mapping: TableMapping, joints: Sequence[str]) -> None:
    """Refuse a column that is used for two quantities, or a part with two temperatures.

    The encoder column of a joint may be its command column, as in a table without encoders.
    """
    turns = mapping.turn.columns if mapping.turn else ()
    uses = [("time", mapping.time), ("payload", mapping.payload)]
    uses += [(f"commands: {j}", c) for j, c in zip(joints, mapping.commands, strict=True)]
    uses += [
        (f"encoders: {joints[k]}", column)
        for k, column in enumerate(mapping.encoders)
        if column.name != mapping.commands[k].name
    ]
    uses += [(f"position.columns[{k}]", column) for k, column in enumerate(mapping.position)]
    uses += [(f"rotation.columns[{k}]", column) for k, column in enumerate(turns)]
    uses += [
        (f"reflectors[{k - 1}].columns[{axis}]", column)
        for k, reflector in enumerate(mapping.reflectors)
        for axis, column in enumerate(reflector.columns)
        if k > 0
    ]
    uses += [(f"temperature: {part}", column) for part, column in mapping.temperature]
    first: dict[str, str] = {}
    for use, column in uses:
        if column is not None and first.setdefault(column.name, use) != use:
            raise ConfigError(
                f"{mapping.source}: {use}: column {column.name!r} is already used for "
                f"{first[column.name]}; each needs its own"
            )
    parts = [part for part, _ in mapping.temperature]
    twice = next((part for part in parts if parts.count(part) > 1), None)
    if twice is not None:
        raise ConfigError(
            f"{mapping.source}: temperature: part {twice!r} is given twice; one column per part "
            "is allowed"
        )


def _joints(entries: Sequence[Mapping[str, Any]], robot: Robot, where: str) -> tuple[Column, ...]:
    """One column a joint, in the robot's order; none where there are no entries."""
    names = robot.joints.names
    found = [entry["joint"] for entry in entries]
    if entries and sorted(found) != sorted(names):
        raise ConfigError(
            f"{where}: joints {', '.join(found)} are not allowed; each of {', '.join(names)} once"
        )
    turning = robot.joints.unit == "rad"
    by_name = {entry["joint"]: _joint(entry, turning, where) for entry in entries}
    return tuple(by_name[name] for name in names if entries)


def _joint(entry: Mapping[str, Any], turning: bool, where: str) -> Column:
    units, step = (ANGLES, "step_deg") if turning else (LENGTHS, "step_mm")
    unit, where = entry["unit"], f"{where}: {entry['joint']}"
    steps = [key for key in ("step_deg", "step_mm") if key in entry]
    if steps != ([step] if unit == _STEPS else []):
        raise ConfigError(
            f"{where}: unit {unit} with {', '.join(steps) or 'no step'} is not allowed; "
            f"{step} goes with {_STEPS} of this joint, and only with them"
        )
    if unit != _STEPS and unit not in units:
        kind = "turns" if turning else "slides"
        raise ConfigError(
            f"{where}: unit {unit!r} is not allowed; the joint {kind}: "
            f"{', '.join((*units, _STEPS))}"
        )
    factor = units[unit] if unit != _STEPS else units["deg" if turning else "mm"] * entry[step]
    scale, offset = entry.get("scale", 1.0), entry.get("offset", 0.0)
    return Column(entry["column"], unit, factor, scale, offset, _plus(entry))


def _plus(entry: Mapping[str, Any]) -> tuple[tuple[str, float], ...]:
    """Columns to add to a joint's column, each with its factor."""
    return tuple((item["column"], item.get("scale", 1.0)) for item in entry.get("plus", ()))


def _turn(entry: Mapping[str, Any] | None, where: str) -> Turn | None:
    if entry is None:
        return None
    form, columns = entry["form"], entry["columns"]
    angles = form in ("rpy", "euler")
    bare = form.startswith("quaternion") or form == "matrix"
    expected = {"quaternion_xyzw": 4, "quaternion_wxyz": 4, "matrix": 9}.get(form, 3)
    if len(columns) != expected:
        raise ConfigError(f"{where}.columns: {len(columns)} values found, {expected} are expected")
    if form == "rpy" and entry.get("axes", "xyz").lower() not in ("xyz", "zyx"):
        raise ConfigError(
            f"{where}: axes {entry['axes']!r} is not allowed with form rpy: xyz, XYZ, zyx, ZYX; "
            "form euler takes any order, its columns in the order of the axes"
        )
    for key, needed in (("unit", not bare), ("axes", angles)):
        if (key in entry) != needed:
            raise ConfigError(
                f"{where}: {'missing' if needed else 'unknown'} key {key} with form {form}"
            )
    unit = entry.get("unit", "")
    return Turn(
        tuple(Column(name, unit, ANGLES.get(unit, 1.0)) for name in columns),
        form,
        entry.get("axes", ""),
    )


def _places(entry: Mapping[str, Any], where: str) -> tuple[Column, ...]:
    """Columns of x, y and z, with one unit or one each, and the columns to add to them."""
    units = entry["unit"] if isinstance(entry["unit"], list) else [entry["unit"]] * 3
    added: list[str] = entry.get("plus", [])
    if added and len(added) != len(entry["columns"]):
        raise ConfigError(f"{where}: plus: {len(added)} columns, one for each of position.columns")
    plus: list[tuple[tuple[str, float], ...]] = [((name, 1.0),) for name in added] or [()] * 3
    return tuple(
        Column(name, unit, LENGTHS[unit], plus=more)
        for name, unit, more in zip(entry["columns"], units, plus, strict=True)
    )


def _reflectors(data: Mapping[str, Any], where: str) -> tuple[Reflector, ...]:
    """Reflector of `position` and the others, three or more in all; empty if there is only one."""
    beside, first = data.get("reflectors", ()), data["position"]
    if not beside:
        if "place_mm" in first:
            raise ConfigError(f"{where}: position.place_mm needs further reflectors")
        return ()
    if "rotation" in data:
        raise ConfigError(
            f"{where}: rotation is not allowed together with them; it is computed "
            "from the reflectors"
        )
    found = tuple(
        Reflector(
            _places(entry, where), tuple(1e-3 * v for v in entry.get("place_mm", (0.0,) * 3))
        )
        for entry in (first, *beside)
    )
    place = np.array([each.place for each in found])
    spread = np.linalg.svd(place - place.mean(axis=0), compute_uv=False)
    if spread[1] < _THIN:
        raise ConfigError(
            f"{where}: place_mm: the places lie on one line, within {1e3 * _THIN:g} mm; a "
            "rotation needs three places that do not"
        )
    return found


def _join(entry: Mapping[str, Any] | None, path: Path) -> Join | None:
    """Join of the second file; a relative path starts at the mapping's folder."""
    if entry is None:
        return None
    where, by = f"{path}: join", entry["by"]
    needed = {"row": (), "column": ("left", "right"), "nearest": ("left", "right", "within")}[by]
    rest = ("shift",) if by == "nearest" else ()
    for key in ("left", "right", "within", "shift"):
        if (key in entry) != (key in needed) and key not in rest:
            missing = "missing" if key in needed else "unknown"
            raise ConfigError(f"{where}: {missing} key {key} with by: {by}")
    form = Form.of(entry.get("table", {}), entry.get("delimiter", ","), f"{where}.table")
    keys = {key: entry[key] for key in (*needed, *rest) if key in entry}
    return Join((path.parent / entry["file"]).resolve(), by, form=form, **keys)


def _one(entry: Mapping[str, Any] | None, units: Mapping[str, float]) -> Column | None:
    if entry is None:
        return None
    return Column(entry["column"], entry["unit"], units[entry["unit"]])
