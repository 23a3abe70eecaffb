"""Loops over samples for any mechanism: its limbs' law is called by its address.

A mechanism consists of limbs that share one law; each limb has some rows of the closure, some
joints and some dimensions. `Limbs` holds what the loops need of it (see `mechanisms/base.py`):

    law (4,)         addresses: setup, shared, near, full (law.py)
    at (10,)         places in a limb's workspace: q, x, g, c, f, f_x, f_q, f_g, shared from, to
    joints (L, mj)   which joints a limb has
    params (L, pl)   which of the p dimensions, or of the fixed numbers behind them
    rows (L, r)      which rows of the closure
    consts (L, nc)   its own constants
    fixed (c,)       dimensions of the drawing that are no parameters
    sizes (5,)       joints m, pose k, dimensions p, closures R, commanded coordinates t
    most (R,)        largest closure that counts as closed
    sense, zero (m,) of the drives' readings, see mechanisms/drives.py: a law uses the mechanism's
                     own joints, everything else the readings

Everything is per sample, in scratch arrays that a call makes once; a sample without a solution
becomes NaN. Dimensions are (1, p) for all samples or (n, p).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.chain_constants import (
    LEFT,
    ON_THE_WAY,
    SETTLED_STEP,
    SIDES,
    SMALL_STEP,
    STEPS,
)
from delta_calibration.model.elimination import (
    across,
    down,
    down_half,
    halved,
    least_step,
    normal_step,
    solve,
    solve_definite,
    squares,
    triangles,
)
from delta_calibration.model.jit import call, compiled, record

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_DAMPED_STEPS = 200


@record
class Limbs(NamedTuple):
    """A mechanism's law, and the joints, dimensions and closures of each limb; see above."""

    law: Index
    at: Index
    joints: Index
    params: Index
    rows: Index
    consts: Array
    fixed: Array
    sizes: Index
    most: Array
    sense: Array
    zero: Array


@record
class Room(NamedTuple):
    """Scratch of one mechanism, used again for all samples of a call."""

    work: Array  # (L, s) workspaces of the limbs
    f: Array  # (R,)
    by_x: Array  # (R, k)
    by_drives: Array  # (R, k) by the pose, through the effects of the drives; see `add_by_drives`
    by_q: Array  # (R, m)
    by_g: Array  # (R, p)
    system: Array  # (max, max + sides)
    factor: Array  # (k, k + 2) factors of f_x, its row exchanges, one over its diagonal
    weight: Array  # (R,) of the closures
    step: Array  # of the unknowns, or a weight for each output
    way: Array  # (m,) joints of a stage on the way
    past: Array  # (k,) pose of the stage before, on the way
    stage: Array  # (2,) last stage evaluated, or 0; 1 if `factor` is of the same place, else 0


Q, X, G, C, F, F_X, F_Q, F_G, FROM, TO = range(10)
SETUP, SHARED, NEAR, FULL = range(4)
BESIDE = NEAR  # the stage where derivatives by the joints are needed, besides those by the pose
M, K, P, R, T = range(5)


@compiled()
def room(limbs: Limbs, size: int) -> Room:
    """Allocate scratch; `size` is that of a limb's workspace."""
    m, k, p, r = limbs.sizes[M], limbs.sizes[K], limbs.sizes[P], limbs.sizes[R]
    wide = max(k, max(r, m + k))
    work = np.zeros((len(limbs.joints), size))
    for limb in range(len(work)):
        for i in range(limbs.consts.shape[1]):
            work[limb, limbs.at[C] + i] = limbs.consts[limb, i]
    work[0, limbs.at[X]] = np.nan  # at no pose yet
    return Room(
        work,
        np.zeros(r),
        np.zeros((r, k)),
        np.zeros((r, k)),
        np.zeros((r, m)),
        np.zeros((r, p)),
        np.zeros((wide, wide + max(m, max(k, SIDES)))),
        np.zeros((k, k + 2)),
        np.zeros(r),
        np.zeros(max(wide, SIDES)),
        np.zeros(m),
        np.zeros(k),
        np.zeros(2),
    )


@compiled(borrows=True)
def fill(values: Array, value: float) -> None:
    """Set all elements of a two-dimensional array to a value."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] = value


@compiled(borrows=True)
def copy_into(values: Array, source: Array) -> None:
    """Copy a vector into another."""
    for i in range(len(values)):
        values[i] = source[i]


@compiled(borrows=True)
def same(values: Array, others: Array) -> bool:
    """Whether two vectors are equal, number by number."""
    for i in range(len(values)):  # noqa: SIM110 - nothing is made for it
        if values[i] != others[i]:
            return False
    return True


@compiled(borrows=True)
def set_geometry(limbs: Limbs, g: Array, room: Room) -> None:
    """Set the dimensions (p,) of the limbs."""
    p = limbs.sizes[P]
    room.stage[0] = room.stage[1] = 0.0
    for limb in range(len(limbs.params)):
        work = room.work[limb]
        for i in range(limbs.params.shape[1]):
            row = limbs.params[limb, i]
            work[limbs.at[G] + i] = g[row] if row < p else limbs.fixed[row - p]
        call(limbs.law[SETUP], work)


@compiled(borrows=True)
def set_sample(limbs: Limbs, g: Array, row: int, room: Room) -> None:
    """Set the dimensions of one sample after another, of (n, p) or of (1, p) for all samples."""
    if row == 0 or len(g) > 1:
        set_geometry(limbs, g[min(row, len(g) - 1)], room)


@compiled(borrows=True)
def own_joint(limbs: Limbs, joint: int, reading: float) -> float:
    """Convert the reading of a drive to the mechanism's own joint."""
    return float(limbs.sense[joint] * (reading - limbs.zero[joint]))


@compiled(borrows=True, shared=True)
def place(limbs: Limbs, q: Array, x: Array, stage: int, room: Room) -> None:
    """Evaluate the closures at joints q (m,) and pose x (k,), at stage `NEAR` or `FULL`.

    If the limbs are at this place already, nothing is evaluated again.
    """
    if room.stage[0] < stage or not _placed(limbs, q, x, room.work):
        _place_limbs(limbs, q, x, stage, room.work)
        room.stage[0], room.stage[1] = stage, 0.0
    _gather(limbs, room.work, room.f, room.by_x)


@compiled(borrows=True)
def place_in(
    limbs: Limbs, q: Array, x: Array, stage: int, every: Array, f: Array, by_x: Array
) -> None:
    """Evaluate as `place`, in other workspaces (L, s) that have the dimensions."""
    _place_limbs(limbs, q, x, stage, every)
    _gather(limbs, every, f, by_x)


@compiled(borrows=True)
def _placed(limbs: Limbs, q: Array, x: Array, every: Array) -> bool:
    """Whether the workspaces (L, s) are at these joints (m,) and this pose (k,)."""
    to_q, to_x = limbs.at[Q], limbs.at[X]
    if not same(every[0][to_x : to_x + len(x)], x):
        return False
    for limb in range(len(limbs.joints)):
        for i in range(limbs.joints.shape[1]):
            joint = limbs.joints[limb, i]
            if every[limb, to_q + i] != own_joint(limbs, joint, q[joint]):
                return False
    return True


@compiled(borrows=True)
def _place_limbs(limbs: Limbs, q: Array, x: Array, stage: int, every: Array) -> None:
    """Evaluate the law of all limbs; what depends on the pose alone is kept while that stays."""
    at, law, joints = limbs.at, limbs.law, limbs.joints
    to_q, to_x, k = at[Q], at[X], len(x)
    known = same(every[0][to_x : to_x + k], x)
    for limb in range(len(joints)):
        work = every[limb]
        for i in range(joints.shape[1]):
            joint = joints[limb, i]
            work[to_q + i] = own_joint(limbs, joint, q[joint])
        if not known:
            copy_into(work[to_x : to_x + k], x)
            if limb == 0:
                call(law[SHARED], work)
            else:
                copy_into(work[at[FROM] : at[TO]], every[0][at[FROM] : at[TO]])
        call(law[stage], work)


@compiled(borrows=True)
def _gather(limbs: Limbs, every: Array, f: Array, by_x: Array) -> None:
    """Copy closures (R,) and their derivatives by the pose (R, k) from the workspaces (L, s)."""
    rows, from_f, from_x, k = limbs.rows, limbs.at[F], limbs.at[F_X], by_x.shape[1]
    for limb in range(len(rows)):
        work = every[limb]
        for i in range(rows.shape[1]):
            row, first = rows[limb, i], from_x + i * k
            f[row] = work[from_f + i]
            slope = by_x[row]
            for j in range(k):
                slope[j] = work[first + j]


@compiled(borrows=True)
def add_by_drives(limbs: Limbs, room: Room) -> None:
    """Add to f_x, after `place`, what the effects of the drives change as the pose does.

    The pose is where the closures' squares are least: if they outnumber the coordinates it depends
    on the whole derivative. A cable pulls along its way from the pulley, not from the anchor.
    Where the closures vanish, no part of it is needed.
    """
    r, k = limbs.sizes[R], limbs.sizes[K]
    if r == k:
        return
    for row in range(r):
        for i in range(k):
            room.by_x[row, i] += room.by_drives[row, i]


@compiled(borrows=True)
def spread_joints(limbs: Limbs, room: Room) -> None:
    """Put the limbs' derivatives by their joints into their places in `by_q`."""
    count = limbs.joints.shape[1]
    for limb in range(len(limbs.joints)):
        for i in range(limbs.rows.shape[1]):
            for j in range(count):
                joint = limbs.joints[limb, j]
                slope = limbs.sense[joint] * room.work[limb, limbs.at[F_Q] + i * count + j]
                room.by_q[limbs.rows[limb, i], joint] = slope


@compiled(borrows=True)
def spread_geometry(limbs: Limbs, room: Room) -> None:
    """Put the limbs' derivatives by their dimensions into their places in `by_g`."""
    count = limbs.params.shape[1]
    for limb in range(len(limbs.params)):
        for i in range(limbs.rows.shape[1]):
            for j in range(count):
                if limbs.params[limb, j] < limbs.sizes[P]:
                    slope = room.work[limb, limbs.at[F_G] + i * count + j]
                    room.by_g[limbs.rows[limb, i], limbs.params[limb, j]] = slope


@compiled(borrows=True)
def towards(room: Room, r: int, k: int) -> bool:
    """Compute Newton's step in the pose, f_x^+ f, into `step`; False if f_x is singular."""
    if r == k:
        return least_step(room.by_x, room.f, 0.0, room.system, room.step)
    return normal_step(room.by_x, room.f, room.system, room.step)


@compiled(borrows=True)
def factored(limbs: Limbs, room: Room) -> bool:
    """Factorise f_x where the limbs are placed, for any number of `along` and `weigh`.

    Factorises f_x^T f_x if closures outnumber coordinates; False if it is singular.
    """
    r, k = limbs.sizes[R], limbs.sizes[K]
    if room.stage[1] > 0.0:
        return True
    if r == k:
        for i in range(k):
            for j in range(k):
                room.factor[i, j] = room.by_x[i, j]
        good = triangles(room.factor, k)
    else:
        squares(room.by_x, room.factor)
        good = halved(room.factor, k)
    room.stage[1] = 1.0 if good else 0.0
    return good


@compiled(borrows=True)
def along(limbs: Limbs, joints: Array, room: Room) -> None:
    """f_x^+ (f + f_q joints), into `step`: Newton's step in the pose while joints (m,) move.

    After `factored`, with the limbs placed `BESIDE`, so that they have their derivatives by the
    joints. `f` may be another rate of the closures by then; it is overwritten.
    """
    count, from_q, f = limbs.joints.shape[1], limbs.at[F_Q], room.f
    for limb in range(len(limbs.joints)):
        work = room.work[limb]
        for i in range(limbs.rows.shape[1]):
            row = limbs.rows[limb, i]
            for j in range(count):
                joint = limbs.joints[limb, j]
                f[row] += limbs.sense[joint] * work[from_q + i * count + j] * joints[joint]
    closing(limbs, room)


@compiled(borrows=True)
def closing(limbs: Limbs, room: Room) -> None:
    """f_x^+ f, into `step`, after `factored`."""
    r, k, step = limbs.sizes[R], limbs.sizes[K], room.step
    if r == k:
        for i in range(k):
            step[i] = room.f[i]
        down(room.factor, k, step)
        return
    for i in range(k):
        step[i] = 0.0
    for row in range(r):
        for i in range(k):
            step[i] += room.by_x[row, i] * room.f[row]
    down_half(room.factor, k, step)


@compiled(borrows=True)
def weigh(limbs: Limbs, by_pose: Array, room: Room) -> None:
    """Write -by_pose f_x^+ of a quantity with derivative `by_pose` (k,) into `weight` (R,).

    weight f_q and weight f_g are its derivatives by joints and dimensions. After `factored`;
    `step` is overwritten.
    """
    r, k, weight, step = limbs.sizes[R], limbs.sizes[K], room.weight, room.step
    for i in range(k):
        step[i] = -by_pose[i]
    if r == k:
        across(room.factor, k, step)
        for i in range(k):
            weight[i] = step[i]
        return
    down_half(room.factor, k, step)
    for row in range(r):
        weight[row] = 0.0
        for i in range(k):
            weight[row] += room.by_x[row, i] * step[i]


@compiled(borrows=True)
def add_by_joints(limbs: Limbs, room: Room, by_q: Array) -> None:
    """Add the derivative by the joints, weight f_q, to (m,); placed `BESIDE` or `FULL`."""
    count, from_q = limbs.joints.shape[1], limbs.at[F_Q]
    for limb in range(len(limbs.joints)):
        work = room.work[limb]
        for i in range(limbs.rows.shape[1]):
            weight = room.weight[limbs.rows[limb, i]]
            for j in range(count):
                joint = limbs.joints[limb, j]
                by_q[joint] += weight * (limbs.sense[joint] * work[from_q + i * count + j])


@compiled(borrows=True)
def closed(limbs: Limbs, room: Room, share: float, stray: float) -> bool:
    """Whether the limbs close at the pose: no further step is needed, and no limb is torn open.

    Called after `towards` near the pose; `share` is the share of the error that its step leaves.
    """
    r, k = limbs.sizes[R], limbs.sizes[K]
    for row in range(r):
        missed = 0.0
        if r == k:
            missed = room.f[row]
        else:
            for j in range(k):
                missed += room.by_x[row, j] * room.step[j]
        if not abs(share * missed) < stray or not abs(room.f[row]) <= limbs.most[row]:
            return False
    return True


@compiled(borrows=True, shared=True)
def assemble(limbs: Limbs, q: Array, x: Array, stray: float, room: Room) -> bool:
    """Solve the pose x (k,) at joints q (m,), starting at x; NaN and False if there is none.

    The share of a step that remains is estimated from the step before: the square of their ratio
    for Newton steps, which converge quadratically, the ratio itself for Gauss-Newton steps. The
    last step is the one after which the remaining error is negligible.
    """
    r, k = limbs.sizes[R], limbs.sizes[K]
    good, before = False, 0.0
    for _ in range(STEPS):
        good = False
        most = nearer(limbs, q, x, room)
        if not most < np.inf:
            break
        share = 1.0
        if most < min(before, SMALL_STEP):
            share = most / before
            share *= share if r == k else 1.0
        good, before = closed(limbs, room, share, stray), most
        if most <= SETTLED_STEP or share * most <= LEFT:
            break
    if good:
        return True
    for i in range(k):
        x[i] = np.nan
    return False


@compiled(borrows=True)
def nearer(limbs: Limbs, q: Array, x: Array, room: Room) -> float:
    """Take one Newton step of the pose x (k,) at joints q (m,); returns its size, or NaN."""
    place(limbs, q, x, NEAR, room)
    add_by_drives(limbs, room)
    if not towards(room, limbs.sizes[R], limbs.sizes[K]):
        return np.nan
    most = 0.0
    for i in range(len(x)):
        most += abs(room.step[i])  # NaN if any of them is
        x[i] -= room.step[i]
    return most


@compiled(borrows=True)
def lead(limbs: Limbs, q: Array, x: Array, way: float, room: Room) -> bool:
    """Solve the pose x (k,) at joints q (m,) roughly, as an intermediate stage of `follow`.

    Ends when a step is small compared with the way of the stage before, or with its largest step.
    """
    for _ in range(STEPS):
        most = nearer(limbs, q, x, room)
        if not most < np.inf:
            return False
        way = max(way, most)
        if most <= max(ON_THE_WAY * way, SETTLED_STEP):  # `way` is 0 at a solved pose
            return True
    return False


@compiled(borrows=True, shared=True)
def follow(
    limbs: Limbs, home: Array, q: Array, x: Array, stages: int, stray: float, room: Room
) -> bool:
    """Solve the pose x at joints q (m,) in stages from joints home (m,), where x is the pose.

    So the assembly mode is that of home. Each stage starts at an extrapolation of the one before.
    """
    m, way, past = limbs.sizes[M], room.way, room.past
    copy_into(past, x)
    for stage in range(1, stages + 1):
        last = stage == stages
        for i in range(m):
            way[i] = q[i] if last else home[i] + (q[i] - home[i]) * stage / stages
        length = 0.0
        for i in range(len(x)):
            moved_by = x[i] - past[i]
            past[i] = x[i]
            x[i] += moved_by
            length += abs(moved_by)
        if last:
            return assemble(limbs, way, x, stray, room)
        if not lead(limbs, way, x, length, room):
            break
    for i in range(len(x)):
        x[i] = np.nan
    return False


@compiled(borrows=True)
def back(limbs: Limbs, by_pose: Array, room: Room) -> bool:
    """Solve f_x^T y = by_pose[i], for each row of `by_pose` (c, k), into `system[:k, k + i]`.

    If closures outnumber coordinates, f_x^T f_x y = by_pose[i] instead. False if singular.
    """
    r, k, count = limbs.sizes[R], limbs.sizes[K], len(by_pose)
    system, by_x = room.system, room.by_x
    if r != k:
        squares(by_x, system)
    for i in range(k):
        if r == k:
            for j in range(k):
                system[i, j] = by_x[j, i]
        for side in range(count):
            system[i, k + side] = by_pose[side, i]
    if r != k:
        return solve_definite(system, k, count)
    return solve(system, k, count)


@compiled(borrows=True, shared=True)
def moved(limbs: Limbs, by_pose: Array, room: Room, by_q: Array, by_g: Array) -> None:
    """Derivatives by joints (c, m) and dimensions (c, p) of quantities with `by_pose` (c, k).

    By the implicit function theorem, where the limbs were placed with `FULL`, or with `BESIDE` if
    `by_g` has no columns. Columns of `by_g` behind those of the dimensions become zero.
    """
    r, k, p, count = limbs.sizes[R], limbs.sizes[K], limbs.sizes[P], len(by_pose)
    found = back(limbs, by_pose, room)
    fill(by_q, 0.0 if found else np.nan)
    fill(by_g, 0.0 if found else np.nan)
    if not found:
        return
    joints, params, rows = limbs.joints, limbs.params, limbs.rows
    own, from_q, from_g = joints.shape[1], limbs.at[F_Q], limbs.at[F_G]
    each = params.shape[1] if by_g.shape[1] > 0 else 0
    every, by_x, system, weight = room.work, room.by_x, room.system, room.step
    for limb in range(len(joints)):
        work = every[limb]
        for i in range(rows.shape[1]):
            row = rows[limb, i]
            for side in range(count):
                total = 0.0
                if r == k:
                    total = -system[row, k + side]
                else:
                    for j in range(k):
                        total -= by_x[row, j] * system[j, k + side]
                weight[side] = total
            for j in range(own):
                column = joints[limb, j]
                slope = limbs.sense[column] * work[from_q + i * own + j]
                for side in range(count):
                    by_q[side, column] += weight[side] * slope
            for j in range(each):
                column, slope = params[limb, j], work[from_g + i * each + j]
                if column < p and slope != 0.0:
                    for side in range(count):
                        by_g[side, column] += weight[side] * slope


# --- all samples ---------------------------------------------------------------------------------


@compiled()
def started(
    law: Index, at: Index, size: int, consts: Array, q: Array, g: Array, found: Array
) -> None:
    """Evaluate a law (places of q, g, c and f) at every sample, into `found` (n, outputs)."""
    work, last = np.zeros(size), len(g) - 1
    for i in range(len(consts)):
        work[at[2] + i] = consts[i]
    for row in range(len(q)):
        if row == 0 or last > 0:
            for i in range(g.shape[1]):
                work[at[1] + i] = g[min(row, last), i]
            call(law[SETUP], work)
        for i in range(q.shape[1]):
            work[at[0] + i] = q[row, i]
        call(law[SHARED], work)
        call(law[FULL], work)
        for i in range(found.shape[1]):
            found[row, i] = work[at[3] + i]


@compiled(borrows=True)
def _poses(
    limbs: Limbs, home: Array, stages: int, q: Array, g: Array, x: Array, stray: float, own: Room
) -> None:
    for row in range(len(q)):
        set_sample(limbs, g, row, own)
        follow(limbs, home, q[row], x[row], stages, stray, own)


@compiled()
def poses(
    limbs: Limbs, size: int, home: Array, stages: int, q: Array, g: Array, x: Array, stray: float
) -> None:
    """Solve poses x (n, k) at joints q (n, m), starting at x; NaN rows if there is none.

    With more than one of the `stages`, x starts as the pose at joints `home` (m,): see `follow`.
    """
    _poses(limbs, home, stages, q, g, x, stray, room(limbs, size))


@compiled()
def closures(
    limbs: Limbs, size: int, q: Array, x: Array, g: Array, derivatives: bool
) -> tuple[Array, Array, Array, Array]:
    """f (n, R) and, where asked for, its derivatives by pose, joints and dimensions."""
    n, m, k, p, r = len(q), limbs.sizes[M], limbs.sizes[K], limbs.sizes[P], limbs.sizes[R]
    some = n if derivatives else 0
    f, by_x = np.empty((n, r)), np.empty((n, r, k))
    by_q, by_g = np.zeros((some, r, m)), np.zeros((some, r, p))
    own = room(limbs, size)
    for row in range(n):
        set_sample(limbs, g, row, own)
        place(limbs, q[row], x[row], FULL if derivatives else NEAR, own)
        f[row], by_x[row] = own.f, own.by_x
        if derivatives:
            spread_joints(limbs, own)
            spread_geometry(limbs, own)
            by_q[row], by_g[row] = own.by_q, own.by_g
    return f, by_x, by_q, by_g


@compiled(borrows=True)
def _slopes(
    limbs: Limbs, q: Array, x: Array, g: Array, by_pose: Array, by_q: Array, by_g: Array, own: Room
) -> None:
    for row in range(len(q)):
        set_sample(limbs, g, row, own)
        place(limbs, q[row], x[row], FULL, own)
        moved(limbs, by_pose[row], own, by_q[row], by_g[row])


@compiled()
def slopes(
    limbs: Limbs, size: int, q: Array, x: Array, g: Array, by_pose: Array
) -> tuple[Array, Array]:
    """Derivatives by joints (n, c, m) and dimensions (n, c, p), by `by_pose` (n, c, k)."""
    n, count = len(q), by_pose.shape[1]
    by_q = np.empty((n, count, limbs.sizes[M]))
    by_g = np.empty((n, count, limbs.sizes[P]))
    _slopes(limbs, q, x, g, by_pose, by_q, by_g, room(limbs, size))
    return by_q, by_g


@compiled()
def joints_for(
    limbs: Limbs,
    size: int,
    task: Array,
    g: Array,
    q: Array,
    x: Array,
    stray: float,
    damped: bool,
) -> None:
    """Solve joints q (n, m) at which the first t pose coordinates are `task` (n, t).

    Unknowns are the joints and the coordinates that they do not command, which start at x (n, k);
    NaN rows out of reach. Steps are Newton's, of least length where unknowns outnumber closures;
    `damped` by the squared residual (Sugihara) they stay short far off and near a singularity.
    """
    m, k, r, t = limbs.sizes[M], limbs.sizes[K], limbs.sizes[R], limbs.sizes[T]
    count = m + k - t
    slope = np.zeros((r, count))
    own = room(limbs, size)
    for row in range(len(task)):
        set_sample(limbs, g, row, own)
        for i in range(t):
            x[row, i] = task[row, i]
        good = False
        for _ in range(_DAMPED_STEPS if damped else STEPS):
            place(limbs, q[row], x[row], BESIDE, own)
            spread_joints(limbs, own)
            square, missed = 0.0, 0.0
            for i in range(r):
                square += own.f[i] * own.f[i]
                missed = max(missed, abs(own.f[i]))
                for j in range(m):
                    slope[i, j] = own.by_q[i, j]
                for j in range(k - t):
                    slope[i, m + j] = own.by_x[i, t + j]
            good = square < np.inf and missed < stray  # max() ignores NaN, the sum does not
            if not square < np.inf or (good and damped):
                break
            if not least_step(slope, own.f, square if damped else 0.0, own.system, own.step):
                break
            most = 0.0
            for j in range(m):
                q[row, j] -= own.step[j]
            for j in range(k - t):
                x[row, t + j] -= own.step[m + j]
            for j in range(count):
                most = max(most, abs(own.step[j]))
            if good and most <= SETTLED_STEP:
                break
        if not good:
            q[row] = np.nan
