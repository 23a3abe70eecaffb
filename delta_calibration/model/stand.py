"""Compiled forward chain: from encoder angles to the pose, effects included.

For one sample, with D the sum of the effects of the drives and S that of the structure's,

    f(q + D(c, x, loads), x, g + S(c, x, loads)) = 0

or, if closures outnumber the coordinates of the pose, where their squares are least: as if all
cables were springs of one stiffness, pulled along the ways on which their lengths are measured.
Loads, and other inputs of an effect from the machine, are those at the pose itself. The pose is
therefore found in rounds (fixed-point iteration), each with the effects at the pose of the round
before. Effects move it by hundredths of what the joints do, so that a few rounds settle it. If
crossing a clearance makes the machine move back across it, neither side is a solution, and the
last one tried is taken; `State.swing` is how far the last round moved the pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.chain_constants import (
    ACCELERATION,
    ASIDE,
    CARRIED,
    CENTRE,
    GEOMETRY,
    GRAVITY,
    INERTIA,
    JOINT,
    LEADS_ON,
    LEFT,
    LOAD,
    OF_CARRIED,
    OF_INERTIA,
    OF_PULLS,
    OF_REACTION,
    OF_TIGHTNESS,
    OF_WEIGHT,
    PAYLOAD,
    POSE,
    PULL,
    PULL_HOME,
    RATE,
    REACTION,
    ROUNDS,
    SAME_POSE,
    SETTLED_POSE,
    TIGHTNESS,
)
from delta_calibration.model.jit import call, compiled, record
from delta_calibration.model.kernels import (
    BESIDE,
    FULL,
    SETUP,
    SHARED,
    K,
    Limbs,
    M,
    P,
    R,
    Room,
    assemble,
    closed,
    copy_into,
    fill,
    follow,
    nearer,
    own_joint,
    place,
    room,
    same,
    set_geometry,
    spread_joints,
)
from delta_calibration.model.loads import Bearing, Carried, bear, carried, set_masses
from delta_calibration.model.terms import Table, add_shift, takes

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@record
class Opening(NamedTuple):
    """Law of a pose near the wanted assembly mode: stages, places of q, g, c, f and its size.

    `law` is empty where a mechanism has none.
    """

    law: Index
    at: Index
    joints: Index
    dims: Index
    constants: Array


@record
class Body(NamedTuple):
    """Data of a mechanism that the chain needs."""

    limbs: Limbs
    size: int  # of a limb's workspace
    bearing: Bearing
    opening: Opening
    home: Array  # (m,) joints of `bearing.home`
    stages: int  # number of stages from home if there is no opening


@record
class Stages(NamedTuple):
    """Effects of drives, structure, base and reflector, and what they need."""

    drive: Table
    structure: Table
    base: Table
    reflector: Table
    asked: int  # flags of the loads that they need
    loaded: Index  # parameters of a limb whose dU/dg is needed
    stands: bool  # whether they need the pose
    gentle: bool  # whether those that need it change little with it, so that rounds settle
    at: Index  # places of signals, see chain_constants.py


@record
class Kept(NamedTuple):
    """Copies of the laws' workspaces at the identified dimensions, to restore them."""

    work: Array  # (L, s) of the limbs
    opening: Array


@record
class State(NamedTuple):
    """Scratch of one sample, and its joints, dimensions and last round of effects."""

    room: Room
    carried: Carried
    opening: Array
    drive: Array  # workspaces of the terms
    structure: Array
    base: Array
    reflector: Array
    joint: Array  # (m,) behind the drives
    aside: Array  # (m,) the same a little aside of the pose
    derived_at: Array  # (k,) pose of `Room.by_drives`; NaN: none yet
    leads: Array  # (1,) 1 if `Room.by_drives` is not zero, else 0
    kept: Kept
    geometry: Array  # (p,) dimensions under the sample's conditions
    shaped: Array  # (p,) dimensions that it is to have
    before: Array  # (k,) pose before the last round
    swing: Array  # (1,) [m, rad] by which the last round of effects moved the pose
    rounds: Array  # (1,) number of rounds of effects


@compiled()
def state_of(body: Body, stages: Stages) -> State:
    """Allocate scratch for one sample after another."""
    limbs = body.limbs
    own = np.zeros(body.opening.at[4] if len(body.opening.law) else 1)
    if len(body.opening.law):
        for i in range(len(body.opening.constants)):
            own[body.opening.at[2] + i] = body.opening.constants[i]
    return State(
        room(limbs, body.size),
        carried(limbs, body.bearing, body.size),
        own,
        stages.drive.work.copy(),
        stages.structure.work.copy(),
        stages.base.work.copy(),
        stages.reflector.work.copy(),
        np.zeros(limbs.sizes[M]),
        np.zeros(limbs.sizes[M]),
        np.full(limbs.sizes[K], np.nan),
        np.zeros(1),
        Kept(np.zeros((len(limbs.joints), body.size)), np.zeros(len(own))),
        np.zeros(limbs.sizes[P]),
        np.zeros(limbs.sizes[P]),
        np.zeros(limbs.sizes[K]),
        np.zeros(1),
        np.zeros(1),
    )


@compiled(borrows=True)
def take_dimensions(body: Body, g: Array, state: State) -> None:
    """Set the identified dimensions (p,), and keep copies for `back_to`."""
    copy_into(state.geometry, g)
    take_shape(body, state)
    for limb in range(len(state.kept.work)):
        copy_into(state.kept.work[limb], state.room.work[limb])
    copy_into(state.kept.opening, state.opening)


@compiled(borrows=True)
def back_to(body: Body, g: Array, state: State) -> None:
    """Restore the dimensions (p,) that `take_dimensions` has set last."""
    if same(g, state.geometry):
        return
    copy_into(state.geometry, g)
    for limb in range(len(state.kept.work)):
        copy_into(state.room.work[limb], state.kept.work[limb])
    state.room.stage[0] = state.room.stage[1] = 0.0
    copy_into(state.opening, state.kept.opening)
    set_masses(body.limbs, body.bearing, g, state.carried)


@compiled(borrows=True)
def reshape(body: Body, g: Array, state: State) -> None:
    """Set other dimensions (p,) for a while, if they differ from the present ones."""
    if same(g, state.geometry):
        return
    copy_into(state.geometry, g)
    take_shape(body, state)


@compiled(borrows=True)
def take_shape(body: Body, state: State) -> None:
    """Pass the dimensions in the state to all laws."""
    set_geometry(body.limbs, state.geometry, state.room)
    set_masses(body.limbs, body.bearing, state.geometry, state.carried)
    opening, own, p = body.opening, state.opening, body.limbs.sizes[P]
    if not len(opening.law):
        return
    for i in range(len(opening.dims)):
        row = opening.dims[i]
        value = state.geometry[row] if row < p else body.limbs.fixed[row - p]
        own[opening.at[1] + i] = value
    call(opening.law[SETUP], own)


@compiled(borrows=True)
def open_near(body: Body, q: Array, x: Array, state: State) -> None:
    """Set x to a pose near the wanted one at joints q, by the mechanism's opening law."""
    opening, own = body.opening, state.opening
    for i in range(len(opening.joints)):
        joint = opening.joints[i]
        own[opening.at[0] + i] = own_joint(body.limbs, joint, q[joint])
    call(opening.law[SHARED], own)
    call(opening.law[FULL], own)
    for i in range(len(x)):
        x[i] = own[opening.at[3] + i]


@compiled(borrows=True, shared=True)
def opened(body: Body, q: Array, x: Array, stray: float, state: State) -> bool:
    """Solve the forward kinematics x at joints q from its start: opening law, or home."""
    if len(body.opening.law):
        open_near(body, q, x, state)
        return assemble(body.limbs, q, x, stray, state.room)
    copy_into(x, body.bearing.home)
    return follow(body.limbs, body.home, q, x, body.stages, stray, state.room)


@compiled(borrows=True, shared=True)
def opens_on(body: Body, q: Array, x: Array, stray: float, state: State) -> bool:
    """Close a nearby pose x (k,) at joints q; True if it is in the assembly mode of home.

    If the first Newton step from the opening's pose nearly reaches it, convergence is quadratic,
    and the other steps need not be made. `state.before` is overwritten.
    """
    found = state.before
    if not nearer(body.limbs, q, x, state.room) <= SAME_POSE:
        return False
    if not closed(body.limbs, state.room, 1.0, stray):
        return False
    if len(body.opening.law):
        open_near(body, q, found, state)
        far = apart(found, x)
        if far <= SAME_POSE:
            return True
        nearer(body.limbs, q, found, state.room)
        if apart(found, x) <= max(LEADS_ON * far, SAME_POSE):
            return True
    return opened(body, q, found, stray, state) and apart(found, x) <= SAME_POSE


@compiled(borrows=True)
def apart(x: Array, other: Array) -> float:
    """Largest difference of two poses' coordinates; infinite if one is not finite."""
    most = 0.0
    for i in range(len(x)):
        most = max(most, abs(x[i] - other[i]))
        if not abs(x[i] - other[i]) < np.inf:
            return np.inf
    return most


@compiled(borrows=True)
def add_signals(body: Body, stages: Stages, signals: Array, x: Array, state: State) -> None:
    """Fill in a sample's signals that depend on the machine: pose, dimensions, loads."""
    at = stages.at
    copy_into(signals[at[POSE] : at[POSE] + len(x)], x)
    copy_into(signals[at[GEOMETRY] : at[GEOMETRY] + len(state.geometry)], state.geometry)
    if stages.asked == 0:
        return
    m, found = len(state.joint), state.carried
    bear(
        body.limbs,
        body.bearing,
        stages.asked,
        stages.loaded,
        state.joint,
        x,
        signals[at[RATE] : at[RATE] + m],
        signals[at[ACCELERATION] : at[ACCELERATION] + m],
        signals[at[PAYLOAD]],
        signals[at[CENTRE] : at[CENTRE] + 3],
        state.room,
        found,
    )
    if stages.asked & OF_WEIGHT:
        copy_into(signals[at[GRAVITY] : at[GRAVITY] + len(found.gravity)], found.gravity)
        copy_into(signals[at[LOAD] : at[LOAD] + len(found.load)], found.load)
    if stages.asked & OF_INERTIA:
        copy_into(signals[at[INERTIA] : at[INERTIA] + len(found.inertia)], found.inertia)
    if stages.asked & OF_REACTION:
        copy_into(signals[at[REACTION] : at[REACTION] + 6], found.reaction)
    if stages.asked & OF_CARRIED:
        copy_into(signals[at[CARRIED] : at[CARRIED] + 6], found.payload)
    if stages.asked & OF_PULLS:
        copy_into(signals[at[PULL] : at[PULL] + len(found.pull)], found.pull)
        copy_into(signals[at[PULL_HOME] : at[PULL_HOME] + len(found.pull_home)], found.pull_home)
    if stages.asked & OF_TIGHTNESS:
        copy_into(signals[at[TIGHTNESS] : at[TIGHTNESS] + len(found.tightness)], found.tightness)


@compiled(borrows=True)
def shift(
    body: Body, stages: Stages, signals: Array, g: Array, values: Array, state: State
) -> None:
    """Compute joints behind the drives, and dimensions, under a sample's conditions."""
    for i in range(len(state.joint)):
        state.joint[i] = signals[stages.at[JOINT] + i]
    add_shift(stages.drive, signals, values, state.drive, state.joint)
    shift_dimensions(body, stages, signals, g, values, state)


@compiled(borrows=True)
def shift_dimensions(
    body: Body, stages: Stages, signals: Array, g: Array, values: Array, state: State
) -> None:
    """Compute dimensions under a sample's conditions."""
    if len(stages.structure.law):
        copy_into(state.shaped, g)
        add_shift(stages.structure, signals, values, state.structure, state.shaped)
        reshape(body, state.shaped, state)


@compiled(borrows=True, shared=True)
def begin_at(
    body: Body, stages: Stages, signals: Array, g: Array, stray: float, x: Array, state: State
) -> bool:
    """Solve the pose x (k,) at a sample's joint readings, as if there were no effects."""
    _take_readings(body, stages, signals, g, state)
    return opened(body, state.joint, x, stray, state)


@compiled(borrows=True, shared=True)
def begin_near_by(
    body: Body, stages: Stages, signals: Array, g: Array, stray: float, x: Array, state: State
) -> bool:
    """Set x (k,) near the pose of `begin_at`, as a start of Newton steps in the pose."""
    _take_readings(body, stages, signals, g, state)
    return opened_near(body, state.joint, x, stray, state)


@compiled(borrows=True)
def opened_near(body: Body, q: Array, x: Array, stray: float, state: State) -> bool:
    """Set x to a pose from which Newton steps lead to that of joints q."""
    if not len(body.opening.law):
        return opened(body, q, x, stray, state)
    open_near(body, q, x, state)
    return True


@compiled(borrows=True)
def _take_readings(body: Body, stages: Stages, signals: Array, g: Array, state: State) -> None:
    if len(stages.structure.law):
        back_to(body, g, state)
    fill(state.room.by_drives, 0.0)
    state.leads[0] = 0.0
    for i in range(len(state.derived_at)):
        state.derived_at[i] = np.nan
    copy_into(state.joint, signals[stages.at[JOINT] : stages.at[JOINT] + len(state.joint)])


@compiled(borrows=True, shared=True)
def take_effects(
    body: Body, stages: Stages, signals: Array, g: Array, values: Array, x: Array, state: State
) -> None:
    """Set joints and dimensions by the effects at the pose x (k,), kept in `before`."""
    copy_into(state.before, x)
    add_signals(body, stages, signals, x, state)
    shift(body, stages, signals, g, values, state)
    if body.limbs.sizes[R] == body.limbs.sizes[K] or apart(x, state.derived_at) <= SAME_POSE:
        return
    if takes(stages.drive, stages.at[POSE], len(x)):
        derive_drives(body, stages, signals, values, x, state)


@compiled(borrows=True, shared=True)
def derive_drives(
    body: Body, stages: Stages, signals: Array, values: Array, x: Array, state: State
) -> None:
    """Compute how the closures change with the pose because the effects of the drives do.

    From differences of the effects at constant loads, which hardly change with the pose. It is
    kept until the pose x (k,) is another: its rounding would keep rounds from settling. The
    workspaces of the effects are left at the pose.
    """
    limbs, own, aside = body.limbs, state.room, state.aside
    copy_into(state.derived_at, x)
    place(limbs, state.joint, x, BESIDE, own)
    spread_joints(limbs, own)
    first, state.leads[0] = stages.at[POSE], 0.0
    for i in range(len(x)):
        signals[first + i] = x[i] + ASIDE
        copy_into(aside, signals[stages.at[JOINT] : stages.at[JOINT] + len(aside)])
        add_shift(stages.drive, signals, values, state.drive, aside)
        signals[first + i] = x[i]
        for row in range(len(own.by_drives)):
            total = 0.0
            for j in range(len(aside)):
                total += own.by_q[row, j] * (aside[j] - state.joint[j]) / ASIDE
            own.by_drives[row, i] = total
            if total != 0.0:
                state.leads[0] = 1.0
    copy_into(aside, state.joint)
    add_shift(stages.drive, signals, values, state.drive, aside)


@compiled(borrows=True, shared=True)
def next_round(
    body: Body,
    stages: Stages,
    signals: Array,
    g: Array,
    values: Array,
    stray: float,
    x: Array,
    state: State,
) -> bool:
    """Solve the pose x (k,) again, with the effects at the present one; see `stand`.

    By one step where the closures' derivative includes the effects: more would not be closer.
    """
    take_effects(body, stages, signals, g, values, x, state)
    if state.leads[0] == 0.0:
        good = assemble(body.limbs, state.joint, x, stray, state.room)
        state.swing[0] = apart(x, state.before)
        return good
    state.swing[0] = nearer(body.limbs, state.joint, x, state.room)
    if state.swing[0] < np.inf and closed(body.limbs, state.room, 0.0, stray):
        return True
    for i in range(len(x)):
        x[i] = np.nan
    return False


@compiled(borrows=True, shared=True)
def step_on(
    body: Body, stages: Stages, signals: Array, g: Array, values: Array, x: Array, state: State
) -> bool:
    """Do `next_round` by one Newton step only; the error left is of the order of its square."""
    take_effects(body, stages, signals, g, values, x, state)
    state.swing[0] = nearer(body.limbs, state.joint, x, state.room)
    return bool(state.swing[0] < np.inf)


@compiled(borrows=True, shared=True)
def stand(
    body: Body,
    stages: Stages,
    signals: Array,
    g: Array,
    values: Array,
    near: bool,
    stray: float,
    x: Array,
    state: State,
) -> bool:
    """Solve the pose x (k,) of the machine under a sample's signals, with all effects.

    Args:
        body: the mechanism; `state` has its dimensions g.
        stages: the effects.
        signals: of the sample; those that depend on the machine are filled in.
        g: dimensions as identified, (p,).
        values: of the effects' parameters.
        near: whether x is a pose nearby; else the pose is solved from the beginning.
        stray: largest closure that counts as closed.
        x: the pose; NaN where there is none.
        state: scratch; joints and dimensions are written there.
    """
    state.swing[0] = 0.0
    if not stages.stands:
        shift(body, stages, signals, g, values, state)
        if near:
            return assemble(body.limbs, state.joint, x, stray, state.room)
        return opened(body, state.joint, x, stray, state)
    if near:
        _take_readings(body, stages, signals, g, state)
    elif not begin_at(body, stages, signals, g, stray, x, state):
        return False
    before = swing = 0.0
    for number in range(ROUNDS):
        state.rounds[0] = number + 1
        if not next_round(body, stages, signals, g, values, stray, x, state):
            return False
        swing = state.swing[0]
        share = swing / before if stages.gentle and swing < before else 1.0
        if swing <= SETTLED_POSE or share * swing <= LEFT:
            break
        before = swing
    if state.leads[0] == 0.0 or swing <= SAME_POSE:
        return True
    for i in range(len(x)):
        x[i] = np.nan
    return False
