"""Tool points of the named plans, and their joints by nominal inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import at_rest
from delta_calibration.effects.loads import weight_known
from delta_calibration.errors import InputError, ReachError
from delta_calibration.geometry.halton import halton
from delta_calibration.iso9283 import Cube
from delta_calibration.mechanisms import Mechanism
from delta_calibration.plans.motion import APPROACH
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

LINE_HALF = 0.45  # [m] |x| on the Delta paper's line (15)
PLANE = -0.711  # [m] its height
RADIUS = 0.45  # [m] of the paper's disc; plan `identify` extends to the ends of the line
PLACES = 60  # default number of places in the plan `identify`
LOW, HIGH = -0.15, 0.10  # [m] heights from the plane, between which poses are spread
_SAME = 1e-6  # [m, 1] by which a pose may differ from the commanded one
CUBE = Cube((0.0, 0.0, -0.8), 0.3)  # of ISO 9283, in the most used part of the workspace


def nominal_joints(
    robot: Robot, targets: Array, turns: Array | None = None, payload: Array | float = 0.0
) -> Array:
    """Joints of tool points by nominal inverse kinematics, (n, m) [rad or m].

    Args:
        robot: its nominal dimensions and limits.
        targets: tool points, (n, 3) [m].
        turns: rotations of the platform, if it can rotate, (n, 3) [rad]; zero by default.
        payload: on the platform, one for all or (n,) [kg].

    Raises:
        ReachError: names the first point that is out of reach, beyond a joint limit, or where
            cables cannot carry the load on the platform.
    """
    joint = joints_toward(robot, targets, turns)
    wanted, unit = targets, "m"
    if turns is not None and turns.any():
        wanted, unit = np.concatenate([targets, np.degrees(turns)], axis=1), "m and degrees"
    robot.commanded.require_reach(joint, wanted, "point", unit)
    require_limits(robot, joint, "point")
    require_borne(robot, joint, "point", payload)
    return joint


def require_borne(robot: Robot, joint: Array, what: str, payload: Array | float = 0.0) -> None:
    """Refuse joints (n, m) at which limbs that only pull cannot carry the load on the platform.

    Args:
        robot: its nominal dimensions and masses.
        joint: joints within reach, (n, m).
        what: name of a row in messages.
        payload: at the platform's centre, one for all or (n,) [kg].

    Raises:
        ReachError: names the first such row and what gives way.
    """
    model = robot.commanded
    if model.pulls:
        x, load = _loaded(robot, joint, payload)
        model.require_borne(x, model.parameters.nominal, load, what)


def borne(robot: Robot, joint: Array, payload: Array | float = 0.0) -> NDArray[np.bool_]:
    """Whether the limbs can carry the load on the platform at joints (n, m), (n,)."""
    model = robot.commanded
    if not model.pulls:
        return np.ones(len(joint), dtype=np.bool_)
    x, load = _loaded(robot, joint, payload)
    return model.borne(x, model.parameters.nominal, load)


def _loaded(robot: Robot, joint: Array, payload: Array | float) -> tuple[Array, Array]:
    """Poses (n, k) and the weight on the platform as generalised force, dU/dx (n, k) [N, N m]."""
    model = robot.commanded
    x = model.forward(joint, model.parameters.nominal)
    at = replace(at_rest(joint), payload=np.broadcast_to(payload, len(joint)).astype(float))
    return x, weight_known(robot, model, at, x)


def joints_toward(robot: Robot, targets: Array, turns: Array | None = None) -> Array:
    """Joints of tool points as in `nominal_joints`, limits ignored; NaN rows out of reach.

    A solution is rejected if forward kinematics in the assembly mode of home leads to another
    pose: the target then belongs to another assembly mode.
    """
    model = robot.commanded
    turns = np.zeros_like(targets) if turns is None else turns
    task = model.task(targets, turns)
    turned = task.shape[1] == model.pose_size  # else the platform does not turn
    offset = model.rotation(task) @ robot.tool_offset if turned else robot.tool_offset
    task = model.task(targets - offset, turns)
    joint = model.inverse(task, model.parameters.nominal)
    found = np.isfinite(joint).all(axis=1)
    x = model.forward(joint[found], model.parameters.nominal)
    joint[found] = np.where(_meets(model, x, task[found])[:, None], joint[found], np.nan)
    return joint


def _meets(model: Mechanism, x: Array, task: Array) -> NDArray[np.bool_]:
    """Whether poses (n, k) equal those commanded, (n, task_size); rotations as matrices."""
    gap = x[:, : model.task_size] - task
    if model.task_size == model.pose_size:
        turned = (model.rotation(x) - model.rotation(task)).reshape(len(x), 9)
        gap = np.concatenate([model.position(x) - model.position(task), turned], axis=1)
    return np.asarray(np.abs(gap).max(axis=1, initial=0.0) < _SAME)  # NaN compares false


def tool_points(robot: Robot, joint: Array) -> Array:
    """Tool points at joints (n, m) by nominal forward kinematics, (n, 3) [m]; NaN out of reach."""
    return tool_frames(robot, joint)[0]


def tool_frames(robot: Robot, joint: Array) -> tuple[Array, Array]:
    """Nominal tool points and platform rotations (`Mechanism.turn`), (n, 3) each [m, rad]."""
    model = robot.commanded
    x = model.forward(joint, model.parameters.nominal)
    return model.points(x, robot.tool_offset), model.turn(x)


def require_limits(robot: Robot, joint: Array, what: str) -> None:
    """Refuse joints (n, m) [rad or m] that are beyond the robot's limits.

    Raises:
        ReachError: names the first such row, its joint and what is allowed.
    """
    for row, one in enumerate(joint):
        wrong = robot.joints.beyond(one)
        if wrong:
            raise ReachError(f"{what} {row + 1} needs {wrong}")


def line(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """The Delta paper's line (15): x = -y, z = -711 mm."""
    x = np.linspace(-LINE_HALF, LINE_HALF, count or 61)
    return np.stack([x, -x, np.full_like(x, PLANE)], axis=1)


def disc(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """Points spread evenly over the disc (sunflower) in the paper's plane, sorted by angle."""
    k = np.arange(count or 60) + 0.5
    r, angle = radius * np.sqrt(k / len(k)), np.mod(np.pi * (1 + np.sqrt(5)) * k, 2 * np.pi)
    r, angle = r[np.argsort(angle)], np.sort(angle)
    return np.stack([r * np.cos(angle), r * np.sin(angle), np.full_like(r, PLANE)], axis=1)


def iso9283(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """Cycles P5, P4, P3, P2, P1 of the standard's cube."""
    return np.tile(CUBE.poses()[::-1], (count or 30, 1))


def identify(robot: Robot, count: int | None, radius: float, rng: np.random.Generator) -> Array:
    """Points on a rim above and below the paper's plane, the rest spread evenly inside.

    The rim comes first: a calibration is valid inside the hull of its poses, and the paper's line
    ends at a radius of sqrt(2) times its |x|.
    """
    wanted, widest = count or PLACES, radius * np.sqrt(2)
    ring = _rim(robot, 1.03 * widest)[:wanted]
    # One random shift of all points, so that they depend on the seed.
    draws = np.mod(halton(10 * wanted, 3) + rng.random(3), 1.0)
    r, angle = widest * np.sqrt(draws[:, 0]), 2 * np.pi * draws[:, 1]
    height = PLANE + LOW + (HIGH - LOW) * draws[:, 2]
    points = np.stack([r * np.cos(angle), r * np.sin(angle), height], axis=1)
    points = np.concatenate([ring, points[usable(robot, points)]])
    if len(points) < wanted:
        raise InputError(
            f"only {len(points)} of {wanted} points could be placed up to {1e3 * widest:.0f} mm "
            f"from the axis at z {1e3 * (PLANE + LOW):.0f} to {1e3 * (PLANE + HIGH):.0f} mm, the "
            f"region of `srbd`, which is used because {robot.source} has no section `workspace`: "
            "add one (centre_mm and size_mm of the box to measure in; `delta-cal robot check` "
            "proposes it), or choose a smaller radius"
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


def usable(
    robot: Robot, points: Array, turns: Array | None = None, payloads: Sequence[float] = (0.0,)
) -> NDArray[np.bool_]:
    """Whether points, with rotations, are in reach, within limits and well conditioned, (n,).

    The limbs can carry each of the payloads [kg] there.
    """
    model = robot.commanded
    nominal, joint = model.parameters.nominal, joints_toward(robot, points, turns)
    room = 2 * APPROACH * model.joint_size  # the approach to a stop must be within the limits too
    inside = (joint > robot.joints.lower + room) & (joint < robot.joints.upper - room)
    good = np.asarray(inside.all(axis=1))  # False where out of reach: NaN compares false
    x = model.forward(joint[good], nominal)
    good[good] = model.condition(joint[good], x, nominal) < robot.limits.condition / 2
    for payload in payloads:
        good[good] = borne(robot, joint[good], payload)
    return good
