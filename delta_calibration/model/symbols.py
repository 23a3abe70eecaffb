"""The vocabulary in which laws are written: functions of symbols, for one sample.

Scalars and vectors here are expressions of CasADi (Andersson et al., "CasADi: a software framework
for nonlinear optimization and optimal control", Math. Prog. Comp. 11 (2019) 1). A law is evaluated
on them once, when its code is generated; CasADi is loaded only then.

Vectors are columns, `v[i]` is their entry; `+ - * /` work by entry, `@` multiplies matrices.
"""

from __future__ import annotations

from importlib import import_module
from math import factorial, pi
from typing import Any

Symbol = Any  # a CasADi expression, or a number

LITTLE = 0.03  # [rad] largest rotation that `little` is for
_TERMS_LITTLE = 3  # of its series: off by less than 2e-17
_TERMS = 6  # of the series of a small rotation: exact to rounding up to 0.5 rad
_TINY = 1e-300  # added to a square, so that its root has a derivative at 0


def _casadi() -> Any:
    return import_module("casadi")


def column(*entries: Symbol) -> Symbol:
    """The vector of these entries."""
    return _casadi().vertcat(*entries)


def rows(*vectors: Symbol) -> Symbol:
    """The matrix whose rows are these vectors."""
    return _casadi().horzcat(*vectors).T


def sin(x: Symbol) -> Symbol:
    """Sine of an angle [rad]."""
    return _casadi().sin(x)


def cos(x: Symbol) -> Symbol:
    """Cosine of an angle [rad]."""
    return _casadi().cos(x)


def acos(x: Symbol) -> Symbol:
    """Arc cosine [rad]; NaN beyond -1 .. 1."""
    return _casadi().acos(x)


def atan2(y: Symbol, x: Symbol) -> Symbol:
    """Angle of the point (x, y) [rad]."""
    return _casadi().atan2(y, x)


def sqrt(x: Symbol) -> Symbol:
    """Square root; NaN below 0."""
    return _casadi().sqrt(x)


def exp(x: Symbol) -> Symbol:
    """The exponential function."""
    return _casadi().exp(x)


def tanh(x: Symbol) -> Symbol:
    """Hyperbolic tangent."""
    return _casadi().tanh(x)


def sign(x: Symbol) -> Symbol:
    """Sign of x: -1, 0 or 1."""
    return _casadi().sign(x)


def absolute(x: Symbol) -> Symbol:
    """Absolute value of x."""
    return _casadi().fabs(x)


def minimum(x: Symbol, y: Symbol) -> Symbol:
    """The smaller of two values."""
    return _casadi().fmin(x, y)


def maximum(x: Symbol, y: Symbol) -> Symbol:
    """The larger of two values."""
    return _casadi().fmax(x, y)


def floor(x: Symbol) -> Symbol:
    """The largest whole number that is not above x."""
    return _casadi().floor(x)


def where(condition: Symbol, yes: Symbol, no: Symbol) -> Symbol:
    """`yes` where the condition holds, else `no`; both are evaluated and must be finite."""
    return _casadi().if_else(condition, yes, no)


def matrix(entries: Symbol, width: int) -> Symbol:
    """The matrix of `width` columns with these entries, row by row."""
    return _casadi().reshape(entries, width, entries.shape[0] // width).T


def dot(a: Symbol, b: Symbol) -> Symbol:
    """Inner product of two vectors."""
    return _casadi().dot(a, b)


def square(a: Symbol) -> Symbol:
    """Squared length of a vector."""
    return dot(a, a)


def norm(a: Symbol) -> Symbol:
    """Length of a vector; its derivative is NaN at 0."""
    return sqrt(square(a))


def cross(a: Symbol, b: Symbol) -> Symbol:
    """Cross product of two vectors of three entries."""
    return _casadi().cross(a, b)


def about_z(cosine: Symbol, sine: Symbol) -> Symbol:
    """Rotation about z by the angle of this cosine and sine, (3, 3)."""
    return rows(column(cosine, -sine, 0), column(sine, cosine, 0), column(0, 0, 1))


def _series(square_: Symbol, terms: int) -> tuple[Symbol, Symbol]:
    """sin(t)/t and (1 - cos t)/t^2 by t^2: power series, smooth at 0 and without a branch."""
    a, b = 1 / factorial(2 * terms + 1), 1 / factorial(2 * terms + 2)
    for k in reversed(range(terms)):
        a = 1 / factorial(2 * k + 1) - square_ * a
        b = 1 / factorial(2 * k + 2) - square_ * b
    return a, b


def little(angle: Symbol) -> tuple[Symbol, Symbol]:
    """Cosine and sine of an angle up to `LITTLE` [rad], by products and sums alone."""
    square_ = angle * angle
    a, b = _series(square_, _TERMS_LITTLE)
    return 1 - square_ * b, a * angle


def tilt(w: Symbol) -> Symbol:
    """Rotation matrix of a small rotation vector [rad], up to half a radian: a part's tilt."""
    return _rotation(w, *_series(square(w), _TERMS))


def rotation(w: Symbol) -> Symbol:
    """Rotation matrix of a rotation vector [rad] (Rodrigues)."""
    a, cosine = _half_turn(w)
    return _rotation(w, a * cosine, a * a / 2)


def _rotation(w: Symbol, a: Symbol, b: Symbol) -> Symbol:
    casadi = _casadi()
    k = casadi.skew(w)
    return casadi.SX.eye(3) + a * k + b * (k @ k)


def _half_turn(w: Symbol) -> tuple[Symbol, Symbol]:
    """sin(t)/t and cos t, where t is half the length of a rotation vector w.

    Their derivatives are off by rounding over t, but are multiplied by w, whose length is 2 t.
    """
    half = sqrt(square(w) + _TINY) / 2
    return sin(half) / half, cos(half)


def quaternion(w: Symbol) -> Symbol:
    """Unit quaternion (scalar first) of a rotation vector [rad]."""
    a, cosine = _half_turn(w)
    return column(cosine, a * w / 2)


def quaternion_product(a: Symbol, b: Symbol) -> Symbol:
    """Product of quaternions: the rotation b, then a; both scalar first."""
    s, t, u, v = a[0], b[0], a[1:4], b[1:4]
    return column(s * t - dot(u, v), s * v + t * u + cross(u, v))


def rotation_vector(q: Symbol) -> Symbol:
    """Rotation vector [rad], at most pi long, of a unit quaternion (scalar first)."""
    length = square(q[1:4])
    small = length < 1e-24
    sine = sqrt(where(small, 1.0, length))
    half = atan2(sine, q[0] * where(q[0] < 0, -1.0, 1.0))
    factor = where(small, 2.0, 2 * half / sine)
    return factor * where(q[0] < 0, -1.0, 1.0) * q[1:4]


def wrapped(angle: Symbol) -> Symbol:
    """The angle of the same direction in (-pi, pi] [rad]."""
    return angle + 2 * pi * floor((pi - angle) / (2 * pi))
