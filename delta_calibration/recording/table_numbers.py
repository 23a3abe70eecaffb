"""Read the numbers of a table in SI, each with the line that it came from."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.errors import InputError
from delta_calibration.geometry import align
from delta_calibration.recording.table_mapping import (
    KELVIN,
    PAUSE,
    Column,
    Reflector,
    TableMapping,
    Turn,
)
from delta_calibration.recording.table_repeats import new_rows
from delta_calibration.recording.table_source import is_gap, read_source
from delta_calibration.tables import Row
from delta_calibration.texts import number_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STOP = 10.0  # [s] from row to row if a table of stops has no times
_LATEST = float(2**31)  # [s] a ROS stamp ends there
_SHOWN = 6  # texts of a column in a message, at most
_APART = 0.5e-3  # [m] largest distance of a reflector from its place in the fitted platform frame
_YEAR = re.compile(r"%[YyGcDFxsj]")  # directives of a time that includes a date
_COMMA = re.compile(r"[+-]?[\d.' ]*\d,\d+")  # perhaps a decimal comma
_SIDES = "is not allowed; allowed: -1, 0, 1 (motion to the stop: backward, unknown, forward)"
_NOT_UNIT = 1e-2  # deviation of a quaternion or matrix from unit length, too large for rounding


@dataclass(frozen=True)
class TableNumbers:
    """Numbers of a table in SI, for n rows and m joints."""

    file: Path
    rows: tuple[Row, ...]
    time: Array  # (n,) [s], rising
    command: Array  # (n, m) [rad, m]
    encoder: Array | None  # (n, m)
    position: Array  # (n, 3) [m]; NaN in rows that move
    quaternion: Array | None  # (n, 4) x y z w; NaN in rows that move
    payload: Array | None  # (n,) [kg]
    temperature: Array  # (n, parts) [deg C]
    direction: Array | None  # (n, m) -1, 0, 1
    moves: Mask  # (n,)
    notes: tuple[str, ...]

    def wrong(self, row: int, column: str, problem: str) -> InputError:
        """Error about the value of a row (from 0) in a column."""
        return self.rows[row].wrong(column, problem)


def read_numbers(path: Path, mapping: TableMapping, sigma: float) -> TableNumbers:
    """Read the rows of a table that are used; `sigma` [m] is the least noise of a reading.

    Raises:
        InputError: no such file, a column missing, a cell that is empty or no finite number,
            times that do not rise, repeated rows, none at rest, an impossible rotation or
            direction; names file, line and column.
    """
    source = read_source(path, mapping.names, mapping.form, mapping.join)
    rows, notes = list(source.rows), list(source.notes)
    if mapping.skip_missing:
        whole = [row for row in rows if all(_filled(row, name) for name in mapping.names)]
        if len(whole) < len(rows):
            notes.append(_left_out(rows, whole))
        rows = whole
        if not rows:
            raise InputError(f"{path}: every row has gaps in {', '.join(mapping.names)}")
    moves = np.array([_moves(row, mapping) for row in rows])
    if moves.all():
        found = sorted({(row.text[mapping.moving] or "").strip() for row in rows})
        raise InputError(
            f"{path}: column {mapping.moving}: no row is at rest; moving.at_rest has "
            f"{', '.join(map(repr, mapping.at_rest))}, the column has "
            f"{', '.join(map(repr, found[:_SHOWN]))}"
        )
    new, repeats = new_rows(rows, moves, mapping, sigma)
    rows, moves = [row for row, kept in zip(rows, new, strict=True) if kept], moves[new]
    notes += repeats
    if moves.any():
        notes.append(f"{np.count_nonzero(moves)} rows in motion; their measurements were left out")
    still = [row for row, moving in zip(rows, moves, strict=True) if not moving]
    position = np.full((len(rows), 3), np.nan)
    position[~moves] = _columns(still, mapping.position).reshape(-1, 3)
    quaternion = None
    if mapping.turn is not None:
        quaternion = np.full((len(rows), 4), np.nan)
        quaternion[~moves] = _quaternions(still, mapping.turn)
    elif mapping.reflectors:
        quaternion = np.full((len(rows), 4), np.nan)
        quaternion[~moves] = _turns(still, mapping.reflectors)
    numbers = TableNumbers(
        file=path,
        rows=tuple(rows),
        time=_times(rows, mapping),
        command=_columns(rows, mapping.commands),
        encoder=_columns(rows, mapping.encoders) if mapping.encoders else None,
        position=position,
        quaternion=quaternion,
        payload=None if mapping.payload is None else _payload(rows, mapping.payload),
        temperature=_celsius(rows, mapping),
        direction=_directions(rows, mapping) if mapping.direction else None,
        moves=moves,
        notes=tuple(notes),
    )
    if mapping.same_command:
        _require_same(numbers, mapping)
    return numbers


def _left_out(rows: Sequence[Row], whole: Sequence[Row]) -> str:
    """Note on the rows that have gaps."""
    kept = {id(row) for row in whole}
    lines = [str(row.line) for row in rows if id(row) not in kept]
    more, many = ", ..." * (len(lines) > _SHOWN), "s" * (len(lines) > 1)
    return (
        f"{len(lines)} of {len(rows)} rows have gaps and were left out (line{many} "
        f"{', '.join(lines[:_SHOWN])}{more})"
    )


def _filled(row: Row, name: str) -> bool:
    return not is_gap(row.text[name])


def _number(row: Row, name: str) -> float:
    if not _filled(row, name):
        raise row.wrong(name, "is missing; `missing: skip` in the mapping leaves such rows out")
    if _COMMA.fullmatch((row.text[name] or "").strip()):
        raise row.wrong(
            name,
            "is not a finite number; use a decimal point and no thousands separator: -1234.5; if "
            "the comma is the decimal mark, state it in the mapping: `table: {decimal: ','}`, for "
            "a second file below `join` (--mapping-out writes the mapping of a preset)",
        )
    return row.number(name)


def _summed(row: Row, column: Column) -> float:
    """Value of a column plus that of the columns to be added, in the column's unit."""
    return _number(row, column.name) + sum(k * _number(row, name) for name, k in column.plus)


def _columns(rows: Sequence[Row], columns: Sequence[Column]) -> Array:
    """Values of the columns in SI, (n, columns)."""
    raw = np.array([[_summed(row, c) for c in columns] for row in rows])
    scale, offset, factor = (
        np.array([getattr(c, name) for c in columns]) for name in ("scale", "offset", "factor")
    )
    return np.asarray((scale * raw + offset) * factor)


def _times(rows: Sequence[Row], mapping: TableMapping) -> Array:
    """Times of the rows, (n,) [s]; at equal steps if the table has none.

    Rows that were left out, or had no partner in another file, take their time too.
    """
    column = mapping.time
    if column is None:
        step = mapping.row_interval or STOP
        time = step * np.array([row.line - rows[0].line + 1.0 for row in rows])
        if time[-1] >= _LATEST:
            raise InputError(
                f"{rows[-1].file}: {len(rows)} rows, {step:g} s apart, end at "
                f"{time[-1]:.6g} s; less than {_LATEST:.0f} s is allowed"
            )
        return time
    if column.unit == "format":
        time = np.array([_moment(row, column.name, mapping.time_format) for row in rows])
    else:
        time = _columns(rows, [column])[:, 0]
    outside = np.flatnonzero(~((time >= 0) & (time < _LATEST)))
    if outside.size:
        raise rows[outside[0]].wrong(
            column.name,
            f"is {time[outside[0]]:.6g} s; 0 to {_LATEST:.0f} s are allowed: is it in another "
            "unit?",
        )
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        row, before = rows[late[0] + 1], rows[late[0]]
        how = "is the same as" if time[late[0] + 1] == time[late[0]] else "is before that of"
        raise row.wrong(
            column.name,
            f"{how} line {before.line}, {(before.text[column.name] or '')!r}; rows must be in "
            "order of time",
        )
    close = np.flatnonzero(np.diff(time) < PAUSE)
    if not mapping.stream and close.size:
        row, gap = rows[close[0] + 1], float(np.diff(time)[close[0]])
        raise row.wrong(
            column.name,
            f"is {gap:.3g} s after line {rows[close[0]].line}; stops are {PAUSE:g} s apart or "
            "more: another unit, or `rows: stream`? Without time, rows are stops in their order",
        )
    return time


def _moment(row: Row, name: str, form: str) -> float:
    """Seconds since 1970; a time of day without a date is taken as one of the first day."""
    try:
        moment = datetime.strptime((row.text[name] or "").strip(), form)
    except (ValueError, re.error):  # the latter if the form has a directive twice
        raise row.wrong(name, f"is not of the form {form!r}") from None
    if not _YEAR.search(form):
        moment = moment.replace(year=1970)
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=timezone.utc)
    return moment.timestamp()


def _moves(row: Row, mapping: TableMapping) -> bool:
    return bool(mapping.moving) and (row.text[mapping.moving] or "").strip() not in mapping.at_rest


def _quaternions(rows: Sequence[Row], turn: Turn) -> Array:
    """Unit quaternions of measured rotations, (n, 4) x y z w."""
    if not rows:
        return np.zeros((0, 4))
    values = _columns(rows, turn.columns)
    names = [column.name for column in turn.columns]
    if turn.form.startswith("quaternion"):
        off = np.abs(np.linalg.norm(values, axis=1) - 1.0)
        bad = np.flatnonzero(off > _NOT_UNIT)
        if bad.size:
            raise rows[bad[0]].wrong(
                names[0],
                f"and {', '.join(names[1:])} form a quaternion of length "
                f"{np.linalg.norm(values[bad[0]]):.4g}; 1 is needed",
            )
        ordered = values if turn.form.endswith("xyzw") else np.roll(values, -1, axis=1)
        return np.asarray(Rotation.from_quat(ordered).as_quat())
    if turn.form == "matrix":
        return _matrices(rows, values.reshape(-1, 3, 3), names)
    beyond = np.argwhere(np.abs(values) > 2 * np.pi)
    if len(beyond):
        row, column = beyond[0].tolist()
        other = "deg" if turn.columns[0].unit != "deg" else "another unit"
        raise rows[row].wrong(
            names[column],
            f"{turn.columns[0].unit} is more than a turn; likely {other}",
        )
    rotation = (
        Rotation.from_rotvec(values)
        if turn.form == "rotation_vector"
        else Rotation.from_euler(
            turn.axes, _in_order(values, turn.axes) if turn.form == "rpy" else values
        )
    )
    return np.asarray(rotation.as_quat())


def _turns(rows: Sequence[Row], reflectors: Sequence[Reflector]) -> Array:
    """Quaternions (n, 4) of the platform, fitted to three or more reflectors on it."""
    place = np.array([reflector.place for reflector in reflectors])
    point = np.stack([_columns(rows, reflector.columns) for reflector in reflectors], axis=1)
    found = np.empty((len(rows), 4))
    for k, row in enumerate(rows):
        frame = align(place, point[k])
        off = np.linalg.norm(frame.apply(place) - point[k], axis=1)
        worst = int(off.argmax())
        if off[worst] > _APART:
            raise row.wrong(
                reflectors[worst].columns[0].name,
                f"and those beside it lie {1e3 * off[worst]:.3g} mm from the place of that "
                f"reflector relative to the others in place_mm; {1e3 * _APART:g} mm are allowed",
            )
        found[k] = Rotation.from_matrix(frame.rotation).as_quat()
    return found


def _matrices(rows: Sequence[Row], matrix: Array, names: Sequence[str]) -> Array:
    """Quaternions (n, 4) of rotation matrices (n, 3, 3), given row by row."""
    off = np.abs(matrix @ matrix.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero((off > _NOT_UNIT) | (np.linalg.det(matrix) < 0))
    if bad.size:
        raise rows[bad[0]].wrong(
            names[0], f"and {', '.join(names[1:])} do not form a rotation matrix (row by row)"
        )
    return np.asarray(Rotation.from_matrix(matrix).as_quat())


def _in_order(values: Array, axes: str) -> Array:
    """Sort roll, pitch, yaw (about x, y, z) into the order of the rotations."""
    return values[:, ["xyz".index(axis) for axis in axes.lower()]]


def _payload(rows: Sequence[Row], column: Column) -> Array:
    mass = _columns(rows, [column])[:, 0]
    bad = np.flatnonzero(mass < 0)
    if bad.size:
        raise rows[bad[0]].wrong(column.name, "is negative; a mass is not")
    return mass


def _celsius(rows: Sequence[Row], mapping: TableMapping) -> Array:
    """Temperatures of the parts, (n, parts) [deg C]."""
    columns = [column for _, column in mapping.temperature]
    if not columns:
        return np.zeros((len(rows), 0))
    factor, shift = np.array([KELVIN[column.unit] for column in columns]).T
    celsius = _columns(rows, columns) * factor + shift
    bad = np.argwhere((celsius < -60.0) | (celsius > 200.0))
    if len(bad):
        row, column = bad[0].tolist()
        raise rows[row].wrong(
            columns[column].name,
            f"{columns[column].unit} is {celsius[row, column]:.0f} deg C; -60 to 200 are allowed: "
            "likely in another unit (degC, degF, K)",
        )
    return np.asarray(celsius)


def _directions(rows: Sequence[Row], mapping: TableMapping) -> Array:
    """Direction of approach of each joint, (n, m): -1, 0 or 1."""
    for row, name in product(rows, mapping.direction):
        if _filled(row, name) and not np.isfinite(number_of(row.text[name] or "")):
            raise row.wrong(name, _SIDES)
    sides = np.array([[_number(row, name) for name in mapping.direction] for row in rows])
    bad = np.argwhere(~np.isin(sides, (-1.0, 0.0, 1.0)))
    if len(bad):
        row, column = bad[0].tolist()
        raise rows[row].wrong(mapping.direction[column], _SIDES)
    return np.broadcast_to(sides, (len(rows), len(mapping.commands)))


def _require_same(numbers: TableNumbers, mapping: TableMapping) -> None:
    """Refuse rows that are labelled as one command but have different commands."""
    first: dict[str, int] = {}
    for row, line in enumerate(numbers.rows):
        label = (line.text[mapping.same_command] or "").strip()
        like = first.setdefault(label, row)
        joint = int(np.abs(numbers.command[row] - numbers.command[like]).argmax())
        if abs(numbers.command[row] - numbers.command[like])[joint] > 1e-9:
            name = mapping.commands[joint].name
            raise numbers.wrong(
                row,
                name,
                f"differs from {(numbers.rows[like].text[name] or '')!r} in line "
                f"{numbers.rows[like].line}, which has the same {mapping.same_command} {label!r}",
            )
