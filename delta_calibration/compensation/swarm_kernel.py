"""Compiled APSO swarm for any machine, effects included: the algorithm of apso.py.

Arrays are by component: (j m,) holds a joint of all m particles of one target, then the next of j
joints, in the mechanism's own sense, so that a search takes the same path whichever direction a
drive counts in. All are used again for all targets of a call. A particle's position is judged by
the whole chain run forward (backward_kernel.py).

A mechanism may have a law of the tool places near a command (`Mechanism.nearby`). Without effects,
in a box up to `LITTLE`, and if the machine has a pose at the command itself, the law gives the
squared distances of all particles at once, in vector instructions. Products and sums are
contracted there: distances only decide which position is better, the positions themselves are
rounded as in numpy.

Random numbers are drawn beforehand, by the same generator as in apso.py (numpy's Philox 4x64-10,
counter-based), and every target reads them from the beginning: targets share no state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.backward_kernel import (
    MachineRecord,
    Place,
    begin,
    reached,
    scratch,
    stands,
)
from delta_calibration.model.chain_constants import JOINT
from delta_calibration.model.jit import call, compiled, record
from delta_calibration.model.kernels import (
    FULL,
    NEAR,
    SETUP,
    M,
    P,
    closing,
    copy_into,
    factored,
    own_joint,
    place,
)
from delta_calibration.model.stand import Opening

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Settings = tuple[float, float, float, float, float]  # of `ApsoSettings`, see search

_SPACE = 3


@compiled(borrows=True)
def _set_machine(nearby: Opening, machine: MachineRecord, particles: int, work: Array) -> None:
    """Write dimensions, constants and number of particles into the nearby law's workspace."""
    limbs = machine.body.limbs
    for i in range(len(nearby.dims)):
        row, p = nearby.dims[i], limbs.sizes[P]
        work[nearby.at[1] + i] = machine.g[row] if row < p else limbs.fixed[row - p]
    for i in range(len(nearby.constants)):
        work[nearby.at[2] + i] = nearby.constants[i]
    work[nearby.at[4] - 1] = particles


@compiled(borrows=True, shared=True)
def _set_command(
    machine: MachineRecord,
    nearby: Opening,
    signals: Array,
    goes: Array,
    work: Array,
    room: Place,
) -> bool:
    """Write the command, its pose and its target into the nearby law's workspace.

    False if there is no pose at the command, or a singular or over-constrained one.
    """
    limbs, own, k = machine.body.limbs, room.state.room, len(room.x)
    first = limbs.sizes[M]
    q = signals[machine.stages.at[JOINT] : machine.stages.at[JOINT] + first]
    begin(machine, room)
    if not stands(machine, q, signals, room):
        return False
    place(limbs, room.state.joint, room.x, NEAR, own)
    if len(own.f) != k or not factored(limbs, own):
        return False
    copy_into(work[first : first + _SPACE], goes)
    copy_into(work[first + _SPACE : first + 2 * _SPACE], machine.aim.tool)
    copy_into(work[first + 2 * _SPACE : first + 2 * _SPACE + k], room.x)
    slope = work[first + 2 * _SPACE + k : nearby.at[0]]
    for i in range(k):
        for row in range(k):
            own.f[row] = 1.0 if row == i else 0.0
        closing(limbs, own)
        for row in range(k):
            slope[row * k + i] = own.step[row]
    for i in range(len(nearby.joints)):
        joint = nearby.joints[i]
        work[nearby.at[0] + i] = own_joint(limbs, joint, q[joint])
    call(nearby.law[SETUP], work)
    return True


@compiled(borrows=True, shared=True)
def _squares(
    machine: MachineRecord,
    q: Array,
    signals: Array,
    target: Array,
    x: Array,
    there: Array,
    square: Array,
    room: Place,
) -> None:
    """Squared distances (m,) [m^2] for any machine, infinite where it has no pose."""
    m = len(square)
    for i in range(m):
        for k in range(len(q)):
            there[k] = q[k] + machine.body.limbs.sense[k] * x[k * m + i]
        begin(machine, room)
        far = reached(machine, there, signals, target, room)
        square[i] = far * far


@compiled(borrows=True)
def _remember(x: Array, square: Array, own: Array, fitness: Array) -> tuple[int, float]:
    """Update each particle's best position; returns the best particle and its square."""
    m = len(square)
    for i in range(m):
        if square[i] < fitness[i]:
            fitness[i] = square[i]
            for k in range(i, len(x), m):
                own[k] = x[k]
    winner, least = 0, fitness[0]
    for i in range(1, m):
        if fitness[i] < least:
            winner, least = i, fitness[i]
    return winner, least


@compiled(borrows=True)
def _inertia(x: Array, bound: float, gains: Array, bins: Index, counts: Index) -> float:
    """Weight w of (14) from the entropy along the box's diagonal, as `swarm_entropy` has it.

    `gains` (m,) is the growth of a bin's term of E by one more particle, by their number in it.
    """
    m = len(bins)
    width, half = len(x) // m * bound, 0.5 * m
    for i in range(m):
        along = 0.0
        for k in range(i, len(x), m):
            along += x[k]
        along /= width
        bins[i] = min(max(int((along + 1.0) * half), 0), m - 1)
    for i in range(m):
        counts[i] = 0
    entropy = 0.0
    for i in range(m):
        entropy += gains[counts[bins[i]]]
        counts[bins[i]] += 1
    return float(1.0 / (1.0 + 1.5 * np.exp(-2.6 * entropy)))


@compiled(borrows=True)
def _move(
    x: Array,
    v: Array,
    own: Array,
    goal: Array,
    draws: Array,
    move: int,
    joints: int,
    winner: int,
    w: float,
    settings: Settings,
) -> None:
    """Move every particle by (10), with the draws of this move; clipped to the box.

    `goal` (j m,) is filled with p_g, once for each particle.
    """
    bound, _, velocity_fraction, cognitive, social = settings
    most = velocity_fraction * 2.0 * bound
    size = len(x)
    m = size // joints
    for k in range(joints):
        leader = own[k * m + winner]
        for i in range(m):
            goal[k * m + i] = leader
    r1 = draws[2 * size * move : (2 * move + 1) * size]
    r2 = draws[(2 * move + 1) * size : 2 * (move + 1) * size]
    for i in range(size):
        pull = cognitive * (r1[i] * (own[i] - x[i]))
        pull = w * v[i] + pull + social * (r2[i] * (goal[i] - x[i]))
        step = min(max(pull, -most), most)
        v[i] = step
        x[i] = min(max(x[i] + step, -bound), bound)


@record
class Swarm(NamedTuple):
    """Arrays of one target's swarm: (j m,) by joint and particle, (m,) by particle."""

    x: Array  # positions
    v: Array
    own: Array  # p_i
    goal: Array
    square: Array  # of the distance [m^2]
    fitness: Array
    bins: Index
    counts: Index
    there: Array  # (j,) a command


@compiled(borrows=True, shared=True)
def _swarm(
    machine: MachineRecord,
    law: int,
    work: Array,
    signals: Array,
    target: Array,
    given: tuple[Array, Array, Array],
    settings: Settings,
    swarm: Swarm,
    room: Place,
    out: Array,
) -> bool:
    """Search one target by the nearby law, or by the whole chain if `law` is 0.

    Returns whether it came within the tolerance. `given` are start, draws and gains of `search`.
    """
    (start, draws, gains), bound, limbs = given, settings[0], machine.body.limbs
    m, size = len(gains), len(start)
    joints, iterations = size // m, len(draws) // (2 * size)
    x, own, winner, at = swarm.x, swarm.own, 0, machine.stages.at[JOINT]
    for i in range(size):
        x[i], swarm.v[i], own[i] = start[i], 0.0, start[i]
    for i in range(m):
        swarm.fitness[i] = np.inf
    out[joints + 1] = 0.0
    for iteration in range(iterations + 1):
        if law != 0:
            call(law, work)  # NaN where there is no pose
        else:
            q = signals[at : at + joints]
            _squares(machine, q, signals, target, x, swarm.there, swarm.square, room)
        winner, least = _remember(x, swarm.square, own, swarm.fitness)
        out[joints] = np.sqrt(least)
        out[joints + 1] += m
        if out[joints] <= settings[1] or iteration == iterations:
            break
        w = _inertia(x, bound, gains, swarm.bins, swarm.counts)
        _move(x, swarm.v, own, swarm.goal, draws, iteration, joints, winner, w, settings)
    for k in range(joints):
        out[k] = limbs.sense[k] * own[k * m + winner]
        swarm.there[k] = signals[at + k] + out[k]
    return bool(out[joints] <= settings[1])


@compiled()
def search(
    machine: MachineRecord,
    nearby: Opening,
    signals: Array,
    target: Array,
    start: Array,
    draws: Array,
    gains: Array,
    settings: Settings,
) -> Array:
    """Corrections (0 to j - 1), distance [m] (j) and evaluations (j + 1) of each, (n, j + 2).

    Results of the nearby law are checked with the whole chain. If the check fails, near a
    singular pose, or if nothing was found, the whole chain is searched as well.

    Args:
        machine: with its effects.
        nearby: law of tool places near a command, if there are no effects; else empty.
        signals: of the commands, (n, S).
        target: tool places they are meant to reach (n, a) [m].
        start: start positions (j m,).
        draws: r1 (j m,) and r2 (j m,) of each move, one after the other.
        gains: see `_inertia`, (m,).
        settings: bound, tolerance, velocity_fraction, cognitive, social.
    """
    joints, m, size = machine.body.limbs.sizes[M], len(gains), len(start)
    lawful, first = len(nearby.law) > 0, nearby.at[4]  # the law reads the particles in place
    out, given = np.zeros((len(signals), joints + 2)), (start, draws, gains)
    work, rest = np.zeros(first + size + m), np.zeros(3 * size + m)
    swarm = Swarm(
        work[first : first + size],
        rest[:size],
        rest[size : 2 * size],
        rest[2 * size : 3 * size],
        work[first + size :],
        rest[3 * size :],
        np.empty(m, dtype=np.int64),
        np.empty(m, dtype=np.int64),
        np.empty(joints),
    )
    if lawful:
        _set_machine(nearby, machine, m, work)
    room = scratch(machine, signals.shape[1])
    for row in range(len(signals)):
        own, goes = signals[row], target[row]
        law = 0
        if lawful and _set_command(machine, nearby, own, goes, work, room):
            law = nearby.law[FULL]
        found = _swarm(machine, law, work, own, goes, given, settings, swarm, room, out[row])
        if law == 0 or machine.exact:
            continue
        begin(machine, room)
        error = reached(machine, swarm.there, own, goes, room)
        if found and error <= settings[1]:
            out[row, joints] = error
        else:
            _swarm(machine, 0, work, own, goes, given, settings, swarm, room, out[row])
    return out
