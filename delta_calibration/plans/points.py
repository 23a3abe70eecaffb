"""The places of a plan: by name, or from a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from delta_calibration.errors import InputError, ReachError
from delta_calibration.iso9283 import Cube
from delta_calibration.plans.motion import APPROACH
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

LINE_HALF = 0.45  # [m] |x| on the Delta paper's line (15)
PLANE = -0.711  # [m] its height
COLUMNS = ("x_mm", "y_mm", "z_mm")
CUBE = Cube((0.0, 0.0, -0.8), 0.3)  # of ISO 9283, in the most used part of the workspace


def nominal_joints(robot: Robot, targets: Array, turns: Array | None = None) -> Array:
    """Joints that the drawing takes for the tool points, (n, m) [rad or m].

    Args:
        robot: whose drawing.
        targets: tool points, (n, 3) [m].
        turns: of the platform, where it can be turned, (n, 3) [rad]; none where not given.

    Raises:
        ReachError: the first point out of reach or beyond a joint's limit.
    """
    joint = _joints(robot, targets, turns)
    robot.commanded.require_reach(joint, targets, "point", "m")
    require_limits(robot, joint, "point")
    return joint


def _joints(robot: Robot, targets: Array, turns: Array | None) -> Array:
    """The same; NaN rows out of reach."""
    model = robot.commanded
    turns = np.zeros_like(targets) if turns is None else turns
    task = model.task(targets, turns)
    turned = task.shape[1] == model.pose_size  # else the platform does not turn
    offset = model.rotation(task) @ robot.tool_offset if turned else robot.tool_offset
    task = model.task(targets - offset, turns)
    return model.inverse(task, model.parameters.nominal)


def tool_points(robot: Robot, joint: Array) -> Array:
    """Where the drawing has the tool at joints (n, m), (n, 3) [m]; NaN out of reach."""
    model = robot.commanded
    x = model.forward(joint, model.parameters.nominal)
    return np.asarray(model.position(x) + model.rotation(x) @ robot.tool_offset)


def require_limits(robot: Robot, joint: Array, what: str) -> None:
    """Refuse joint angles (n, m) [rad] that are beyond the robot's limits.

    Raises:
        ReachError: names the first such row, its joint and what is allowed.
    """
    for row, one in enumerate(joint):
        wrong = robot.joints.beyond(one)
        if wrong:
            raise ReachError(f"{what} {row + 1} needs {wrong}")


def read_points(path: Path) -> Array:
    """Tool points of a CSV file with columns x_mm, y_mm, z_mm, (n, 3) [m].

    Raises:
        InputError: no such file, a column missing, a value that is no finite number, or no row.
    """
    return np.array([row.point for row in read_rows(path)])


@dataclass(frozen=True)
class Row:
    """A line of a CSV file."""

    file: Path
    line: int
    text: Mapping[str, str | None]  # by the names of the columns; None where the line is short

    @property
    def point(self) -> list[float]:
        """The tool point [m]."""
        return [1e-3 * self.number(name) for name in COLUMNS]

    def number(self, column: str) -> float:
        """The finite number in a column.

        Raises:
            InputError: another text.
        """
        text = self.text[column] or ""
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.wrong(column, "is not a finite number")
        return value

    def wrong(self, column: str, problem: str) -> InputError:
        """What is wrong with the value in a column."""
        text = self.text[column] or ""
        return InputError(f"{self.file}: line {self.line}: {column}: {text!r} {problem}")


def read_rows(
    path: Path, columns: Sequence[str] = COLUMNS, delimiter: str = ","
) -> list[Row]:
    """The lines of a CSV file that has some columns at least.

    Raises:
        InputError: no such file, a column missing or there twice, a line too long, or no line.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, delimiter=delimiter, skipinitialspace=True)
            found = reader.fieldnames or []
            missing = [name for name in columns if name not in found]
            if missing:
                raise InputError(
                    f"{path}: column {', '.join(missing)} missing; expected "
                    f"{', '.join(columns)}, found {', '.join(found) or 'nothing'}"
                )
            twice = [name for name in columns if found.count(name) > 1]
            if twice:
                raise InputError(f"{path}: column {', '.join(twice)} is there twice")
            rows = [Row(path, reader.line_num, row) for row in _of_one_length(path, reader, found)]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if not rows:
        raise InputError(f"{path}: no points in it")
    return rows


def line(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """The Delta paper's line (15): x = -y, z = -711 mm."""
    x = np.linspace(-LINE_HALF, LINE_HALF, count or 61)
    return np.stack([x, -x, np.full_like(x, PLANE)], axis=1)


def disc(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """Evenly spread over the disc (sunflower), in the paper's plane, taken round by round."""
    k = np.arange(count or 60) + 0.5
    r, angle = radius * np.sqrt(k / len(k)), np.mod(np.pi * (1 + np.sqrt(5)) * k, 2 * np.pi)
    r, angle = r[np.argsort(angle)], np.sort(angle)
    return np.stack([r * np.cos(angle), r * np.sin(angle), np.full_like(r, PLANE)], axis=1)


def iso9283(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """Cycles P5, P4, P3, P2, P1 of the standard's cube."""
    return np.tile(CUBE.poses()[::-1], (count or 30, 1))


def identify(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """A ring at the rim above and below the paper's plane, the rest spread evenly inside.

    The rim comes first: a calibration holds inside the hull of its poses, and the paper's line
    ends at sqrt(2) times its |x|.
    """
    wanted, widest = count or 60, radius * np.sqrt(2)
    ring = _rim(robot, 1.03 * widest)[:wanted]
    # Shifted as a whole, so that the seed decides and every version of scipy draws the same.
    draws = np.mod(qmc.Halton(3, scramble=False).random(10 * wanted) + rng.random(3), 1.0)
    r, angle = widest * np.sqrt(draws[:, 0]), 2 * np.pi * draws[:, 1]
    height = PLANE - 0.15 + 0.25 * draws[:, 2]
    points = np.stack([r * np.cos(angle), r * np.sin(angle), height], axis=1)
    points = np.concatenate([ring, points[usable(robot, points)]])
    if len(points) < wanted:
        raise InputError(
            f"only {len(points)} of {wanted} points could be placed; choose a smaller radius"
        )
    return points[:wanted]


def _rim(robot: Robot, widest: float) -> Array:
    """The outermost usable points within `widest` of the axis: twelve directions, two heights."""
    angle = np.radians(15 + 30 * np.arange(12))
    radii = np.linspace(widest, 0, 40, endpoint=False)
    rim = []
    for height in (PLANE - 0.05, PLANE + 0.05):
        for a in angle:
            ray = np.stack(
                [radii * np.cos(a), radii * np.sin(a), np.full_like(radii, height)], axis=1
            )
            good = usable(robot, ray)
            if good.any():
                rim.append(ray[np.argmax(good)])
    return np.array(rim).reshape(-1, 3)


def usable(robot: Robot, points: Array, turns: Array | None = None) -> NDArray[np.bool_]:
    """Points, and turns there, within reach and limits, well away from singularities, (n,)."""
    model = robot.commanded
    nominal, joint = model.parameters.nominal, _joints(robot, points, turns)
    room = 2 * APPROACH * model.joint_size  # the way into a stop must be within the limits too
    inside = (joint > robot.joints.lower + room) & (joint < robot.joints.upper - room)
    good = np.asarray(inside.all(axis=1))  # False where out of reach: NaN compares false
    x = model.forward(joint[good], nominal)
    good[good] = model.condition(joint[good], x, nominal) < robot.limits.condition / 2
    return good


def _of_one_length(
    path: Path, reader: csv.DictReader[str], columns: Sequence[str]
) -> Iterator[dict[str, str]]:
    """The rows, none longer than the header: `1,5,2,5` is not 1.5 and 2.5."""
    for row in reader:
        surplus: Sequence[str] = row.pop(None, ())
        if surplus:
            raise InputError(
                f"{path}: line {reader.line_num}: {len(columns) + len(surplus)} values, but "
                f"{len(columns)} columns; decimals take a point, not a comma"
            )
        yield row
