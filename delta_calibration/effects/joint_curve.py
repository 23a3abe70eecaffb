"""Joint error curve: the error of each joint as any smooth function of its own angle.

dq_j = sum_f w_jf B_f(q_j)        B: cubic B-splines, evenly spaced over the joint's range

It includes every error of gears and encoders that repeats with the joint angle, down to periods
of two widths: runout, teeth, a wave generator, an encoder's own curve. It shows which joint has an
error and its shape, but not which part causes it. With so many weights it needs hundreds of poses;
it is tried on serial arms, whose joints turn far, if the session has enough readings for its
weights.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import SPREAD, Array, Effect, Limits, Stage
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import JOINT, Places
from delta_calibration.effects.usual import Usual
from delta_calibration.mechanisms import Mechanism, SerialArm
from delta_calibration.model.symbols import Symbol, maximum, minimum, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import Robot

_DEGREE = 3
_WIDTH, _SIZE = 0.07, 0.15e-3  # [rad of a Delta] spacing of the splines, size of a weight
_WIDTHS = (1.0, 3.0)  # widths to try, in usual widths
_READINGS = 2.0  # least number of measured coordinates per weight


@dataclass(frozen=True)
class JointCurve(Effect):
    """Error curves of all joints over their ranges; `lower`, `upper` (m,) in a row.

    Outside its range a curve is zero. If no range is given, the robot's joint limits are used.
    """

    cause: ClassVar[str] = "joint_error_curve"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "joint",
        "compensate with the error curve of the joint",
        "measure the joint alone against a reference encoder",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    free_form: ClassVar[bool] = True
    limits: ClassVar[Limits] = {"width": (1e-4, 10.0), "size": (1e-7, 1e-1)}
    of_joints: ClassVar[tuple[str, ...]] = ("width", "size")

    # in the joints' unit
    width: Usual = Usual(_WIDTH)  # between splines
    size: Usual = Usual(_SIZE)  # expected of a weight
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()

    @classmethod
    def over(cls, robot: Robot, mechanism: Mechanism, joint: Array, width: float) -> JointCurve:
        """Curve over the range of these joint coordinates (n, m); `width` is in the same unit."""
        low, high = joint.min(axis=0), joint.max(axis=0)
        return cls(robot, mechanism, width, lower=tuple(low.tolist()), upper=tuple(high.tolist()))

    @property
    def suits(self) -> bool:
        """Whether it is a serial arm."""
        return isinstance(self.mechanism, SerialArm)

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Itself if it has a range; else over the session's range, as finely as readings allow."""
        if self.lower:
            yield self
            return
        if not len(at) or not (np.ptp(at.joint, axis=0) > 0).all():
            return
        for times in _WIDTHS:
            width = times * _WIDTH * self.mechanism.joint_size
            curve = JointCurve.over(self.robot, self.mechanism, at.joint, width)
            if 3 * len(at) >= _READINGS * len(curve.parameters):
                yield curve

    @property
    def parameters(self) -> ParameterSet:
        """Weights of each joint's splines, in the joints' unit."""
        counts = tuple(len(k) - _DEGREE - 1 for k in self._knots())
        mechanism = self.mechanism
        return _weights(counts, self.size / SPREAD, mechanism.joint_unit, mechanism.limb)

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """w B(q) of one spline within the joint's range; c: first knot, step, range."""
        first, step, lower, upper = c[0], c[1], c[2], c[3]
        inside = minimum(maximum(s[0], lower), upper)
        known = where(s[0] >= lower, where(s[0] <= upper, 1.0, 0.0), 0.0)
        return v[0] * known * _spline((inside - first) / step)

    def terms(self, places: Places) -> Iterator[Term]:
        """One term for each spline of each joint."""
        row, joint = 0, places.begin(JOINT)
        for j, knots in enumerate(self._knots()):
            step = float(knots[1] - knots[0])
            for first in knots[: len(knots) - _DEGREE - 1].tolist():
                constants = first, step, *self._range[j]
                reach = first, first + (_DEGREE + 1) * step
                yield Term((joint + j,), (row,), (j,), constants, reach)
                row += 1

    def wrong(self) -> str:
        """Check that the range, if given, has an interval for each joint."""
        m = self.mechanism.joints
        if not self.lower and not self.upper:
            return super().wrong()
        for name, value in (("lower", self.lower), ("upper", self.upper)):
            if len(value) != m or not np.isfinite(value).all():
                return f"{name}: {list(value)} is not allowed; {m} finite numbers, one a joint"
        if not (np.array(self.upper) > np.array(self.lower)).all():
            return f"upper: {list(self.upper)} is not allowed; each over lower {list(self.lower)}"
        return super().wrong()

    @property
    def _range(self) -> tuple[tuple[float, float], ...]:
        """Range of each joint."""
        limits = self.robot.joints
        lower = self.lower or tuple(limits.lower.tolist())
        return tuple(zip(lower, self.upper or tuple(limits.upper.tolist()), strict=True))

    def _knots(self) -> Iterator[Array]:
        """Knots of each joint, evenly spaced, three beyond either end."""
        for low, high in self._range:
            inner = np.linspace(low, high, max(2, int(np.ceil((high - low) / self.width)) + 1))
            step = inner[1] - inner[0]
            beyond = step * np.arange(1, _DEGREE + 1)
            yield np.concatenate([low - beyond[::-1], inner, high + beyond])


def _spline(u: Symbol) -> Symbol:
    """Cubic B-spline over the knots 0 to 4."""
    w = 2.0 - where(u < 2, 2.0 - u, u - 2.0)  # distance from the nearer end
    outer = maximum(w, 0.0) ** 3 / 6
    inner = maximum(w - 1.0, 0.0)
    return outer - 4.0 / 6.0 * inner**3


@lru_cache
def _weights(counts: tuple[int, ...], prior: float, unit: str, limb: str) -> ParameterSet:
    """Weights of each joint's splines; cached, as they are many and often requested."""
    return ParameterSet(
        tuple(
            Parameter(f"curve_{j}_{f}", unit, 0.0, prior, JointCurve.cause, f"{limb}_{j}")
            for j, count in enumerate(counts, start=1)
            for f in range(1, count + 1)
        )
    )
