"""Compiled measurement model: pose, tracker reading, and their derivatives by theta.

For one sample, with p(x, o) the reflector's place on a platform at pose x and R, t the frame,

    before = R (p + d + b x p) + t      (d, b) = B(c, v)      reading = before + M(c, before, v)
    o = o_0 + O(c, v)

d, b being shift and rotation [m, rad] of the base by the effects of its support, O those by which
the reflector moves on the platform, and M the effects of the measurement. Derivatives by all of
theta follow from the closure (the implicit function theorem) at the machine as it stands under the
sample's conditions, and from the derivatives of the effects' laws. Loads count as constant in the
derivatives: they change by only a thousandth as the pose does. Where closures outnumber the
coordinates of the pose, terms proportional to what the closures miss are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.chain_constants import (
    ACCELERATION,
    JOINT,
    MOMENT,
    NOTHING,
    POSES,
    RATE,
    READING,
    READING_ACCELERATION,
    READING_RATE,
    READINGS,
)
from delta_calibration.model.jit import compiled, record
from delta_calibration.model.kernels import (
    FULL,
    K,
    M,
    add_by_drives,
    copy_into,
    fill,
    moved,
    place,
)
from delta_calibration.model.loads import point_at
from delta_calibration.model.stand import Body, Stages, State, stand, state_of, take_dimensions
from delta_calibration.model.terms import Table, add_shift, slopes_into, takes

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@record
class Device(NamedTuple):
    """A reflector on the platform, and the frame of the device that measures it."""

    offset: Array  # (3,) [m] of the reflector in the platform
    rotation: Array  # (3, 3) of the base in the device's frame
    place: Array  # (3,) [m] of the base in the device's frame
    turning: Array  # (3, 3, 3) d(rotation[i, j]) / d(turn[k])
    at: Index  # (3,) where offset, turn and place begin in theta


class Seen(NamedTuple):
    """Results of n samples; rows of NaN where the machine has no pose."""

    x: Array  # (n, k) pose
    joint: Array  # (n, m) behind the drives
    geometry: Array  # (n, p) dimensions under its conditions, or (1, p) where all share them
    before: Array  # (n, 3) [m] where the reflector is, in the device's frame
    rate: Array  # (n, 3) [m/s] its velocity there; 0 where it is not needed, see `see`
    acceleration: Array  # (n, 3) [m/s^2] and acceleration; 0 where no effect takes it
    reading: Array  # (n, 3) [m]
    by_joints: Array  # (n, d, m) d(before) or d(pose) by the joints behind the drives
    jacobian: Array  # (n, d, P) d(reading) or d(pose) by theta


@record
class Room(NamedTuple):
    """Scratch, used again for every sample."""

    state: State
    signals: Array  # (S,) of a sample, with those that depend on the machine
    last: Array  # workspaces of the terms of the measurement
    slope: Array  # (d, k) derivatives of d outputs by the pose
    unit: Array  # (3, 3)
    turned: Array  # (3, 3) rotation of the shifted base in the device's frame
    moved: Array  # (3,) [m] reflector in the frame of the base without loads
    shift: Array  # (6,) [m, rad] of the base
    by_base: Array  # (3, 6) d(before) by it
    offset: Array  # (3,) [m] of the reflector in the platform, moved by its effects
    by_offset: Array  # (3, 3) d(before) by it
    aside: Array  # (k,) pose a moment away
    there: Array  # (3,) [m] where the reflector is then


@compiled(borrows=True)
def _move_base(
    stages: Stages, device: Device, sample: Array, theta: Array, first: int, room: Room
) -> None:
    """Apply the shift of the base to the reflector's place, evaluated before, and the rotation."""
    state, shift, turned, by_base = room.state, room.shift, room.turned, room.by_base
    place = state.carried.point
    for i in range(6):
        shift[i] = 0.0
    add_shift(stages.base, sample, theta, state.base, shift)
    for i in range(3):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            at_a, at_b = device.rotation[i, a], device.rotation[i, b]
            turned[i, j] = device.rotation[i, j] + at_a * shift[3 + b] - at_b * shift[3 + a]
            by_base[i, j] = device.rotation[i, j]
            by_base[i, 3 + j] = at_b * place[first + a] - at_a * place[first + b]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        moved_by = shift[3 + a] * place[first + b] - shift[3 + b] * place[first + a]
        room.moved[i] = place[first + i] + shift[i] + moved_by
    for i in range(3):
        place[first + i] = room.moved[i]


@compiled(borrows=True)
def _place_reflector(
    body: Body,
    stages: Stages,
    device: Device,
    sample: Array,
    theta: Array,
    x: Array,
    room: Room,
    before: Array,
) -> None:
    """Evaluate the law of the reflector's place and transform it to the device's frame."""
    state = room.state
    work, first = state.carried.point, body.bearing.point_at[2]
    copy_into(room.offset, device.offset)
    add_shift(stages.reflector, sample, theta, state.reflector, room.offset)
    point_at(body.bearing, x, room.offset, work)
    if len(stages.base.law):
        _move_base(stages, device, sample, theta, first, room)
    for i in range(3):
        before[i] = device.place[i]
        for j in range(3):
            before[i] += device.rotation[i, j] * work[first + j]


@compiled(borrows=True)
def _by_pose(body: Body, turned: Array, asked: int, state: State, slope: Array) -> None:
    """d(before)/dx, or the unit matrix where the pose itself is asked for, into `slope` (d, k)."""
    work, first, k = state.carried.point, body.bearing.point_at[3], slope.shape[1]
    for i in range(len(slope)):
        for c in range(k):
            if asked == POSES:
                slope[i, c] = 1.0 if i == c else 0.0
                continue
            slope[i, c] = 0.0
            for j in range(3):
                slope[i, c] += turned[i, j] * work[first + j * k + c]


@compiled(borrows=True)
def _by_offset(body: Body, room: Room) -> None:
    """d(before) by the reflector's offset in the platform, into `room.by_offset` (3, 3)."""
    work, first = room.state.carried.point, body.bearing.point_at[4]
    for i in range(3):
        for c in range(3):
            room.by_offset[i, c] = 0.0
            for j in range(3):
                room.by_offset[i, c] += room.turned[i, j] * work[first + 3 * j + c]


@compiled(borrows=True)
def _by_device(body: Body, device: Device, room: Room, jacobian: Array) -> None:
    """Columns of reflector offset and of device turn and place, into `jacobian` (3, P)."""
    work, first = room.state.carried.point, body.bearing.point_at[2]
    offset, turn, origin = device.at[0], device.at[1], device.at[2]
    for i in range(3):
        for c in range(3):
            across = 0.0
            for j in range(3):
                across += device.turning[i, j, c] * work[first + j]
            jacobian[i, offset + c] = room.by_offset[i, c]
            jacobian[i, turn + c] = across
            jacobian[i, origin + c] = 1.0 if i == c else 0.0


@compiled(borrows=True, shared=True)
def _derive(
    body: Body,
    stages: Stages,
    asked: int,
    sample: Array,
    x: Array,
    room: Room,
    by_joints: Array,
    jacobian: Array,
) -> None:
    """Compute derivatives by joints and, into the first columns of `jacobian`, by dimensions.

    From these follow those by the values of the effects of drives, structure and base.
    """
    own, slope = room.state, room.slope
    _by_pose(body, room.turned, asked, own, slope)
    place(body.limbs, own.joint, x, FULL, own.room)
    add_by_drives(body.limbs, own.room)
    moved(body.limbs, slope, own.room, by_joints, jacobian)
    slopes_into(stages.drive, sample, own.drive, by_joints, jacobian)
    slopes_into(stages.structure, sample, own.structure, jacobian, jacobian)
    if asked != POSES:  # a pose is relative to the base, and has no reflector
        _by_offset(body, room)
        slopes_into(stages.base, sample, own.base, room.by_base, jacobian)
        slopes_into(stages.reflector, sample, own.reflector, room.by_offset, jacobian)


@compiled(borrows=True)
def _is_moving(signals: Array, rates: int, m: int) -> bool:
    """Whether any of m joints moves, whose rates begin at index `rates` of a sample."""
    moving = False
    for i in range(m):
        moving = moving or signals[rates + i] != 0.0
    return moving


@compiled(borrows=True, shared=True)
def _see_around(
    body: Body,
    stages: Stages,
    device: Device,
    signals: Array,
    g: Array,
    theta: Array,
    near: bool,
    stray: float,
    x: Array,
    room: Room,
    found: Array,
) -> bool:
    """Sum of the reflector's places a `MOMENT` before and after a sample, into `found` (3,).

    The joints follow their rates and accelerations. False if there is no pose there.
    """
    sample, at, own = room.signals, stages.at, room.state
    for i in range(3):
        found[i] = 0.0
    for when in (-MOMENT, MOMENT):
        copy_into(sample, signals)
        copy_into(room.aside, x)
        for i in range(len(own.joint)):
            rate, change = signals[at[RATE] + i], signals[at[ACCELERATION] + i]
            sample[at[JOINT] + i] += when * (rate + when / 2 * change)
        if not stand(body, stages, sample, g, theta, near, stray, room.aside, own):
            return False
        _place_reflector(body, stages, device, sample, theta, room.aside, room, room.there)
        for i in range(3):
            found[i] += room.there[i]
    return True


@compiled(borrows=True)
def _see_each(
    body: Body,
    stages: Stages,
    last: Table,
    device: Device,
    signals: Array,
    g: Array,
    theta: Array,
    near: bool,
    stray: float,
    asked: int,
    found: Seen,
    room: Room,
) -> None:
    """Fill in the results of every sample, one after the other."""
    m, own, sample = body.limbs.sizes[M], room.state, room.signals
    reshaped = len(stages.structure.law) > 0
    rates, at = stages.at[RATE], stages.at[READING]
    accelerations = stages.at[READING_ACCELERATION]
    accelerated = takes(last, accelerations, 3)
    wanted = accelerated or asked == READINGS or takes(last, stages.at[READING_RATE], 3)
    take_dimensions(body, g, own)
    if not reshaped:
        copy_into(found.geometry[0], g)
    for row in range(len(signals)):
        x, before, reading = found.x[row], found.before[row], found.reading[row]
        moving = wanted and _is_moving(signals[row], rates, m)
        around = found.acceleration[row]
        known = accelerated and moving
        if known:
            known = _see_around(
                body, stages, device, signals[row], g, theta, near, stray, x, room, around
            )
        copy_into(sample, signals[row])
        good = stand(body, stages, sample, g, theta, near, stray, x, own)
        copy_into(found.joint[row], own.joint)
        if reshaped:
            copy_into(found.geometry[row], own.geometry)
        if not good:
            for i in range(3):
                before[i] = reading[i] = np.nan
            if asked != NOTHING:
                fill(found.by_joints[row], np.nan)
                fill(found.jacobian[row], np.nan)
            continue
        _place_reflector(body, stages, device, sample, theta, x, room, before)
        for i in range(3):
            around[i] = (around[i] - 2 * before[i]) / MOMENT**2 if known else 0.0
        some = row if asked != NOTHING else 0
        if asked != NOTHING or moving:
            by_joints, jacobian = found.by_joints[some], found.jacobian[some]
            _derive(body, stages, asked, sample, x, room, by_joints, jacobian)
            for i in range(3):
                if moving and asked != POSES:
                    for j in range(m):
                        found.rate[row, i] += by_joints[i, j] * sample[rates + j]
        for i in range(3):
            sample[at + i] = reading[i] = before[i]
            sample[stages.at[READING_RATE] + i] = found.rate[row, i]
            sample[accelerations + i] = around[i]
        add_shift(last, sample, theta, room.last, reading)
        if asked == READINGS:
            _by_device(body, device, room, found.jacobian[row])
            slopes_into(last, sample, room.last, room.unit, found.jacobian[row])


@compiled()
def see(
    body: Body,
    stages: Stages,
    last: Table,
    device: tuple[Array, Array, Array, Array, Index],
    signals: Array,
    g: Array,
    theta: Array,
    near: bool,
    stray: float,
    asked: int,
    x: Array,
) -> Seen:
    """Compute poses, readings and wanted derivatives of a machine at every sample.

    Args:
        body: the mechanism.
        stages: effects of all stages before the reading.
        last: those of the measurement.
        device: reflector and frame, the fields of `Device`.
        signals: (n, S) as recorded.
        g: dimensions, (p,).
        theta: all parameters, among them the effects' values, (P,).
        near: whether x holds poses nearby.
        stray: largest closure that counts as closed.
        asked: which derivatives are wanted: `NOTHING`, `READINGS` or `POSES`. The velocity of the
            reflector is found with those of readings, or where `last` takes it; its acceleration
            only where `last` takes that.
        x: (n, k), filled in.
    """
    n, m, k = len(signals), body.limbs.sizes[M], body.limbs.sizes[K]
    sides = k if asked == POSES else 3
    some = 1 if asked == NOTHING else n  # room for the rate of a sample
    found = Seen(
        x,
        np.empty((n, m)),
        np.empty((n if len(stages.structure.law) else 1, len(g))),
        np.empty((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.empty((n, 3)),
        np.empty((some, sides, m)),
        np.empty((some, sides, len(theta))),
    )
    slope, unit = np.empty((sides, k)), np.eye(3)
    sample = np.empty(signals.shape[1])
    turned, moved_to, by_base = device[1].copy(), np.zeros(3), np.zeros((3, 6))
    state, work = state_of(body, stages), last.work.copy()
    aside, there = np.zeros(k), np.zeros(3)
    shift, offset, by_offset = np.zeros(6), np.zeros(3), np.zeros((3, 3))
    room = Room(
        state,
        sample,
        work,
        slope,
        unit,
        turned,
        moved_to,
        shift,
        by_base,
        offset,
        by_offset,
        aside,
        there,
    )
    own = Device(device[0], device[1], device[2], device[3], device[4])
    _see_each(body, stages, last, own, signals, g, theta, near, stray, asked, found, room)
    return found
