"""Rotation vectors, their matrices, Jacobians and quaternions, for many samples at once.

A rotation vector w (..., 3) [rad] rotates by |w| about its own direction; R(w) = exp([w]x).
`skew`, `exp` and the Jacobians consist of analytic operations only, so that complex-step
derivatives are possible.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

# squared angle [rad^2] under which the three coefficients are computed by their series
_SERIES_BELOW = 1e-4


def skew(v: NDArray[Any]) -> NDArray[Any]:
    """Matrix of the cross product: skew(v) @ u = v x u.  (..., 3) -> (..., 3, 3)."""
    v = np.asarray(v)
    matrix = np.zeros((*v.shape, 3), dtype=v.dtype)
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    return matrix - np.swapaxes(matrix, -1, -2)


_CROSS = skew(np.eye(3))  # [e_j]x


def _coefficients(w: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3 with t = |w|, each (..., 1, 1) or a number."""
    t2 = w @ w if np.ndim(w) == 1 else np.sum(w * w, axis=-1)[..., None, None]
    small = np.abs(t2) < _SERIES_BELOW
    a = 1 - t2 / 6 + t2**2 / 120 - t2**3 / 5040
    b = 0.5 - t2 / 24 + t2**2 / 720 - t2**3 / 40320
    c = 1 / 6 - t2 / 120 + t2**2 / 5040
    if np.all(small):  # the usual case: tilts of machines are about a milliradian
        return a, b, c
    safe = np.where(small, 1.0, t2)
    t = np.sqrt(safe)
    a = np.where(small, a, np.sin(t) / t)
    b = np.where(small, b, (1 - np.cos(t)) / safe)
    c = np.where(small, c, (t - np.sin(t)) / (safe * t))
    return a, b, c


def exp(w: NDArray[Any]) -> NDArray[Any]:
    """Rotation matrix of a rotation vector (Rodrigues).  (..., 3) [rad] -> (..., 3, 3)."""
    a, b, _ = _coefficients(w)
    k = skew(w)
    return np.asarray(np.eye(3) + a * k + b * (k @ k))


def exp_with_derivative(w: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """R(w) and dR[i, j]/dw[k] of one rotation vector.  (3,) [rad] -> (3, 3), (3, 3, 3)."""
    rotation, right = _with_right_jacobian(w)
    by_column = -rotation @ _CROSS @ right  # of R e_j, (j, i, k)
    return rotation, np.ascontiguousarray(by_column.transpose(1, 0, 2))


def _with_right_jacobian(w: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    a, b, c = _coefficients(w)
    k = skew(w)
    k2 = k @ k
    return np.eye(3) + a * k + b * k2, np.eye(3) - b * k + c * k2


def left_jacobian(w: NDArray[Any]) -> NDArray[Any]:
    """J with dR = [J dw]x R: small rotation, in fixed axes, for a change of w.  -> (..., 3, 3)."""
    _, b, c = _coefficients(w)
    k = skew(w)
    return np.asarray(np.eye(3) + b * k + c * (k @ k))


def log(rotation: Array) -> Array:
    """Rotation vector of a rotation matrix, |w| <= pi.  (..., 3, 3) -> (..., 3) [rad]."""
    flat = np.asarray(rotation, dtype=float).reshape(-1, 3, 3)
    return np.asarray(Rotation.from_matrix(flat).as_rotvec()).reshape(rotation.shape[:-1])


def to_quaternion(rotation: Array) -> Array:
    """Unit quaternion x y z w (ROS order).  (..., 3, 3) -> (..., 4)."""
    flat = np.asarray(rotation, dtype=float).reshape(-1, 3, 3)
    return np.asarray(Rotation.from_matrix(flat).as_quat()).reshape((*rotation.shape[:-2], 4))


def from_quaternion(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion x y z w of any nonzero length.  (..., 4) -> (..., 3, 3)."""
    flat = np.asarray(quaternion, dtype=float).reshape(-1, 4)
    return np.asarray(Rotation.from_quat(flat).as_matrix()).reshape((*quaternion.shape[:-1], 3, 3))


def about_z(angle: ArrayLike) -> Array:
    """Rotation matrix about z.  (...,) [rad] -> (..., 3, 3)."""
    turn = np.asarray(angle, dtype=float)
    return exp(np.stack([np.zeros_like(turn), np.zeros_like(turn), turn], axis=-1))


def roll_pitch_yaw(rotation: Array) -> Array:
    """Roll, pitch, yaw: successive angles about the fixed x, y, z axes, (3, 3) -> (3,) [rad].

    They are also the angles about the moving z, y and x axes, in the order yaw, pitch, roll. In
    gimbal lock (x vertical) roll and yaw are about the same axis; roll then follows from yaw.
    """
    m = rotation
    yaw = np.arctan2(m[1, 0], m[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-m[2, 0], c * m[0, 0] + s * m[1, 0])
    roll = np.arctan2(s * m[0, 2] - c * m[1, 2], c * m[1, 1] - s * m[0, 1])
    return np.array([roll, pitch, yaw])
