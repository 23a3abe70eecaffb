"""The criteria of ISO 9283 on a recorded session of the standard's cycles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.data import Poses, Readings
from delta_calibration.errors import DataError
from delta_calibration.geometry import align
from delta_calibration.iso9283 import (
    Conditions,
    Cube,
    distance_accuracy,
    distance_repeatability,
    path_accuracy,
    path_repeatability,
    position_accuracy,
    position_repeatability,
)
from delta_calibration.plans import cube_of, tool_points
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_SAME = 0.5e-3  # [m] a command within this of a pose or path of the cube belongs to it
_FINE = 801  # points of a path, so that the circle is round to 1 um
_MOVED = 10e-3  # [m] off as a whole: from here on it is the tracker's frame, not the machine
_TIMES = 5.0  # off by this many times what the best frame leaves: off as a whole
_PAUSE = 0.5  # [s] a longer gap between readings ends a run along a path


@dataclass(frozen=True)
class IsoValue:
    """Value of one criterion of the standard."""

    symbol: str  # AP, RP, AD, RD, AT, RT
    where: str  # P1 ..., "P2-P4", "line", "circle"
    value: float  # [m]
    cycles: int


@dataclass(frozen=True)
class IsoReport:
    """The criteria of ISO 9283 of a session, with the conditions they were measured under."""

    conditions: Conditions
    frame: str  # how the tracker was registered to the base
    values: tuple[IsoValue, ...]
    left_out: tuple[str, ...] = ()  # criteria that could not be computed, and why


@dataclass(frozen=True)
class _Attained:
    """Commanded and attained tool points in the base frame."""

    robot: str  # its name
    cube: Cube  # its poses and paths were commanded
    meant: Array  # (n, 3) [m] commanded: nominal forward kinematics
    reached: Array  # (n, 3) [m] attained: measured


def evaluate(
    poses: Poses,
    readings: Readings,
    robot: Robot,
    conditions: Conditions,
    calibration: Calibration | None,
) -> IsoReport:
    """Compute AP, RP of P1 to P5, AD, RD of P2-P4, and AT, RT of line and circle if they were run.

    Without a calibration the tracker is registered by the best rigid frame over the stops
    themselves, which flatters AP; AD and RD do not depend on it.

    Raises:
        DataError: a pose of the cube was not reached, or fewer times than the conditions require;
            commands out of the robot's reach; or a calibration with another tracker frame.
        InputError: a workspace without volume, or input that a criterion refuses.
    """
    meant, named = partial(tool_points, robot), (robot.name, cube_of(robot))
    stops = meant(poses.command)
    _require_this_robot(stops, poses, robot)
    if calibration is None:
        frame = align(stops, poses.point).inverse()
        attained = _Attained(*named, stops, frame.apply(poses.point))
        moving = _Attained(*named, meant(readings.command), frame.apply(readings.point))
        said = "best-fit frame of the same stops (makes AP look better; does not affect AD and RD)"
    else:
        there = calibration.tool_points(poses.point, poses.joint, poses.conditions)
        attained = _Attained(*named, stops, there)
        seen = calibration.tool_points(readings.point, readings.joint)
        moving = _Attained(*named, meant(readings.command), seen)
        said = f"calibration of session {calibration.source!r}"
    cycles = _cycles(attained, conditions)
    other_frame = "" if calibration is None else _other_frame(attained, calibration, _MOVED)
    if other_frame:
        raise DataError(f"{poses.source}: {other_frame}")
    p = attained.cube.poses()
    values = [*_positions(cycles, p, conditions), *_distances(cycles, p, conditions)]
    try:
        paths, left_out = _paths(moving, readings.time, conditions)
    except DataError as error:
        if calibration is not None and (why := _other_frame(attained, calibration, 0.0)):
            raise DataError(f"{poses.source}: {why}") from error
        raise
    return IsoReport(conditions, said, tuple(values + paths), tuple(left_out))


def _require_this_robot(stops: Array, poses: Poses, robot: Robot) -> None:
    """Refuse commands that are out of the nominal robot's reach."""
    bad = np.flatnonzero(~np.isfinite(stops).all(axis=1))
    if bad.size:
        joint = ", ".join(f"{v:.6g}" for v in poses.command[bad[0]])
        raise DataError(
            f"{poses.source}: pose {bad[0] + 1} ({joint} {robot.joints.unit}) is out of reach of "
            f"robot {robot.name!r}: is it the session of another robot, or do the joints have "
            "another zero?"
        )


def _other_frame(attained: _Attained, calibration: Calibration, allowed: float) -> str:
    """Sentence if the stops are off as a whole, but fit in another frame; else empty.

    Args:
        attained: the stops, by the tracker frame of the calibration.
        calibration: gives its name.
        allowed: RMS distance that is put down to the machine, [m].
    """
    meant, reached = attained.meant, attained.reached
    off = _rms(reached - meant)
    left = _rms(align(meant, reached).apply(meant) - reached)
    if off <= max(allowed, _TIMES * left):
        return ""
    return (
        f"the tracker frame of calibration {calibration.source!r} does not fit this session: it "
        f"is off by {1e3 * off:.0f} mm (RMS of the stops), so the tracker was probably moved; "
        "leave out --calibration or use one of this set-up"
    )


def _rms(error: Array) -> float:
    """Root mean square length of errors (n, 3) [m]."""
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _cycles(attained: _Attained, conditions: Conditions) -> list[Array]:
    """Attained positions of P1 to P5 in order of time, five arrays (n, 3) [m]."""
    found = []
    needed = max(conditions.position_cycles, conditions.distance_cycles)
    for number, pose in enumerate(attained.cube.poses(), start=1):
        rows = np.flatnonzero(np.linalg.norm(attained.meant - pose, axis=1) < _SAME)
        if len(rows) < needed:
            place = ", ".join(f"{v * 1e3:.0f}" for v in pose)
            raise DataError(
                f"P{number} of the cube of robot {attained.robot} ({place} mm) was reached "
                f"{len(rows)} times; {conditions.name} asks for {needed}"
                + ("" if len(rows) else ": not a session of the plan iso9283")
            )
        found.append(attained.reached[rows])
    return found


def _positions(cycles: list[Array], poses: Array, conditions: Conditions) -> list[IsoValue]:
    n = conditions.position_cycles
    values = []
    for number, (reached, pose) in enumerate(zip(cycles, poses, strict=True), start=1):
        ap = position_accuracy(reached[:n], pose, conditions)
        rp = position_repeatability(reached[:n], conditions)
        values += [IsoValue(c.symbol, f"P{number}", float(c.value), n) for c in (ap, rp)]
    return values


def _distances(cycles: list[Array], poses: Array, conditions: Conditions) -> list[IsoValue]:
    n = conditions.distance_cycles
    first, second = cycles[1][:n], cycles[3][:n]
    ad = distance_accuracy(first, second, poses[[1, 3]], conditions)
    rd = distance_repeatability(first, second, conditions)
    return [IsoValue(c.symbol, "P2-P4", float(c.value), n) for c in (ad, rd)]


def _paths(
    moving: _Attained, time: Array, conditions: Conditions
) -> tuple[list[IsoValue], list[str]]:
    """AT and RT of each path with enough runs, and for the other paths the reason for none."""
    values, left_out, n = [], [], conditions.path_cycles
    for name, way_of in (("line", moving.cube.line), ("circle", moving.cube.circle)):
        runs = [moving.reached[run] for run in _runs(moving.meant, time, way_of())]
        if len(runs) < n:
            left_out.append(
                f"AT and RT of the {name}: {len(runs)} complete runs found, "
                f"{conditions.name} asks for {n}"
            )
            continue
        way = way_of(stations=_FINE)
        at = path_accuracy(way, runs[:n], conditions)
        rt = path_repeatability(way, runs[:n], conditions)
        values += [IsoValue(c.symbol, name, float(c.value), n) for c in (at, rt)]
    return values, left_out


def _runs(meant: Array, time: Array, way: Array) -> list[NDArray[np.intp]]:
    """Rows of the readings of each complete run along a path, from one end to the other."""
    segment = np.diff(way, axis=0)
    along = np.sum((meant[:, None] - way[:-1]) * segment, axis=-1) / np.sum(segment**2, axis=-1)
    foot = way[:-1] + np.clip(along, 0, 1)[..., None] * segment
    off = np.linalg.norm(meant[:, None] - foot, axis=-1).min(axis=1)
    moving = np.r_[np.linalg.norm(np.diff(meant, axis=0), axis=1) > 1e-6, False]
    on = np.flatnonzero((off < _SAME) & moving)
    if on.size == 0:
        return []
    breaks = np.flatnonzero((np.diff(on) > 1) | (np.diff(time[on]) > _PAUSE)) + 1
    length = float(np.linalg.norm(segment, axis=1).sum())
    complete = []
    for run in np.split(on, breaks):
        run = np.append(run, run[-1] + 1)  # the first reading at rest again
        travelled = float(np.linalg.norm(np.diff(meant[run], axis=0), axis=1).sum())
        if abs(travelled - length) < 0.02 * length:
            complete.append(run)
    return complete
