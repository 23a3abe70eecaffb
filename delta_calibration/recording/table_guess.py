"""Propose a mapping for a table, with the doubts about it.

Columns are identified by their names first. Columns and units that the names leave open are chosen
by the robot: they are right if the nominal robot then matches the measured points. The share of a
reading is the median distance between nominal robot and points over the points' spread.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from delta_calibration.errors import InputError
from delta_calibration.recording.presets import Other
from delta_calibration.recording.table_computed import last_digits, why_computed
from delta_calibration.recording.table_found import FoundTable, found_table
from delta_calibration.recording.table_groups import (
    INTENDED,
    READ,
    Group,
    by_instrument,
    joint_groups,
    kind_of,
    measured_first,
    point_groups,
    rotation_columns,
)
from delta_calibration.recording.table_mapping import ANGLES, KELVIN, LENGTHS
from delta_calibration.recording.table_names import CLOCK, MEANT, bare_name, warm_name
from delta_calibration.recording.table_pair import paired
from delta_calibration.recording.table_placing import FEWEST, Placed
from delta_calibration.recording.table_source import is_gap
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
_Numbers = TypeVar("_Numbers", float, Array)

_LIES = 0.03  # largest share at which the nominal robot matches the points
_BETTER = 0.9  # of the share with one unit for x, y and z: below it, mixed units raise a doubt
_CLEARLY = 3.0  # factor between two shares from which one reading is clearly better
_ZEROS = 48  # steps in which the common zero of all joints is searched, over one turn
_ALIKE = 3  # if more of these zeros fit as well as the best, the points do not determine the zero
_OUT_OF_REACH = 1e6  # share of a reading that the nominal robot cannot reach
_MOST = 300  # rows that are evaluated at most
_SHOWN = 10  # rows that are shown to the user
_STEPS = 2.0, 600.0  # [s] plausible time between stops, if a column of times is in seconds
_POINT_UNITS = ("mm", "m", "inch")
_POINT_UNITS_ALIKE = tuple((unit, unit, unit) for unit in _POINT_UNITS)
_PLACE = re.compile(
    r"(?:(?:meas|measured|measurement|tracker|ist|actual|pos|position|point|p|t|tcp)[ _.-]*)*"
    r"([xyz])$"
)
_TURN = re.compile(r"(?:quat|rot|q|orientation)[ _.-]*([xyzw])$")
_OTHERS = {
    "time": re.compile(rf"({CLOCK}|date|datetime|datum|uhrzeit|zeitstempel)$"),
    "payload": re.compile(r"(payload|load|mass|last|masse|zuladung)$"),
}
_SIDE = re.compile(r"(direction|side|approach|seite|richtung)$")
_WORKSHOP = -20.0, 60.0  # [deg C] plausible temperatures, if a name does not spell out the unit
_AGREE = 0.05  # of the commands' extent: encoders differ less from them
_DIFFERENCE = re.compile(
    r"(?:d|delta|diff?|difference|err|error|dev|deviation)[ _.-]*([xyz])$|"
    r"([xyz])[ _.-]*(?:delta|diff?|difference|err|error|dev|deviation)$"
)


@dataclass(frozen=True)
class Guess:
    """A proposed mapping, with the doubts to be checked before it is used."""

    mapping: Mapping[str, Any]
    sure: tuple[str, ...]  # findings, each with its reason
    doubts: tuple[str, ...]
    shown: tuple[Mapping[str, str], ...]  # rows as they would be read

    def as_dict(self) -> dict[str, Any]:
        """As `delta-cal import --guess --json` writes it."""
        return {
            "schema": 1,
            "mapping": dict(self.mapping),
            "sure": list(self.sure),
            "doubts": list(self.doubts),
            "rows": [dict(row) for row in self.shown],
        }


@dataclass(frozen=True)
class _Count:
    """Direction and zero that all joint numbers share, if they differ from the robot file's."""

    sign: float = 1.0
    zero: float = 0.0  # number in the table, in its unit, at the zero of the robot's joints
    open: tuple[float, float] = (0.0, 0.0)  # interval of zeros that fit as well, if any

    def joints(self, number: _Numbers) -> _Numbers:
        """Convert numbers of the table to the robot's joints, in the unit of the numbers."""
        return self.sign * (number - self.zero)

    def mapped(self, factor: float = 1.0) -> dict[str, float]:
        """Keys `scale` and `offset` of a mapping's joints.

        Args:
            factor: of the numbers' unit to that of the column.
        """
        scale = {"scale": -1} if self.sign < 0 else {}
        return scale | ({"offset": -self.sign * self.zero * factor} if self.zero else {})

    def said(self, unit: str) -> str:
        """Describe direction and zero for the user."""
        way = "count in the other direction" if self.sign < 0 else "count from another zero"
        return f"{way}, and read {self.zero:g} {unit} where the robot file has 0"

    def doubt(self, unit: str) -> str:
        """Doubt about direction and zero, for the user."""
        if self.open[1] > self.open[0]:
            low, high = self.open
            return (
                "the points do not determine the common zero of the joints: any value from "
                f"{low:.3g} to {high:.3g} {unit} matches equally well"
            )
        return (
            "the direction and zero of the joints were found from the points: compare them with "
            "the drives' settings"
        )


_AS_FILED = _Count()


@dataclass
class _Found:
    """Columns and units identified so far, with the findings and doubts."""

    joints: list[str] = field(default_factory=list)  # columns of the joints
    encoders: list[str] = field(default_factory=list)  # columns of the joints' measured values
    encoder_unit: str = ""
    place: list[str] = field(default_factory=list)  # columns x, y, z of the point
    points: list[Group] = field(default_factory=list)  # columns that may be a point, by names
    measured: list[str] = field(default_factory=list)  # columns of joints' measured values
    joint_unit: str = ""
    place_units: list[str] = field(default_factory=list)
    count: _Count | None = None  # direction and zero of all joints, if not the robot file's
    sure: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


def guessed(
    path: Path, robot: Robot, other: Other | None = None, beside: Path = Path("mapping.yaml")
) -> Guess:
    """Propose a mapping for a table with the joints of a robot and measured points.

    Args:
        path: file of the table.
        robot: whose joints and dimensions are looked for.
        other: second table, if joints and points are in two files; its preset is not used.
        beside: file that the mapping will be written to; the second file's path is relative to it.

    Raises:
        InputError: no such file, no table in it, no columns that could be the joints and the
            points, or two tables whose rows do not go together.
    """
    table = found_table(path)
    if other is not None:
        table = paired(table, found_table(other.file, "--join-preset"), path, other, beside)
    found = _by_names(table, robot)
    _by_robot(path, table, robot, found, other is not None)
    mapping = _mapping(table, robot, found)
    return Guess(
        mapping,
        (*table.notes, *found.sure),
        tuple(found.doubts),
        tuple(_rows(table, found)),
    )


# --- by names


def _by_names(table: FoundTable, robot: Robot) -> _Found:
    found = _Found()
    if not table.named:
        return found
    joints = joint_groups(table.names, robot.joints.names)
    found.joints = list(joints[0].columns) if joints else []
    found.measured = [name for g in joints[1:] if g.kind == READ for name in g.columns]
    taken = {*found.joints, *found.measured}
    found.points = [g for g in point_groups(table.names) if not taken & set(g.columns)]
    found.place = _named_place(table, found)
    for what, columns in (("joints", found.joints), ("the point", found.place)):
        if columns:
            found.sure.append(f"{what}: columns {', '.join(columns)}, by their names")
    units = {bare_name(name)[1] for name in found.joints} - {""}
    known = ANGLES if robot.joints.unit == "rad" else LENGTHS
    found.joint_unit = units.pop() if len(units) == 1 and units <= set(known) else ""
    found.place_units = list(_told_units(found.place))
    return found


def _told_units(place: Sequence[str]) -> tuple[str, ...]:
    """Units in the names of a point's columns; empty if any of them lacks one."""
    told = tuple(bare_name(name)[1] for name in place)
    return told if all(unit in LENGTHS for unit in told) else ()


def _named_place(table: FoundTable, found: _Found) -> list[str]:
    """Columns of the point if the names leave no choice, else empty."""
    if not found.points:
        bare = {name: bare_name(name)[0] for name in table.names}
        place = [
            n for axis in "xyz" for n in bare if (m := _PLACE.match(bare[n])) and m[1] == axis
        ]
        return place if len(place) == 3 else []
    best = measured_first(found.points)
    alone = len(best) == 1 and best[0].plain and best[0].kind != INTENDED
    return list(best[0].columns) if alone else []


# --- by the robot


def _by_robot(path: Path, table: FoundTable, robot: Robot, found: _Found, joined: bool) -> None:
    """Choose columns and units that the names leave open, by the fit of the nominal robot."""
    tried = _tried(table, robot, found)
    if tried:
        tried = _of_measured(tried, table, robot, found)
    if tried and not found.place_units:
        tried = _by_mixed_units(tried, table, robot, found)
    if not tried:
        raise InputError(
            f"{path}: no {len(robot.joints.names)} columns of joints and 3 of a point found; "
            f"columns: {', '.join(table.names)}"
            + ("" if joined else "; if they are in a second file, give it with --join FILE")
        )
    share, joints, place, joint_unit, place_units = tried[0]
    found.joints, found.place = list(joints), list(place)
    open_units = not (found.joint_unit and _told_units(place))
    found.joint_unit, found.place_units = joint_unit, list(place_units)
    if not np.isfinite(share) or share > _LIES:
        if _by_count(table, robot, found, tried):
            return
        found.doubts.append(
            "no choice of columns and units makes the nominal robot match the points: perhaps "
            "the joints have another sign, zero or order, it is another robot, or there are too "
            "few rows at rest"
        )
        return
    told = place_units[:1] if len(set(place_units)) == 1 else place_units
    said = f"joints in {joint_unit}, the point in {', '.join(told)}"
    reason = f"the nominal robot matches the points within {100 * share:.1f} % of their extent"
    found.sure.append(f"{said}: {reason}" if open_units else f"{said}, by name; {reason}")
    near = [one for one in tried[1:] if one[0] < _CLEARLY * share and not _apart(one, tried[0])]
    if near:
        _, j, p, ju, pu = near[0]
        found.doubts.append(
            f"columns {', '.join((*j, *p))} in {ju} and {pu[0]} match nearly as well: check the "
            "rows"
        )


def _tried(table: FoundTable, robot: Robot, found: _Found) -> list[_Reading]:
    """Readings with the smallest share first, of the points that the names suggest.

    Without usual names, other columns follow; intended points do if no others are named.
    """
    if found.place:
        return sorted(_readings(table, robot, found, [tuple(found.place)]), key=_by_share)
    best = measured_first(found.points)
    named = [group.columns for group in best if group.kind != INTENDED]
    intended = [group.columns for group in found.points if group.kind == INTENDED]
    usual = bool(named) and any(group.plain for group in best)
    steps = [named] if usual else [named, _free_points(table, found), [] if named else intended]
    tried: list[_Reading] = []
    for points in steps:
        tried = sorted([*tried, *_readings(table, robot, found, points)], key=_by_share)
        if tried and tried[0][0] <= _LIES:
            break
    return tried


def _by_share(reading: _Reading) -> float:
    return reading[0]


def _free_points(table: FoundTable, found: _Found) -> list[tuple[str, ...]]:
    """Three columns side by side that may be a point, although their names do not say so."""
    taken = set(found.joints) | set(found.measured)
    taken |= {name for group in found.points for name in group.columns}
    return [run for run in _runs(_filled(table), 3, taken) if INTENDED not in map(kind_of, run)]


def _apart(one: _Reading, other: _Reading) -> bool:
    """Whether two readings have the points in different columns."""
    return not set(one[2]) & set(other[2])


def _of_measured(
    tried: list[_Reading], table: FoundTable, robot: Robot, found: _Found
) -> list[_Reading]:
    """Readings, first that of points which were not computed; doubts if others match as well."""
    first = tried[0]
    rivals = [first]
    for one in tried[1:]:
        if one[0] <= _LIES and all(_apart(one, rival) for rival in rivals):
            rivals.append(one)
    if first[0] > _LIES:
        return tried
    why = {one[2]: _computed(table, robot, one) for one in rivals}
    rivals.sort(key=lambda one: (bool(why[one[2]]), one[0]))
    best = rivals[0]
    point, others = ", ".join(best[2]), [", ".join(one[2]) for one in rivals[1:]]
    if INTENDED in map(kind_of, best[2]):
        found.doubts.append(
            f"{point}: by their names these are intended positions; no columns of measured ones "
            "were found"
        )
    if others:
        found.doubts.append(
            f"{point} are read as the measured point, but {' and '.join(others)} match the robot "
            "as well: which of them were measured?"
        )
    unread = [", ".join(g.columns) for g in found.points if g.columns not in why]
    for columns, reason in why.items():
        if reason:
            told = f"{', '.join(columns)} {reason}"
            told += f"; were {' or '.join(unread)} measured?" if unread and not others else ""
            (found.doubts if others or unread else found.sure).append(told)
    return [best, *(one for one in tried if one is not best)]


def _computed(table: FoundTable, robot: Robot, reading: _Reading) -> str:
    """Why the points of a reading were computed from the nominal robot; empty if they were not."""
    _, joints, place, unit, place_units = reading
    q, y = _numbers(table, robot, joints, place, unit, place_units)
    placed = Placed.on(robot, [(q, y)])
    if placed is None:
        return ""
    factor = (ANGLES if robot.joints.unit == "rad" else LENGTHS)[unit]
    lengths = np.array([LENGTHS[each] for each in place_units])
    steps = factor * last_digits(table, joints), lengths * last_digits(table, place)
    named = all(map(by_instrument, place))
    return why_computed(placed, q, steps, named)


def _by_mixed_units(
    tried: list[_Reading], table: FoundTable, robot: Robot, found: _Found
) -> list[_Reading]:
    """Readings, first one with mixed units of x, y and z if it is clearly better.

    A coordinate that varies little hardly shows its unit. If the best reading with a single unit
    matches, mixed units are tried for its columns only, otherwise for all columns. If a reading
    with a coordinate in a larger unit is better by `_BETTER`, the units are put in doubt: a
    coordinate in m that is read in mm is almost constant, which nearly matches.
    """
    share, joints, place, joint_unit, _ = tried[0]
    known = found
    if share <= _LIES:
        known = _Found(joints=list(joints), place=list(place), joint_unit=joint_unit)
    mixed = [units for units in product(_POINT_UNITS, repeat=3) if len(set(units)) > 1]
    points = list(dict.fromkeys(one[2] for one in tried)) if share > _LIES else [place]
    readings = sorted(_readings(table, robot, known, points, mixed), key=_by_share)
    best = readings[0]
    if best[0] * _CLEARLY < share:
        return [best, *tried]
    larger = next((one for one in readings if _all_larger(one[4], tried[0][4])), best)
    if larger[0] < _BETTER * share <= _BETTER * _LIES:
        found.doubts.append(
            f"{', '.join(place)} in {', '.join(larger[4])} match better than all in "
            f"{tried[0][4][0]}: check the units"
        )
    return tried


def _all_larger(units: Sequence[str], than: Sequence[str]) -> bool:
    """Whether no unit of a point is smaller than that of another reading."""
    return all(LENGTHS[one] >= LENGTHS[other] for one, other in zip(units, than, strict=True))


def _by_count(table: FoundTable, robot: Robot, found: _Found, tried: Sequence[_Reading]) -> bool:
    """Whether the nominal robot matches the points with another direction or zero of all joints.

    Only the named columns are tried, or else those that fit best: all pairs would take long.
    """
    best, least = None, _LIES
    for reading in tried:
        if reading[1:3] != (tuple(found.joints), tuple(found.place)):
            continue
        for sign in (1.0, -1.0):
            count, share = _best_count(table, robot, reading, sign)
            if share < least:
                best, least = (reading, count), share
    if best is None:
        return False
    (_, _, _, found.joint_unit, place_units), found.count = best
    found.place_units = list(place_units)
    found.sure.append(
        f"all joints {found.count.said(found.joint_unit)} (`scale` and `offset` in the mapping): "
        f"the nominal robot then matches the points within {100 * least:.1f} % of their extent"
    )
    found.doubts.append(found.count.doubt(found.joint_unit))
    return True


def _best_count(
    table: FoundTable, robot: Robot, reading: _Reading, sign: float
) -> tuple[_Count, float]:
    """Zero with the smallest share, in whole degrees or mm if that fits nearly as well."""
    _, joints, place, unit, place_units = reading
    number = np.column_stack([table.column(name) for name in joints])
    if robot.joints.unit == "rad":
        most, fine = np.pi / ANGLES[unit], np.pi / 180 / ANGLES[unit]
    else:
        most = float(np.nanmax(np.abs(number)) + np.nanmax(number) - np.nanmin(number))
        fine = 1e-3 / LENGTHS[unit]

    def share(zero: float) -> float:
        missed = _share(
            robot, *_numbers(table, robot, joints, place, unit, place_units, _Count(sign, zero))
        )
        return min(missed, _OUT_OF_REACH)

    grid = np.linspace(-most, most, _ZEROS + 1)
    tried, step = np.array([share(zero) for zero in grid]), float(grid[1] - grid[0])
    alike = grid[tried <= _CLEARLY * tried.min()]
    if tried.min() <= _LIES and len(alike) > _ALIKE:
        zero = float(f"{fine * round(float(np.median(alike)) / fine):.6g}")
        return _Count(sign, zero, (float(alike[0]), float(alike[-1]))), share(zero)
    near = float(grid[int(np.argmin(tried))])
    bounds = near - step, near + step
    best = minimize_scalar(share, bounds=bounds, method="bounded", options={"xatol": fine / 10})
    rounded = fine * round(float(best.x) / fine)  # a machine deviates a little from nominal
    zero = rounded if share(rounded) <= _CLEARLY * float(best.fun) else float(best.x)
    return _Count(sign, float(f"{zero:.6g}")), share(zero)


_Reading = tuple[float, tuple[str, ...], tuple[str, ...], str, tuple[str, ...]]


def _readings(
    table: FoundTable,
    robot: Robot,
    found: _Found,
    points: Sequence[tuple[str, ...]],
    units: Sequence[tuple[str, ...]] = _POINT_UNITS_ALIKE,
) -> Iterator[_Reading]:
    """Candidate readings of joints and point (columns and units), each with its share.

    Args:
        table: the cells.
        robot: nominal robot that is fitted to the points.
        found: columns and units known from the names.
        points: candidate columns of x, y and z.
        units: candidate units of x, y and z, if the names do not give them.
    """
    count = len(robot.joints.names)
    turning = robot.joints.unit == "rad"
    joint_units = (
        [found.joint_unit] if found.joint_unit else (["deg", "rad"] if turning else ["mm", "m"])
    )
    every = _filled(table)
    joints = [tuple(found.joints)] if found.joints else list(_runs(every, count, found.place))
    for j in joints:
        for p in points:
            if set(j) & set(p):
                continue
            place_units = [told] if (told := tuple(found.place_units) or _told_units(p)) else units
            for ju, pu in product(joint_units, place_units):
                yield _share(robot, *_numbers(table, robot, j, p, ju, pu)), j, p, ju, pu


def _filled(table: FoundTable) -> list[str]:
    """Columns of numbers with few gaps."""
    return [name for name in table.names if np.isfinite(table.column(name)).mean() > 0.9]


def _runs(names: Sequence[str], count: int, but: Collection[str]) -> Iterator[tuple[str, ...]]:
    """Columns side by side, without those of `but`; intended and measured ones are not mixed."""
    for k in range(len(names) - count + 1):
        run = tuple(names[k : k + count])
        if not set(run) & set(but) and len(set(map(kind_of, run))) == 1:
            yield run


def _share(robot: Robot, q: Array, y: Array) -> float:
    """Share of the points that the nominal robot does not explain; infinite out of its limits."""
    inside = (q >= robot.joints.lower) & (q <= robot.joints.upper)
    if len(q) < FEWEST or inside.all(axis=1).mean() < 0.5:
        return np.inf
    placed = Placed.on(robot, [(q, y)])
    return np.inf if placed is None else placed.share


def _numbers(
    table: FoundTable,
    robot: Robot,
    joints: Sequence[str],
    place: Sequence[str],
    joint_unit: str,
    place_units: Sequence[str],
    count: _Count = _AS_FILED,
) -> tuple[Array, Array]:
    """Joints (n, m) and points (n, 3) [m] of the rows without gaps, `_MOST` at most."""
    factor = (ANGLES if robot.joints.unit == "rad" else LENGTHS)[joint_unit]
    q = factor * count.joints(np.column_stack([table.column(name) for name in joints]))
    lengths = [LENGTHS[unit] for unit in place_units]
    y = np.column_stack([table.column(name) for name in place]) * lengths
    rows = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(y).all(axis=1))
    rows = rows[:: -(-len(rows) // _MOST) or 1]
    return q[rows], y[rows]


# --- the mapping


def _mapping(table: FoundTable, robot: Robot, found: _Found) -> dict[str, Any]:
    units = list(found.place_units)
    form = table.written()
    mapping: dict[str, Any] = {"schema": 1, "rows": _kind(table, found)}
    if table.form.delimiter != ",":
        mapping["delimiter"] = table.form.delimiter
    if form:
        mapping["table"] = form
    if table.join:
        mapping["join"] = dict(table.join)
    known = ANGLES if robot.joints.unit == "rad" else LENGTHS
    _find_encoders(table, robot, found)
    for key, columns, unit in (
        ("commands", found.joints, found.joint_unit),
        ("encoders", found.encoders, found.encoder_unit),
    ):
        if columns:
            factor = known[found.joint_unit] / known[unit]
            counted = found.count.mapped(factor) if found.count else {}
            mapping[key] = [
                {"joint": joint, "column": column, "unit": unit, **counted}
                for joint, column in zip(robot.joints.names, columns, strict=True)
            ]
    mapping["position"] = {
        "columns": list(found.place),
        "unit": units[0] if len(set(units)) == 1 else units,
    }
    mapping |= _others(table, found)
    _doubt_of_differences(table, found)
    return mapping | _gaps(table, found, mapping)


def _find_encoders(table: FoundTable, robot: Robot, found: _Found) -> None:
    """Take columns of the joints' measured values as encoders, if they agree with the commands."""
    count = len(found.joints)
    own = np.column_stack([table.column(name) for name in found.joints])
    known = ANGLES if robot.joints.unit == "rad" else LENGTHS
    for k in range(0, len(found.measured), count):
        columns = found.measured[k : k + count]
        read = np.column_stack([table.column(name) for name in columns])
        if set(columns) & {*found.joints, *found.place} or np.isfinite(read).mean() < 1.0:
            continue
        told = {bare_name(name)[1] for name in columns} & set(known)
        unit = told.pop() if len(told) == 1 else found.joint_unit
        off = np.nanmedian(np.abs(read * known[unit] / known[found.joint_unit] - own))
        if off <= _AGREE * float(np.nanmax(own) - np.nanmin(own)):
            found.encoders, found.encoder_unit = columns, unit
            found.sure.append(f"encoders of the joints: columns {', '.join(columns)}")
            return


def _gaps(table: FoundTable, found: _Found, mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Key `missing` of a mapping: skip rows with gaps in used columns, and note their number."""
    read = {key: value for key, value in mapping.items() if key not in ("table", "join")}
    used = [table.names.index(name) for name in _columns_in(read)]
    gaps = sum(any(is_gap(row[k]) for k in used) for row in table.text)
    if gaps:
        found.sure.append(f"{gaps} of {len(table.text)} rows have gaps and are left out")
    return {"missing": "skip"} if gaps or table.ends else {}


def _kind(table: FoundTable, found: _Found) -> str:
    """Kind of the rows: `stream` if there are over 200 in small joint steps, else `stops`."""
    joint = np.column_stack([table.column(name) for name in found.joints])
    steps = np.abs(np.diff(joint, axis=0)).max(axis=1)
    extent = float(np.max(np.ptp(joint[np.isfinite(joint).all(axis=1)], axis=0)))
    still = steps < 1e-4 * extent
    stream = len(joint) > 200 and float(np.median(steps[~still] if (~still).any() else steps)) < (
        0.02 * extent
    )
    return "stream" if stream else "stops"


def _others(table: FoundTable, found: _Found) -> dict[str, Any]:
    """Keys of a mapping for time, payload, direction, temperatures and rotation, by names."""
    more: dict[str, Any] = {}
    used = {*found.joints, *found.encoders, *found.place}
    quaternion: dict[str, str] = {}
    for name in table.names:
        bare, unit = bare_name(name)
        if name in used or not table.named:
            continue
        if (warm := warm_name(name)) is not None:
            _add_warmth(table, name, warm, more, found)
        elif (match := _TURN.match(bare)) is not None:
            quaternion[match[1]] = name
        elif _OTHERS["time"].match(bare) and "time" not in more:
            more |= _time(table, name, unit or MEANT.get(bare, ""), found)
        elif _OTHERS["payload"].match(bare) and "payload" not in more:
            if unit in ("g", "kg"):
                more["payload"] = {"column": name, "unit": unit}
            else:
                found.doubts.append(f"{name}: is this a payload in g or kg? It is left out")
        elif _SIDE.match(bare) and set(np.unique(table.column(name))) <= {-1.0, 0.0, 1.0}:
            more["direction"] = [name]
    if set(quaternion) == set("xyzw"):
        columns = [quaternion[axis] for axis in "xyzw"]
        more["rotation"] = {"columns": columns, "form": "quaternion_xyzw"}
    if more:
        found.sure.append(f"also used: {', '.join(_told(more))}")
    taken = used | set(_columns_in(more))
    _tell_unused(table, found, [name for name in table.names if name and name not in taken])
    return more


def _add_warmth(
    table: FoundTable, name: str, warm: tuple[str, str], more: dict[str, Any], found: _Found
) -> None:
    """Add a column of temperatures to a mapping, unless its part has one or it has no numbers."""
    part, unit = warm
    number = table.column(name)
    entries = more.get("temperature", [])
    if not np.isfinite(number).any() or any(entry["part"] == part for entry in entries):
        return
    factor, shift = KELVIN[unit or "degC"]
    low, high = (float(v) * factor + shift for v in (np.nanmin(number), np.nanmax(number)))
    if not unit and not _WORKSHOP[0] <= low <= high <= _WORKSHOP[1]:
        found.doubts.append(
            f"{name}: is this a temperature in degC? It would be {low:.3g} to {high:.3g} degC; "
            "`unit` in the mapping may be degC, degF or K"
        )
    entry = {"part": part, "column": name, "unit": unit or "degC"}
    more["temperature"] = [*entries, entry]


def _tell_unused(table: FoundTable, found: _Found, left: Sequence[str]) -> None:
    """Add the columns that are not used to the findings: targets, and rotations by themselves."""
    targets = [
        name
        for group in found.points
        if group.kind == INTENDED and set(group.columns) <= set(left)
        for name in group.columns
    ]
    rest = [name for name in left if name not in targets]
    told = [f"{', '.join(targets)} (targets)"] * bool(targets) + rest
    if told:
        found.sure.append(f"not used: {', '.join(told)}")
    turn = rotation_columns(table, rest)
    if turn:
        found.sure.append(
            f"{', '.join(turn)} look like a rotation, which a mapping can read: `rotation` with "
            "`columns` and `form`, see docs/import.md"
        )


def _told(more: Mapping[str, Any]) -> Iterator[str]:
    """Describe how the columns besides joints and point are read."""
    for what, entries in more.items():
        for entry in entries if isinstance(entries, list) else [entries]:
            if isinstance(entry, str):
                yield f"{what} {entry}"
                continue
            said = entry.get("format") or entry.get("form") or entry["unit"]
            part = f" of {entry['part']}" if "part" in entry else ""
            yield f"{what}{part} {' '.join(_columns_in(entry))} ({said})"


def _doubt_of_differences(table: FoundTable, found: _Found) -> None:
    """Add a doubt if columns of differences suggest that the point is intended, not measured."""
    told = any(kind_of(name) == READ for name in found.place)
    if not table.named or told or any(group.kind == INTENDED for group in found.points):
        return
    found_of = {
        match[1] or match[2]: name
        for name in table.names
        if name not in found.place and (match := _DIFFERENCE.match(bare_name(name)[0]))
    }
    if set(found_of) == set("xyz"):
        differences = ", ".join(found_of[axis] for axis in "xyz")
        found.doubts.append(
            f"{', '.join(found.place)}: are these measured positions or commanded ones? To "
            f"commanded ones, {differences} have to be added (`plus: [{differences}]` in "
            "`position`)"
        )


def _columns_in(mapping: object) -> Iterator[str]:
    """Names of all columns in a part of a mapping."""
    if isinstance(mapping, list):
        for entry in mapping:
            yield from _columns_in(entry)
    elif isinstance(mapping, dict):
        for key, value in mapping.items():
            if key == "column":
                yield value
            elif key in ("columns", "direction"):
                yield from value
            else:
                yield from _columns_in(value)


_DIGITS = r"(?:19|20)\d{12}"  # date and time written as one number
_FORMATS = (
    "%Y%m%d%H%M%S",
    "%Y-%m-%d %H:%M:%S",
    "%Y-%m-%dT%H:%M:%S",
    "%d.%m.%Y %H:%M:%S",
    "%Y-%m-%d %H:%M:%S.%f",
    "%Y-%m-%dT%H:%M:%S.%f",
    "%Y-%m-%dT%H:%M:%S%z",
    "%Y-%m-%dT%H:%M:%S.%f%z",
    "%d.%m.%Y %H:%M:%S.%f",
    "%H:%M:%S",
    "%H:%M:%S.%f",
)
_DAY = re.compile(r"\d{4}-\d{1,2}-\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{2,4}")  # without time of day


def _time(table: FoundTable, name: str, unit: str, found: _Found) -> dict[str, Any]:
    """Key `time` of a mapping, by the column's unit or format; empty if it cannot be used."""
    from datetime import datetime

    column = table.names.index(name)
    text = table.text[0][column].strip()
    if _without_order(name, table.number[:, column], found):
        return {}
    if not re.fullmatch(_DIGITS, text) and np.isfinite(table.number[:, column]).all():
        if unit in ("ns", "us", "ms", "s", "min", "h"):
            return {"time": {"column": name, "unit": unit}}
        step = float(np.median(np.diff(table.number[:, column])))
        if _STEPS[0] <= step <= _STEPS[1]:
            found.sure.append(f"{name}: read in seconds; {step:.3g} s from row to row (median)")
        else:
            found.doubts.append(
                f"{name}: is this a time in seconds? It would be {step:.3g} s from row to row"
            )
        return {"time": {"column": name, "unit": "s"}}
    texts = [row[column].strip() for row in table.text if not is_gap(row[column])]
    if all(_DAY.fullmatch(each) for each in texts):
        found.sure.append(f"{name}: a date without a time of day; it is left out")
        return {}
    for form in _FORMATS:
        try:
            times = [datetime.strptime(each, form) for each in texts]
        except ValueError:
            continue
        since = np.array([(each - times[0]).total_seconds() for each in times])
        if _without_order(name, since, found):
            return {}
        return {"time": {"column": name, "unit": "format", "format": form}}
    found.doubts.append(f"{name}: {text!r} is not a time in a known format; it is left out")
    return {}


def _without_order(name: str, time: Array, found: _Found) -> bool:
    """Whether a column of times does not order the rows; the reason is added to the findings."""
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size:
        found.sure.append(f"{name}: goes back at row {back[0] + 2} of the table; it is left out")
    elif np.ptp(time) == 0.0:
        found.sure.append(f"{name}: is the same in all rows; it is left out")
    return bool(back.size or np.ptp(time) == 0.0)


def _rows(table: FoundTable, found: _Found) -> Iterator[dict[str, str]]:
    """First rows as the mapping reads them, to be shown to the user."""
    joints, places = (
        {name: _with_unit(name, unit) for name, unit in zip(names, units, strict=True)}
        for names, units in (
            (found.joints, [found.joint_unit] * len(found.joints)),
            (found.place, found.place_units),
        )
    )
    count = found.count or _AS_FILED
    for row in table.number[:_SHOWN]:
        value = dict(zip(table.names, row.tolist(), strict=True))
        yield {
            **{told: f"{count.joints(value[name]):.6g}" for name, told in joints.items()},
            **{told: f"{value[name]:.7g}" for name, told in places.items()},
        }


def _with_unit(name: str, unit: str) -> str:
    """Name of a column with the unit in which it is read, unless the name has it already."""
    return name if bare_name(name)[1] == unit else f"{name} [{unit}]"
