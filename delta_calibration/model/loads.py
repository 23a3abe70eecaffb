"""Forces that a mechanism carries, by virtual work, for one sample: compiled.

With U(q, x) the work of moving the masses against a field of force (gravity, or what accelerates
them), the joints carry dU/dq and a dimension g of the machine carries dU/dg,

    dU/dq = u_q - u_x f_x^+ f_q        dU/dg = -u_x f_x^+ f_g        u_x, u_q: at constant q, x

Cables can only pull, and if they outnumber the freedoms they tension each other: of all pulls that
bear the load the nearest to the pretension t_p is taken, t = t_p + (f_x^T)^+ (-u_x - f_x^T t_p).

Force and moment of the machine on its base are sums over the masses (d'Alembert), with z up,

    F = -sum m (p'' + G z)        M = -sum p x m (p'' + G z)

and the payload's terms alone are its force and moment on the platform.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.chain_constants import (
    FREE_FALL,
    MOMENT,
    OF_CARRIED,
    OF_DIMENSIONS,
    OF_INERTIA,
    OF_PULLS,
    OF_REACTION,
    OF_TIGHTNESS,
    OF_WEIGHT,
)
from delta_calibration.model.elimination import solve_definite, squares
from delta_calibration.model.jit import call, compiled, record
from delta_calibration.model.kernels import (
    BESIDE,
    F_G,
    FULL,
    NEAR,
    SETUP,
    SHARED,
    K,
    Limbs,
    M,
    R,
    Room,
    add_by_joints,
    along,
    copy_into,
    factored,
    own_joint,
    place,
    place_in,
    room,
    same,
    set_geometry,
    set_sample,
    weigh,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WEIGHT, INERTIA = range(2)  # rows of the work
_UNTOUCHED = -1.2345e-67  # value that no law yields for inputs between 0 and 1


@record
class Bearing(NamedTuple):
    """Masses of a mechanism and the laws of their places; z is up.

    point (4,), point_at (6,)   law of a point fixed to the platform; places of x, o, f, f_x, f_o,
                                and its size
    mass (4,), mass_at (7,)     law of the masses' places; places of x, q, g, f, f_x, f_q, size
    dims (d,)                   dimensions that it takes, or fixed numbers behind them
    kg (k,), moves (k,)         each mass, and the share of it that is accelerated at its place
    levers (k, 3)               how far [m] each is from the place that its law states
    pivots (k, 3)               points [m] about which the rest of each mass turns
    home (k,)                   pose at which counters are zero
    pretension                  [N] of every cable
    constants (c,)              of the limbs, for the law of the masses
    joints (j,)                 of the limbs, in the order that this law takes them
    by_pose (s, 3)              derivatives of the masses' places that are not always zero: slot in
                                the workspace, coordinate of the place, coordinate of the pose
    by_joint (t, 3)             the same by the joints: slot, coordinate of the place, joint
    """

    point: Index
    point_at: Index
    mass: Index
    mass_at: Index
    dims: Index
    kg: Array
    moves: Array
    levers: Array
    pivots: Array
    home: Array
    pretension: float
    constants: Array
    joints: Index
    by_pose: Index
    by_joint: Index


@compiled()
def stored(law: Index, size: int, inputs: int) -> Array:
    """Which numbers of a workspace a law writes, 1 or 0, (size,); the inputs come first.

    All inputs get different values, none of them the mark of a number that was not written.
    """
    work = np.full(size, _UNTOUCHED)
    for i in range(inputs):
        work[i] = (i + 1.0) / (inputs + 1.0)
    call(law[SETUP], work)
    call(law[SHARED], work)
    call(law[FULL], work)
    return np.where(work == _UNTOUCHED, 0.0, 1.0)


@record
class Beside(NamedTuple):
    """Workspaces to evaluate neighbouring places, while the sample's own place is kept."""

    work: Array  # (L, s) of the limbs
    f: Array  # (R,)
    by_x: Array  # (R, k)
    point: Array
    mass: Array
    joint: Array  # (m,)
    pose: Array  # (k,)


@record
class Carried(NamedTuple):
    """Scratch and results: torques of weight and inertia, dU/dg, reactions, pulls.

    Arrays of the work U have a row for `WEIGHT` and one for `INERTIA`. dU/dg is that of the
    weight, plus that of the inertia where that is asked for as well.
    """

    point: Array
    mass: Array
    u_x: Array  # (2, k)
    u_q: Array  # (2, m)
    carried: Array  # (2, R) -u_x f_x^+
    accelerated: Array  # (3 (masses + payload),)
    force: Array  # the same, force on each mass [N]
    gravity: Array  # (m,)
    inertia: Array  # (m,)
    load: Array  # (p,)
    reaction: Array  # (6,) [N, N m] force and moment on the base, about its origin
    payload: Array  # (6,) the payload's part of it
    pull: Array  # (R,)
    tightness: Array  # (R,) change of each pull by one newton of pretension
    pull_home: Array  # (R,)
    still: Array  # (m,) readings of counters at home
    origin: Array  # (3,)
    a: Array  # (3,)
    pace: Array  # (k,) velocity of the pose, then its acceleration
    turn: Array  # (R,) second derivative of the closures along the velocity
    known: Array  # (1,) whether the pulls at home are those of these dimensions
    beside: Beside


@compiled()
def nowhere(bearing: Bearing) -> Array:
    """Workspace of the law of a point that is at no pose yet."""
    work = np.zeros(bearing.point_at[5])
    work[bearing.point_at[0]] = np.nan
    return work


@compiled()
def carried(limbs: Limbs, bearing: Bearing, size: int) -> Carried:
    """Allocate scratch for one sample after another; `size` is that of a limb's workspace."""
    m, k, p, r = limbs.sizes[M], limbs.sizes[K], limbs.sizes[2], limbs.sizes[R]
    beside = Beside(
        np.zeros((len(limbs.joints), size)),
        np.zeros(r),
        np.zeros((r, k)),
        nowhere(bearing),
        np.zeros(max(1, bearing.mass_at[6])),
        np.zeros(m),
        np.zeros(k),
    )
    return Carried(
        nowhere(bearing),
        np.zeros(max(1, bearing.mass_at[6])),
        np.zeros((2, k)),
        np.zeros((2, m)),
        np.zeros((2, r)),
        np.zeros(3 * (len(bearing.kg) + 1)),
        np.zeros(3 * (len(bearing.kg) + 1)),
        np.zeros(m),
        np.zeros(m),
        np.zeros(p),
        np.zeros(6),
        np.zeros(6),
        np.zeros(r),
        np.zeros(r),
        np.zeros(r),
        np.zeros(m),
        np.zeros(3),
        np.zeros(3),
        np.zeros(k),
        np.zeros(r),
        np.zeros(1),
        beside,
    )


@compiled(borrows=True)
def point_at(bearing: Bearing, x: Array, offset: Array, work: Array) -> None:
    """Evaluate the law of a point at `offset` (3,) [m] of the platform."""
    first = bearing.point_at[0]
    if not same(work[first : first + len(x)], x):
        copy_into(work[first : first + len(x)], x)
        call(bearing.point[SETUP], work)
        call(bearing.point[SHARED], work)
    other_point(bearing, offset, work)


@compiled(borrows=True)
def other_point(bearing: Bearing, offset: Array, work: Array) -> None:
    """Evaluate the law of a point for another offset at the same pose."""
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
    """Set the dimensions (p,) of the masses' law."""
    p = limbs.sizes[2]
    for i in range(len(bearing.dims)):
        row = bearing.dims[i]
        found.mass[bearing.mass_at[2] + i] = g[row] if row < p else limbs.fixed[row - p]
    found.known[0] = 0.0
    first = bearing.mass_at[2] + len(bearing.dims)
    for i in range(len(bearing.constants)):
        found.mass[first + i] = bearing.constants[i]


@compiled(borrows=True)
def _work(limbs: Limbs, bearing: Bearing, payload: float, row: int, found: Carried) -> None:
    """Compute row `WEIGHT` or `INERTIA` of u_x and u_q, after the laws were evaluated."""
    u_x, u_q, force, count = found.u_x[row], found.u_q[row], found.force, len(bearing.kg)
    for point in range(count + 1):  # the payload is the last
        kg = payload if point == count else bearing.kg[point]
        if row == INERTIA and point < count:
            kg *= bearing.moves[point]
        for axis in range(3):
            weight = FREE_FALL if axis == 2 else 0.0
            a = found.accelerated[3 * point + axis] if row == INERTIA else weight
            force[3 * point + axis] = kg * a
    k, mass = len(u_x), found.mass
    for i in range(k):
        place, total = bearing.point_at[3] + i, 0.0
        for axis in range(3):
            total += force[3 * count + axis] * found.point[place + axis * k]
        u_x[i] = total
    for at in bearing.by_pose:
        u_x[at[2]] += force[at[1]] * mass[at[0]]
    u_q[:] = 0.0
    for at in bearing.by_joint:
        u_q[at[2]] += force[at[1]] * (limbs.sense[at[2]] * mass[at[0]])


@compiled(borrows=True)
def _places(bearing: Bearing, point: Array, mass: Array, weight: float, found: Array) -> None:
    """Add the places of all masses and the payload, times a weight, to `found`."""
    count = 3 * len(bearing.kg)
    for i in range(count):
        found[i] += weight * mass[bearing.mass_at[3] + i]
    for i in range(3):
        found[count + i] += weight * point[bearing.point_at[2] + i]


@compiled(borrows=True)
def _moves(rate: Array, acceleration: Array) -> bool:
    """Whether any joint moves."""
    for i in range(len(rate)):  # noqa: SIM110 - nothing is made for it
        if rate[i] != 0.0 or acceleration[i] != 0.0:
            return True
    return False


@compiled(borrows=True)
def _pose_for(limbs: Limbs, joints: Array, turn: Array, room: Room, found: Array) -> None:
    """-f_x^+ (f_q joints + turn): rate of the pose (k,) at these rates of the joints (m,).

    The limbs are placed with their derivatives by the joints, and factored.
    """
    copy_into(room.f, turn)
    along(limbs, joints, room)
    for i in range(len(found)):
        found[i] = -room.step[i]


@compiled(borrows=True, shared=True)
def _curved(
    limbs: Limbs,
    bearing: Bearing,
    q: Array,
    x: Array,
    rate: Array,
    centre: Array,
    room: Room,
    found: Carried,
) -> None:
    """Second derivatives of closures and of masses' places along the motion, by differences.

    Along the straight line through (q, x) that has the velocity (q', x'), x' = -f_x^+ f_q q'.
    Limbs and masses are placed at (q, x), and stay so.
    """
    turn, places, beside, share = found.turn, found.accelerated, found.beside, 1.0 / MOMENT**2
    for row in range(len(turn)):
        turn[row] = 0.0
    for i in range(len(places)):
        places[i] = 0.0
    _places(bearing, found.point, found.mass, -2.0 * share, places)
    copy_into(beside.f, room.f)
    _pose_for(limbs, rate, turn, room, found.pace)
    for row in range(len(turn)):
        turn[row] -= 2.0 * share * beside.f[row]
    for limb in range(len(beside.work)):
        copy_into(beside.work[limb], room.work[limb])
    copy_into(beside.mass, found.mass)
    for side in range(2):
        t = MOMENT if side == 0 else -MOMENT
        for i in range(len(q)):
            beside.joint[i] = q[i] + rate[i] * t
        for i in range(len(x)):
            beside.pose[i] = x[i] + found.pace[i] * t
        place_in(limbs, beside.joint, beside.pose, NEAR, beside.work, beside.f, beside.by_x)
        for row in range(len(turn)):
            turn[row] += share * beside.f[row]
        point_at(bearing, beside.pose, centre, beside.point)
        masses_at(limbs, bearing, beside.joint, beside.pose, beside.mass)
        _places(bearing, beside.point, beside.mass, share, places)


@compiled(borrows=True)
def _accelerate(
    limbs: Limbs, bearing: Bearing, acceleration: Array, room: Room, found: Carried
) -> None:
    """Accelerations of all masses, after `_curved`.

    With D2 the second derivative along the velocity, and p the masses' places:

        x'' = -f_x^+ (f_q q'' + D2 f)      p'' = p_x x'' + p_q q'' + D2 p
    """
    k, pace, mass, count = len(found.pace), found.pace, found.mass, 3 * len(bearing.kg)
    _pose_for(limbs, acceleration, found.turn, room, pace)
    for at in bearing.by_pose:
        found.accelerated[at[1]] += mass[at[0]] * pace[at[2]]
    for at in bearing.by_joint:
        slope = limbs.sense[at[2]] * mass[at[0]]
        found.accelerated[at[1]] += slope * acceleration[at[2]]
    for axis in range(3):
        total, by_x = found.accelerated[count + axis], bearing.point_at[3] + axis * k
        for i in range(k):
            total += found.point[by_x + i] * pace[i]
        found.accelerated[count + axis] = total


@compiled(borrows=True)
def _react(bearing: Bearing, payload: float, moving: bool, found: Carried) -> None:
    """Compute force and moment on the base, after the laws and, if `moving`, accelerations.

    If only a share of a mass is accelerated at its place, the rest acts at the point that it
    turns about.
    """
    a, count = found.a, len(bearing.kg)
    for i in range(6):
        found.reaction[i] = 0.0
    for point in range(-1, count):
        kg = payload if point < 0 else bearing.kg[point]
        for axis in range(3):
            a[axis] = 0.0 if axis < 2 else FREE_FALL
        _press(bearing, found, point, kg, 1.0)
        if moving:
            row = count if point < 0 else point
            for axis in range(3):
                a[axis] = found.accelerated[3 * row + axis]
            _press(bearing, found, point, kg, 1.0 if point < 0 else bearing.moves[point])
        if point < 0:
            copy_into(found.payload, found.reaction)


@compiled(borrows=True)
def _press(bearing: Bearing, found: Carried, point: int, kg: float, share: float) -> None:
    """Add force and moment on the base of a mass of acceleration `a`; -1 is the payload."""
    a, total = found.a, found.reaction
    x = _coordinate(bearing, found, point, 0, share)
    y = _coordinate(bearing, found, point, 1, share)
    z = _coordinate(bearing, found, point, 2, share)
    for axis in range(3):
        total[axis] -= kg * a[axis]
    total[3] -= kg * (y * a[2] - z * a[1])
    total[4] -= kg * (z * a[0] - x * a[2])
    total[5] -= kg * (x * a[1] - y * a[0])


@compiled(borrows=True)
def _coordinate(bearing: Bearing, found: Carried, point: int, axis: int, share: float) -> float:
    """Coordinate of a mass in the base [m]: `share` of it at its place, the rest at its pivot."""
    if point < 0:
        return float(found.point[bearing.point_at[2] + axis])
    own = found.mass[bearing.mass_at[3] + 3 * point + axis] + bearing.levers[point, axis]
    return float(share * own + (1.0 - share) * bearing.pivots[point, axis])


@compiled(borrows=True)
def _pulls(limbs: Limbs, pretension: float, room: Room, u_x: Array, pull: Array) -> None:
    """Pulls of the cables that bear u_x (k,), nearest to the pretension; the limbs are placed."""
    r, k = limbs.sizes[R], limbs.sizes[K]
    system = room.system
    squares(room.by_x, system)
    for i in range(k):
        right = -u_x[i]
        for row in range(r):
            right -= room.by_x[row, i] * pretension
        system[i, k] = right
    good = solve_definite(system, k, 1)
    for row in range(r):
        pull[row] = pretension if good else np.nan
        for i in range(k):
            pull[row] += room.by_x[row, i] * system[i, k]


@compiled(borrows=True)
def _pulls_at_home(limbs: Limbs, bearing: Bearing, room: Room, found: Carried) -> None:
    """Pulls at home (counters zero) without a payload; evaluated once for the same dimensions."""
    if found.known[0] > 0.0:
        return
    copy_into(found.still, limbs.zero)
    place(limbs, found.still, bearing.home, BESIDE, room)
    point_at(bearing, bearing.home, found.origin, found.point)
    masses_at(limbs, bearing, found.still, bearing.home, found.mass)
    _work(limbs, bearing, 0.0, WEIGHT, found)
    _pulls(limbs, bearing.pretension, room, found.u_x[WEIGHT], found.pull_home)
    found.known[0] = 1.0


@compiled(borrows=True, shared=True)
def bear(
    limbs: Limbs,
    bearing: Bearing,
    asked: int,
    loaded: Index,
    q: Array,
    x: Array,
    rate: Array,
    acceleration: Array,
    payload: float,
    centre: Array,
    room: Room,
    found: Carried,
) -> None:
    """Compute the loads `asked` for at joints q (m,) and pose x (k,); the limbs have their g.

    dU/dg only of those of the limbs' parameters that are `loaded` (l,).
    """
    if asked & OF_PULLS:
        _pulls_at_home(limbs, bearing, room, found)
    place(limbs, q, x, FULL if asked & OF_DIMENSIONS else BESIDE, room)
    point_at(bearing, x, centre, found.point)
    masses_at(limbs, bearing, q, x, found.mass)
    _work(limbs, bearing, payload, WEIGHT, found)
    inertia = asked & OF_INERTIA > 0
    reaction = asked & OF_REACTION > 0 or asked & OF_CARRIED > 0
    moving = (inertia or reaction) and _moves(rate, acceleration)
    regular = (asked & OF_WEIGHT > 0 or moving) and factored(limbs, room)
    if moving:
        if regular:
            _curved(limbs, bearing, q, x, rate, centre, room, found)
            _accelerate(limbs, bearing, acceleration, room, found)
        else:
            found.accelerated[:] = np.nan
        _work(limbs, bearing, payload, INERTIA, found)
    if reaction:
        _react(bearing, payload, moving, found)
    if asked & OF_PULLS:
        _pulls(limbs, bearing.pretension, room, found.u_x[WEIGHT], found.pull)
    if asked & OF_WEIGHT:
        _turn(limbs, WEIGHT, regular, room, found, found.gravity)
    if inertia:
        for i in range(len(q)):
            found.inertia[i] = 0.0
    if inertia and moving:
        _turn(limbs, INERTIA, regular, room, found, found.inertia)
    if asked & OF_DIMENSIONS:
        _load(limbs, loaded, moving and inertia, room, found)
    if asked & OF_TIGHTNESS:  # the last, as it overwrites the work
        u_x = found.u_x[WEIGHT]
        u_x[:] = 0.0
        _pulls(limbs, 1.0, room, u_x, found.tightness)


@compiled(borrows=True)
def _turn(
    limbs: Limbs, row: int, regular: bool, room: Room, found: Carried, torque: Array
) -> None:
    """Torques (m,) of a row of the work, dU/dq; NaN at a singular pose (not `regular`)."""
    if regular:
        weigh(limbs, found.u_x[row], room)
    else:
        room.weight[:] = np.nan
    copy_into(found.carried[row], room.weight)
    copy_into(torque, found.u_q[row])
    add_by_joints(limbs, room, torque)


@compiled(borrows=True)
def _load(limbs: Limbs, loaded: Index, moving: bool, room: Room, found: Carried) -> None:
    """Compute dU/dg of weight, and of inertia if `moving`, after `_turn` of both."""
    p, count, from_g = limbs.sizes[2], limbs.params.shape[1], limbs.at[F_G]
    found.load[:] = 0.0
    for limb in range(len(limbs.params)):
        for i in range(limbs.rows.shape[1]):
            row = limbs.rows[limb, i]
            inertia = found.carried[INERTIA, row] if moving else 0.0
            weight = found.carried[WEIGHT, row] + inertia
            for j in loaded:
                column = limbs.params[limb, j]
                if column < p:
                    found.load[column] += weight * room.work[limb, from_g + i * count + j]


class Loads(NamedTuple):
    """Loads of a machine at n samples; zeros where not asked for."""

    weight: Array  # (n, m) torque or force of the weight on each joint
    inertia: Array  # (n, m) the same to accelerate the masses
    dimension: Array  # (n, p) dU/dg of weight and inertia
    pull: Array  # (n, R) of the limbs [N]
    pull_home: Array  # (n, R) the same at home [N]
    reaction: Array  # (n, 6) force [N] and moment [N m] on the base
    payload: Array  # (n, 6) the payload's part of `reaction`
    tightness: Array  # (n, R) change of the pulls by one newton of pretension


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
) -> Loads:
    """Compute the loads `asked` for of every sample; see `Mechanism.loads`."""
    n, m, p, r = len(q), limbs.sizes[M], limbs.sizes[2], limbs.sizes[R]
    weight, inertia, load = np.zeros((n, m)), np.zeros((n, m)), np.zeros((n, p))
    pull, home, tightness = np.zeros((n, r)), np.zeros((n, r)), np.zeros((n, r))
    reaction, of_payload = np.zeros((n, 6)), np.zeros((n, 6))
    own, found, last = room(limbs, size), carried(limbs, bearing, size), len(g) - 1
    loaded = np.arange(limbs.params.shape[1])
    for row in range(n):
        if row == 0 or last > 0:
            set_geometry(limbs, g[min(row, last)], own)
            set_masses(limbs, bearing, g[min(row, last)], found)
        bear(
            limbs,
            bearing,
            asked,
            loaded,
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
        pull[row], home[row], tightness[row] = found.pull, found.pull_home, found.tightness
        reaction[row], of_payload[row] = found.reaction, found.payload
    return Loads(weight, inertia, load, pull, home, reaction, of_payload, tightness)


@compiled()
def pulls(limbs: Limbs, size: int, bearing: Bearing, x: Array, g: Array, load: Array) -> Array:
    """Pulls of the limbs that bear dU/dx = load (n, k) at poses x (n, k), (n, R)."""
    n, own, found = len(x), room(limbs, size), carried(limbs, bearing, size)
    every_pull = np.empty((n, limbs.sizes[R]))
    for row in range(n):
        set_sample(limbs, g, row, own)
        place(limbs, found.still, x[row], BESIDE, own)
        _pulls(limbs, bearing.pretension, own, load[row], every_pull[row])
    return every_pull
