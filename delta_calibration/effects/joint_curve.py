"""An error of each joint that is any smooth function of its own angle.

dq_j = sum_f w_jf B_f(q_j)        B: cubic B-splines, evenly spaced over the joint's range

Whatever gears and encoders do that comes back with the angle lies in it, at every frequency down
to two widths: runout, teeth, a wave generator, an encoder's own curve. It says which joint errs
and how, not which part of it. With so many weights it wants hundreds of poses, and is tried where
asked for; it is not among what every machine is tried with.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar

import numpy as np
from scipy.interpolate import BSpline

from delta_calibration.effects.base import SPREAD, Array, Effect, Limits, Stage
from delta_calibration.mechanisms import Mechanism
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions

_DEGREE = 3


@dataclass(frozen=True)
class JointCurve(Effect):
    """Error curves of all joints over their ranges; `lower`, `upper` (m,) in a row.

    Outside its range a curve is taken to be nothing.
    """

    cause: ClassVar[str] = "joint_error_curve"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    limits: ClassVar[Limits] = {"width": (1e-4, 10.0), "size": (1e-7, 1e-1)}

    width: float = 0.07  # [rad] between splines
    size: float = 0.15e-3  # [rad] expected of a weight
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()

    @classmethod
    def over(cls, robot: Robot, mechanism: Mechanism, joint: Array, width: float) -> JointCurve:
        """Of joints that were seen at these angles (n, m) [rad]."""
        low, high = joint.min(axis=0), joint.max(axis=0)
        return cls(
            robot, mechanism, width, lower=tuple(low.tolist()), upper=tuple(high.tolist())
        )

    @property
    def parameters(self) -> ParameterSet:
        """Weights [rad] of each joint's splines."""
        return _weights(tuple(len(k) - _DEGREE - 1 for k in self._knots()), self.size / SPREAD)

    def columns(self, at: Conditions) -> Array:
        """(n, m, sum of the joints' splines)."""
        knots = list(self._knots())
        ends = np.cumsum([0, *(len(k) - _DEGREE - 1 for k in knots)]).tolist()
        columns = np.zeros((*at.joint.shape, ends[-1]))
        for j, (k, (begin, end)) in enumerate(zip(knots, pairwise(ends), strict=True)):
            angle = at.joint[:, j]
            known = (angle >= self.lower[j]) & (angle <= self.upper[j])
            inside = np.clip(angle, self.lower[j], self.upper[j])
            design = BSpline.design_matrix(inside, k, _DEGREE).toarray()
            columns[:, j, begin:end] = known[:, None] * design
        return columns

    def wrong(self) -> str:
        """A range for each joint."""
        m = self.mechanism.joints
        for name, value in (("lower", self.lower), ("upper", self.upper)):
            if len(value) != m or not np.isfinite(value).all():
                return f"{name}: {list(value)} is not allowed; {m} finite numbers, one a joint"
        if not (np.array(self.upper) > np.array(self.lower)).all():
            return f"upper: {list(self.upper)} is not allowed; each over lower {list(self.lower)}"
        return super().wrong()

    def _knots(self) -> Iterator[Array]:
        """Of each joint, evenly spaced, three beyond either end."""
        for low, high in zip(self.lower, self.upper, strict=True):
            inner = np.linspace(low, high, max(2, int(np.ceil((high - low) / self.width)) + 1))
            step = inner[1] - inner[0]
            beyond = step * np.arange(1, _DEGREE + 1)
            yield np.concatenate([low - beyond[::-1], inner, high + beyond])


@lru_cache
def _weights(counts: tuple[int, ...], prior: float) -> ParameterSet:
    """Of each joint's splines; there are many, and they are asked for often."""
    return ParameterSet(
        tuple(
            Parameter(f"curve_{j}_{f}", "rad", 0.0, prior, JointCurve.cause, f"joint_{j}")
            for j, count in enumerate(counts, start=1)
            for f in range(1, count + 1)
        )
    )
