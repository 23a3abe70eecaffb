"""Compiled guards, correction and limits of joint commands, one or many, any mechanism.

All decisions on a command are made here: for single commands of a stream, for batches, and for
corrections that were found otherwise, by a swarm or a table.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.backward_kernel import (
    MachineRecord,
    Place,
    Search,
    begin,
    begin_near,
    correct,
    reached,
    scratch,
    stands,
    verified,
)
from delta_calibration.compensation.command_status import (
    COUNT,
    FOUND,
    JOINT_LIMIT,
    LEFT,
    NOT_FINITE,
    NOT_REACHED,
    OUT_OF_REACH,
    OUTSIDE_REGION,
    PASSED,
    SHARE,
    SINGULAR,
    SLACK,
    TURN,
    VERIFIED,
)
from delta_calibration.model.jit import compiled, record
from delta_calibration.model.kernels import BESIDE, K, M, T, copy_into, moved, place
from delta_calibration.model.loads import bear, point_at

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SWEEPS = 60
_SQUARE, _MUCH = 1e-15, 1e-9  # |cosine| that counts as 0; that needs another sweep
_LOST = 1e-12  # share of the trace that may be left of a pivot by rounding alone


@record
class Guards(NamedTuple):
    """Limits that a command and its correction must satisfy."""

    planes: Array  # (f, 4) faces of the calibrated region: n . p + d <= 0 inside
    lower: Array  # (m,) of the joints
    upper: Array  # (m,)
    least: Array  # (m,) range of the joint angles measured, with a margin
    most: Array  # (m,)
    condition: float  # largest condition number of the nominal machine's Jacobian
    typical: float  # typical gain that it is compared with [m/rad]
    margin: float  # [m] beyond the region over which corrections are blended out
    on_face: float  # [m] a point this near a face of the region is on it
    correction: float  # largest correction of a joint
    reached: float  # [m] distance that counts as reached
    stepped: float  # [m] the same of a machine whose dimensions change, as by a clearance
    pulls: int  # loads to evaluate where limbs can only pull (cables), else 0


@record
class CommandRoom(NamedTuple):
    """Scratch arrays, used again for every command."""

    drawn: Place
    own: Place
    signals: Array  # of the nominal machine
    origin: Array  # (3,)
    task: Array  # (t, k) first rows of the unit matrix
    by_q: Array  # (t, m)
    by_g: Array  # (t, 0)
    told: Array  # (m,)
    still: Array  # (m,)


@record
class Single(NamedTuple):
    """Machines, guards, settings and scratch arrays for single commands."""

    drawn: MachineRecord
    machine: MachineRecord
    guards: Guards
    search: Search
    room: CommandRoom


@compiled()
def command_room(
    drawn: MachineRecord, machine: MachineRecord, of_drawn: int, of_own: int
) -> CommandRoom:
    """Allocate scratch; the sizes are lengths of a sample's signals for either machine."""
    sizes = drawn.body.limbs.sizes
    return CommandRoom(
        scratch(drawn, of_drawn),
        scratch(machine, of_own),
        np.zeros(of_drawn),
        np.zeros(3),
        np.eye(sizes[T], sizes[K]),
        np.zeros((sizes[T], sizes[M])),
        np.zeros((sizes[T], 0)),
        np.zeros(sizes[M]),
        np.zeros(sizes[M]),
    )


@compiled(borrows=True)
def _within(guards: Guards, q: Array, dq: Array) -> bool:
    """Whether q + dq is within the joints' limits."""
    for i in range(len(q)):  # noqa: SIM110 - nothing is made for it
        if not guards.lower[i] <= q[i] + dq[i] <= guards.upper[i]:
            return False
    return True


@compiled(borrows=True)
def _finite(values: Array) -> bool:
    for value in values:  # noqa: SIM110
        if not np.isfinite(value):
            return False
    return True


@compiled(borrows=True)
def _outside(guards: Guards, point: Array) -> float:
    """How far outside the region a point lies [m]; negative inside."""
    most = -np.inf
    for face in guards.planes:
        most = max(most, face[0] * point[0] + face[1] * point[1] + face[2] * point[2] + face[3])
    return most


@compiled(borrows=True)
def _unseen(guards: Guards, q: Array) -> float:
    """Excess of a command over the measured joint range, converted to tool motion [m]."""
    most = -np.inf
    for i in range(len(q)):
        most = max(most, guards.least[i] - q[i], q[i] - guards.most[i])
    return guards.typical * most


@compiled(borrows=True)
def _turned(values: Array, i: int, j: int, flat: bool) -> bool:
    """Rotate two rows (columns if not `flat`) to be orthogonal; True if a sweep must follow."""
    length = values.shape[1] if flat else values.shape[0]
    own, other, cross = 0.0, 0.0, 0.0
    for e in range(length):
        u = values[i, e] if flat else values[e, i]
        v = values[j, e] if flat else values[e, j]
        own, other, cross = own + u * u, other + v * v, cross + u * v
    scale = np.sqrt(own * other)
    if not abs(cross) > _SQUARE * scale:
        return False
    zeta = (other - own) / (2.0 * cross)
    tangent = (1.0 if zeta >= 0.0 else -1.0) / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
    c = 1.0 / np.sqrt(1.0 + tangent * tangent)
    s = c * tangent
    for e in range(length):
        if flat:
            u, v = values[i, e], values[j, e]
            values[i, e], values[j, e] = c * u - s * v, s * u + c * v
        else:
            u, v = values[e, i], values[e, j]
            values[e, i], values[e, j] = c * u - s * v, s * u + c * v
    return bool(abs(cross) > _MUCH * scale)  # a sweep squares the remaining cosine


@compiled(borrows=True)
def gains_of(values: Array) -> tuple[float, float]:
    """Largest and smallest singular value by one-sided Jacobi rotations; destroys the matrix.

    LAPACK's takes longer, most of all when its code has not been used for a millisecond.
    """
    flat = values.shape[0] <= values.shape[1]
    count = min(values.shape[0], values.shape[1])
    for _ in range(_SWEEPS):
        turned = False
        for i in range(count):
            for j in range(i + 1, count):
                turned = _turned(values, i, j, flat) or turned
        if not turned:
            break
    most, least = 0.0, np.inf
    for i in range(count):
        square = 0.0
        for e in range(values.shape[1] if flat else values.shape[0]):
            square += (values[i, e] if flat else values[e, i]) ** 2
        most, least = max(most, np.sqrt(square)), min(least, np.sqrt(square))
    return most, least


@compiled(borrows=True)
def gains_within(values: Array, system: Array) -> tuple[float, float]:
    """Upper and lower bound of all singular values of a matrix.

    By A A^T = L L^T (or A^T A, whichever is the smaller): the largest is no larger than the
    Frobenius norm of L, the smallest no smaller than one over that of L^-1. Takes a fraction
    of the work of `gains_of`; a bound is off by at most the square root of their number. The
    lower bound is 0 where rounding hides it.
    """
    flat = values.shape[0] <= values.shape[1]
    count = min(values.shape[0], values.shape[1])
    length = max(values.shape[0], values.shape[1])
    whole, inverse = 0.0, 0.0
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for e in range(length):
                total += values[i, e] * values[j, e] if flat else values[e, i] * values[e, j]
            whole += total if i == j else 0.0
            for e in range(j):
                total -= system[i, e] * system[j, e]
            if i != j:
                system[i, j] = total / system[j, j]
            elif total > _LOST * whole:
                system[i, i] = np.sqrt(total)
            else:
                return np.sqrt(whole), 0.0
    for j in range(count):  # L^-1, a column at a time, above the diagonal of L
        for i in range(j, count):
            total = 1.0 if i == j else 0.0
            for e in range(j, i):
                total -= system[i, e] * system[j, e + 1]
            system[j, i + 1] = total / system[i, i]
            inverse += system[j, i + 1] ** 2
    return np.sqrt(whole), 1.0 / np.sqrt(inverse)


@compiled(borrows=True)
def _alike(guards: Guards, most: float, least: float) -> bool:
    """Whether the extreme gains are close enough to each other and to the typical gain."""
    most, least = max(most, guards.typical), min(least, guards.typical)
    return bool(most <= guards.condition * least and least > 0.0)


@compiled(borrows=True)
def _regular(drawn: MachineRecord, guards: Guards, room: CommandRoom) -> bool:
    """Whether the nominal machine's pose is far enough from a singularity."""
    own = room.drawn
    place(drawn.body.limbs, own.state.joint, own.x, BESIDE, own.state.room)
    moved(drawn.body.limbs, room.task, own.state.room, room.by_q, room.by_g)
    for row in range(room.by_q.shape[0]):
        if not _finite(room.by_q[row]):
            return False
    most, least = gains_within(room.by_q, room.drawn.state.room.system)
    if _alike(guards, most, least):
        return True
    most, least = gains_of(room.by_q)
    return _alike(guards, most, least)


@compiled(borrows=True)
def _borne(
    drawn: MachineRecord, guards: Guards, payload: float, centre: Array, room: CommandRoom
) -> bool:
    """Whether every cable is in tension; an unknown payload counts as zero."""
    own, still = room.drawn, room.still
    known = payload == payload and _finite(centre)
    where = centre if known else room.origin
    bear(
        drawn.body.limbs,
        drawn.body.bearing,
        guards.pulls,
        drawn.stages.loaded,
        own.state.joint,
        own.x,
        still,
        still,
        payload if known else 0.0,
        where,
        own.state.room,
        own.state.carried,
    )
    for pull in own.state.carried.pull:  # noqa: SIM110
        if not pull > 0.0:
            return False
    return True


@compiled(borrows=True, shared=True)
def judged(
    drawn: MachineRecord,
    guards: Guards,
    q: Array,
    payload: float,
    centre: Array,
    target: Array,
    told: Array,
    room: CommandRoom,
) -> int:
    """Return the code of the first guard that a command (m,) fails, or `PASSED`.

    Writes the command's target into `target` (a,), and the share of the correction that is to be
    applied there into `told`.
    """
    told[SHARE] = 0.0
    target[:] = np.nan
    beyond = np.inf
    if not _finite(q):
        return NOT_FINITE
    begin(drawn, room.drawn)
    good = stands(drawn, q, room.signals, room.drawn)
    if good:
        copy_into(target, room.drawn.place)
        point = room.drawn.state.carried.point
        point_at(drawn.body.bearing, room.drawn.x, room.origin, point)
        first = drawn.body.bearing.point_at[2]
        beyond = _outside(guards, point[first : first + 3]) - guards.on_face
        beyond = max(beyond, _unseen(guards, q))
        if guards.margin > 0.0:
            told[SHARE] = min(max(1.0 - max(beyond, 0.0) / guards.margin, 0.0), 1.0)
        else:
            told[SHARE] = 1.0 if beyond <= 0.0 else 0.0
    for i in range(len(q)):
        if not guards.lower[i] <= q[i] <= guards.upper[i]:
            return JOINT_LIMIT
    if not good:
        return OUT_OF_REACH
    if not beyond <= guards.margin:
        return OUTSIDE_REGION
    if not _regular(drawn, guards, room):
        return SINGULAR
    if guards.pulls and not _borne(drawn, guards, payload, centre, room):
        return SLACK
    return PASSED


@compiled(borrows=True, shared=True)
def finished(
    machine: MachineRecord,
    guards: Guards,
    q: Array,
    signals: Array,
    target: Array,
    dq: Array,
    told: Array,
    room: CommandRoom,
) -> int:
    """Check a correction dq (m,) and apply its share, or set it to zero; returns the code.

    The whole chain, run forward, gives the remaining distance and rotation, written into `told`.
    Where the effects do not settle, the machine may be off by the swing of the last round. At a
    clearance that the correction itself crosses, this is at most the clearance, and either side
    counts as reached. A larger swing, or one of a machine without clearances, is rejected.
    """
    share, bounded = told[SHARE], True
    told[LEFT], told[TURN] = np.inf, np.inf
    for i in range(len(q)):
        room.told[i] = q[i] + dq[i]
        bounded = bounded and abs(dq[i]) <= guards.correction
    error = verified(machine, room.told, signals, target, room.own)
    most = guards.stepped if machine.reshaped else guards.reached
    good = max(error, room.own.state.swing[0]) <= most
    code = PASSED if good and bounded else NOT_REACHED
    if code == PASSED:
        for i in range(len(q)):
            dq[i] *= share
            room.told[i] = q[i] + dq[i]
        if not _within(guards, q, dq):
            code = JOINT_LIMIT
    if code != PASSED:
        for i in range(len(q)):
            dq[i] = 0.0
        return code
    if share < 1.0:
        error = reached(machine, room.told, signals, target, room.own)
    told[LEFT] = error
    if machine.aim.turns:
        far, chord = 0.0, 0.0
        for i in range(len(target)):
            square = (room.own.place[i] - target[i]) ** 2
            far, chord = (far + square, chord) if i < 3 else (far, chord + square)
        told[LEFT] = np.sqrt(far)
        told[TURN] = 2 * np.arcsin(min(np.sqrt(chord / 8) / machine.aim.arm, 1.0))
    return PASSED


@compiled(borrows=True, shared=True)
def commanded(
    drawn: MachineRecord,
    machine: MachineRecord,
    guards: Guards,
    search: Search,
    q: Array,
    signals: Array,
    payload: float,
    centre: Array,
    usable: bool,
    target: Array,
    dq: Array,
    told: Array,
    room: CommandRoom,
) -> int:
    """Apply guards and correction to one command q (m,) under its signals; see `Guards`."""
    dq[:] = 0.0
    told[:] = 0.0
    told[LEFT], told[TURN] = np.inf, np.inf
    code = judged(drawn, guards, q, payload, centre, target, told, room)
    if code != PASSED or not usable:
        return code
    begin_near(drawn, room.drawn, machine, room.own)
    _, told[COUNT] = correct(machine, search, q, signals, target, dq, room.own)
    return finished(machine, guards, q, signals, target, dq, told, room)


@compiled()
def every(
    drawn: MachineRecord,
    machine: MachineRecord,
    guards: Guards,
    search: Search,
    of_drawn: int,
    mode: int,
    q: Array,
    signals: Array,
    payload: Array,
    centre: Array,
    usable: NDArray[np.bool_],
    target: Array,
    dq: Array,
    told: Array,
) -> Index:
    """Apply `commanded` to n commands: returns codes (n,); fills in `target`, `dq` and `told`.

    Args:
        drawn: the nominal machine.
        machine: the identified machine.
        guards: limits to be kept.
        search: settings of Newton's method.
        of_drawn: length of a sample's signals for the nominal machine.
        mode: `FOUND` to correct, `JUDGED` for guards and targets alone, `VERIFIED` to check
            corrections dq that were found otherwise, with `target` and the share in `told` given.
        q: commands (n, m).
        signals: of the commands, (n, S).
        payload: [kg] (n,).
        centre: of the payload [m] (n, 3).
        usable: whether all conditions of a command are known, (n,).
        target: places (n, a).
        dq: corrections (n, m).
        told: results (n, 4): `SHARE`, `LEFT`, `TURN`, `COUNT`.
    """
    n = len(q)
    room, code = command_room(drawn, machine, of_drawn, signals.shape[1]), np.zeros(n, np.int64)
    for row in range(n):
        if mode == VERIFIED:
            begin(machine, room.own)
            code[row] = finished(
                machine, guards, q[row], signals[row], target[row], dq[row], told[row], room
            )
        else:
            code[row] = commanded(
                drawn,
                machine,
                guards,
                search,
                q[row],
                signals[row],
                payload[row],
                centre[row],
                usable[row] and mode == FOUND,
                target[row],
                dq[row],
                told[row],
                room,
            )
    return code


@compiled(alone=True)
def single(
    own: Single,
    q: Array,
    signals: Array,
    payload: float,
    centre: Array,
    usable: bool,
    target: Array,
    dq: Array,
    told: Array,
) -> int:
    """Apply `commanded` to one command (m,)."""
    return commanded(
        own.drawn,
        own.machine,
        own.guards,
        own.search,
        q,
        signals,
        payload,
        centre,
        usable,
        target,
        dq,
        told,
        own.room,
    )
