"""Units that a table's numbers cannot have, told by the robot: its joints' limits and its reach.

The drawing at the commanded joints, in the best frame before the tracker, misses measured points
by what a machine is off its drawing and by where its reflector really is: little beside the way
that the points lie apart. A number in another unit than it is said to have is off by its own size.
Only what another unit would bring to where the others are is refused; an outlier is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.geometry import Frame, align
from delta_calibration.mechanisms import Mechanism
from delta_calibration.recording.table_mapping import ANGLES, LENGTHS, Column, TableMapping
from delta_calibration.recording.table_numbers import TableNumbers
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_FEWEST = 6  # rows to lay a frame on
_MOST = 400  # of them used for it
_TRIPLES = 200  # frames tried on three points each: that of the least median is believed, ...
_ROUNDS = 6  # ... and the frame and the reflector then laid anew so many times ...
_CLOSE = 4.0  # ... on the rows that miss by less than so many medians
_HOPELESS = 0.15  # of the points' spread: a median miss that no frame explains
_FAR = 15.0  # times the median miss, and
_WIDE = 0.03  # of the points' spread: a row that misses by more than both is looked into
_LOOKED_INTO = 50  # such rows at most
_BETTER = 0.1  # of the miss: what another unit may leave


@dataclass(frozen=True)
class _Meant:
    """Columns in another unit than they are said to have."""

    columns: tuple[Column, ...]
    unit: str
    factor: float  # what their SI values would be, of those by the stated unit


@dataclass(frozen=True)
class _Placed:
    """The drawing before the tracker, as most rows have it."""

    model: Mechanism
    frame: Frame  # T_tracker_base
    offset: Array  # (3,) [m] of the reflector
    typical: float  # [m] median miss
    spread: float  # [m] RMS distance of the points from their middle

    @classmethod
    def on(cls, model: Mechanism, offset: Array, joint: Array, point: Array) -> _Placed | None:
        """Laid on joints (n, m) and points (n, 3) [m]; None where nothing can be."""
        x = model.forward(joint, model.parameters.nominal)
        good = np.isfinite(x).all(axis=1)
        x, point = x[good], point[good]
        if len(x) < _FEWEST:
            return None
        rng = np.random.default_rng(0)
        frames = list(_frames(model.position(x) + model.rotation(x) @ offset, point, rng))
        if not frames:
            return None
        centre = np.median(point, axis=0)
        spread = float(np.sqrt(np.mean(np.sum((point - centre) ** 2, axis=1))))
        placed = [cls._judged(model, frame, offset, spread, x, point) for frame in frames]
        best = min(placed, key=lambda p: p.typical)
        for _ in range(_ROUNDS):
            best = best._again(x, point)
        return best

    @classmethod
    def _judged(
        cls, model: Mechanism, frame: Frame, offset: Array, spread: float, x: Array, point: Array
    ) -> _Placed:
        predicted = frame.apply(model.position(x) + model.rotation(x) @ offset)
        typical = float(np.median(np.linalg.norm(predicted - point, axis=1)))
        return cls(model, frame, offset, typical, spread)

    def _again(self, x: Array, point: Array) -> _Placed:
        """With the frame, then the reflector, laid on the rows that are close."""
        rotation = self.model.rotation(x)
        place = self.model.position(x) + rotation @ self.offset
        close = np.linalg.norm(self.frame.apply(place) - point, axis=1) <= _CLOSE * self.typical
        try:
            frame = align(place[close], point[close])
        except DataError:
            return self
        left = (frame.inverse().apply(point) - place)[close]
        offset = self.offset + np.mean(
            np.swapaxes(rotation[close], 1, 2) @ left[..., None], axis=0
        )[:, 0]
        found = self._judged(self.model, frame, offset, self.spread, x, point)
        return found if found.typical < self.typical else self

    def missed(self, joint: Array, point: Array) -> Array:
        """Distances between drawing and points, (n,) [m]; infinite out of reach."""
        x = self.model.forward(joint, self.model.parameters.nominal)
        predicted = self.frame.apply(self.model.position(x) + self.model.rotation(x) @ self.offset)
        missed = np.linalg.norm(predicted - point, axis=1)
        return np.asarray(np.nan_to_num(missed, nan=np.inf))


def require_units(numbers: TableNumbers, mapping: TableMapping, robot: Robot) -> None:
    """Refuse numbers whose size contradicts the robot.

    Raises:
        InputError: names file, line, column, value and the likely unit.
    """
    _require_limits(numbers, numbers.command, mapping.commands, robot)
    if numbers.encoder is not None:
        _require_limits(numbers, numbers.encoder, mapping.encoders, robot)
    rows = np.flatnonzero(~numbers.moves)
    some = rows[:: -(-len(rows) // _MOST)] if len(rows) else rows
    offset = robot.tracker.reflector_offset
    joint, point = numbers.command, numbers.position
    placed = _Placed.on(robot.commanded, offset, joint[some], point[some])
    if placed is None:
        return
    if placed.typical > _HOPELESS * placed.spread:
        for meant in _possible(mapping):
            tried = _Placed.on(
                placed.model, offset, *_as_meant(meant, mapping, joint[some], point[some])
            )
            if tried is not None and tried.typical / tried.spread < (
                _BETTER * placed.typical / placed.spread
            ):
                raise _refused(numbers, int(rows[0]), meant, "as in all rows", placed.typical)
        return
    missed = placed.missed(joint[rows], point[rows])
    far = rows[missed > max(_FAR * placed.typical, _WIDE * placed.spread)]
    for row in far[:_LOOKED_INTO].tolist():
        one = slice(row, row + 1)
        miss = float(placed.missed(joint[one], point[one])[0])
        for meant in _possible(mapping):
            left = placed.missed(*_as_meant(meant, mapping, joint[one], point[one]))[0]
            if left < max(_BETTER * miss, _CLOSE * placed.typical) and left < miss / 2:
                raise _refused(numbers, row, meant, "unlike most rows", miss)


def _require_limits(
    numbers: TableNumbers, joint: Array, columns: Sequence[Column], robot: Robot
) -> None:
    """Refuse joints beyond the robot's limits."""
    low, high = robot.joints.lower, robot.joints.upper
    beyond = np.argwhere((joint < low) | (joint > high))
    if not len(beyond):
        return
    row, k = beyond[0].tolist()
    name, factor = robot.joints.shown
    value = joint[row, k]
    fits = [m.unit for m in _others([columns[k]]) if low[k] <= value * m.factor <= high[k]]
    likely = f"likely {fits[0]}" if fits else "another robot, or joints of another zero?"
    raise numbers.wrong(
        row,
        columns[k].name,
        f"in {columns[k].unit} is {factor * value:.6g} {name}, beyond the limits of "
        f"{robot.joints.names[k]}, {factor * low[k]:.6g} to {factor * high[k]:.6g}; {likely}",
    )


def _refused(
    numbers: TableNumbers, row: int, meant: _Meant, where: str, missed: float
) -> Exception:
    first, *others = meant.columns
    beside = f"and those of {', '.join(c.name for c in others)} " if others else ""
    return numbers.wrong(
        row,
        first.name,
        f"{beside}cannot be in {first.unit}: by the robot's reach the measured point is "
        f"{missed * 1e3:.4g} mm from where it can be; likely {meant.unit}, {where}",
    )


def _possible(mapping: TableMapping) -> Iterator[_Meant]:
    """Other units of each column by itself, of all commands, of all of the position."""
    groups = [[c] for c in (*mapping.position, *mapping.commands)]
    groups += [
        list(columns)
        for columns in (mapping.position, mapping.commands)
        if len({c.unit for c in columns}) == 1
    ]
    for group in groups:
        yield from _others(group)


def _others(columns: Sequence[Column]) -> Iterator[_Meant]:
    """Other units of the same kind; none for microsteps and for what has an offset."""
    unit = columns[0].unit
    kind: Mapping[str, float] = next((u for u in (ANGLES, LENGTHS) if unit in u), {})
    if any(c.offset for c in columns):
        return
    for other in ("deg", "rad", "mm", "m", *kind):
        if other in kind and other != unit:
            yield _Meant(tuple(columns), other, kind[other] / kind[unit])


def _as_meant(
    meant: _Meant, mapping: TableMapping, joint: Array, point: Array
) -> tuple[Array, Array]:
    """Joints and points with those columns in the other unit."""
    factors = [
        np.array([meant.factor if c in meant.columns else 1.0 for c in columns])
        for columns in (mapping.commands, mapping.position)
    ]
    return joint * factors[0], point * factors[1]


def _frames(place: Array, point: Array, rng: np.random.Generator) -> Iterator[Frame]:
    """Of three points each, those that span one."""
    for _ in range(_TRIPLES):
        rows = rng.choice(len(place), 3, replace=False)
        try:
            yield align(place[rows], point[rows])
        except DataError:
            continue
