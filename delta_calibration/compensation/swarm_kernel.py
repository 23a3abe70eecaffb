"""Compiled swarm over a Delta's geometry: the law of apso.py, particle by particle.

Importing this module compiles, or loads what an earlier process compiled; `CompiledApso` does so
when it is made. Arrays are by component: (3 m,) holds a joint of all m particles of one target,
then the next joint. All are used again for all targets of a call. Loops run along the particles
and become vector instructions, but for what depends on chance and is rarely so.

Three spheres in a box up to `SHORT` take the least arithmetic. Each arm is turned to the command
once for a target and by the small d of a particle from there,

    u cos(q + d) + v sin(q + d) = u' cos d + v' sin d,

with cos d and sin d by their series to d^6 and d^7: off by less than 2e-17 up to `SHORT`, below
the rounding of either. Centres are taken from the target, so that the meeting point is the gap.
Products and sums are contracted there: distances only decide which place is the better one, the
places themselves are rounded as numpy has it.
All other machines are asked for their point as kernel.py has it.

Random numbers are drawn beforehand, by the same generator as in apso.py (numpy's Philox 4x64-10,
counter-based), and read by every target from their beginning: no state is left to share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation import kernel
from delta_calibration.compensation.jit import compiled

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Leg = tuple[float, float, float, float, float, float, float, float, float, float]
Settings = tuple[float, float, float, float, float]  # of `ApsoSettings`, see search

SHORT = 0.03  # [rad] largest |d| whose cosine and sine the series gives


@compiled()
def _leg(legs: Array, i: int, offset: Array, q: Array, target: Array) -> Leg:
    """Sphere of leg i with its arm at the command: c seen from the target, u', v', l^2 [m]."""
    cos, sin = np.cos(q[i]), np.sin(q[i])
    return (
        legs[i, 0] + (offset[0] - target[0]),
        legs[i, 1] + (offset[1] - target[1]),
        legs[i, 2] + (offset[2] - target[2]),
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

    The equations are those of `_meet` in kernel.py.
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


@compiled(None, kernel)
def _squares(
    machine: tuple[Array, Array, Array],
    q: Array,
    target: Array,
    x: Array,
    square: Array,
) -> None:
    """Squared distances (m,) [m^2] of any machine of kernel.py, infinite without a pose."""
    legs, rods, offset = machine
    there, gap, scratch = np.empty(3), np.empty(3), kernel._scratch()
    m = len(square)
    for i in range(m):
        for k in range(3):
            there[k] = q[k] + x[k * m + i]
        far = kernel._distance(legs, rods, offset, there, target, gap, scratch)
        square[i] = far * far


@compiled()
def _remember(x: Array, square: Array, own: Array, fitness: Array) -> tuple[int, float]:
    """Let each particle keep its place if that is its best; the swarm's best and its square."""
    m = len(square)
    for i in range(m):
        if square[i] < fitness[i]:
            fitness[i] = square[i]
            own[i], own[m + i], own[2 * m + i] = x[i], x[m + i], x[2 * m + i]
    winner, least = 0, fitness[0]
    for i in range(1, m):
        if fitness[i] < least:
            winner, least = i, fitness[i]
    return winner, least


@compiled()
def _inertia(x: Array, bound: float, gains: Array, bins: Counts, counts: Counts) -> float:
    """Weight w of (14) from the entropy along the box's diagonal, as `swarm_entropy` has it.

    `gains` (m,) is what a bin's share of E grows by with one particle more in it.
    """
    m = len(bins)
    width, half = 3 * bound, 0.5 * m
    for i in range(m):
        along = (x[i] + x[m + i] + x[2 * m + i]) / width
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
    winner: int,
    w: float,
    settings: Settings,
) -> None:
    """Move every particle by (10), with the draws of this move; the box is a wall.

    `goal` (3 m,) takes p_g, once for each particle.
    """
    bound, _, velocity_fraction, cognitive, social = settings
    most = velocity_fraction * 2.0 * bound
    size = len(x)
    m = size // 3
    for k in range(3):
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


_MACHINE = "Tuple((f8[:, ::1], f8[:, ::1], f8[::1]))"  # legs, rods, offset: see kernel.py
_DRAWN = "f8[::1], f8[::1], f8[::1]"  # start, draws, gains
_SETTINGS = "UniTuple(f8, 5)"


@compiled(
    f"f8[:, ::1]({_MACHINE}, f8[:, ::1], f8[:, ::1], {_DRAWN}, {_SETTINGS})",
    kernel,
)
def search(
    machine: tuple[Array, Array, Array],
    q: Array,
    target: Array,
    start: Array,
    draws: Array,
    gains: Array,
    settings: Settings,
) -> Array:
    """Corrections [rad] (0-2), distance [m] (3) and evaluations (4) of each, (n, 5): see apso.py.

    Args:
        machine: legs, rods and offset as in kernel.py.
        q: commands (n, 3) [rad].
        target: points they mean (n, 3) [m].
        start: first places (3 m,) [rad].
        draws: r1 (3 m,) and r2 (3 m,) of each move, one after the other.
        gains: see `_inertia`, (m,).
        settings: bound, tolerance, velocity_fraction, cognitive, social.
    """
    legs, rods, offset = machine
    bound, tolerance = settings[0], settings[1]
    n, m = len(q), len(gains)
    iterations = len(draws) // (6 * m)
    out = np.zeros((n, 5))
    room, whole = np.empty(14 * m), np.empty(2 * m, dtype=np.int64)  # two are made sooner than six
    x, v, own = room[: 3 * m], room[3 * m : 6 * m], room[6 * m : 9 * m]
    goal, square, fitness = room[9 * m : 12 * m], room[12 * m : 13 * m], room[13 * m :]
    bins, counts = whole[:m], whole[m:]
    short = len(rods) == 0 and bound <= SHORT
    for row in range(n):
        first = _leg(legs, 0, offset, q[row], target[row])
        second = _leg(legs, 1, offset, q[row], target[row])
        third = _leg(legs, 2, offset, q[row], target[row])
        for i in range(3 * m):
            x[i], v[i], own[i] = start[i], 0.0, start[i]
        for i in range(m):
            fitness[i] = np.inf
        for iteration in range(iterations + 1):
            if short:
                _short_squares(first, second, third, x, square)
            else:
                _squares(machine, q[row], target[row], x, square)
            winner, least = _remember(x, square, own, fitness)
            out[row, 3] = np.sqrt(least)
            out[row, 4] += m
            if out[row, 3] <= tolerance or iteration == iterations:
                break
            w = _inertia(x, bound, gains, bins, counts)
            _move(x, v, own, goal, draws, iteration, winner, w, settings)
        for k in range(3):
            out[row, k] = own[k * m + winner]
    return out
