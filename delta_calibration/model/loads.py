"""Forces that a mechanism carries, by virtual work, for one sample: compiled.

With U(q, x) the work of moving the masses against a field of force (gravity, or what accelerates
them), the joints carry dU/dq and a dimension g of the machine carries dU/dg,

    dU/dq = u_q - u_x f_x^+ f_q        dU/dg = -u_x f_x^+ f_g        u_x, u_q: at constant q, x

Cables can only pull, and more of them than freedoms hold each other taut: of all pulls that bear
the load the nearest to the pretension is taken, t = t_p + (f_x^T)^+ (-u_x - f_x^T t_p).

What all of it presses on the base is the sum over the masses (d'Alembert), with z up,

    F = -sum m (p'' + G z)        M = -sum p x m (p'' + G z)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.chain_constants import (
    FREE_FALL,
    MOMENT,
    OF_INERTIA,
    OF_PULLS,
    OF_REACTION,
    OF_WEIGHT,
)
from delta_calibration.model.jit import call, compiled, record
from delta_calibration.model.kernels import (
    BESIDE,
    F_Q,
    FULL,
    NEAR,
    SETUP,
    SHARED,
    K,
    Limbs,
    M,
    R,
    Room,
    copy_into,
    fill,
    moved,
    own_joint,
    place,
    room,
    set_geometry,
    solve,
    squares,
    towards,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@record
class Bearing(NamedTuple):
    """What a mechanism carries and where; z is up.

    point (4,), point_at (6,)   law of a point fixed to the platform; places of x, o, f, f_x, f_o,
                                and its size
    mass (4,), mass_at (7,)     law of the masses' places; places of x, q, g, f, f_x, f_q, size
    dims (d,)                   dimensions that it takes, or fixed numbers behind them
    kg (k,), levers (k, 3)      each mass, and how far [m] it is from the place that its law states
    home (k,)                   pose at which counters are zero
    pretension                  [N] of every cable
    constants (c,)              of the limbs, for the law of the masses
    joints (j,)                 of the limbs, in the order that this law takes them
    """

    point: Index
    point_at: Index
    mass: Index
    mass_at: Index
    dims: Index
    kg: Array
    levers: Array
    home: Array
    pretension: float
    constants: Array
    joints: Index


@record
class Carried(NamedTuple):
    """Scratch, and what is found: torques of weight and inertia, dU/dg, reaction, pulls.

    dU/dg is that of the weight, and of the inertia where that is asked for as well.
    """

    point: Array
    mass: Array
    u_x: Array  # (1, k)
    by_q: Array  # (1, m)
    by_g: Array  # (1, p)
    accelerated: Array  # (3 (masses + payload),)
    gravity: Array  # (m,)
    inertia: Array  # (m,)
    load: Array  # (p,)
    reaction: Array  # (6,) [N, N m] force and moment on the base, about its origin
    pull: Array  # (R,)
    pull_home: Array  # (R,)
    there: Array  # (k,)
    way: Array  # (m,)
    u_q: Array  # (m,)
    still: Array  # (m,) readings of counters at home
    origin: Array  # (3,)
    a: Array  # (3,)
    pace: Array  # (k,) velocity of the pose, then its acceleration
    turn: Array  # (R,) second derivative of the closures along the velocity
    known: Array  # (1,) whether the pulls at home are those of these dimensions


@compiled()
def carried(limbs: Limbs, bearing: Bearing) -> Carried:
    """Scratch for one sample after the other."""
    m, k, p, r = limbs.sizes[M], limbs.sizes[K], limbs.sizes[2], limbs.sizes[R]
    return Carried(
        np.zeros(bearing.point_at[5]),
        np.zeros(max(1, bearing.mass_at[6])),
        np.zeros((1, k)),
        np.zeros((1, m)),
        np.zeros((1, p)),
        np.zeros(3 * (len(bearing.kg) + 1)),
        np.zeros(m),
        np.zeros(m),
        np.zeros(p),
        np.zeros(6),
        np.zeros(r),
        np.zeros(r),
        np.zeros(k),
        np.zeros(m),
        np.zeros(m),
        np.zeros(m),
        np.zeros(3),
        np.zeros(3),
        np.zeros(k),
        np.zeros(r),
        np.zeros(1),
    )


@compiled(borrows=True)
def point_at(bearing: Bearing, x: Array, offset: Array, work: Array) -> None:
    """Evaluate the law of a point at `offset` (3,) [m] of the platform."""
    copy_into(work[bearing.point_at[0] : bearing.point_at[0] + len(x)], x)
    call(bearing.point[SETUP], work)
    call(bearing.point[SHARED], work)
    other_point(bearing, offset, work)


@compiled(borrows=True)
def other_point(bearing: Bearing, offset: Array, work: Array) -> None:
    """Evaluate the same at the same pose for another offset."""
    for i in range(3):
        work[bearing.point_at[1] + i] = offset[i]
    call(bearing.point[FULL], work)


@compiled(borrows=True)
def masses_at(limbs: Limbs, bearing: Bearing, q: Array, x: Array, work: Array) -> None:
    """Evaluate the law of the masses' places; their dimensions are in the workspace."""
    for i in range(len(x)):
        work[bearing.mass_at[0] + i] = x[i]
    for i in range(len(bearing.joints)):
        joint = bearing.joints[i]
        work[bearing.mass_at[1] + i] = own_joint(limbs, joint, q[joint])
    call(bearing.mass[SETUP], work)
    call(bearing.mass[SHARED], work)
    call(bearing.mass[FULL], work)


@compiled(borrows=True)
def set_masses(limbs: Limbs, bearing: Bearing, g: Array, found: Carried) -> None:
    """Give the masses' law these dimensions (p,)."""
    p = limbs.sizes[2]
    for i in range(len(bearing.dims)):
        row = bearing.dims[i]
        found.mass[bearing.mass_at[2] + i] = g[row] if row < p else limbs.fixed[row - p]
    found.known[0] = 0.0
    first = bearing.mass_at[2] + len(bearing.dims)
    for i in range(len(bearing.constants)):
        found.mass[first + i] = bearing.constants[i]


@compiled(borrows=True)
def _add(
    limbs: Limbs,
    bearing: Bearing,
    found: Carried,
    point: int,
    kg: float,
    a: Array,
    u_q: Array,
) -> None:
    """Add the work of one mass against the acceleration a (3,) to u_x and u_q."""
    k = found.u_x.shape[1]
    for axis in range(3):
        force = kg * a[axis]
        if force == 0.0:
            continue
        if point < 0:  # the payload
            for i in range(k):
                found.u_x[0, i] += force * found.point[bearing.point_at[3] + axis * k + i]
            continue
        row = 3 * point + axis
        for i in range(k):
            found.u_x[0, i] += force * found.mass[bearing.mass_at[4] + row * k + i]
        for i in range(len(bearing.joints)):
            slope = found.mass[bearing.mass_at[5] + row * len(bearing.joints) + i]
            joint = bearing.joints[i]
            u_q[joint] += force * (limbs.sense[joint] * slope)


@compiled(borrows=True)
def _work(
    limbs: Limbs,
    bearing: Bearing,
    payload: float,
    accelerated: bool,
    found: Carried,
    u_q: Array,
) -> None:
    """u_x and u_q of all masses, under gravity or as `accelerated`; the laws are evaluated."""
    a, count = found.a, len(bearing.kg)
    fill(found.u_x, 0.0)
    for i in range(len(u_q)):
        u_q[i] = 0.0
    for point in range(-1, count):
        kg = payload if point < 0 else bearing.kg[point]
        for axis in range(3):
            a[axis] = 0.0 if axis < 2 else FREE_FALL
            if accelerated:
                a[axis] = found.accelerated[3 * (count if point < 0 else point) + axis]
        _add(limbs, bearing, found, point, kg, a, u_q)


@compiled(borrows=True)
def _places(bearing: Bearing, found: Carried, weight: float) -> None:
    """Add the places of all masses and the payload, times a weight, to what is accelerated."""
    count = len(bearing.kg)
    for i in range(3 * count):
        found.accelerated[i] += weight * found.mass[bearing.mass_at[3] + i]
    for i in range(3):
        found.accelerated[3 * count + i] += weight * found.point[bearing.point_at[2] + i]


@compiled(borrows=True)
def _moves(rate: Array, acceleration: Array) -> bool:
    """Whether any joint moves."""
    for i in range(len(rate)):  # noqa: SIM110 - nothing is made for it
        if rate[i] != 0.0 or acceleration[i] != 0.0:
            return True
    return False


@compiled(borrows=True)
def _pose_for(limbs: Limbs, joints: Array, turn: Array, room: Room, found: Array) -> None:
    """-f_x^+ (f_q joints + turn): what a pose does (k,) while its joints do this (m,).

    The limbs are placed with their derivatives by the joints. NaN where it is singular.
    """
    count, k = limbs.joints.shape[1], limbs.sizes[K]
    for limb in range(len(limbs.joints)):
        work = room.work[limb]
        for i in range(limbs.rows.shape[1]):
            row = limbs.rows[limb, i]
            room.f[row] = turn[row]
            for j in range(count):
                joint = limbs.joints[limb, j]
                slope = limbs.sense[joint] * work[limbs.at[F_Q] + i * count + j]
                room.f[row] += slope * joints[joint]
    good = towards(room, limbs.sizes[R], k)
    for i in range(k):
        found[i] = -room.step[i] if good else np.nan


@compiled(borrows=True)
def _along(
    limbs: Limbs,
    bearing: Bearing,
    q: Array,
    x: Array,
    rate: Array,
    centre: Array,
    room: Room,
    found: Carried,
) -> None:
    """Second differences of closures and of masses' places, but for what is in their middle.

    Along the straight line through (q, x) that has the velocity (q', x'), x' = -f_x^+ f_q q'.
    """
    there, way, turn = found.there, found.way, found.turn
    for row in range(len(turn)):
        turn[row] = 0.0
    for i in range(len(found.accelerated)):
        found.accelerated[i] = 0.0
    place(limbs, q, x, BESIDE, room)
    _pose_for(limbs, rate, turn, room, found.pace)
    for side in range(2):
        t = MOMENT if side == 0 else -MOMENT
        for i in range(len(q)):
            way[i] = q[i] + rate[i] * t
        for i in range(len(x)):
            there[i] = x[i] + found.pace[i] * t
        place(limbs, way, there, NEAR, room)
        for row in range(len(turn)):
            turn[row] += room.f[row] / MOMENT**2
        point_at(bearing, there, centre, found.point)
        masses_at(limbs, bearing, way, there, found.mass)
        _places(bearing, found, 1.0 / MOMENT**2)


@compiled(borrows=True)
def _accelerate(
    limbs: Limbs, bearing: Bearing, acceleration: Array, room: Room, found: Carried
) -> None:
    """Accelerations of all masses, after `_along`; limbs and masses are placed.

    With D2 the second derivative along the velocity, and p the masses' places:

        x'' = -f_x^+ (f_q q'' + D2 f)      p'' = p_x x'' + p_q q'' + D2 p
    """
    k, joints, pace = len(found.pace), bearing.joints, found.pace
    for row in range(len(found.turn)):
        found.turn[row] -= 2.0 * room.f[row] / MOMENT**2
    _places(bearing, found, -2.0 / MOMENT**2)
    _pose_for(limbs, acceleration, found.turn, room, pace)
    for row in range(3 * len(bearing.kg)):
        for i in range(k):
            found.accelerated[row] += found.mass[bearing.mass_at[4] + row * k + i] * pace[i]
        for i in range(len(joints)):
            slope = limbs.sense[joints[i]] * found.mass[bearing.mass_at[5] + row * len(joints) + i]
            found.accelerated[row] += slope * acceleration[joints[i]]
    for axis in range(3):
        row = 3 * len(bearing.kg) + axis
        for i in range(k):
            found.accelerated[row] += found.point[bearing.point_at[3] + axis * k + i] * pace[i]


@compiled(borrows=True)
def _react(bearing: Bearing, payload: float, moving: bool, found: Carried) -> None:
    """Force and moment on the base; the laws are evaluated, and the accelerations if `moving`."""
    a, count, total = found.a, len(bearing.kg), found.reaction
    for i in range(6):
        total[i] = 0.0
    for point in range(-1, count):
        row = count if point < 0 else point
        kg = payload if point < 0 else bearing.kg[point]
        for axis in range(3):
            a[axis] = 0.0 if axis < 2 else FREE_FALL
            if moving:
                a[axis] += found.accelerated[3 * row + axis]
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            p_i, p_j = _place_of(bearing, found, point, i), _place_of(bearing, found, point, j)
            total[axis] -= kg * a[axis]
            total[3 + axis] -= kg * (p_i * a[j] - p_j * a[i])


@compiled(borrows=True)
def _place_of(bearing: Bearing, found: Carried, point: int, axis: int) -> float:
    """Where a mass is along an axis of the base [m]; the payload's number is -1."""
    if point < 0:
        return float(found.point[bearing.point_at[2] + axis])
    return float(found.mass[bearing.mass_at[3] + 3 * point + axis] + bearing.levers[point, axis])


@compiled(borrows=True)
def _pulls(limbs: Limbs, bearing: Bearing, room: Room, found: Carried, pull: Array) -> None:
    """Pulls of the cables that bear u_x, nearest to the pretension; the limbs are placed."""
    r, k = limbs.sizes[R], limbs.sizes[K]
    system = room.system
    squares(room.by_x, system)
    for i in range(k):
        right = -found.u_x[0, i]
        for row in range(r):
            right -= room.by_x[row, i] * bearing.pretension
        system[i, k] = right
    good = solve(system, k, 1)
    for row in range(r):
        pull[row] = bearing.pretension if good else np.nan
        for i in range(k):
            pull[row] += room.by_x[row, i] * system[i, k]


@compiled(borrows=True)
def bear(
    limbs: Limbs,
    bearing: Bearing,
    asked: int,
    q: Array,
    x: Array,
    rate: Array,
    acceleration: Array,
    payload: float,
    centre: Array,
    room: Room,
    found: Carried,
) -> None:
    """All loads that are asked for, at joints q (m,) and pose x (k,); the limbs know their g."""
    u_q, moving = found.u_q, False
    for i in range(len(found.load)):
        found.load[i] = 0.0
    if asked & OF_PULLS and found.known[0] == 0.0:
        copy_into(found.still, limbs.zero)
        place(limbs, found.still, bearing.home, FULL, room)
        point_at(bearing, bearing.home, found.origin, found.point)
        masses_at(limbs, bearing, found.still, bearing.home, found.mass)
        _work(limbs, bearing, 0.0, False, found, u_q)
        _pulls(limbs, bearing, room, found, found.pull_home)
        found.known[0] = 1.0
    if asked & OF_INERTIA:
        for i in range(len(q)):
            found.inertia[i] = 0.0
    if asked & (OF_INERTIA | OF_REACTION):
        moving = _moves(rate, acceleration)
    if moving:
        _along(limbs, bearing, q, x, rate, centre, room, found)
    place(limbs, q, x, FULL, room)
    point_at(bearing, x, centre, found.point)
    masses_at(limbs, bearing, q, x, found.mass)
    if moving:
        _accelerate(limbs, bearing, acceleration, room, found)
    if asked & OF_REACTION:
        _react(bearing, payload, moving, found)
    if moving and asked & OF_INERTIA:
        _work(limbs, bearing, payload, True, found, u_q)
        moved(limbs, found.u_x, room, found.by_q, found.by_g)
        for i in range(len(q)):
            found.inertia[i] = u_q[i] + found.by_q[0, i]
        for i in range(found.by_g.shape[1]):
            found.load[i] = found.by_g[0, i]
    _work(limbs, bearing, payload, False, found, u_q)
    if asked & OF_PULLS:
        _pulls(limbs, bearing, room, found, found.pull)
    if asked & OF_WEIGHT:
        moved(limbs, found.u_x, room, found.by_q, found.by_g)
        for i in range(len(q)):
            found.gravity[i] = u_q[i] + found.by_q[0, i]
        for i in range(found.by_g.shape[1]):
            found.load[i] += found.by_g[0, i]


@compiled()
def every(
    limbs: Limbs,
    size: int,
    bearing: Bearing,
    asked: int,
    q: Array,
    x: Array,
    g: Array,
    rate: Array,
    acceleration: Array,
    payload: Array,
    centre: Array,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """All loads that are asked for, of every sample; see `Mechanism.loads`."""
    n, m, p, r = len(q), limbs.sizes[M], limbs.sizes[2], limbs.sizes[R]
    weight, inertia, load = np.zeros((n, m)), np.zeros((n, m)), np.zeros((n, p))
    pull, home, reaction = np.zeros((n, r)), np.zeros((n, r)), np.zeros((n, 6))
    own, found, last = room(limbs, size), carried(limbs, bearing), len(g) - 1
    for row in range(n):
        if row == 0 or last > 0:
            set_geometry(limbs, g[min(row, last)], own)
            set_masses(limbs, bearing, g[min(row, last)], found)
        bear(
            limbs,
            bearing,
            asked,
            q[row],
            x[row],
            rate[row],
            acceleration[row],
            payload[row],
            centre[row],
            own,
            found,
        )
        weight[row], inertia[row], load[row] = found.gravity, found.inertia, found.load
        pull[row], home[row], reaction[row] = found.pull, found.pull_home, found.reaction
    return weight, inertia, load, pull, home, reaction


@compiled()
def pulls(limbs: Limbs, size: int, bearing: Bearing, x: Array, g: Array, load: Array) -> Array:
    """Pulls of the limbs that bear dU/dx = load (n, k) at poses x (n, k), (n, R)."""
    n, last = len(x), len(g) - 1
    own, found = room(limbs, size), carried(limbs, bearing)
    every_pull = np.empty((n, limbs.sizes[R]))
    for row in range(n):
        if row == 0 or last > 0:
            set_geometry(limbs, g[min(row, last)], own)
        place(limbs, found.still, x[row], FULL, own)
        copy_into(found.u_x[0], load[row])
        _pulls(limbs, bearing, own, found, every_pull[row])
    return every_pull
