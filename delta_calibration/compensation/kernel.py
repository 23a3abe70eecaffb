"""Compiled geometry of a rotary Delta: scalar loops of numba over the samples of a batch.

Importing this module imports numba and compiles, or loads what an earlier process compiled:
`CompiledGeometry` does so when it is needed and prepares the arrays that all functions here take:

    legs (3, 10): c, u, v, l of each leg's sphere: centre c + u cos q + v sin q, radius l [m]
    rods (6, 7):  e, a, l of each rod: from e + u cos q + v sin q on its arm to a on the platform,
                  length l [m]; no rows (0, 7) for a platform that only translates
    offset (3,):  tool centre point in the platform's frame [m]

All else is in the base's frame. With s = p + R(w) a - (e + u cos q + v sin q), the six equations
|s|^2 = l^2 are solved by Newton's method for the pose (p, w) as in `SixRodDelta`, from the lower
meeting point of the spheres. Rows without a pose come out as NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.jit import compiled

Array = NDArray[np.float64]
Scratch = tuple[Array, Array, Array, Array, Array, Array, Array]

_POSE_STEPS = 25  # as in mechanisms/base.py
_POSE_STEP = 1e-9  # [m, rad] the last step; what is left is of the order of its square
_STRAY = 1e-9  # largest closure of a solution [m^2], as there
_SERIES_BELOW = 1e-4  # squared angle [rad^2], as in geometry/rotations.py
_SWEEPS = 30  # most of Jacobi's method; three or four do
_ORTHOGONAL = 1e-10  # largest cosine between columns at the start of the last sweep


@compiled()
def _scratch() -> Scratch:
    """Places for one sample's vectors, used again for all samples of a call."""
    return (
        np.empty((3, 3)),  # [m] u cos q + v sin q of each arm
        np.empty((3, 3)),  # [m/rad] its derivative
        np.empty((6, 3)),  # [m] s of each rod, from elbow to platform
        np.empty((6, 3)),  # [m] b = R a, its ball joint on the platform seen from the centre
        np.empty((6, 9)),  # equations, and up to three right sides behind them
        np.zeros((3, 3)),  # R
        np.zeros(6),  # x: pose
    )


@compiled()
def _cross(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float, float]:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@compiled()
def _solve(system: Array, size: int, sides: int) -> bool:
    """Solve size equations for the right sides behind them, in place; False if singular."""
    width = size + sides
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(system[i, k]) > abs(system[best, k]):
                best = i
        if not abs(system[best, k]) > 0.0:  # zero or NaN
            return False
        if best != k:
            for j in range(k, width):
                system[k, j], system[best, j] = system[best, j], system[k, j]
        inverse = 1 / system[k, k]
        for i in range(k + 1, size):
            factor = system[i, k] * inverse
            for j in range(k + 1, width):
                system[i, j] -= factor * system[k, j]
    for k in range(size - 1, -1, -1):
        for side in range(size, width):
            total = system[k, side]
            for j in range(k + 1, size):
                total -= system[k, j] * system[j, side]
            system[k, side] = total / system[k, k]
    return True


@compiled()
def _swing(legs: Array, q: Array, scratch: Scratch) -> None:
    """Turn the arms to the joint angles q (3,) [rad]."""
    swing, turn = scratch[0], scratch[1]
    for leg in range(3):
        cos, sin = np.cos(q[leg]), np.sin(q[leg])
        for k in range(3):
            u, v = legs[leg, 3 + k], legs[leg, 6 + k]
            swing[leg, k] = cos * u + sin * v
            turn[leg, k] = cos * v - sin * u


@compiled()
def _meet(legs: Array, scratch: Scratch) -> None:
    """Lower meeting point of the three spheres, no tilt; see mechanisms/rotary_delta.py."""
    swing, x = scratch[0], scratch[6]
    cx, cy, cz = legs[0, 0] + swing[0, 0], legs[0, 1] + swing[0, 1], legs[0, 2] + swing[0, 2]
    ax, ay = legs[1, 0] + swing[1, 0] - cx, legs[1, 1] + swing[1, 1] - cy
    bx, by = legs[2, 0] + swing[2, 0] - cx, legs[2, 1] + swing[2, 1] - cy
    az, bz = legs[1, 2] + swing[1, 2] - cz, legs[2, 2] + swing[2, 2] - cz
    nx, ny, nz = _cross(ax, ay, az, bx, by, bz)
    square = nx * nx + ny * ny + nz * nz
    r2 = legs[0, 9] ** 2
    da = (ax * ax + ay * ay + az * az + r2 - legs[1, 9] ** 2) / (2 * square)
    db = (bx * bx + by * by + bz * bz + r2 - legs[2, 9] ** 2) / (2 * square)
    gx, gy, gz = _cross(bx, by, bz, nx, ny, nz)
    hx, hy, hz = _cross(nx, ny, nz, ax, ay, az)
    fx, fy, fz = da * gx + db * hx, da * gy + db * hy, da * gz + db * hz
    rise = np.sqrt((r2 - (fx * fx + fy * fy + fz * fz)) / square)  # NaN where they do not meet
    x[0], x[1], x[2] = cx + fx - rise * nx, cy + fy - rise * ny, cz + fz - rise * nz
    x[3], x[4], x[5] = 0.0, 0.0, 0.0


@compiled()
def _coefficients(x: Array) -> tuple[float, float, float]:
    """sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3 with t = |w|; see geometry/rotations.py."""
    t2 = x[3] * x[3] + x[4] * x[4] + x[5] * x[5]
    if t2 < _SERIES_BELOW:
        a = 1 - t2 / 6 + t2**2 / 120 - t2**3 / 5040
        return a, 0.5 - t2 / 24 + t2**2 / 720 - t2**3 / 40320, 1 / 6 - t2 / 120 + t2**2 / 5040
    t = np.sqrt(t2)
    return np.sin(t) / t, (1 - np.cos(t)) / t2, (t - np.sin(t)) / (t2 * t)


@compiled()
def _rotate(scratch: Scratch) -> None:
    """R(w) = 1 + a [w]x + b [w]x^2."""
    r, x = scratch[5], scratch[6]
    a, b, _ = _coefficients(x)
    for i in range(3):
        for j in range(3):
            r[i, j] = b * x[3 + i] * x[3 + j]
        r[i, i] += 1 - b * (x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    r[0, 1], r[1, 0] = r[0, 1] - a * x[5], r[1, 0] + a * x[5]
    r[2, 0], r[0, 2] = r[2, 0] - a * x[4], r[0, 2] + a * x[4]
    r[1, 2], r[2, 1] = r[1, 2] - a * x[3], r[2, 1] + a * x[3]


@compiled()
def _close(rods: Array, scratch: Scratch) -> float:
    """Lay the rods at the pose x; closures |s|^2 - l^2 go behind the system, the largest back."""
    swing, _, s, b, system, r, x = scratch
    _rotate(scratch)
    most = 0.0
    for rod in range(6):
        square = 0.0
        for k in range(3):
            ball = r[k, 0] * rods[rod, 3] + r[k, 1] * rods[rod, 4] + r[k, 2] * rods[rod, 5]
            gap = x[k] + ball - rods[rod, k] - swing[rod // 2, k]
            b[rod, k], s[rod, k] = ball, gap
            square += gap * gap
        system[rod, 6] = square - rods[rod, 6] ** 2
        most = max(most, abs(system[rod, 6]))
    return most


@compiled()
def _settle(rods: Array, scratch: Scratch) -> bool:
    """Newton's method on the six closures from where x stands; whether it found a pose.

    d|s|^2 = 2 (s . dp + (b x s) . J dw), J = 1 + B [w]x + C [w]x^2 the left Jacobian of R(w).
    """
    _, _, s, b, system, _, x = scratch
    for _ in range(_POSE_STEPS):
        _close(rods, scratch)
        _, by, cy = _coefficients(x)
        for i in range(6):
            cross = _cross(b[i, 0], b[i, 1], b[i, 2], s[i, 0], s[i, 1], s[i, 2])
            once = _cross(cross[0], cross[1], cross[2], x[3], x[4], x[5])
            twice = _cross(once[0], once[1], once[2], x[3], x[4], x[5])
            for k in range(3):
                system[i, k] = 2 * s[i, k]
                system[i, 3 + k] = 2 * (cross[k] + by * once[k] + cy * twice[k])
        if not _solve(system, 6, 1):
            return False
        step = 0.0
        for k in range(6):
            x[k] -= system[k, 6]
            step += abs(system[k, 6])
        if not step < np.inf:
            return False
        if step <= _POSE_STEP:
            break
    return _close(rods, scratch) < _STRAY


@compiled()
def _pose(legs: Array, rods: Array, q: Array, scratch: Scratch) -> bool:
    """Bring the platform to joints q (3,) [rad]; False and NaN where that cannot be."""
    _swing(legs, q, scratch)
    _meet(legs, scratch)
    x = scratch[6]
    found = bool(np.isfinite(x[0] + x[1] + x[2]))
    if len(rods) == 0:
        _rotate(scratch)
    elif found:
        found = _settle(rods, scratch)
    if not found:
        for k in range(6):
            x[k] = np.nan
    return found


@compiled()
def _stands(offset: Array, scratch: Scratch) -> tuple[float, float, float]:
    """R o: the tool seen from the platform's centre, in the base [m]."""
    r, (x, y, z) = scratch[5], (offset[0], offset[1], offset[2])
    return (
        r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@compiled()
def _point(
    legs: Array, rods: Array, offset: Array, q: Array, out: Array, scratch: Scratch
) -> bool:
    """p + R o at joints q, into out (3,) [m]."""
    found = _pose(legs, rods, q, scratch)
    stands = _stands(offset, scratch)
    for k in range(3):
        out[k] = scratch[6][k] + stands[k]
    return found


@compiled()
def _slope(
    legs: Array, rods: Array, offset: Array, q: Array, out: Array, scratch: Scratch
) -> bool:
    """d(tool point)/dq at joints q into out (3, 3) [m/rad]."""
    found = _pose(legs, rods, q, scratch)
    return _slope_here(legs, rods, offset, found, out, scratch)


@compiled()
def _slope_here(
    legs: Array, rods: Array, offset: Array, found: bool, out: Array, scratch: Scratch
) -> bool:
    """d(tool point)/dq = dp + omega x R o where the platform stands, if its pose was found.

    s . dp + (b x s) . omega = s . de for each rod, with de the motion of its elbow. A platform
    that only translates has one rod a leg, from the sphere's centre, and no omega.
    """
    swing, turn, s, b, system, _, x = scratch
    size = 6 if len(rods) else 3
    for i in range(size):
        leg = i * 3 // size
        for k in range(3):
            if size == 3:
                s[i, k] = x[k] - legs[i, k] - swing[i, k]
            system[i, k], system[i, size + k] = s[i, k], 0.0
        along = s[i, 0] * turn[leg, 0] + s[i, 1] * turn[leg, 1] + s[i, 2] * turn[leg, 2]
        if size == 6:
            cross = _cross(b[i, 0], b[i, 1], b[i, 2], s[i, 0], s[i, 1], s[i, 2])
            system[i, 3], system[i, 4], system[i, 5] = cross
        system[i, size + leg] = along
    found = found and _solve(system, size, 3)
    ox, oy, oz = _stands(offset, scratch)
    for joint in range(3):
        dx, dy, dz = 0.0, 0.0, 0.0
        if size == 6:
            wx, wy, wz = system[3, 6 + joint], system[4, 6 + joint], system[5, 6 + joint]
            dx, dy, dz = _cross(wx, wy, wz, ox, oy, oz)
        out[0, joint] = system[0, size + joint] + dx if found else np.nan
        out[1, joint] = system[1, size + joint] + dy if found else np.nan
        out[2, joint] = system[2, size + joint] + dz if found else np.nan
    return found


@compiled()
def _decompose(slope: Array, a: Array) -> tuple[float, float]:
    """One-sided Jacobi: turn the columns of J (3, 3) until they are perpendicular.

    Puts U S over V, with J = U S V^T, into a (6, 3); returns the largest and the smallest singular
    value. Accurate for small ones too, which the roots of J^T J are not.
    """
    for i in range(3):
        for j in range(3):
            a[i, j], a[3 + i, j] = slope[i, j], 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        most = 0.0
        for i in range(2):
            for j in range(i + 1, 3):
                ii, jj, ij = 0.0, 0.0, 0.0
                for k in range(3):
                    ii += a[k, i] * a[k, i]
                    jj += a[k, j] * a[k, j]
                    ij += a[k, i] * a[k, j]
                if ij == 0.0:
                    continue
                most = max(most, abs(ij) / np.sqrt(ii * jj))
                ratio = (jj - ii) / (2 * ij)
                tangent = 1 / (abs(ratio) + np.sqrt(1 + ratio * ratio))
                tangent = tangent if ratio > 0 else -tangent
                cosine = 1 / np.sqrt(1 + tangent * tangent)
                for k in range(6):
                    left, right = a[k, i], a[k, j]
                    a[k, i] = cosine * (left - tangent * right)
                    a[k, j] = cosine * (right + tangent * left)
        if most <= _ORTHOGONAL:
            break
    largest, smallest = 0.0, np.inf
    for j in range(3):
        length = np.sqrt(a[0, j] ** 2 + a[1, j] ** 2 + a[2, j] ** 2)
        largest, smallest = max(largest, length), min(smallest, length)
    return largest, smallest


@compiled()
def _distance(
    legs: Array, rods: Array, offset: Array, q: Array, target: Array, gap: Array, scratch: Scratch
) -> float:
    """Distance of the tool from the target [m], inf without a pose; the way it is off in gap."""
    if not _point(legs, rods, offset, q, gap, scratch):
        return np.inf
    for k in range(3):
        gap[k] -= target[k]
    return float(np.sqrt(gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2))


# --- all samples ---------------------------------------------------------------------------------

_GEOMETRY = "f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1]"  # legs, rods, offset, q


@compiled(f"Tuple((f8[:, ::1], f8[:, ::1]))({_GEOMETRY})")
def points(legs: Array, rods: Array, offset: Array, q: Array) -> tuple[Array, Array]:
    """Tool points (n, 3) [m] and poses x (n, 6) [m, rad] at joints q (n, 3) [rad]."""
    out, pose, scratch = np.empty((len(q), 3)), np.empty((len(q), 6)), _scratch()
    for row in range(len(q)):
        _point(legs, rods, offset, q[row], out[row], scratch)
        for k in range(6):
            pose[row, k] = scratch[6][k]
    return out, pose


@compiled(f"Tuple((f8[:, :, ::1], f8[:, ::1]))({_GEOMETRY})")
def jacobians(legs: Array, rods: Array, offset: Array, q: Array) -> tuple[Array, Array]:
    """d(tool point)/dq (n, 3, 3) [m/rad] and its largest and smallest singular value (n, 2).

    Both values are 0 where there is no Jacobian.
    """
    out, gains = np.empty((len(q), 3, 3)), np.zeros((len(q), 2))
    scratch, a = _scratch(), np.empty((6, 3))
    for row in range(len(q)):
        if _slope(legs, rods, offset, q[row], out[row], scratch):
            gains[row, 0], gains[row, 1] = _decompose(out[row], a)
    return out, gains
