"""Hypotheses of mistakes in units, wiring and axes, as changes that undo them.

Each transforms the rows of a stream, with one parameter or none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
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
LENGTHS = (("unit_mm", "mm", 1e3), ("unit_inch", "inch", 1 / 25.4e-3))  # last: units per metre
AXES = "xyz"


def unit_of_joints(robot: Robot, streams: tuple[str, ...]) -> Iterator[Change]:
    """All joints of some streams were recorded in a unit that is not SI."""
    turning = robot.joints.unit == "rad"
    for mistake, unit, factor in (("unit_degrees", "deg", DEGREES),) if turning else LENGTHS:
        yield Change(
            mistake,
            streams,
            of_angles(streams, lambda q, f=factor: q / f),  # type: ignore[misc]
            f"`unit: {unit}` for every joint in the mapping of a table, or publish "
            f"{robot.joints.unit} (divide by {factor:.10g}; --fix does)",
            value=factor,
            unit=f"{unit}/{robot.joints.unit}",
        )


def unit_of_tracker() -> Iterator[Change]:
    """The tracker's points were recorded in a unit that is not SI."""
    yield from _unit_of_points((0, 1, 2), "the position", None)


def unit_of_coordinates() -> Iterator[Change]:
    """One or two coordinates of the points have another unit, such as heights in mm beside m."""
    for which in (*combinations(range(3), 1), *combinations(range(3), 2)):
        part = ", ".join(AXES[k] for k in which)
        yield from _unit_of_points(which, f"{part} of the position", part)


def _unit_of_points(which: tuple[int, ...], said: str, part: str | None) -> Iterator[Change]:
    """Some coordinates of the tracker's points were recorded in a unit that is not SI."""
    for mistake, unit, factor in LENGTHS:
        by = np.ones(3)
        by[list(which)] = factor
        yield Change(
            mistake,
            (TRACKER,),
            of_points(lambda p, by=by: p / by),  # type: ignore[misc]
            f"`unit: {unit}` for {said} in the mapping of a table, or publish metres (divide "
            f"{f'{part} ' if part else ''}by {factor:.10g}; --fix does)",
            part=part,
            value=factor,
            unit=f"{unit}/m",
        )


def orders_of_joints(robot: Robot, streams: tuple[str, ...]) -> Iterator[Change]:
    """Two joints were exchanged, or the order of all of them reversed."""
    names = robot.joints.names
    for a, b in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[a], order[b] = b, a
        yield swapped(robot, streams, tuple(order))
    if len(names) > 3:
        yield swapped(robot, streams, tuple(reversed(range(len(names)))))


def swapped(robot: Robot, streams: tuple[str, ...], order: tuple[int, ...]) -> Change:
    """Joints were permuted: the values of joint j were recorded as joint order[j]."""
    names = robot.joints.names
    moved = [k for k in range(len(names)) if order[k] != k]
    lines = ", ".join(f"the values of {names[k]} are recorded as {names[order[k]]}" for k in moved)
    return Change(
        "joints_swapped",
        streams,
        of_angles(streams, lambda q: q[:, list(order)]),
        f"swap their columns in the mapping, or their names in the publisher: {lines} (--fix "
        "does)",
        part=", ".join(names[k] for k in moved),
    )


def signs_of_joints(robot: Robot, streams: tuple[str, ...]) -> Iterator[Change]:
    """One joint, or all joints, were recorded with the opposite sign."""
    names = robot.joints.names
    for joint in range(len(names)):
        yield reversed_joints(robot, streams, (joint,))
    yield reversed_joints(robot, streams, tuple(range(len(names))))


def reversed_joints(robot: Robot, streams: tuple[str, ...], which: tuple[int, ...]) -> Change:
    """Some joints were recorded with the opposite sign."""
    names = robot.joints.names
    sign = np.ones(len(names))
    sign[list(which)] = -1.0
    part = ", ".join(names[k] for k in which)
    return Change(
        "joint_reversed",
        streams,
        of_angles(streams, lambda q: q * sign),
        f"`scale: -1` for {part} in the mapping, or reverse the sign in the drive (--fix does "
        "this); if the drive is right, reverse `joints.sign` and negate the zero in the robot "
        "file",
        part=part,
    )


def offset_joint(robot: Robot, streams: tuple[str, ...], joint: int, value: float) -> Change:
    """A joint has a wrong zero: recorded less true is `value` [rad or m]."""
    return offset_joints(robot, streams, (joint,), value)


def offset_joints(
    robot: Robot, streams: tuple[str, ...], which: tuple[int, ...], value: float
) -> Change:
    """Joints have the same wrong zero: recorded less true is `value` [rad or m] for each."""
    unit, (key, factor) = robot.joints.unit, _zeros(robot)
    shift = np.zeros(len(robot.joints.names))
    shift[list(which)] = value
    part = ", ".join(robot.joints.names[k] for k in which)
    home = "home the joint again" if len(which) == 1 else "home the joints again"
    return Change(
        "joint_offset",
        streams,
        of_angles(streams, lambda q: q - shift),
        f"`offset: {-value:.6g}` for {part} in the mapping (here in {unit}; the mapping has the "
        f"unit of the column), or {home} (--fix subtracts it); if the drive is right, add "
        f"{factor * value:.6g} to `{key}` in the robot file",
        part=part,
        value=value,
        unit=unit,
    )


def opposite(robot: Robot, streams: tuple[str, ...], value: float) -> tuple[Change, Change]:
    """All joints have the opposite sign, and read `value` [rad or m] where they should read 0.

    The recorded value is `value` less the true one. To undo it, subtract the offset, the second of
    the changes, then reverse the sign, the first.
    """
    every = tuple(range(len(robot.joints.names)))
    shifted = offset_joints(robot, streams, every, value)
    turned, (key, factor) = reversed_joints(robot, streams, every), _zeros(robot)
    mend = (
        f"`scale: -1` and `offset: {value:.6g}` ({robot.joints.unit}) for {shifted.part} in the "
        "mapping, or reverse the signs in the drives and home the joints again (--fix does both); "
        "if the drives are right, reverse `joints.sign` in the robot file, negate "
        f"`{key}` and add {factor * value:.6g} to it"
    )
    return replace(turned, mend=mend), replace(shifted, mend=mend)


def _zeros(robot: Robot) -> tuple[str, float]:
    """Key of the zeros in a robot file, and the factor from SI to its unit."""
    key = "joints.zero_deg" if robot.joints.unit == "rad" else "joints.zero_mm"
    return key, robot.joints.shown[1]


def turns_in(robot: Robot, value: float) -> int:
    """Number of whole turns of an offset [rad]; 0 if it is not close to a whole number."""
    if robot.joints.unit != "rad":
        return 0
    turns = round(value / (2 * np.pi))
    return turns if abs(value - 2 * np.pi * turns) < 0.03 * 2 * np.pi else 0


def handedness() -> Iterator[Change]:
    """The tracker's frame is left-handed: one axis has the opposite sign, or two are swapped.

    All of these fit points equally well, as the tracker's frame is free; only rotations or an
    upright tracker distinguish them.
    """
    for axis in (1, 0, 2):
        matrix = np.eye(3)
        matrix[axis, axis] = -1.0
        yield _axes("frame_mirrored", AXES[axis], matrix, f"reverse the sign of {AXES[axis]}")
    for a, b in ((0, 1), (1, 2), (0, 2)):
        order = [0, 1, 2]
        order[a], order[b] = b, a
        part = f"{AXES[a]}, {AXES[b]}"
        yield _axes("axes_swapped", part, np.eye(3)[order], f"swap {AXES[a]} and {AXES[b]}")


def cyclic_axes() -> Iterator[Change]:
    """The axes of the points were permuted cyclically: a rotation, visible only in 6-D poses."""
    for order in ([1, 2, 0], [2, 0, 1]):
        said = ", ".join(AXES[k] for k in order)
        yield _axes("axes_swapped", "x, y, z", np.eye(3)[order], f"use {said} as x, y, z")


def _axes(mistake: str, part: str, matrix: Array, how: str) -> Change:
    return Change(
        mistake,
        (TRACKER,),
        of_points(lambda p: p @ matrix.T),
        f"{how} in the tracker's export or in `position.columns` of the mapping (--fix does this)",
        part=part,
    )


def rotation_orders() -> Iterator[Change]:
    """Quaternions or angles were recorded in another order, or rotations are inverted."""
    yield _turns("w, x, y, z", lambda q: q[:, [1, 2, 3, 0]], "the quaternion is w, x, y, z")
    yield _turns("z, w order", lambda q: q[:, [3, 0, 1, 2]], "the quaternion was reordered twice")
    yield _turns("inverse", lambda q: q * [-1, -1, -1, 1], "the rotation is the inverse one")
    orders = ["".join(p) for p in permutations(AXES)]
    for true in orders:
        for read in orders:
            for other in (False, True) if true != read else ():
                yield _turns(
                    f"{true} as {read}",
                    lambda q, t=true, r=read, o=other: _reordered(q, t, r, o),  # type: ignore[misc]
                    f"the angles rotate about fixed axes {', '.join(true)} in this order, not "
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
        f"{said}: `form` and `axes` of `rotation` in the mapping, or change the order in the "
        "publisher (--fix does this)",
        part=part,
    )


def _reordered(quaternion: Array, true: str, read: str, other: bool) -> Array:
    """Rotations whose Euler angles were combined in the order `read` instead of `true`.

    Two sets of angles give the same rotation; in the `other` one the second angle exceeds 90
    degrees.
    """
    angles = Rotation.from_quat(quaternion).as_euler(read)
    if other:
        angles = angles * [1.0, -1.0, 1.0] + np.pi
    by_axis = {axis: angles[:, k] for k, axis in enumerate(read)}
    ordered = np.column_stack([by_axis[axis] for axis in true])
    return np.asarray(Rotation.from_euler(true, ordered).as_quat())
