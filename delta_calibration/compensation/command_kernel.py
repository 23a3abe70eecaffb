"""One command through guards and Newton's method in one compiled call: the stream's own way.

`JointCompensator.compensate` says the same of many commands at once, by numpy and for any machine;
here the order of the guards and what is told of a command are repeated number by number. Both
functions put into `out`

    0-2 target [m]   3 share of the correction that is applied there

and, where the command is corrected as well, 4-6 the correction [rad], 7 the distance from the
target that is left by the model [m], 8 evaluations of it.

    legs (3, 10)     the commanded drawing's spheres, see kernel.py
    planes (f, 4)    faces of the calibrated region: n . p + d <= 0 inside
    joints (2, m)    lower and upper limits [rad]
    tool (3,)        tool centre point on the drawing's platform [m]
    limits           see `Limits`
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation import kernel, newton_kernel
from delta_calibration.compensation.jit import compiled
from delta_calibration.compensation.kernel import Scratch

Array = NDArray[np.float64]
Limits = tuple[float, float, float, float, float, float]
"""Condition; the typical gain it compares with [m/rad]; the region's margin [m]; how near a point
on its face is to it [m]; largest correction [rad]; largest distance that counts as reached [m]."""

OUT = 9  # numbers that `out` holds
PASSED, NOT_FINITE, JOINT_LIMIT, OUT_OF_REACH, OUTSIDE_REGION, SINGULAR, NOT_REACHED = range(7)


@compiled()
def _within(joints: Array, q: Array, dq: Array, share: float) -> bool:
    """Whether q + share dq [rad] is within the joints' limits."""
    good = True
    for k in range(3):
        angle = q[k] + share * dq[k]
        good = good and joints[0, k] <= angle <= joints[1, k]
    return good


@compiled()
def _outside(planes: Array, x: float, y: float, z: float) -> float:
    """How far outside the region a point lies [m]; negative inside."""
    most = -np.inf
    for f in range(len(planes)):
        most = max(most, planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z + planes[f, 3])
    return most


@compiled(None, kernel)
def _judged(
    legs: Array,
    planes: Array,
    joints: Array,
    tool: Array,
    limits: Limits,
    q: Array,
    out: Array,
    room: tuple[Scratch, Array, Array],
) -> int:
    """The first guard that a command fails, `PASSED` where it passes all; its target and share.

    `room` is for a pose, U S over V and a Jacobian.
    """
    condition, typical, margin, on_face, _, _ = limits
    scratch, a, slope = room
    rods, still = np.empty((0, 7)), np.zeros(3)
    finite = bool(np.isfinite(q[0]) and np.isfinite(q[1]) and np.isfinite(q[2]))
    known = q if finite else still
    reached = kernel._point(legs, rods, tool, known, out[:3], scratch)
    x, y, z = -tool[0], -tool[1], -tool[2]
    if reached:
        x, y, z = out[0] + x, out[1] + y, out[2] + z
    beyond = _outside(planes, x, y, z) - on_face
    if margin > 0.0:
        out[3] = min(max(1.0 - max(beyond, 0.0) / margin, 0.0), 1.0)
    else:
        out[3] = 1.0 if beyond <= 0.0 else 0.0
    if not finite:
        return NOT_FINITE
    if not _within(joints, q, still, 0.0):
        return JOINT_LIMIT
    if not reached:
        return OUT_OF_REACH
    if not beyond <= margin:
        return OUTSIDE_REGION
    if not kernel._slope_here(legs, rods, still, True, slope, scratch):
        return SINGULAR
    largest, smallest = kernel._decompose(slope, a)
    if not max(largest, typical) / min(smallest, typical) <= condition:  # infinite over zero
        return SINGULAR
    return PASSED


@compiled(None, kernel)
def _left(machine: tuple[Array, Array, Array], q: Array, dq: Array, slope: Array) -> float:
    """How far a correction moves the tool, to first order [m]."""
    if not kernel._slope(machine[0], machine[1], machine[2], q, slope, kernel._scratch()):
        return np.nan
    square = 0.0
    for i in range(3):
        moved = slope[i, 0] * dq[0] + slope[i, 1] * dq[1] + slope[i, 2] * dq[2]
        square += moved * moved
    return float(np.sqrt(square))


_GUARDS = "f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], UniTuple(f8, 6)"
_MACHINE = "f8[:, ::1], f8[:, ::1], f8[::1]"  # legs, rods, offset: see kernel.py
_SETTINGS = "Tuple((f8, f8, f8, i8, i8))"  # of `NewtonSettings`


@compiled(f"i8({_GUARDS}, f8[::1], f8[::1])", kernel)
def judge(
    legs: Array, planes: Array, joints: Array, tool: Array, limits: Limits, q: Array, out: Array
) -> int:
    """Guards of a command q (3,) [rad], before it is corrected."""
    room = kernel._scratch(), np.empty((6, 3)), np.empty((3, 3))
    return _judged(legs, planes, joints, tool, limits, q, out, room)


@compiled(
    f"i8({_GUARDS}, {_MACHINE}, {_SETTINGS}, f8[::1], f8[::1])", kernel, newton_kernel
)
def correct(
    legs: Array,
    planes: Array,
    joints: Array,
    tool: Array,
    limits: Limits,
    own_legs: Array,
    own_rods: Array,
    own_offset: Array,
    settings: newton_kernel.Settings,
    q: Array,
    out: Array,
) -> int:
    """Guards and Newton's correction of a command q (3,) [rad] for the identified machine."""
    room = newton_kernel._room()
    out[4:9] = 0.0
    out[7] = np.inf
    code = _judged(
        legs, planes, joints, tool, limits, q, out, (room[0], room[1], room[2])
    )
    if code != PASSED:
        return code
    machine, share, dq = (own_legs, own_rods, own_offset), out[3], out[4:7]
    error, out[8] = newton_kernel._search(machine, q, out[:3], settings, dq, room)
    reached = error <= limits[5]
    for k in range(3):
        reached = reached and abs(dq[k]) <= limits[4]
    if not (reached and _within(joints, q, dq, share)):
        dq[:] = 0.0
        return JOINT_LIMIT if reached else NOT_REACHED
    out[7] = error
    if share < 1.0:
        out[7] += (1.0 - share) * _left(machine, q, dq, room[2])
        for k in range(3):
            dq[k] *= share
    return PASSED
