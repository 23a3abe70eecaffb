"""From a nominal joint command to the one that puts the tool where the nominal robot meant it.

For a nominal command q the target is p* = FK_nominal(q); the answer is the command q + dq that
brings the identified chain there, under the conditions that the command is given in. Every path to
it is guarded: a command that fails a guard gets no correction, and the reason.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation.aim import Aim
from delta_calibration.compensation.alone import Alone
from delta_calibration.compensation.answer import Compensated, Verdict
from delta_calibration.compensation.backward import Backward
from delta_calibration.compensation.base import REACHED, Correction, Flags, distance
from delta_calibration.compensation.compiled import CompiledGeometry
from delta_calibration.compensation.machine import TABLE, Machine, require_method
from delta_calibration.compensation.table import Stamp, Table
from delta_calibration.compensation.table_build import Follow, TableSettings, Task, build
from delta_calibration.effects.loads import weight_known
from delta_calibration.errors import InputError
from delta_calibration.samples import Conditions, at_rest

Array = NDArray[np.float64]

_PLACES = 10_000  # of the region at which a table is tried, beside the middles of its cells
_WIDE = 10.0  # times the bound of a correction: at nodes beyond the region it may be larger
_ON_FACE = 1e-9  # [m] a point this near a face of the region is on it
_ALONE = tuple(  # by the codes of command_kernel.py
    (verdict,)
    for verdict in (
        Verdict.CORRECTED,
        Verdict.NOT_FINITE,
        Verdict.JOINT_LIMIT,
        Verdict.OUT_OF_REACH,
        Verdict.OUTSIDE_REGION,
        Verdict.SINGULAR,
        Verdict.NOT_REACHED,
    )
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
        table: Table | TableSettings | None = None,
        follow: Follow = iter,
    ) -> None:
        """From a calibration; `method` is one of `METHODS`, `seed` that of the swarm.

        For method `table`, `table` is one or says how to make one, which is done before this
        returns; `follow` is handed the blocks of that work, for a progress bar. A table holds the
        corrections of one geometry. What drives do by direction, speed, load or angle is undone
        around it; where an effect changes the dimensions themselves there is no table, and every
        correction is found by the solver that would have made it: see `way`.

        With `compiled` the geometry is compiled, or loaded from where an earlier process left it,
        before this returns: the same answers to 1e-10 rad, much sooner for single commands. The
        property `compiled` says whether it came to that.

        Raises:
            InputError: no such method, none for such a robot, or a table for another or for
                something else.
            DataError: no table within its bound.
        """
        self._nominal = calibration.robot.commanded
        require_method(self._nominal, method, calibration.robot.name)
        if table is not None and method != TABLE:
            raise InputError(f"a table is for method {TABLE!r}, not {method!r}")
        self.calibration = calibration
        self.robot = calibration.robot
        self.method = method
        tool, bound = self.robot.tool_offset, self.robot.limits.correction
        self._aim = Aim.of(self._nominal, tool)
        # what is left is then said by the chain run forward, apart for place and turn
        self._by_pose = self._aim.turns or self._nominal.joints > self._nominal.task_size
        self._home = self._nominal.home[None]
        self._pose_at_home = self._nominal.forward(self._home, self._nominal.parameters.nominal)
        made = TableSettings() if table is None else table
        self._solver = made.solver if method == TABLE else method
        self._model = Machine(
            calibration.chain, calibration.geometry, tool, self._solver, bound, seed,
            compiled=compiled,
        )  # fmt: skip
        self._effects = tuple(effect for effect, _ in calibration.live)
        self._backward = Backward(calibration, self._model)
        self._fast_nominal: CompiledGeometry | None = None
        if self._model.fast is not None:
            nominal = self._nominal.parameters.nominal
            self._fast_nominal = CompiledGeometry(self._nominal, nominal, tool)
        self.table: Table | None = None
        if method == TABLE and not self._backward.reshaping:
            self._tabulate(made, follow)
        self._alone: Alone | None = None
        if self._fast_nominal is not None and not self.needs_conditions:
            solver = self._model.solver
            self._alone = Alone(calibration, self._fast_nominal, solver, _ON_FACE)

    @property
    def compiled(self) -> bool:
        """Whether compiled functions do the work: asked for, and there for this mechanism."""
        return self._model.fast is not None

    @property
    def needs_conditions(self) -> bool:
        """Whether the answer depends on more than the command: direction, payload, speed ..."""
        return self._backward.stages

    @property
    def by(self) -> str:
        """What finds the geometry's corrections: one of `METHODS`."""
        return self._solver if self.table is None else TABLE

    @property
    def way(self) -> str:
        """How the geometry's corrections are found, for people."""
        if self.table is not None:
            return f"{TABLE} ({self.table.told()})"
        if self.method == TABLE:
            causes = ", ".join(self._backward.reshaping)
            return f"{self.by} (no table: the dimensions change with {causes})"
        return self.method

    def missing(self, at: Conditions) -> str:
        """What of the conditions the model needs is not known; empty where all is.

        A joint that has not moved yet is on neither side of its play: the middle is right for it.
        """
        at = replace(at, direction=np.ones_like(at.direction))
        texts = (effect.missing(at) for effect in self._effects)
        return "; ".join(dict.fromkeys(text for text in texts if text))

    def warm_up(self) -> None:
        """Take the first command's delay now: compensate one at home and forget it."""
        self.compensate(self._home)

    def targets(self, q: Array) -> Array:
        """Tool points the nominal robot means by the commands, (n, d) [m]; NaN without a pose.

        As in aim.py where the joints turn the tool.
        """
        if self._fast_nominal is not None:
            return self._fast_nominal.point(q)
        return self._aim.places(self._nominal, self._meant(q))

    def point(self, q: Array) -> Array:
        """Tool points of the identified geometry, (..., m) -> (..., d) [m]; NaN without a pose."""
        return self._model.point(q)

    def jacobian(self, q: Array) -> Array:
        """d(tool point)/dq of the identified geometry, (..., m) -> (..., d, m) [m/rad]."""
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
        if len(q) == 1 and self._alone is not None:
            at_once = self._at_once(self._alone, np.ascontiguousarray(q, dtype=np.float64))
            if at_once is not None:
                return at_once
        known = np.where(np.isfinite(q), q, 0.0)
        at = at_rest(known) if at is None else replace(at, joint=known)
        meant = self._meant(known)
        target, outside = self._aim.places(self._nominal, meant), self._outside(meant)
        verdicts = self._guard(q, meant, outside, at)
        missing = self.missing(at)
        for row in self._lacking(at) if missing else ():
            verdicts[row] = _unless(verdicts[row], Verdict.MISSING_CONDITION)
        usable = np.array([verdict is Verdict.CORRECTED for verdict in verdicts], dtype=bool)
        found = Correction.none(0, joints)
        if usable.any():
            found = self._backward.correct(at.take(usable), target[usable])
        whole = found.spread(usable)
        bounded = (np.abs(whole.dq) <= self.robot.limits.correction).all(axis=1)
        share = self._share(outside)
        dq = share[:, None] * whole.dq
        reached, turn = whole.converged & bounded, None
        if self._by_pose:
            gap = self._backward.points(at, known + dq) - target
            left, turn = self._aim.parted(gap)
            reached &= (distance(gap) <= np.maximum(whole.error, REACHED)) | (share < 1.0)
        else:
            left = whole.error + self._left(known, whole.dq, 1.0 - share)
        good = reached & self._within(q + dq)
        correction = np.where(good[:, None], dq, 0.0)
        for row in np.flatnonzero(usable & ~good).tolist():
            verdicts[row] = Verdict.JOINT_LIMIT if reached[row] else Verdict.NOT_REACHED
        return Compensated(
            q + correction,
            correction,
            np.where(good, left, np.inf),
            whole.evaluations,
            tuple(verdicts),
            missing,
            self._told_share(share),
            np.where(good, turn, np.inf) if turn is not None and self._aim.turns else None,
        )

    def _meant(self, q: Array) -> Array:
        """Poses of the nominal robot, (n, k); NaN out of reach."""
        if self._fast_nominal is not None:
            return self._fast_nominal.pose(q)
        return self._nominal.forward(q, self._nominal.parameters.nominal)

    def _at_once(self, alone: Alone, q: Array) -> Compensated | None:
        """What `compensate` says of one command (1, m), a tenth of the time; None: ask that.

        Newton's method answers every command here, any other solver what all guards let pass.
        """
        if alone.corrects:
            code, out = alone.correct(q[0])
            dq, evaluations = out[None, 4:7], np.array([int(out[8])])
            return Compensated(
                q + dq, dq, out[7:8], evaluations, _ALONE[code],
                share=self._told_share(out[3:4]),
            )  # fmt: skip
        code, out = alone.judge(q[0])
        if code or out[3] < 1.0:
            return None
        found = self._model.solver.correct(q, out[None, :3])
        joint, bound = q + found.dq, self.robot.limits.correction
        if not (found.error[0] <= REACHED and np.abs(found.dq).max() <= bound):
            return None
        if not self._within(joint)[0]:
            return None
        return Compensated(
            joint, found.dq, found.error, found.evaluations, _ALONE[code],
            share=self._told_share(out[3:4]),
        )  # fmt: skip

    def _outside(self, meant: Array) -> Array:
        """How far outside the calibrated region poses (n, k) lie, (n,) [m]; negative inside."""
        known = np.where(_finite(meant)[:, None], meant, 0.0)
        return self.calibration.region.outside(self._nominal.position(known))

    def _share(self, outside: Array) -> Array:
        """How much of a correction is applied so far outside (n,) [m] of the region, (n,).

        All of it inside, in proportion less over the margin beyond, nothing at its end: a
        continuous function of the place, whatever the motion.
        """
        beyond = np.maximum(outside - _ON_FACE, 0.0)
        margin = self.robot.limits.region_margin
        return np.clip(1.0 - beyond / margin, 0.0, 1.0) if margin else 1.0 * (beyond == 0.0)

    def _told_share(self, share: Array) -> Array | None:
        """The share where it goes down over a margin; None where corrections end at the region."""
        return share if self.robot.limits.region_margin else None

    def _left(self, q: Array, dq: Array, part: Array) -> Array:
        """How far from the target a part (n,) of the corrections dq would move the tool, (n,) [m].

        Linear: corrections are small beside what bends the map from joints to tool.
        """
        left = np.zeros(len(q))
        rows = np.flatnonzero(part > 0.0)
        if rows.size:
            moved = np.einsum("nij,nj->ni", self.jacobian(q[rows]), dq[rows])
            left[rows] = part[rows] * np.linalg.norm(moved, axis=1)
        return left

    def _lacking(self, at: Conditions) -> list[int]:
        """Commands of which something is missing."""
        return [row for row in range(len(at)) if self.missing(at.take(slice(row, row + 1)))]

    def _tabulate(self, made: Table | TableSettings, follow: Follow) -> None:
        """Take a table, made here or before, in the place of the search."""
        if isinstance(made, TableSettings):
            made = build(self._task(), made, follow)
        made.stamp.require(self.calibration)
        self.table, self._model = made, self._model.tabulated(made)
        self._backward = Backward(self.calibration, self._model)

    def _task(self) -> Task:
        """What a table is to hold."""
        bound, region = self.robot.limits.correction, self.calibration.region
        places = region.sample(_PLACES, self.robot.limits.region_margin, np.random.default_rng(0))
        q = self._nominal.inverse(places, self._nominal.parameters.nominal)
        reached = q[_finite(q)]
        return Task(
            stamp=Stamp.of(self.calibration),
            solver=self._model.within(_WIDE * bound).solver,
            meant=self.targets,
            point=self.point,
            admitted=self._admitted,
            largest=bound,
            asked=reached[self._admitted(reached)],
        )

    def _admitted(self, q: Array) -> Flags:
        """Commands that no guard refuses, (n,)."""
        meant = self._meant(q)
        checks = self._checks(q, meant, self._outside(meant), at_rest(q))
        return np.asarray(np.all([passed for passed, _ in checks], axis=0))

    def _guard(self, q: Array, meant: Array, outside: Array, at: Conditions) -> list[Verdict]:
        """The first guard that each command fails, `CORRECTED` where it passes all."""
        checks = self._checks(q, meant, outside, at)
        return [
            next((verdict for passed, verdict in checks if not passed[row]), Verdict.CORRECTED)
            for row in range(len(q))
        ]

    def _checks(
        self, q: Array, meant: Array, outside: Array, at: Conditions
    ) -> list[tuple[Flags, Verdict]]:
        """Which commands pass each guard, (n,), and what the others are told."""
        limits = self.robot.limits
        finite, reached = _finite(q), _finite(meant)
        covered = outside <= limits.region_margin + _ON_FACE
        there = (finite & reached)[:, None]
        safe, x = np.where(there, q, self._home), np.where(there, meant, self._pose_at_home)
        regular = np.asarray(self._condition(safe, x) <= limits.condition)
        checks = [
            (finite, Verdict.NOT_FINITE),
            (self._within(q), Verdict.JOINT_LIMIT),
            (reached, Verdict.OUT_OF_REACH),
            (covered, Verdict.OUTSIDE_REGION),
            (regular, Verdict.SINGULAR),
            (self._borne(x, at), Verdict.SLACK),
        ]
        if self.table is not None:
            checks.append((self.table.covers(q), Verdict.OUTSIDE_TABLE))
        return checks

    def _borne(self, x: Array, at: Conditions) -> Flags:
        """Poses (n, k) at which the nominal robot bears what is on it, (n,).

        An unknown payload is none: where the model needs it, that is told for itself.
        """
        if not self._nominal.pulls:
            return np.ones(len(x), dtype=np.bool_)
        load = weight_known(self.robot, self._nominal, at, x)
        return self._nominal.borne(x, self._nominal.parameters.nominal, load)

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
