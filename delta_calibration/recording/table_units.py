"""Refuse columns that contradict the robot: limits of its joints, and reach of the nominal robot.

Points are refused only if another reading of the columns (unit, sign, order) makes the nominal
robot match them: an outlier is not refused. Joints beyond their limits are always refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.recording.table_mapping import Column, TableMapping
from delta_calibration.recording.table_numbers import TableNumbers
from delta_calibration.recording.table_placing import FEWEST, Placed, Way
from delta_calibration.recording.table_repeats import lines_of
from delta_calibration.recording.table_slips import Slip, order_slips, other_units, unit_slips
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_MOST = 400  # rows to which the nominal robot is fitted
_HOPELESS = 0.03  # of the points' spread: from this median residual on other readings are tried
_UNKNOWN = 0.15  # of the points' spread: from this median residual on a note says so
_FAR = 15.0  # times the median residual, and
_WIDE = 0.03  # of the points' spread: a row with a residual above both is far off
_MANY = 0.1  # share of far rows from which a column may be in another unit in all rows
_LOOKED_INTO = 50  # far rows that are examined at most
_BETTER = 0.1  # of the residual: another reading has to be this small
_AS_GOOD = 3.0  # times the best residual: readings below it cannot be distinguished
_REACHES = 0.05  # of a joint's range: its largest value, at least, in the right unit


def require_units(numbers: TableNumbers, mapping: TableMapping, robot: Robot) -> list[str]:
    """Refuse numbers whose size contradicts the robot; return notes on what was not decided.

    Raises:
        InputError: names file, lines, columns, value and the more likely unit or meaning.
    """
    rows = np.flatnonzero(~numbers.moves)
    few = len(rows) < FEWEST
    notes = [f"{len(rows)} rows at rest: too few to check the units against the robot's reach"]
    if not few:
        notes = _require_reach(numbers, mapping, robot, rows)
    if notes:  # for example because the units of joints and points are both wrong
        few = few or _all_inside(numbers.command, mapping.commands, robot)
    _require_limits(numbers, numbers.command, mapping.commands, robot, few)
    if numbers.encoder is not None:
        _require_limits(numbers, numbers.encoder, mapping.encoders, robot, True)
    return notes


def _require_reach(
    numbers: TableNumbers, mapping: TableMapping, robot: Robot, rows: Rows
) -> list[str]:
    """Refuse points that the nominal robot matches only with another reading of the columns."""
    way = numbers.command[rows], numbers.position[rows]
    some = slice(None, None, -(-len(rows) // _MOST))
    stated = Placed.on(robot, [_part(way, some)])
    if stated is not None and stated.share <= _HOPELESS:
        _require_heights(numbers, mapping, stated, rows)
        _require_rows(numbers, mapping, stated, rows)
        return []
    miss, share = (stated.typical, stated.share) if stated else (np.inf, np.inf)
    good = min(_HOPELESS, _BETTER * share)
    units, orders = [*unit_slips(mapping)], [*order_slips(mapping)]
    for slips, mixed in (([*units, *orders], False), (units, True)):
        tried = [(_with(robot, _part(way, some), slip, mixed), slip) for slip in slips]
        fit = sorted(((p, s) for p, s in tried if p and p.share <= good), key=_by_share)
        if fit:
            best, slip = fit[0]
            if slip.unit:
                raise _mixed_up(numbers, mapping, rows, best, slip, miss)
            alike = [s for p, s in fit if p.share <= _AS_GOOD * best.share and not s.unit]
            said = [s.said for s in orders if s in alike]
            raise InputError(f"{numbers.file}: {_off(miss)}; likely {', or '.join(said)}")
    if share < _UNKNOWN:
        return []
    return [
        (
            f"{_off(miss)}: is it another robot, or are joint zeros or the order of columns "
            "different?"
        )
    ]


def _by_share(fit: tuple[Placed, Slip]) -> float:
    return fit[0].share


def _part(way: Way, some: slice | Rows) -> Way:
    return way[0][some], way[1][some]


def _with(robot: Robot, way: Way, slip: Slip, mixed: bool) -> Placed | None:
    """Fit to rows with a slip corrected in all of them or, if `mixed`, in those it fits better."""
    return Placed.on(robot, [way, slip.meant(way)] if mixed else [slip.meant(way)])


def _off(miss: float) -> str:
    """Message on the distance of the points from the nominal robot."""
    if not np.isfinite(miss):
        return "with the columns of this mapping, most joints are out of the robot's reach"
    return (
        f"with the columns of this mapping, the measured points are {miss * 1e3:.4g} mm (median) "
        "from where the robot can be"
    )


def _require_heights(
    numbers: TableNumbers, mapping: TableMapping, stated: Placed, rows: Rows
) -> None:
    """Refuse a column in another unit if most rows lie in a plane, which hides the mistake."""
    way = numbers.command[rows], numbers.position[rows]
    some = slice(None, None, -(-len(rows) // _MOST))
    far = _far(stated, way)
    if far.mean() < _MANY:
        return
    for slip in unit_slips(mapping):
        placed = _with(stated.robot, _part(way, some), slip, mixed=False)
        if placed is None or placed.share > _AS_GOOD * stated.share:
            continue
        if _far(placed, slip.meant(way)).mean() < _BETTER * far.mean():
            miss = float(np.median(stated.missed(way)[far]))
            raise _mixed_up(numbers, mapping, rows, placed, slip, miss)


def _far(placed: Placed, way: Way) -> NDArray[np.bool_]:
    """Mask (n,) of rows whose residual is larger than a machine's deviation from nominal."""
    limit = max(_FAR * placed.typical, _WIDE * placed.spread)
    return np.asarray(placed.missed(way) > limit)


def _require_rows(
    numbers: TableNumbers, mapping: TableMapping, stated: Placed, rows: Rows
) -> None:
    """Refuse rows that are in another unit than most."""
    way = numbers.command[rows], numbers.position[rows]
    missed = stated.missed(way)
    enough = _enough(stated, missed)
    far = np.flatnonzero(_far(stated, way))[:_LOOKED_INTO]
    slips = [*unit_slips(mapping)]
    left = np.array([stated.missed(slip.meant(_part(way, far))) for slip in slips])
    for k, row in enumerate(far.tolist()):
        best = int(left[:, k].argmin())
        if left[best, k] < enough[row]:
            raise _mixed_up(numbers, mapping, rows, stated, slips[best], float(missed[row]))


def _enough(placed: Placed, missed: Array) -> Array:
    """Residual (n,) [m] below which another reading of rows with residual (n,) [m] is accepted."""
    better = _BETTER * np.minimum(missed, placed.spread)
    return np.minimum(np.maximum(better, placed.close), missed / 2)


def _mixed_up(
    numbers: TableNumbers,
    mapping: TableMapping,
    rows: Rows,
    placed: Placed,
    slip: Slip,
    miss: float,
) -> InputError:
    """Error about columns in another unit, in all rows or in some of them."""
    way = numbers.command[rows], numbers.position[rows]
    stated, meant = placed.missed(way), placed.missed(slip.meant(way))
    other = rows[meant < _enough(placed, stated)]
    same = np.count_nonzero((stated < meant / 2) & (stated <= placed.close))
    where = "as in all rows"
    if same:
        where = (
            f"as in {lines_of(numbers.rows, other.tolist())}, {len(other)} of {len(rows)} rows; "
            f"the others can be in {slip.columns[0].unit}"
        )
    first, *more = slip.columns
    beside = f"and those of {', '.join(c.name for c in more)} " if more else ""
    row = int(other[0] if other.size else rows[0])
    joint = numbers.command[row]
    beyond = (
        _beyond(placed.robot, k, float(joint[k]))
        for k, column in enumerate(mapping.commands)
        if column in slip.columns
    )
    reason = next(filter(None, beyond), "")
    if not reason and np.isfinite(miss):
        reason = f"the measured point is {miss * 1e3:.4g} mm from where the robot can be with it"
    return numbers.wrong(
        row,
        first.name,
        f"{beside}cannot be in {first.unit}: {reason or 'out of reach'}; likely {slip.unit}, "
        f"{where}",
    )


def _beyond(robot: Robot, k: int, joint: float) -> str:
    """Message that a joint is beyond its limits; empty if it is not."""
    low, high = float(robot.joints.lower[k]), float(robot.joints.upper[k])
    name, factor = robot.joints.shown
    if low <= joint <= high:
        return ""
    return (
        f"{factor * joint:.6g} {name} is beyond the limits of {robot.joints.names[k]}, "
        f"{factor * low:.6g} to {factor * high:.6g}"
    )


def _require_limits(
    numbers: TableNumbers, joint: Array, columns: Sequence[Column], robot: Robot, guess: bool
) -> None:
    """Refuse joints beyond the robot's limits; `guess` adds the likely unit to the message."""
    low, high = robot.joints.lower, robot.joints.upper
    beyond = np.argwhere((joint < low) | (joint > high))
    if not len(beyond):
        return
    row, k = beyond[0].tolist()
    rows = beyond[beyond[:, 1] == k, 0]
    fits = _inside(joint[rows, k], columns[k], float(low[k]), float(high[k])) if guess else ()
    likely = next(
        (f"likely {unit}" for unit in fits), "is it another column, zero, sign or robot?"
    )
    raise numbers.wrong(
        row,
        columns[k].name,
        f"in {columns[k].unit}: {_beyond(robot, k, float(joint[row, k]))}, as in {len(rows)} of "
        f"{len(joint)} rows; {likely}",
    )


def _all_inside(joint: Array, columns: Sequence[Column], robot: Robot) -> bool:
    """Whether one other unit brings all joints (n, m) within limits, and none is within now."""
    low, high = robot.joints.lower, robot.joints.upper
    if ((joint >= low) & (joint <= high)).any():
        return False
    ends = zip(joint.T, columns, low.tolist(), high.tolist(), strict=True)
    return bool(set.intersection(*(set(_inside(*each)) for each in ends)))


def _inside(values: Array, column: Column, low: float, high: float) -> Iterable[str]:
    """Other units that put a joint's values within limits and up to `_REACHES` of its range."""
    for unit, factor in other_units([column]):
        joint = factor * values
        within = np.all((joint >= low) & (joint <= high))
        if within and np.abs(joint).max() >= _REACHES * (high - low):
            yield unit
