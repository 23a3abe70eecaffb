"""From a nominal joint command to the one that puts the tool where the nominal robot meant it.

For a nominal command q the target is p* = FK_nominal(q); the answer is q + dq with FK_identified(q
+ dq) = p*. Every path to it is guarded: a command that fails a guard gets no correction, and the
reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation.apso import Apso, ApsoSettings
from delta_calibration.compensation.base import Compensator, Correction, Flags
from delta_calibration.compensation.compiled import CompiledGeometry, CompiledNewton, available
from delta_calibration.compensation.newton import Newton, NewtonSettings
from delta_calibration.errors import InputError
from delta_calibration.samples import at_rest

Array = NDArray[np.float64]

METHODS = ("apso", "newton")
_REACHED = 1e-6  # [m] by the model; a correction that ends farther off is none


class Verdict(Enum):
    """What became of a command; the value is the reason in words."""

    CORRECTED = "corrected"
    NOT_FINITE = "a joint angle is not a finite number"
    JOINT_LIMIT = "beyond a joint's limit, as commanded or as corrected"
    OUT_OF_REACH = "no pose of the nominal robot"
    OUTSIDE_REGION = "outside the calibrated region"
    SINGULAR = "near a singularity"
    NOT_REACHED = "no correction within the bound reaches the target"


@dataclass(frozen=True)
class Compensated:
    """Corrected commands, and what became of each."""

    joint: Array  # (n, m) [rad] what to send: q + dq, or q where there is no correction
    correction: Array  # (n, m) [rad]
    # (n,) [m] distance to the target *by the model*; infinite without correction
    model_error: Array
    evaluations: NDArray[np.int64]  # (n,) of the model
    verdicts: tuple[Verdict, ...]  # (n,)

    @classmethod
    def joined(cls, parts: Sequence[Compensated]) -> Compensated:
        """Commands one after the other, in one."""
        return cls(
            joint=np.concatenate([part.joint for part in parts]),
            correction=np.concatenate([part.correction for part in parts]),
            model_error=np.concatenate([part.model_error for part in parts]),
            evaluations=np.concatenate([part.evaluations for part in parts]),
            verdicts=tuple(verdict for part in parts for verdict in part.verdicts),
        )


class JointCompensator:
    """Corrects joint commands by an identified chain; no state: same command, same answer."""

    def __init__(
        self,
        calibration: Calibration,
        method: str = "newton",
        seed: int = 0,
        *,
        compiled: bool = False,
    ) -> None:
        """From a calibration; `method` is one of `METHODS`, `seed` that of the swarm.

        With `compiled` the geometry is compiled, or loaded from where an earlier process left it,
        before this returns: the same answers to 1e-10 rad, much sooner for single commands. The
        property `compiled` says whether it came to that.

        Raises:
            InputError: no such method.
        """
        if method not in METHODS:
            raise InputError(f"no method {method!r}; choose from: {', '.join(METHODS)}")
        self.calibration = calibration
        self.robot = calibration.robot
        self.method = method
        self._nominal = self.robot.model("rotary_delta")
        mechanism, tool = calibration.chain.mechanism, self.robot.tool_offset
        self._fast = self._fast_nominal = None
        if compiled and available(mechanism):
            self._fast = CompiledGeometry(mechanism, calibration.geometry, tool)
            self._fast_nominal = CompiledGeometry(
                self._nominal, self._nominal.parameters.nominal, tool
            )
        self._solver = self._make_solver(seed)

    @property
    def compiled(self) -> bool:
        """Whether compiled functions do the work: asked for, and there for this mechanism."""
        return self._fast is not None

    def warm_up(self) -> None:
        """Take the first command's delay now: compensate one at home and forget it."""
        self.compensate(self._nominal.home[None])

    def targets(self, q: Array) -> Array:
        """Tool points the nominal robot means by the commands, (n, 3) [m]; NaN without a pose."""
        if self._fast_nominal is not None:
            return self._fast_nominal.point(q)
        return self._nominal.forward(q, self._nominal.parameters.nominal) + self.robot.tool_offset

    def point(self, q: Array) -> Array:
        """Tool points of the identified robot, (..., m) -> (..., 3) [m]; NaN without a pose."""
        if self._fast is not None:
            return self._fast.point(q)
        flat = q.reshape(-1, q.shape[-1])
        chain = self.calibration.chain
        x = chain.pose(at_rest(flat), self.calibration.theta)
        point = chain.point(x, self.robot.tool_offset)
        return point.reshape((*q.shape[:-1], 3))

    def jacobian(self, q: Array) -> Array:
        """d(tool point)/dq of the identified robot, (..., m) -> (..., 3, m) [m/rad]."""
        if self._fast is not None:
            return self._fast.jacobian(q)
        flat = q.reshape(-1, q.shape[-1])
        chain, geometry = self.calibration.chain, self.calibration.geometry
        x = chain.pose(at_rest(flat), self.calibration.theta)
        slope = chain.point_by_pose(x, self.robot.tool_offset)
        slope = slope @ chain.mechanism.velocity_jacobian(flat, x, geometry)
        return slope.reshape((*q.shape[:-1], 3, q.shape[-1]))

    def compensate(self, q: Array) -> Compensated:
        """Correct commands, (n, m) [rad].

        Raises:
            InputError: q is of another shape.
        """
        joints = len(self.robot.joints.names)
        if q.ndim != 2 or q.shape[1] != joints:
            raise InputError(f"commands have shape {q.shape}; it has to be (n, {joints})")
        target = self.targets(np.where(np.isfinite(q), q, 0.0))
        verdicts = self._guard(q, target)
        usable = np.array([verdict is Verdict.CORRECTED for verdict in verdicts], dtype=bool)
        found = Correction.none(0, q.shape[1])
        if usable.any():
            found = self._solver.correct(q[usable], target[usable])
        whole = found.spread(usable)
        reached = usable & (whole.error <= _REACHED)
        within = self._within(q + whole.dq)
        good = reached & within
        correction = np.where(good[:, None], whole.dq, 0.0)
        for row in np.flatnonzero(usable & ~good):
            verdicts[row] = Verdict.JOINT_LIMIT if reached[row] else Verdict.NOT_REACHED
        error = np.where(good, whole.error, np.inf)
        return Compensated(q + correction, correction, error, whole.evaluations, tuple(verdicts))

    def _make_solver(self, seed: int) -> Compensator:
        bound = self.robot.limits.correction
        if self.method == "apso":
            return Apso(self.point, ApsoSettings(bound_rad=bound, seed=seed))
        settings = NewtonSettings(bound_rad=bound)
        if self._fast is not None:
            return CompiledNewton(self._fast, settings)
        return Newton(self.point, self.jacobian, settings)

    def _guard(self, q: Array, target: Array) -> list[Verdict]:
        """The first guard that each command fails, `CORRECTED` where it passes all."""
        limits = self.robot.limits
        finite, reached = _finite(q), _finite(target)
        known = np.where(reached[:, None], target, 0.0)
        x = known - self.robot.tool_offset
        covered = np.asarray(self.calibration.region.outside(x) <= limits.region_margin)
        safe = np.where((finite & reached)[:, None], q, self._nominal.home)
        regular = np.asarray(self._condition(safe, x) <= limits.condition)
        checks = [
            (finite, Verdict.NOT_FINITE),
            (self._within(q), Verdict.JOINT_LIMIT),
            (reached, Verdict.OUT_OF_REACH),
            (covered, Verdict.OUTSIDE_REGION),
            (regular, Verdict.SINGULAR),
        ]
        return [
            next((verdict for passed, verdict in checks if not passed[row]), Verdict.CORRECTED)
            for row in range(len(q))
        ]

    def _condition(self, q: Array, x: Array) -> Array:
        """`Mechanism.condition` of the nominal robot, (n,)."""
        if self._fast_nominal is not None:
            return self._fast_nominal.condition(q)
        return self._nominal.condition(q, x, self._nominal.parameters.nominal)

    def _within(self, q: Array) -> Flags:
        """Commands within the joints' limits, (n,)."""
        joints = self.robot.joints
        return np.asarray(((q >= joints.lower) & (q <= joints.upper)).all(axis=1))


def _finite(rows: Array) -> Flags:
    return np.asarray(np.isfinite(rows).all(axis=1))
