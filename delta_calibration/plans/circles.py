"""Plan of the circle test: circles in up to three planes, both senses, two feeds, with stops.

Each plane is spanned by two axes of the base and passes through the middle of the workspace. Stops
on the circles show the repeatability at rest; without them a cause could not be distinguished from
noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.plans import points
from delta_calibration.plans.motion import MotionPath, Plan
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

STOPS = 36  # on all circles together
_ROUNDS = 3  # least number of circles that are driven, each in both senses at both feeds
_AGAIN = 3  # every third stop is visited a second time
_TURNS_S = (18.0, 6.0)  # [s] duration of a turn at the two feeds
_RUN = np.radians(30.0)  # angle before and after the turn, to accelerate and to brake
_STEP = np.radians(0.45)  # between points of the command path
_SIZES = 60  # radii that are tried
_AROUND = 72  # points of a circle that have to be usable
_LEAST = 0.1  # smallest circle that is measured, as a share of the widest radius
_SENSES = {"anticlockwise": 1.0, "clockwise": -1.0}


def circles(
    robot: Robot,
    count: int | None,
    dwell: float,
    sides: tuple[float, ...],
    radius: float,
    payload: float,
) -> Plan:
    """Make the plan `circles`.

    Args:
        robot: decides which planes and radii are in reach.
        count: stops on each circle; by default 36 on all circles together.
        dwell: at each stop [s].
        sides: sides from which each stop is approached, +1 or -1.
        radius: largest radius if the robot file states no workspace [m].
        payload: on the platform [kg].

    Raises:
        InputError: no circle is within the reach and the limits of the robot.
    """
    centre, half = _room(robot, radius)
    found = {
        plane: size
        for plane in combinations(range(3), 2)
        if (size := _largest(robot, centre, plane, min(half[list(plane)]), payload)) is not None
    }
    if not found:
        raise InputError(
            f"plan circles: no circle of {_LEAST * 1e3 * half.max():.0f} mm or more about "
            f"{', '.join(f'{1e3 * c:.0f}' for c in centre)} mm is within the reach and the "
            f"limits of {robot.source}"
        )
    stops = count or STOPS // len(found)
    turn = 2 * np.pi * np.arange(stops) / stops
    targets = [_around(centre, plane, size, turn) for plane, size in found.items()]
    paths = [
        path
        for _ in range(-(-_ROUNDS // len(found)))
        for plane, size in found.items()
        for path in _paths(robot, centre, plane, size, payload)
    ]
    places = np.concatenate([*targets, *(each[::_AGAIN] for each in targets)])
    joint = points.nominal_joints(robot, places, payload=payload)
    if robot.workspace is not None:  # not every mechanism commands all coordinates of a point
        places = points.tool_points(robot, joint)
    return Plan.around("circles", places, joint, sides, dwell, payload, tuple(paths))


def _room(robot: Robot, radius: float) -> tuple[Array, Array]:
    """Centre of the circles, and the largest radius along x, y and z, (3,) each [m]."""
    if robot.workspace is not None:
        return np.asarray(robot.workspace.centre), np.asarray(robot.workspace.size) / 2
    return np.array([0.0, 0.0, points.PLANE - 0.05]), np.full(3, radius)


def _largest(
    robot: Robot, centre: Array, plane: tuple[int, int], widest: float, payload: float
) -> float | None:
    """Largest radius at which the whole circle is usable [m]; None if there is none."""
    turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
    for size in widest * np.linspace(1.0, _LEAST, _SIZES) if widest > 0 else ():
        round_it = _around(centre, plane, float(size), turn)
        if points.usable(robot, round_it, payloads=(payload,)).all():
            return float(size)
    return None


def _paths(
    robot: Robot, centre: Array, plane: tuple[int, int], size: float, payload: float
) -> Iterator[MotionPath]:
    """Paths of one circle in both senses at both feeds, with a run-in and a run-out each."""
    whole = 2 * np.pi + 2 * _RUN
    name = "".join("xyz"[axis] for axis in plane)
    turn = np.linspace(-_RUN, 2 * np.pi + _RUN, int(np.ceil(whole / _STEP)) + 1)
    for duration in _TURNS_S:
        for sense, sign in _SENSES.items():
            way = _around(centre, plane, size, sign * turn)
            joint = points.nominal_joints(robot, way, payload=payload)
            seconds = duration * whole / (2 * np.pi)
            yield MotionPath(f"circle_{name}_{sense}_{duration:g}_s", joint, seconds)


def _around(centre: Array, plane: tuple[int, int], size: float, turn: Array) -> Array:
    """Points of a circle in the plane of two axes, (n, 3) [m]."""
    way = np.tile(centre, (len(turn), 1))
    way[:, plane[0]] += size * np.cos(turn)
    way[:, plane[1]] += size * np.sin(turn)
    return way
