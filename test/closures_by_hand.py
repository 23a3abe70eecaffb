"""Closures of all mechanisms written by hand in numpy: an independent second formulation.

The package writes each closure in symbols for one sample and generates its derivatives. Here they
are written for all samples at once, as arrays, with rotations of the package's `geometry` or
scipy's. The first five functions can be evaluated at complex arguments (derivatives by complex
step).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from delta_calibration.geometry import rotations
from delta_calibration.mechanisms import CableRobot, FiveAxis, Mechanism, SerialArm

Array = np.ndarray

FRAMES = rotations.about_z(2 * np.pi / 3 * np.arange(3))  # of the legs of a Delta
SIDES = np.array([-1.0, 1.0])  # of the rods of a leg


def rotary_delta(model: Mechanism, q: Array, x: Array, g: Array) -> Array:
    """Closure |x - e_i|^2 - l_i^2."""
    del model
    leg = _limbs(g, 3)
    elbow = _in_base(leg[..., 0:3] + _arm(q, leg[..., 3:5], leg[..., 5], leg[..., 6]))
    return np.sum((x[:, None] - elbow) ** 2, axis=-1) - leg[..., 7] ** 2


def six_rod_delta(model: Mechanism, q: Array, x: Array, g: Array) -> Array:
    """Closure |p + R a_ij - e_ij|^2 - l_ij^2."""
    del model
    leg = _limbs(g, 3)
    middle = leg[..., 0:3] + _arm(q, leg[..., 6:8], leg[..., 8], leg[..., 9])
    platform_line = _line(leg[..., 18:20])
    hinge = rotations.exp(_tilt(leg[..., 6:8]))
    kept = hinge @ rotations.exp(_tilt(leg[..., 16:18]))
    across = (kept @ _about_y(q + leg[..., 8], _line(leg[..., 20:22]))[..., None])[..., 0]
    turn = rotations.exp(x[:, None, 3:])
    gaps = []
    for j, side in enumerate(SIDES):
        elbow = _in_base(middle + side * leg[..., 12 + j, None] * across)
        ball = _in_base(leg[..., 3:6] + side * leg[..., 14 + j, None] * platform_line)
        rod = x[:, None, :3] + (turn @ ball[..., None])[..., 0] - elbow
        size = leg[..., 10] + side * leg[..., 11] / 2
        gaps.append(np.sum(rod**2, axis=-1) - size**2)
    return np.stack(gaps, axis=-1).reshape(len(x), 6)


def linear_delta(model: Mechanism, q: Array, x: Array, g: Array) -> Array:
    """Closure |x - c_i|^2 - L_i^2."""
    del model
    radius, angle, top, arm = g[..., 0:1], g[..., 1:4], g[..., 4:7], g[..., 7:10]
    out, aside = (g[..., 10:13], g[..., 13:16]) if g.shape[-1] > 10 else (0.0, 0.0)
    slant = np.sqrt(1 + out**2 + aside**2)
    far = (np.cos(angle) * out - np.sin(angle) * aside) * q / slant
    beside = (np.sin(angle) * out + np.cos(angle) * aside) * q / slant
    away = [
        x[:, 0:1] - radius * np.cos(angle) + far,
        x[:, 1:2] - radius * np.sin(angle) + beside,
        x[:, 2:3] - top + q / slant,
    ]
    return sum(part**2 for part in away) - arm**2


def five_axis(model: FiveAxis, q: Array, x: Array, g: Array) -> Array:
    """Closure |o + T_v t_v - s_v - q_v e_z|^2 - L_v^2."""
    strut = _limbs(g[..., :24], 4)
    a, b = x[:, 2:3], x[:, 3:4] * np.array([1.0, 1.0, 0.0, 0.0])
    t, s = strut[..., 0:3], strut[..., 3:6]
    along = np.cos(b) * t[..., 0] + np.sin(b) * t[..., 2]
    risen = np.cos(b) * t[..., 2] - np.sin(b) * t[..., 0]
    away = [
        along - s[..., 0],
        x[:, 0:1] + np.cos(a) * t[..., 1] - np.sin(a) * risen - s[..., 1],
        x[:, 1:2] + np.sin(a) * t[..., 1] + np.cos(a) * risen - s[..., 2] - q,
    ]
    return sum(part**2 for part in away) - g[..., 24:] ** 2


def cable_robot(model: CableRobot, q: Array, x: Array, g: Array) -> Array:
    """Closure |a_i - P - R b_i| - l_0i - k_i theta_i."""
    cable = _limbs(g, model.joints)
    body = model.pose_size == 6
    gain = cable[..., 6 if body else 3]
    zero = cable[..., -1] if model.free_zeros else 0.0

    def lengths(pose: Array) -> Array:
        turned = 0.0
        if body:
            turn = rotations.exp(pose[:, None, 3:])
            turned = (turn @ cable[..., 3:6, None])[..., 0]
        away = cable[..., :3] - pose[:, None, :3] - turned
        return np.sqrt(np.sum(away**2, axis=-1))

    return lengths(x) - lengths(model.dimensions.home[None]) - zero - gain * q


def serial_arm(model: SerialArm, q: Array, x: Array, g: Array) -> Array:
    """Closure (p - p_F, rotation vector of R(w) R_F^T); for real numbers only."""
    each = np.broadcast_to(g, (len(q), g.shape[-1]))
    return np.stack([_arm_misfit(model, *sample) for sample in zip(q, x, each, strict=True)])


BY_HAND: dict[str, Callable[..., Array]] = {
    "rotary_delta": rotary_delta,
    "six_rod_delta": six_rod_delta,
    "linear_delta": linear_delta,
    "five_axis": five_axis,
    "cable_robot": cable_robot,
    "serial_arm": serial_arm,
}


def placed(model: Mechanism, x: Array, offset: Array) -> Array:
    """Points fixed to the platform at `offset` (n, 3), in the base, (n, 3); x may be complex."""
    if model.name == "five_axis":
        a, b = x[:, 2], x[:, 3]
        along = np.cos(b) * offset[:, 0] + np.sin(b) * offset[:, 2]
        risen = np.cos(b) * offset[:, 2] - np.sin(b) * offset[:, 0]
        y = x[:, 0] + np.cos(a) * offset[:, 1] - np.sin(a) * risen
        return np.stack([along, y, x[:, 1] + np.sin(a) * offset[:, 1] + np.cos(a) * risen], axis=1)
    if model.pose_size == 3:
        return x + offset
    return x[:, :3] + (rotations.exp(x[:, 3:]) @ offset[..., None])[..., 0]


def walked(model: SerialArm, q: Array, g: Array) -> tuple[Array, Rotation]:
    """Position (3,) [m] and orientation of an arm's tool, link after link, by scipy."""
    value = dict(zip(model.parameters.names, g, strict=True))
    place, turn = np.zeros(3), Rotation.identity()
    for i, link in enumerate(model.dimensions.links, 1):
        turn = turn * Rotation.from_euler("X", value[f"twist_{i}"])
        if link.parallel:
            turn = turn * Rotation.from_euler("Y", value[f"skew_{i}"])
        place = place + turn.apply([value[f"length_{i}"], 0.0, 0.0])
        turn = turn * Rotation.from_euler("Z", q[i - 1] + value[f"zero_{i}"])
        offset = link.offset if link.parallel else value[f"offset_{i}"]
        place = place + turn.apply([0.0, 0.0, offset])
    place = place + turn.apply([value[f"tool_{axis}"] for axis in "xyz"])
    mounted = Rotation.from_euler("ZYX", model.dimensions.mount)
    crooked = Rotation.from_euler("XYZ", [value[f"tool_turn_{axis}"] for axis in "xyz"])
    return place, turn * mounted * crooked


def _arm_misfit(model: SerialArm, q: Array, x: Array, g: Array) -> Array:
    place, turn = walked(model, q, g)
    left = Rotation.from_rotvec(x[3:]) * turn.inv()
    return np.concatenate([x[:3] - place, left.as_rotvec()])


def _limbs(g: Array, count: int) -> Array:
    return g.reshape((*g.shape[:-1], count, g.shape[-1] // count))


def _in_base(vectors: Array) -> Array:
    """Vectors of three leg frames in the base.  (..., 3, 3) -> (..., 3, 3)."""
    return np.einsum("cij,...cj->...ci", FRAMES, vectors)


def _tilt(about: Array) -> Array:
    """Rotation vector of a tilt about x and z.  (..., 2) -> (..., 3)."""
    return np.stack([about[..., 0], 0 * about[..., 0], about[..., 1]], axis=-1)


def _arm(q: Array, tilt: Array, zero: Array, length: Array) -> Array:
    angle = q + zero
    ahead = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=-1)
    return (rotations.exp(_tilt(tilt)) @ (length[..., None] * ahead)[..., None])[..., 0]


def _about_y(angle: Array, v: Array) -> Array:
    """Vectors (..., 3), turned about y by an angle (...)."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack(np.broadcast_arrays(cosine * x + sine * z, y, cosine * z - sine * x), axis=-1)


def _line(about: Array) -> Array:
    return rotations.exp(_tilt(about))[..., :, 1]
