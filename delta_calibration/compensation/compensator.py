"""From a nominal joint command to the one that puts the tool where the nominal robot meant it.

For a nominal command q the target is p* = FK_nominal(q); the answer is the command that brings the
identified chain there, taken backward stage by stage:

    FK(q_b, g + S(c) v) = p*        the joint angles q_b behind the drives (APSO, Newton)
    q + dq + D(c) v = q_b           what the drives have to be told (a few fixed-point steps)

with c the conditions of the command. Measurement effects are the tracker's and do not enter. Every
path is guarded: a command that fails a guard gets no correction, and the reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation.apso import Apso, ApsoSettings
from delta_calibration.compensation.base import Compensator, Correction, Flags, joined
from delta_calibration.compensation.compiled import CompiledGeometry, CompiledNewton, available
from delta_calibration.compensation.newton import Newton, NewtonSettings
from delta_calibration.effects import Stage
from delta_calibration.errors import InputError
from delta_calibration.samples import Conditions, at_rest

Array = NDArray[np.float64]

METHODS = ("apso", "newton")
_REACHED = 1e-6  # [m] by the model; a correction that ends farther off is none
_DRIVE_STEPS, _DRIVE_SETTLED = 20, 1e-10  # [rad]


class Verdict(Enum):
    """What became of a command; the value is the reason in words."""

    CORRECTED = "corrected"
    NOT_FINITE = "a joint angle is not a finite number"
    JOINT_LIMIT = "beyond a joint's limit, as commanded or as corrected"
    OUT_OF_REACH = "no pose of the nominal robot"
    OUTSIDE_REGION = "outside the calibrated region"
    SINGULAR = "near a singularity"
    NOT_REACHED = "no correction within the bound reaches the target"
    MISSING_CONDITION = "a condition that the model needs is not known"


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
        self._seed, self._compile = seed, compiled
        self._nominal = self.robot.model("rotary_delta")
        self._drive = [pair for pair in calibration.live if pair[0].stage is Stage.DRIVE]
        self._structure = [pair for pair in calibration.live if pair[0].stage is Stage.STRUCTURE]
        self._fast_nominal: CompiledGeometry | None = None
        self._model = self._at_geometry(calibration.geometry)
        if self._model.fast is not None:
            nominal = self._nominal.parameters.nominal
            self._fast_nominal = CompiledGeometry(self._nominal, nominal, self.robot.tool_offset)

    @property
    def compiled(self) -> bool:
        """Whether compiled functions do the work: asked for, and there for this mechanism."""
        return self._model.fast is not None

    @property
    def needs_conditions(self) -> bool:
        """Whether the answer depends on more than the command: direction, payload, speed ..."""
        return bool(self._drive or self._structure)

    def missing(self, at: Conditions) -> str:
        """What of the conditions the model needs is not known; empty where all is.

        A joint that has not moved yet is on neither side of its play: the middle is right for it.
        """
        at = replace(at, direction=np.ones_like(at.direction))
        texts = (effect.missing(at) for effect, _ in self.calibration.live)
        return "; ".join(dict.fromkeys(text for text in texts if text))

    def warm_up(self) -> None:
        """Take the first command's delay now: compensate one at home and forget it."""
        self.compensate(self._nominal.home[None])

    def targets(self, q: Array) -> Array:
        """Tool points the nominal robot means by the commands, (n, 3) [m]; NaN without a pose."""
        if self._fast_nominal is not None:
            return self._fast_nominal.point(q)
        return self._nominal.forward(q, self._nominal.parameters.nominal) + self.robot.tool_offset

    def point(self, q: Array) -> Array:
        """Tool points of the identified geometry, (..., m) -> (..., 3) [m]; NaN without a pose."""
        return self._model.point(q)

    def jacobian(self, q: Array) -> Array:
        """d(tool point)/dq of the identified geometry, (..., m) -> (..., 3, m) [m/rad]."""
        return self._model.jacobian(q)

    def compensate(self, q: Array, at: Conditions | None = None) -> Compensated:
        """Correct commands, (n, m) [rad].

        Args:
            q: nominal commands.
            at: the conditions they are given under, (n); their joint angles are not used. Where
                none are given the joints stand still and nothing else is known.

        Raises:
            InputError: q is of another shape.
        """
        joints = len(self.robot.joints.names)
        if q.ndim != 2 or q.shape[1] != joints:
            raise InputError(f"commands have shape {q.shape}; it has to be (n, {joints})")
        known = np.where(np.isfinite(q), q, 0.0)
        at = at_rest(known) if at is None else replace(at, joint=known)
        target = self.targets(known)
        verdicts = self._guard(q, target)
        if self.needs_conditions and self.missing(at):
            verdicts = [_unless(v, Verdict.MISSING_CONDITION) for v in verdicts]
        usable = np.array([verdict is Verdict.CORRECTED for verdict in verdicts], dtype=bool)
        found = Correction.none(0, joints)
        if usable.any():
            found = self._correct(q[usable], target[usable], at.take(usable))
        whole = found.spread(usable)
        bound = self.robot.limits.correction
        reached = usable & (whole.error <= _REACHED) & (np.abs(whole.dq) <= bound).all(axis=1)
        within = self._within(q + whole.dq)
        good = reached & within
        correction = np.where(good[:, None], whole.dq, 0.0)
        for row in np.flatnonzero(usable & ~good):
            verdicts[row] = Verdict.JOINT_LIMIT if reached[row] else Verdict.NOT_REACHED
        error = np.where(good, whole.error, np.inf)
        return Compensated(q + correction, correction, error, whole.evaluations, tuple(verdicts))

    def _correct(self, q: Array, target: Array, at: Conditions) -> Correction:
        """Back through geometry and drives for usable commands."""
        if self._structure:
            shift = sum(effect.columns(at) @ value for effect, value in self._structure)
            rows = [
                self._at_geometry(self.calibration.geometry + row).solver.correct(
                    q[i : i + 1], target[i : i + 1]
                )
                for i, row in enumerate(np.asarray(shift))
            ]
            behind = joined(rows, q.shape[1])
        else:
            behind = self._model.solver.correct(q, target)
        return replace(behind, dq=self._before_drives(q + behind.dq, at) - q)

    def _before_drives(self, behind: Array, at: Conditions) -> Array:
        """What the drives have to be told for joints to stand at `behind`, (n, m) [rad]."""
        command = behind
        for _ in range(_DRIVE_STEPS if self._drive else 0):
            now = replace(at, joint=command)
            shift = sum(effect.columns(now) @ value for effect, value in self._drive)
            last, command = command, behind - np.asarray(shift)
            if np.abs(command - last).max(initial=0.0) < _DRIVE_SETTLED:
                break
        return command

    def _at_geometry(self, geometry: Array) -> _Geometry:
        """The ways to compensate a machine of one geometry."""
        return _Geometry(self.calibration, geometry, self.method, self._seed, self._compile)

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


def _unless(verdict: Verdict, other: Verdict) -> Verdict:
    """The other verdict for what would have been corrected."""
    return other if verdict is Verdict.CORRECTED else verdict


class _Geometry:
    """Model and solver at one geometry, compiled where that is wanted and can be had.

    Making a compiled one costs a fraction of a millisecond once the functions are loaded, so that
    a geometry that changes with temperature or payload is made anew for each command.
    """

    def __init__(
        self, calibration: Calibration, geometry: Array, method: str, seed: int, compiled: bool
    ) -> None:
        self._chain, self._geometry = calibration.chain, geometry
        self._tool = calibration.robot.tool_offset
        self.fast: CompiledGeometry | None = None
        if compiled and available(self._chain.mechanism):
            self.fast = CompiledGeometry(self._chain.mechanism, geometry, self._tool)
        self.solver = self._solver(method, calibration.robot.limits.correction, seed)

    def point(self, q: Array) -> Array:
        """Tool points, (..., m) -> (..., 3) [m]; NaN without a pose."""
        if self.fast is not None:
            return self.fast.point(q)
        flat = q.reshape(-1, q.shape[-1])
        x = self._chain.mechanism.forward(flat, self._geometry)
        return self._chain.point(x, self._tool).reshape((*q.shape[:-1], 3))

    def jacobian(self, q: Array) -> Array:
        """d(tool point)/dq, (..., m) -> (..., 3, m) [m/rad]."""
        if self.fast is not None:
            return self.fast.jacobian(q)
        flat = q.reshape(-1, q.shape[-1])
        x = self._chain.mechanism.forward(flat, self._geometry)
        slope = self._chain.point_by_pose(x, self._tool)
        slope = slope @ self._chain.mechanism.velocity_jacobian(flat, x, self._geometry)
        return slope.reshape((*q.shape[:-1], 3, q.shape[-1]))

    def _solver(self, method: str, bound: float, seed: int) -> Compensator:
        if method == "apso":
            return Apso(self.point, ApsoSettings(bound_rad=bound, seed=seed))
        settings = NewtonSettings(bound_rad=bound)
        if self.fast is not None:
            return CompiledNewton(self.fast, settings)
        return Newton(self.point, self.jacobian, settings)
