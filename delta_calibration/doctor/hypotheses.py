"""Mistakes in units, wiring and axes, as changes that undo them.

All of them are transformations of the rows of a stream that need no parameter, or one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.data import TrackerStream
from delta_calibration.doctor.change import (
    TRACKER,
    Change,
    of_angles,
    of_points,
    of_tracker,
)
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

DEGREES = 180 / np.pi
LENGTHS = (("unit_mm", "mm", 1e3), ("unit_inch", "inch", 1 / 25.4e-3))  # values of a metre
AXES = "xyz"


def unit_of_joints(robot: Robot, streams: tuple[str, ...]) -> Iterator[Change]:
    """All joints of some streams in a unit that is not SI."""
    turning = robot.joints.unit == "rad"
    for mistake, unit, factor in (("unit_degrees", "deg", DEGREES),) if turning else LENGTHS:
        yield Change(
            mistake,
            streams,
            of_angles(streams, lambda q, f=factor: q / f),  # type: ignore[misc]
            f"`unit: {unit}` for every joint in the mapping of a table; publish "
            f"{robot.joints.unit} (divide by {factor:.10g}; --fix does)",
            value=factor,
            unit=f"{unit}/{robot.joints.unit}",
        )


def unit_of_tracker() -> Iterator[Change]:
    """The tracker's points in a unit that is not SI."""
    for mistake, unit, factor in LENGTHS:
        yield Change(
            mistake,
            (TRACKER,),
            of_points(lambda p, f=factor: p / f),  # type: ignore[misc]
            f"`unit: {unit}` for the position in the mapping of a table; publish metres (divide "
            f"by {factor:.10g}; --fix does)",
            value=factor,
            unit=f"{unit}/m",
        )


def orders_of_joints(robot: Robot, streams: tuple[str, ...]) -> Iterator[Change]:
    """Two joints in each other's place, or all of them backwards."""
    names = robot.joints.names
    for a, b in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[a], order[b] = b, a
        yield swapped(robot, streams, tuple(order))
    if len(names) > 3:
        yield swapped(robot, streams, tuple(reversed(range(len(names)))))


def swapped(robot: Robot, streams: tuple[str, ...], order: tuple[int, ...]) -> Change:
    """Joints in one another's place: joint j is what is called joint order[j]."""
    names = robot.joints.names
    moved = [k for k in range(len(names)) if order[k] != k]
    lines = ", ".join(f"{names[k]} is what is called {names[order[k]]}" for k in moved)
    return Change(
        "joints_swapped",
        streams,
        of_angles(streams, lambda q: q[:, list(order)]),
        f"exchange their columns in the mapping, or their names where they are published: {lines} "
        "(--fix does)",
        part=", ".join(names[k] for k in moved),
    )


def signs_of_joints(robot: Robot, streams: tuple[str, ...]) -> Iterator[Change]:
    """One joint of the other sign, or all."""
    names = robot.joints.names
    for joint in range(len(names)):
        yield reversed_joints(robot, streams, (joint,))
    yield reversed_joints(robot, streams, tuple(range(len(names))))


def reversed_joints(robot: Robot, streams: tuple[str, ...], which: tuple[int, ...]) -> Change:
    """Some joints of the other sign."""
    names = robot.joints.names
    sign = np.ones(len(names))
    sign[list(which)] = -1.0
    part = ", ".join(names[k] for k in which)
    return Change(
        "joint_reversed",
        streams,
        of_angles(streams, lambda q: q * sign),
        f"`scale: -1` for {part} in the mapping, or turn the sign round in the drive (--fix "
        "does); if the drive is right, the other sign in `joints.sign`, its zero negated",
        part=part,
    )


def offset_joint(robot: Robot, streams: tuple[str, ...], joint: int, value: float) -> Change:
    """A joint that counts from another zero: recorded less true is `value` [rad, m]."""
    name, unit = robot.joints.names[joint], robot.joints.unit
    shift, factor = np.zeros(len(robot.joints.names)), robot.joints.shown[1]
    key = "joints.zero_deg" if unit == "rad" else "joints.zero_mm"
    shift[joint] = value
    return Change(
        "joint_offset",
        streams,
        of_angles(streams, lambda q: q - shift),
        f"`offset: {-value:.6g}` ({unit}) for {name} in the mapping, or reference it anew "
        f"(--fix takes it off); if the drive is right, {factor * value:.6g} more in "
        f"`{key}` of the robot file",
        part=name,
        value=value,
        unit=unit,
    )


def turns_in(robot: Robot, value: float) -> int:
    """Whole turns that an offset is, 0 where it is none."""
    if robot.joints.unit != "rad":
        return 0
    turns = round(value / (2 * np.pi))
    return turns if abs(value - 2 * np.pi * turns) < 0.03 * 2 * np.pi else 0


def handedness() -> Iterator[Change]:
    """The tracker's frame left-handed: an axis of the other sign, or two axes swapped.

    All of them fit points alike, as the tracker's frame is free; turns and an upright tracker tell
    them apart.
    """
    for axis in (1, 0, 2):
        matrix = np.eye(3)
        matrix[axis, axis] = -1.0
        yield _axes("frame_mirrored", AXES[axis], matrix, f"turn the sign of {AXES[axis]} round")
    for a, b in ((0, 1), (1, 2), (0, 2)):
        order = [0, 1, 2]
        order[a], order[b] = b, a
        part = f"{AXES[a]}, {AXES[b]}"
        yield _axes("axes_swapped", part, np.eye(3)[order], f"exchange {AXES[a]} and {AXES[b]}")


def cyclic_axes() -> Iterator[Change]:
    """Axes of the tracker's points exchanged in a circle: a turn, which shows in poses only."""
    for order in ([1, 2, 0], [2, 0, 1]):
        said = ", ".join(AXES[k] for k in order)
        yield _axes("axes_swapped", "x, y, z", np.eye(3)[order], f"take {said} for x, y, z")


def _axes(mistake: str, part: str, matrix: Array, how: str) -> Change:
    return Change(
        mistake,
        (TRACKER,),
        of_points(lambda p: p @ matrix.T),
        f"{how} where the tracker's points are exported or in `position.columns` (--fix does)",
        part=part,
    )


def rotation_orders() -> Iterator[Change]:
    """Quaternions and angles in another order, turns of the other sense."""
    yield _turns("w, x, y, z", lambda q: q[:, [1, 2, 3, 0]], "the quaternion is w, x, y, z")
    yield _turns("z, w order", lambda q: q[:, [3, 0, 1, 2]], "the quaternion was reordered twice")
    yield _turns("inverse", lambda q: q * [-1, -1, -1, 1], "the turn is that of the tracker")
    orders = ["".join(p) for p in permutations(AXES)]
    for true in orders:
        for read in orders:
            for other in (False, True) if true != read else ():
                yield _turns(
                    f"{true} as {read}",
                    lambda q, t=true, r=read, o=other: _reordered(q, t, r, o),  # type: ignore[misc]
                    f"the angles turn about fixed axes {', '.join(true)} in this order, not "
                    f"{', '.join(read)}",
                )


def _turns(part: str, undo: Callable[[Array], Array], said: str) -> Change:
    def change(stream: TrackerStream) -> TrackerStream:
        turned = stream.quaternion
        if turned is None:
            return stream
        return TrackerStream(stream.stamp_ns, stream.position, np.asarray(undo(turned)))

    return Change(
        "rotation_order",
        (TRACKER,),
        of_tracker(change),
        f"{said}: `form` and `axes` of `rotation` in the mapping, or reorder what is published "
        "(--fix does)",
        part=part,
    )


def _reordered(quaternion: Array, true: str, read: str, other: bool) -> Array:
    """Turns whose angles about x, y, z were put together in one order and are of another.

    Of the two sets of angles that make a turn, the `other` has its second beyond 90 degrees.
    """
    angles = Rotation.from_quat(quaternion).as_euler(read)
    if other:
        angles = angles * [1.0, -1.0, 1.0] + np.pi
    by_axis = {axis: angles[:, k] for k, axis in enumerate(read)}
    ordered = np.column_stack([by_axis[axis] for axis in true])
    return np.asarray(Rotation.from_euler(true, ordered).as_quat())
