"""Compiled swarm of APSO over any machine, its effects included: the law of apso.py by particles.

Arrays are by component: (j m,) holds a joint of all m particles of one target, then the next of j
joints, in the mechanism's own sense, so that a search takes the same way whichever way a drive
counts. All are used again for all targets of a call. A place is judged by the whole chain run
forward (backward_kernel.py).

A mechanism may have a law of the places near a command (`Mechanism.nearby`). Without effects, in
a box up to `LITTLE`, it gives the squared distances of all particles at once, in vector
instructions. Products and sums are contracted there: distances only decide which place is the
better one, the places themselves are rounded as numpy has it.

Random numbers are drawn beforehand, by the same generator as in apso.py (numpy's Philox 4x64-10,
counter-based), and read by every target from their beginning: no state is left to share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.backward_kernel import (
    MachineRecord,
    Place,
    begin,
    reached,
    scratch,
)
from delta_calibration.model.chain_constants import JOINT
from delta_calibration.model.jit import call, compiled
from delta_calibration.model.kernels import FULL, SETUP, Limbs, M, P, own_joint
from delta_calibration.model.stand import Opening

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Settings = tuple[float, float, float, float, float]  # of `ApsoSettings`, see search

_SPACE = 3


@compiled(borrows=True)
def _set_machine(nearby: Opening, machine: MachineRecord, particles: int, work: Array) -> None:
    """Tell the law of distances nearby the dimensions, and of how many particles."""
    limbs = machine.body.limbs
    for i in range(len(nearby.dims)):
        row, p = nearby.dims[i], limbs.sizes[P]
        work[nearby.at[1] + i] = machine.g[row] if row < p else limbs.fixed[row - p]
    for i in range(len(nearby.constants)):
        work[nearby.at[2] + i] = nearby.constants[i]
    work[nearby.at[4] - 1] = particles


@compiled(borrows=True)
def _set_command(
    limbs: Limbs, nearby: Opening, q: Array, goes: Array, tool: Array, work: Array
) -> None:
    """Tell the law which command the places are near, and where they are to be."""
    for i in range(_SPACE):
        work[len(q) + i] = goes[i] - tool[i]
    for i in range(len(nearby.joints)):
        joint = nearby.joints[i]
        work[nearby.at[0] + i] = own_joint(limbs, joint, q[joint])
    call(nearby.law[SETUP], work)


@compiled(borrows=True)
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
    """Squared distances (m,) [m^2] of any machine, infinite where it cannot stand."""
    m = len(square)
    for i in range(m):
        for k in range(len(q)):
            there[k] = q[k] + machine.body.limbs.sense[k] * x[k * m + i]
        begin(machine, room)
        far = reached(machine, there, signals, target, room)
        square[i] = far * far


@compiled(borrows=True)
def _remember(x: Array, square: Array, own: Array, fitness: Array) -> tuple[int, float]:
    """Let each particle keep its place if that is its best; the swarm's best and its square."""
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

    `gains` (m,) is what a bin's share of E grows by with one particle more in it.
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
    """Move every particle by (10), with the draws of this move; the box is a wall.

    `goal` (j m,) takes p_g, once for each particle.
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

    Args:
        machine: with its effects.
        nearby: law of places near a command, where that is all that counts; else empty.
        signals: of the commands, (n, S).
        target: places they mean (n, a) [m].
        start: first places (j m,).
        draws: r1 (j m,) and r2 (j m,) of each move, one after the other.
        gains: see `_inertia`, (m,).
        settings: bound, tolerance, velocity_fraction, cognitive, social.
    """
    bound, tolerance = settings[0], settings[1]
    limbs = machine.body.limbs
    n, m, joints = len(signals), len(gains), limbs.sizes[M]
    size, at = joints * m, machine.stages.at[JOINT]
    iterations = len(draws) // (2 * size)
    out = np.zeros((n, joints + 2))
    near, first = len(nearby.law) > 0, nearby.at[4]  # the law takes the particles where they are
    work, whole = np.zeros(first + 4 * size + 2 * m), np.empty(2 * m, dtype=np.int64)
    x, square, fitness, rest = (
        work[first : first + size],
        work[first + size : first + size + m],
        work[first + size + m : first + size + 2 * m],
        work[first + size + 2 * m :],
    )
    v, own, goal = rest[:size], rest[size : 2 * size], rest[2 * size :]
    bins, counts = whole[:m], whole[m:]
    if near:
        _set_machine(nearby, machine, m, work)
    room, there = scratch(machine, signals.shape[1]), np.empty(joints)
    for row in range(n):
        q, goes = signals[row, at : at + joints], target[row]
        if near:
            _set_command(limbs, nearby, q, goes, machine.aim.tool, work)
        for i in range(size):
            x[i], v[i], own[i] = start[i], 0.0, start[i]
        for i in range(m):
            fitness[i] = np.inf
        winner = 0
        for iteration in range(iterations + 1):
            if near:
                call(nearby.law[FULL], work)  # not a number where there is no place
            else:
                _squares(machine, q, signals[row], goes, x, there, square, room)
            winner, least = _remember(x, square, own, fitness)
            out[row, joints] = np.sqrt(least)
            out[row, joints + 1] += m
            if out[row, joints] <= tolerance or iteration == iterations:
                break
            w = _inertia(x, bound, gains, bins, counts)
            _move(x, v, own, goal, draws, iteration, joints, winner, w, settings)
        for k in range(joints):
            out[row, k] = limbs.sense[k] * own[k * m + winner]
    return out
