"""What a machine shows: its pose, a tracker's reading of it, and how either goes with theta.

For one sample, with p(x, o) the reflector's place on a platform at pose x and R, t the frame,

    before = R p(x, o) + t        reading = before + M(c, before, v)

M being the effects of the measurement. Derivatives by all of theta follow from the closure (the
implicit function theorem) at the machine as it stands under the sample's conditions, and from the
derivatives of the effects' laws. Loads are taken to stay as they are: they change by a thousandth
where the pose does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.chain_signals import RATE, READING, READING_RATE
from delta_calibration.model.jit import compiled
from delta_calibration.model.kernels import FULL, K, M, P, fill, moved, place
from delta_calibration.model.loads import point_at
from delta_calibration.model.stand import Body, Stages, State, stand, state_of, take_dimensions
from delta_calibration.model.terms import Table, add_shift, slopes_into, takes

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NOTHING, READINGS, POSES = range(3)  # of what derivatives are asked for


class Device(NamedTuple):
    """A reflector on the platform, and how the device that measures it stands."""

    offset: Array  # (3,) [m] of the reflector in the platform
    rotation: Array  # (3, 3) of the base in the device's frame
    place: Array  # (3,) [m]
    turning: Array  # (3, 3, 3) d(rotation[i, j]) / d(turn[k])
    at: Index  # (4,) where offset, turn and place begin in theta, and its size


class Seen(NamedTuple):
    """Of n samples; rows of NaN where the machine cannot stand."""

    x: Array  # (n, k) pose
    joint: Array  # (n, m) behind the drives
    geometry: Array  # (n, p) dimensions under its conditions, or (1, p) where all share them
    before: Array  # (n, 3) [m] where the reflector is, in the device's frame
    rate: Array  # (n, 3) [m/s] how fast it moves there
    reading: Array  # (n, 3) [m]
    by_joints: Array  # (n, d, m) d(before) or d(pose) by the joints behind the drives
    by_geometry: Array  # (n, d, p) the same by the dimensions
    jacobian: Array  # (n, d, P) d(reading) or d(pose) by theta


@compiled(borrows=True)
def _place_reflector(body: Body, device: Device, x: Array, state: State, before: Array) -> None:
    """Evaluate the law of the reflector's place and put that into the device's frame."""
    work, first = state.carried.point, body.bearing.point_at[2]
    point_at(body.bearing, x, device.offset, work)
    for i in range(3):
        before[i] = device.place[i]
        for j in range(3):
            before[i] += device.rotation[i, j] * work[first + j]


@compiled(borrows=True)
def _by_pose(body: Body, device: Device, asked: int, state: State, slope: Array) -> None:
    """d(before)/dx, or the unit matrix where the pose itself is asked for, into `slope` (d, k)."""
    work, first, k = state.carried.point, body.bearing.point_at[3], slope.shape[1]
    for i in range(len(slope)):
        for c in range(k):
            if asked == POSES:
                slope[i, c] = 1.0 if i == c else 0.0
                continue
            slope[i, c] = 0.0
            for j in range(3):
                slope[i, c] += device.rotation[i, j] * work[first + j * k + c]


@compiled(borrows=True)
def _by_device(body: Body, device: Device, state: State, jacobian: Array) -> None:
    """Columns of offset, turn and place of a reading, into `jacobian` (3, P)."""
    work, first, by_offset = (
        state.carried.point, body.bearing.point_at[2], body.bearing.point_at[4]
    )  # fmt: skip
    offset, turn, origin = device.at[0], device.at[1], device.at[2]
    for i in range(3):
        for c in range(3):
            along, turned = 0.0, 0.0
            for j in range(3):
                along += device.rotation[i, j] * work[by_offset + 3 * j + c]
                turned += device.turning[i, j, c] * work[first + j]
            jacobian[i, offset + c] = along
            jacobian[i, turn + c] = turned
            jacobian[i, origin + c] = 1.0 if i == c else 0.0


@compiled()
def see(
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
    x: Array,
) -> Seen:
    """What a machine shows at every sample.

    Args:
        body: the mechanism.
        stages: effects of drives and structure.
        last: those of the measurement.
        device: reflector and frame.
        signals: (n, S) as recorded; what the machine makes of them is filled in.
        g: dimensions, (p,).
        theta: in which the effects' values are, (P,).
        near: whether x holds poses nearby.
        stray: largest closure that counts as closed.
        asked: of what derivatives are wanted: `NOTHING`, `READINGS` or `POSES`.
        x: (n, k), filled in.
    """
    limbs, n = body.limbs, len(signals)
    m, k, p = limbs.sizes[M], limbs.sizes[K], limbs.sizes[P]
    own, work = state_of(body, stages), last.work.copy()
    take_dimensions(body, g, own)
    reshaped = len(stages.structure.law) > 0
    sides = k if asked == POSES else 3
    some = 0 if asked == NOTHING else n
    found = Seen(
        x, np.empty((n, m)), np.empty((n if reshaped else 1, p)), np.empty((n, 3)), np.zeros((n, 3)), np.empty((n, 3)),
        np.empty((some, sides, m)), np.empty((some, sides, p)),
        np.zeros((some, sides, device.at[3])),
    )  # fmt: skip
    if not reshaped:
        found.geometry[0] = g
    slope, by_q, by_g = np.empty((sides, k)), np.empty((sides, m)), np.empty((sides, p))
    rates, unit = stages.at[RATE], np.eye(3)
    takes_rate = takes(last, stages.at[READING_RATE], 3)
    for row in range(n):
        good = stand(body, stages, signals[row], g, theta, near, stray, x[row], own)
        found.joint[row] = own.joint
        if reshaped:
            found.geometry[row] = own.geometry
        if not good:
            found.reading[row] = np.nan
            found.before[row] = np.nan
            if asked != NOTHING:
                fill(found.by_joints[row], np.nan)
                fill(found.by_geometry[row], np.nan)
                fill(found.jacobian[row], np.nan)
            continue
        _place_reflector(body, device, x[row], own, found.before[row])
        moving = False
        for i in range(m):
            moving = moving or (takes_rate and signals[row, rates + i] != 0.0)
        if asked != NOTHING or moving:
            _by_pose(body, device, asked, own, slope)
            place(limbs, own.joint, x[row], FULL, own.room)
            moved(limbs, slope, own.room, by_q, by_g)
        if moving and asked != POSES:
            for i in range(3):
                for j in range(m):
                    found.rate[row, i] += by_q[i, j] * signals[row, rates + j]
        for i in range(3):
            signals[row, stages.at[READING] + i] = found.before[row, i]
            signals[row, stages.at[READING_RATE] + i] = found.rate[row, i]
            found.reading[row, i] = found.before[row, i]
        add_shift(last, signals[row], theta, work, found.reading[row])
        if asked == NOTHING:
            continue
        jacobian = found.jacobian[row]
        for i in range(sides):
            for j in range(m):
                found.by_joints[row, i, j] = by_q[i, j]
            for j in range(p):
                found.by_geometry[row, i, j] = by_g[i, j]
                jacobian[i, j] = by_g[i, j]
        slopes_into(stages.drive, own.drive, by_q, jacobian)
        slopes_into(stages.structure, own.structure, by_g, jacobian)
        if asked == READINGS:
            _by_device(body, device, own, jacobian)
            slopes_into(last, work, unit, jacobian)
    return found
