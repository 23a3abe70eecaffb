"""Compiled swarm of APSO over any machine, its effects included: the law of apso.py by particles.

Arrays are by component: (j m,) holds a joint of all m particles of one target, then the next of j
joints. All are used again for all targets of a call. A place is judged by the whole chain run
forward (backward_kernel.py).

Three spheres without effects, in a box up to `SHORT`, take the least arithmetic, along the
particles in vector instructions. Each arm is turned to the command once for a target and by the
small d of a particle from there,

    u cos(q + d) + v sin(q + d) = u' cos d + v' sin d,

with cos d and sin d by their series to d^6 and d^7: off by less than 2e-17 up to `SHORT`, below
the rounding of either. Centres are taken from the target, so that the meeting point is the gap.
Products and sums are contracted there: distances only decide which place is the better one, the
places themselves are rounded as numpy has it.

Random numbers are drawn beforehand, by the same generator as in apso.py (numpy's Philox 4x64-10,
counter-based), and read by every target from their beginning: no state is left to share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.backward_kernel import Machine, Place, begin, reached, scratch
from delta_calibration.model.chain_constants import JOINT
from delta_calibration.model.jit import compiled
from delta_calibration.model.kernels import M

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Leg = tuple[float, float, float, float, float, float, float, float, float, float]
Settings = tuple[float, float, float, float, float]  # of `ApsoSettings`, see search

SHORT = 0.03  # [rad] largest |d| whose cosine and sine the series gives


@compiled()
def _leg(legs: Array, i: int, tool: Array, q: Array, target: Array) -> Leg:
    """Sphere of leg i with its arm at the command: c seen from the target, u', v', l^2 [m]."""
    cos, sin = np.cos(q[i]), np.sin(q[i])
    return (
        legs[i, 0] + (tool[0] - target[0]),
        legs[i, 1] + (tool[1] - target[1]),
        legs[i, 2] + (tool[2] - target[2]),
        cos * legs[i, 3] + sin * legs[i, 6],
        cos * legs[i, 4] + sin * legs[i, 7],
        cos * legs[i, 5] + sin * legs[i, 8],
        cos * legs[i, 6] - sin * legs[i, 3],
        cos * legs[i, 7] - sin * legs[i, 4],
        cos * legs[i, 8] - sin * legs[i, 5],
        legs[i, 9] * legs[i, 9],
    )


@compiled(contract=True)
def _short(d: float) -> tuple[float, float]:
    """Cosine and sine of |d| <= SHORT [rad]."""
    s = d * d
    cos = 1 - s * (1 / 2 - s * (1 / 24 - s * (1 / 720)))
    sin = d - d * s * (1 / 6 - s * (1 / 120 - s * (1 / 5040)))
    return cos, sin


@compiled(contract=True)
def _centre(leg: Leg, d: float) -> tuple[float, float, float]:
    """Centre of the leg's sphere with its arm d [rad] from the command."""
    cos, sin = _short(d)
    return (
        leg[0] + cos * leg[3] + sin * leg[6],
        leg[1] + cos * leg[4] + sin * leg[7],
        leg[2] + cos * leg[5] + sin * leg[8],
    )


@compiled(contract=True)
def _short_squares(first: Leg, second: Leg, third: Leg, x: Array, square: Array) -> None:
    """Squared distances (m,) [m^2] of three spheres' meeting points, NaN where there are none.

    The equations are those of mechanisms/spheres.py.
    """
    r2 = first[9]
    more_a, more_b = r2 - second[9], r2 - third[9]
    m = len(square)
    for i in range(m):
        cx, cy, cz = _centre(first, x[i])
        ax, ay, az = _centre(second, x[m + i])
        bx, by, bz = _centre(third, x[2 * m + i])
        ax, ay, az, bx, by, bz = ax - cx, ay - cy, az - cz, bx - cx, by - cy, bz - cz
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        inverse = 1 / (nx * nx + ny * ny + nz * nz)
        da = (ax * ax + ay * ay + az * az + more_a) * (0.5 * inverse)
        db = (bx * bx + by * by + bz * bz + more_b) * (0.5 * inverse)
        gx, gy, gz = da * bx - db * ax, da * by - db * ay, da * bz - db * az
        fx, fy, fz = gy * nz - gz * ny, gz * nx - gx * nz, gx * ny - gy * nx
        rise = np.sqrt((r2 - (fx * fx + fy * fy + fz * fz)) * inverse)
        px, py, pz = cx + fx - rise * nx, cy + fy - rise * ny, cz + fz - rise * nz
        square[i] = px * px + py * py + pz * pz


@compiled()
def _squares(
    machine: Machine,
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
            there[k] = q[k] + x[k * m + i]
        begin(room)
        far = reached(machine, there, signals, target, room)
        square[i] = far * far


@compiled()
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


@compiled()
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


@compiled()
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
    machine: Machine,
    legs: Array,
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
        legs: of three spheres without effects c, u, v, l each (3, 10): centre c + u cos q +
            v sin q, radius l [m]; none (0, 10) for any other machine.
        signals: of the commands, (n, S).
        target: places they mean (n, a) [m].
        start: first places (j m,).
        draws: r1 (j m,) and r2 (j m,) of each move, one after the other.
        gains: see `_inertia`, (m,).
        settings: bound, tolerance, velocity_fraction, cognitive, social.
    """
    bound, tolerance = settings[0], settings[1]
    n, m, joints = len(signals), len(gains), machine.body.limbs.sizes[M]
    size, at = joints * m, machine.stages.at[JOINT]
    iterations = len(draws) // (2 * size)
    out = np.zeros((n, joints + 2))
    space, whole = np.empty(4 * size + 2 * m), np.empty(2 * m, dtype=np.int64)
    x, v, own = space[:size], space[size : 2 * size], space[2 * size : 3 * size]
    goal, square, fitness = space[3 * size : 4 * size], space[4 * size : -m], space[-m:]
    bins, counts = whole[:m], whole[m:]
    short = len(legs) == 3 and bound <= SHORT
    room, there = scratch(machine, signals.shape[1]), np.empty(joints)
    for row in range(n):
        q, goes = signals[row, at : at + joints], target[row]
        if short:
            first = _leg(legs, 0, machine.aim.tool, q, goes)
            second = _leg(legs, 1, machine.aim.tool, q, goes)
            third = _leg(legs, 2, machine.aim.tool, q, goes)
        for i in range(size):
            x[i], v[i], own[i] = start[i], 0.0, start[i]
        for i in range(m):
            fitness[i] = np.inf
        winner = 0
        for iteration in range(iterations + 1):
            if short:
                _short_squares(first, second, third, x, square)
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
            out[row, k] = own[k * m + winner]
    return out
