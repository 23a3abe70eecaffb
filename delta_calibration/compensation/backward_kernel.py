"""Compiled inverse of a machine's chain, from tool place to joint command, for any mechanism.

The target of a nominal command q is the tool place p* of the nominal machine at q; sought is the
command q + dq with

    place(stand(q + dq)) = p*      stand: the whole identified chain, see model/stand.py

Where every joint moves the tool by itself, Newton steps in joints and pose at once find it: the
pose closes as the tool reaches its target. The effects are evaluated again between two steps, at
the command and the pose of the last one, so loads are evaluated two or three times. Where this
does not settle, or a step overshoots, Newton's method on the commands evaluates the whole chain
at every command that it tries. Its Jacobian is that of the mechanism alone; it neglects the
effects, which is an error of some hundredths and costs a step or two.

Where the joints command the whole pose, and this includes rotation or the joints outnumber its
coordinates, the pose is found first; then the joints for it, such that no joint works against
another; then the drive commands for these joints.

The pose of the nominal machine at a command is the start pose of the identified machine, which
differs by millimetres: both are in the same assembly mode.

The backlash of a drive counts as crossed as soon as a command reverses, because the correction
itself takes the joint across it: travel since the reversal is not used here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.chain_constants import (
    AIMED,
    JOINED,
    JOINT,
    LEFT,
    ROUNDS,
    SAME_POSE,
    SETTLED_POSE,
    SMALL_STEP,
)
from delta_calibration.model.elimination import least_step, normal_step
from delta_calibration.model.jit import compiled, record
from delta_calibration.model.kernels import (
    BESIDE,
    NEAR,
    K,
    M,
    R,
    X,
    add_by_joints,
    along,
    closing,
    copy_into,
    factored,
    fill,
    moved,
    nearer,
    place,
    spread_joints,
    weigh,
)
from delta_calibration.model.loads import other_point, point_at
from delta_calibration.model.stand import (
    Body,
    Stages,
    State,
    add_signals,
    apart,
    back_to,
    begin_near_by,
    opened_near,
    opens_on,
    shift,
    shift_dimensions,
    stand,
    state_of,
    step_on,
    take_dimensions,
    take_effects,
)
from delta_calibration.model.terms import add_shift

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@record
class TaskRecord(NamedTuple):
    """Tool coordinates that the joints command, see task_coordinates.py."""

    tool: Array  # (3,) [m] in the platform
    axes: Index  # of x, y, z
    turns: bool
    arm: float  # [m] h of task_coordinates.py: converts a rotation to a length


@record
class MachineRecord(NamedTuple):
    """An identified or a nominal machine, and how its commands are found."""

    body: Body
    stages: Stages
    g: Array  # (p,)
    theta: Array  # parameters, among them the effects' values
    aim: TaskRecord
    by_pose: bool  # whether the pose is found before the joints
    reshaped: bool  # whether dimensions change from command to command
    exact: bool  # whether the mechanism's opening law gives the pose itself
    stray: float  # largest closure residual that counts as closed


@record
class Search(NamedTuple):
    """Limits of Newton's method: for the correction, its error and the number of steps."""

    bound: float  # largest |dq_j|
    tolerance: float  # [m]
    iterations: int
    halvings: int


@record
class Place(NamedTuple):
    """Scratch arrays to evaluate the tool places of one machine."""

    state: State
    place: Array  # (a,)
    slope: Array  # (a, k) d(place)/d(pose)
    by_q: Array  # (a, m) d(place)/dq
    by_g: Array  # (a, 0)
    x: Array  # (k,)
    signals: Array  # (S,)
    offset: Array  # (3,)
    normal: Array
    dq: Array  # (m,)
    step: Array  # Newton step of the joints or of the pose
    there: Array  # (m,)
    stood: Array  # (k,) copy of the pose while it is checked
    near: Array  # (1,) 1 if x is a pose nearby, 0 if the pose has to be found from the beginning
    settled: Array  # (1,) 1 if x is the pose at the command that was found, with all effects


@compiled()
def scratch(machine: MachineRecord, signals: int) -> Place:
    """Allocate scratch arrays for a machine; `signals` is the length of a sample's row."""
    sizes = machine.body.limbs.sizes
    count = len(machine.aim.axes) + (9 if machine.aim.turns else 0)
    wide = max(count, max(sizes[K], sizes[M])) + 1
    made = Place(
        state_of(machine.body, machine.stages),
        np.zeros(count),
        np.zeros((count, sizes[K])),
        np.zeros((count, sizes[M])),
        np.zeros((count, 0)),
        np.zeros(sizes[K]),
        np.zeros(signals),
        np.zeros(3),
        np.zeros((wide, wide + 1)),
        np.zeros(sizes[M]),
        np.zeros(wide + sizes[R]),
        np.zeros(sizes[M]),
        np.zeros(sizes[K]),
        np.zeros(1),
        np.zeros(1),
    )
    take_dimensions(machine.body, machine.g, made.state)
    return made


@compiled(borrows=True)
def place_of(machine: MachineRecord, x: Array, room: Place) -> None:
    """Compute the tool place at pose x (k,) and its derivatives by the pose."""
    bearing, aim, k = machine.body.bearing, machine.aim, len(x)
    point = room.state.carried.point  # shared with the loads: evaluated once for each pose
    point_at(bearing, x, aim.tool, point)
    f, slope = bearing.point_at[2], bearing.point_at[3]
    for row in range(len(aim.axes)):
        axis = aim.axes[row]
        room.place[row] = point[f + axis]
        for j in range(k):
            room.slope[row, j] = point[slope + axis * k + j]
    if not aim.turns:
        return
    for arm in range(3):
        for i in range(3):
            room.offset[i] = aim.tool[i] + (aim.arm if i == arm else 0.0)
        other_point(bearing, room.offset, point)
        for axis in range(3):
            row = 3 + 3 * arm + axis
            room.place[row] = point[f + axis] - room.place[axis]
            for j in range(k):
                room.slope[row, j] = point[slope + axis * k + j] - room.slope[axis, j]


@compiled(borrows=True, shared=True)
def stands(machine: MachineRecord, q: Array, signals: Array, room: Place) -> bool:
    """Solve pose and tool place at a command under a sample's signals; False if there is none.

    Starts from the previous pose if there is one; see `begin`.
    """
    copy_into(room.signals, signals)
    for i in range(len(q)):
        room.signals[machine.stages.at[JOINT] + i] = q[i]
    good = stand(
        machine.body,
        machine.stages,
        room.signals,
        machine.g,
        machine.theta,
        room.near[0] > 0.0,
        machine.stray,
        room.x,
        room.state,
    )
    room.near[0] = 1.0 if good and not machine.exact else 0.0
    if good:
        place_of(machine, room.x, room)
    return good


@compiled(borrows=True)
def begin(machine: MachineRecord, room: Place) -> None:
    """Forget the previous pose, so that the result of a command does not depend on others."""
    room.near[0] = room.settled[0] = 0.0
    loads, first = room.state.carried, machine.body.bearing.point_at[0]
    room.state.room.work[0, machine.body.limbs.at[X]] = np.nan
    loads.point[first] = loads.beside.point[first] = np.nan


@compiled(borrows=True)
def begin_near(drawn: MachineRecord, stood: Place, machine: MachineRecord, room: Place) -> None:
    """Start from the nominal machine's pose, if both machines are the same mechanism.

    A machine with an opening law starts from that law's pose instead: see `begin`.
    """
    begin(machine, room)
    same = drawn.body.limbs.law[NEAR] == machine.body.limbs.law[NEAR]
    if same and len(machine.body.opening.law) == 0:
        copy_into(room.x, stood.x)
        room.near[0] = 1.0


@compiled(borrows=True)
def distance(room: Place, target: Array) -> float:
    """Distance of the place from a target (a,) [m]."""
    square = 0.0
    for i in range(len(target)):
        square += (room.place[i] - target[i]) ** 2
    return float(np.sqrt(square))


@compiled(borrows=True, shared=True)
def reached(machine: MachineRecord, q: Array, signals: Array, target: Array, room: Place) -> float:
    """Distance from the target at a command [m]; infinite if the machine has no pose there."""
    if not stands(machine, q, signals, room):
        return np.inf
    far = distance(room, target)
    return far if far < np.inf else np.inf


@compiled(borrows=True, shared=True)
def verified(
    machine: MachineRecord, q: Array, signals: Array, target: Array, room: Place
) -> float:
    """Distance from the target at a command that `correct` has found, solved again [m].

    Solved from the beginning, in the machine's own assembly mode; infinite if there is no pose.
    If x is already the pose at this command, with all effects, only its assembly mode is checked.
    Effects that are not gentle may lead elsewhere, see `found_anew`; `correct` has checked that.
    """
    state = room.state
    if not machine.stages.gentle:
        if room.settled[0] > 0.0:
            return distance(room, target)
        return found_anew(machine, q, signals, target, room)
    if room.settled[0] > 0.0:
        if not opens_on(machine.body, state.joint, room.x, machine.stray, state):
            return np.inf
        place_of(machine, room.x, room)
        return distance(room, target)
    if len(machine.body.opening.law):
        begin(machine, room)
    return reached(machine, q, signals, target, room)


@compiled(borrows=True, shared=True)
def found_anew(
    machine: MachineRecord, q: Array, signals: Array, target: Array, room: Place
) -> float:
    """Distance from the target at a command, solved again with effects that are not gentle [m].

    If the effects settle in the first round already, a second solution starts slightly aside: the
    first may be an unstable fixed point of the rounds, which is no pose that the machine takes.
    """
    begin(machine, room)
    error = reached(machine, q, signals, target, room)
    if room.state.rounds[0] > 1.0 or not error < np.inf:
        return error
    for i in range(len(room.x)):
        room.x[i] += SAME_POSE
    room.near[0] = 1.0
    return max(error, reached(machine, q, signals, target, room))


@compiled(borrows=True)
def _led_back(machine: MachineRecord, q: Array, room: Place) -> bool:
    """Whether one round of the effects, started without a shift, leads back to this pose.

    Then further rounds stay there, as it has settled. False if the start is this pose already.
    """
    body, stages, state = machine.body, machine.stages, room.state
    swing = state.swing[0]
    copy_into(room.stood, room.x)
    for i in range(len(q)):
        room.signals[stages.at[JOINT] + i] = q[i]
    led = (
        begin_near_by(body, stages, room.signals, machine.g, machine.stray, room.x, state)
        and nearer(body.limbs, state.joint, room.x, state.room) < np.inf
        and step_on(body, stages, room.signals, machine.g, machine.theta, room.x, state)
    )
    led = led and state.swing[0] > SAME_POSE and apart(room.x, room.stood) <= SAME_POSE
    copy_into(room.x, room.stood)
    state.swing[0] = swing
    return led


@compiled(borrows=True)
def _slope(machine: MachineRecord, room: Place) -> None:
    """Write d(place)/dq of the mechanism at its pose into `by_q`."""
    state = room.state
    place(machine.body.limbs, state.joint, room.x, BESIDE, state.room)
    moved(machine.body.limbs, room.slope, state.room, room.by_q, room.by_g)


@compiled(borrows=True)
def _least_squares(slope: Array, gap: Array, target: Array, system: Array, step: Array) -> bool:
    """Compute the Newton step of a place to its target, for a Jacobian `slope` (a, c).

    Least squares if a > c, else the step of least length; False if the system is singular.
    """
    rows, count = slope.shape
    for i in range(rows):
        gap[i] -= target[i]
    if rows > count:
        good = normal_step(slope, gap, system, step)
    else:
        good = least_step(slope, gap, 0.0, system, step)
    for i in range(rows):
        gap[i] += target[i]
    return good


@compiled(borrows=True, shared=True)
def newton(
    machine: MachineRecord,
    search: Search,
    q: Array,
    signals: Array,
    target: Array,
    best: Array,
    room: Place,
) -> tuple[float, int]:
    """Correct one command (m,), starting at `best` (m,); remaining distance [m], evaluations."""
    m, dq, step, there = len(q), room.dq, room.step, room.there
    for i in range(m):
        there[i] = q[i] + best[i]
    error, evaluations = reached(machine, there, signals, target, room), 1
    for _ in range(search.iterations):
        before = error
        if not search.tolerance < before < np.inf:
            break
        evaluations += 1
        _slope(machine, room)
        if not _least_squares(room.by_q, room.place, target, room.normal, step):
            break
        for halving in range(search.halvings + 1):
            for i in range(m):
                goal = best[i] - 0.5**halving * step[i]
                dq[i] = min(max(goal, -search.bound), search.bound)
                there[i] = q[i] + dq[i]
            evaluations += 1
            far = reached(machine, there, signals, target, room)
            if far < error:
                error = far
                for i in range(m):
                    best[i] = dq[i]
                break
        if not error < before:
            break
    return error, evaluations


@compiled(borrows=True)
def _aimed(machine: MachineRecord, target: Array, room: Place) -> bool:
    """Write the joints' Newton step to the target (a,) into `step`, from a pose nearby.

    The pose need not close: with F = f_x^+ f the closed pose is nearly x - F, and

        place(x) - p_x F + by_q dq = target        by_q = -p_x f_x^+ f_q

    `place` becomes the place at x - F, and `swing` the size of F.
    """
    limbs, state = machine.body.limbs, room.state
    own, swing = state.room, 0.0
    place(limbs, state.joint, room.x, BESIDE, own)
    place_of(machine, room.x, room)
    if not factored(limbs, own):
        return False
    closing(limbs, own)
    for i in range(len(room.x)):
        swing += abs(own.step[i])  # NaN if any of them is
        for row in range(len(room.place)):
            room.place[row] -= room.slope[row, i] * own.step[i]
    state.swing[0] = swing
    fill(room.by_q, 0.0)
    for row in range(len(room.place)):
        weigh(limbs, room.slope[row], own)
        add_by_joints(limbs, own, room.by_q[row])
    return _least_squares(room.by_q, room.place, target, room.normal, room.step)


@compiled(borrows=True)
def _stepped(machine: MachineRecord, search: Search, room: Place) -> bool:
    """Apply the step of `_aimed` to the correction, the command, the joints and the pose.

    False if the correction exceeds the bound.
    """
    state, by, at = room.state, room.there, machine.stages.at[JOINT]
    for i in range(len(by)):
        by[i] = -room.step[i]
        room.dq[i] += by[i]
        room.signals[at + i] += by[i]
        state.joint[i] += by[i]
        if not abs(room.dq[i]) <= search.bound:
            return False
    along(machine.body.limbs, by, state.room)
    for i in range(len(room.x)):
        room.x[i] -= state.room.step[i]
    return True


@compiled(borrows=True)
def _begun(machine: MachineRecord, room: Place) -> bool:
    """Find a start pose near that of the command; effects count if none needs the pose."""
    body, stages, state = machine.body, machine.stages, room.state
    if not stages.stands:
        shift(body, stages, room.signals, machine.g, machine.theta, state)
        near = room.near[0] > 0.0
        return near or opened_near(body, state.joint, room.x, machine.stray, state)
    return begin_near_by(body, stages, room.signals, machine.g, machine.stray, room.x, state)


@compiled(borrows=True)
def _share(now: float, before: float, square: bool) -> float:
    """Estimate the share of `now` that a step leaves; `square` if steps converge quadratically."""
    share = now / before if now < before else 1.0
    return share * share if square else share


@compiled(borrows=True, shared=True)
def taking_turns(
    machine: MachineRecord,
    search: Search,
    q: Array,
    signals: Array,
    target: Array,
    best: Array,
    room: Place,
) -> tuple[float, int]:
    """Correct one command (m,) as `newton` does, by steps and rounds of the effects in turn.

    A step moves joints and pose at once, so nothing is assembled between two: the pose closes as
    the tool reaches its target. The first step leaves out effects that need a pose; a round of
    these precedes every other step. The error that remains after a step and a round is estimated
    from the previous ones. On return `swing` is how far one more round would move the pose. On
    failure, or if a step overshoots (`newton` halves it), the distance is infinite, `best` kept.
    """
    body, stages, state = machine.body, machine.stages, room.state
    m, at, dq = len(q), stages.at[JOINT], room.dq
    copy_into(room.signals, signals)
    for i in range(m):
        dq[i] = best[i]
        room.signals[at + i] = q[i] + dq[i]
    if not _begun(machine, room):
        return np.inf, 1
    missed, before, last, turn = 0.0, 0.0, False, 0
    limbs = body.limbs
    square = not stages.stands and limbs.sizes[R] == limbs.sizes[K]  # all are Newton steps
    while not last and turn < ROUNDS:
        turn += 1
        if turn > 1 and stages.stands:
            take_effects(body, stages, room.signals, machine.g, machine.theta, room.x, state)
        if not _aimed(machine, target, room):
            return np.inf, turn - 1
        error, swing = distance(room, target), state.swing[0]
        if turn == 1 and not stages.stands and max(error, swing) <= search.tolerance:
            return error, turn
        if turn > 1 and not stages.stands and not error < max(missed, AIMED):
            return np.inf, turn
        if not _stepped(machine, search, room) or (turn > 2 and not swing < before):
            return np.inf, turn
        aside = error * _share(error, missed, square)
        state.swing[0] = swing * _share(swing, before, square)
        last = turn > 1 and max(aside, state.swing[0]) <= AIMED
        if not stages.stands and _told(machine, room) > AIMED:
            last = False
        missed, before = error, swing if turn > 1 or square else 0.0
    if not last:
        return np.inf, turn
    place_of(machine, room.x, room)
    copy_into(best, dq)
    return distance(room, target), turn


@compiled(borrows=True)
def _told(machine: MachineRecord, room: Place) -> float:
    """Adjust the command until the effects that need no pose give the joints of the step.

    Returns the largest difference from these joints before the last adjustment [rad, m].
    """
    state, at, most = room.state, machine.stages.at[JOINT], 0.0
    copy_into(room.there, state.joint)
    for _ in range(2):
        shift(machine.body, machine.stages, room.signals, machine.g, machine.theta, state)
        most = apart(state.joint, room.there)
        if most == 0.0:
            break
        for i in range(len(room.dq)):
            room.dq[i] -= state.joint[i] - room.there[i]
            room.signals[at + i] -= state.joint[i] - room.there[i]
    return most


@compiled(borrows=True)
def _posed(machine: MachineRecord, target: Array, room: Place) -> bool:
    """Move the pose x to the target by Newton steps, ignoring the joints.

    The error that a step leaves is estimated from the step before.
    """
    step, before = room.step, 0.0
    for _ in range(ROUNDS):
        place_of(machine, room.x, room)
        if not _least_squares(room.slope, room.place, target, room.normal, step):
            return False
        most = 0.0
        for i in range(len(room.x)):
            most = max(most, abs(step[i]))
            room.x[i] -= step[i]
        if not most < np.inf:
            return False
        share = most / before if most < min(before, SMALL_STEP) else 1.0
        if most <= SETTLED_POSE or share * share * most <= LEFT:
            break
        before = most
    return True


@compiled(borrows=True)
def _joined(machine: MachineRecord, room: Place) -> bool:
    """Solve the joints behind the drives for the pose x, with an estimate as in `_posed`."""
    limbs, state = machine.body.limbs, room.state
    own, step, before = state.room, room.step, 0.0
    for _ in range(2 * ROUNDS):
        place(limbs, state.joint, room.x, BESIDE, own)
        spread_joints(limbs, own)
        if not least_step(own.by_q, own.f, 0.0, own.system, step):
            return False
        most = 0.0
        for i in range(len(state.joint)):
            most = max(most, abs(step[i]))
            state.joint[i] -= step[i]
        if not most < np.inf:
            return False
        if most <= JOINED or most * _share(most, before, True) <= SETTLED_POSE:
            return True
        before = most
    return False


@compiled(borrows=True)
def _started(machine: MachineRecord, q: Array, signals: Array, room: Place) -> bool:
    """Set the pose and joints to start from: solved at the command, or a pose nearby."""
    if room.near[0] == 0.0:
        return stands(machine, q, signals, room)
    copy_into(room.signals, signals)
    copy_into(room.state.joint, q)
    if machine.reshaped:
        back_to(machine.body, machine.g, room.state)
    return True


@compiled(borrows=True, shared=True)
def by_pose(
    machine: MachineRecord, q: Array, signals: Array, target: Array, best: Array, room: Place
) -> tuple[float, int]:
    """Correct one command by finding the pose at the target first, then joints and command.

    For machines whose joints command the whole pose: see the module docstring. Returns the
    remaining distance [m] and the number of evaluations.
    """
    limbs, state, stages = machine.body.limbs, room.state, machine.stages
    m, told, shift = limbs.sizes[M], room.there, room.dq
    copy_into(told, q)
    if not _started(machine, q, signals, room) or not _posed(machine, target, room):
        return np.inf, 1
    for number in range(ROUNDS):
        if machine.reshaped:
            add_signals(machine.body, stages, room.signals, room.x, state)
            shift_dimensions(machine.body, stages, room.signals, machine.g, machine.theta, state)
        if (machine.reshaped or number == 0) and not _joined(machine, room):
            return np.inf, 1
        if stages.stands and not machine.reshaped and number == 0:
            add_signals(machine.body, stages, room.signals, room.x, state)
        most = 0.0
        for i in range(m):
            room.signals[stages.at[JOINT] + i] = told[i]
        for i in range(m):
            shift[i] = 0.0
        add_shift(stages.drive, room.signals, machine.theta, state.drive, shift)
        for i in range(m):
            goal = state.joint[i] - shift[i]
            most = max(most, abs(goal - told[i]))
            told[i] = goal
        if not most < np.inf:
            return np.inf, 1
        if most <= JOINED:
            break
    place_of(machine, room.x, room)
    for i in range(m):
        best[i] = told[i] - q[i]
    return distance(room, target), 1


# --- all commands --------------------------------------------------------------------------------


@compiled()
def targets(machine: MachineRecord, signals: Array) -> tuple[Array, Array]:
    """Tool places (n, a) and poses (n, k) of a machine; NaN rows where it has no pose."""
    n, room = len(signals), scratch(machine, signals.shape[1])
    found = np.full((n, len(room.place)), np.nan)
    x = np.full((n, len(room.x)), np.nan)
    at, m = machine.stages.at[JOINT], machine.body.limbs.sizes[M]
    for row in range(n):
        begin(machine, room)
        if stands(machine, signals[row, at : at + m], signals[row], room):
            found[row] = room.place
            x[row] = room.x
    return found, x


@compiled()
def corrections(
    machine: MachineRecord, search: Search, signals: Array, target: Array, start: Array
) -> tuple[Array, Array, Index]:
    """Corrections dq (n, m), distances (n,) [m], evaluations (n,) of commands under signals.

    The search starts at `start` (n, m), which `by_pose` ignores.
    """
    n, m, at = len(signals), machine.body.limbs.sizes[M], machine.stages.at[JOINT]
    dq, error, count = start.copy(), np.empty(n), np.empty(n, dtype=np.int64)
    room = scratch(machine, signals.shape[1])
    for row in range(n):
        begin(machine, room)
        error[row], count[row] = correct(
            machine,
            search,
            signals[row, at : at + m].copy(),
            signals[row],
            target[row],
            dq[row],
            room,
        )
    return dq, error, count


@compiled(borrows=True, shared=True)
def correct(
    machine: MachineRecord,
    search: Search,
    q: Array,
    signals: Array,
    target: Array,
    best: Array,
    room: Place,
) -> tuple[float, int]:
    """Correct one command by the method that suits the mechanism; never beyond the bound.

    Starts from the state that `begin` or `begin_near` has set.
    """
    error, count = np.inf, 0
    if machine.by_pose:
        error, count = by_pose(machine, q, signals, target, best, room)
    else:
        error, count = taking_turns(machine, search, q, signals, target, best, room)
        if not machine.stages.gentle and error <= search.tolerance:
            for i in range(len(q)):
                room.there[i] = q[i] + best[i]
            count += 1
            if not _led_back(machine, room.there, room):
                error = found_anew(machine, room.there, signals, target, room)
        room.settled[0] = 1.0 if error <= search.tolerance else 0.0
        if not error <= search.tolerance:
            room.near[0] = 0.0
            error, more = newton(machine, search, q, signals, target, best, room)
            count += more
    for i in range(len(q)):
        if not abs(best[i]) <= search.bound:
            error = np.inf
    if not error < np.inf:
        for i in range(len(q)):
            best[i] = 0.0
    return error, count
