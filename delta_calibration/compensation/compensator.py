"""Correction of joint commands, so that the tool goes where the nominal robot would put it.

For a nominal command q the target is p* = FK_nominal(q); the result is the command q + dq that
brings the identified chain there, under the conditions of the command. Guards check every
command: one that fails a guard gets no correction, and the reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation.base import REACHED, Correction, Flags
from delta_calibration.compensation.command_status import (
    BY_CODE,
    COUNT,
    FOUND,
    JUDGED,
    LEFT,
    PASSED,
    SHARE,
    TURN,
    VERIFIED,
    CommandStatus,
    Compensated,
)
from delta_calibration.compensation.machine import (
    TABLE,
    IdentifiedMachine,
    Newton,
    drawn,
    require_method,
    solver_of,
)
from delta_calibration.compensation.newton import NewtonSettings
from delta_calibration.compensation.table import Stamp, Table, Tabulated
from delta_calibration.compensation.table_build import Follow, TableSettings, Task, build
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects.signals import JOINT, Places, Signals
from delta_calibration.errors import InputError
from delta_calibration.lazy import cached_property
from delta_calibration.model.chain_constants import OF_PULLS

Array = NDArray[np.float64]

_PLACES = 10_000  # points of the region at which a table is checked, besides its cells' middles
_WIDE = 10.0  # times the bound: corrections at nodes beyond the region may be larger
_BEYOND = 0.1  # of each joint's measured range: places between those measured may need this
_ON_FACE = 1e-9  # [m] a point this near a face of the region is on it
_STEPPED = 3e-4  # [m] more than any clearance of a machine in use moves the tool


@dataclass(frozen=True)
class _Single:
    """Compiled function for single commands: machine, slice of its joints, function, data."""

    own: IdentifiedMachine
    joint: slice
    run: Any
    held: Any


class SingleCommand(NamedTuple):
    """Data of the compiled function for single commands, for code generators (C export)."""

    drawn: IdentifiedMachine  # the nominal machine, as in the controller
    own: IdentifiedMachine  # the identified machine
    guards: Any  # of command_kernel.py, as are the next two
    search: Any
    room: Any  # scratch


class SingleWay(NamedTuple):
    """Data for compiled code that corrects single commands itself, see `single_way`."""

    held: Any  # command_kernel.Single
    places: Places  # of the signals in a row
    signals: Array  # (S,) under the given conditions
    aimed: int  # number of target coordinates


class JointCompensator:
    """Corrects joint commands by an identified chain; no state: same command, same result."""

    def __init__(
        self,
        calibration: Calibration,
        method: str = "newton",
        seed: int = 0,
        *,
        table: Table | TableSettings | None = None,
        follow: Follow = iter,
    ) -> None:
        """Prepare for a calibration; `method` is one of `METHODS`, `seed` that of the swarm.

        For method `table`, `table` is a table, or settings to build one here; `follow` wraps the
        iteration over the blocks of that work, for a progress bar. A table holds the corrections
        of one geometry. Effects of the drives (by direction, speed, load or angle) are corrected
        by Newton steps from there. Where an effect changes the dimensions themselves there is no
        table; the solver that would have built it finds every correction: see `way`.

        Raises:
            InputError: no such method, a method that does not suit the robot, or a table that is
                for another method or another calibration.
            DataError: no table within its bound.
        """
        self._nominal = calibration.robot.commanded
        require_method(self._nominal, method, calibration.robot.name)
        if table is not None and method != TABLE:
            raise InputError(f"a table is for method {TABLE!r}, not {method!r}")
        self.calibration = calibration
        self.robot = calibration.robot
        self.method = method
        made = TableSettings() if table is None else table
        self._solver, self._seed = (made.solver if method == TABLE else method), seed
        tool, masses = self.robot.tool_offset, self.robot.masses
        self._drawn = drawn(self._nominal, tool, masses)
        self._effects = tuple(effect.undone for effect, _ in calibration.live)
        chain = calibration.chain.held(calibration.ended).with_effects(self._effects)
        base = calibration.theta[calibration.chain.layout.base]
        theta = np.concatenate([base, *(value for _, value in calibration.live)])
        self._own = IdentifiedMachine(chain, theta, tool, masses)
        self._held: _Single | None = None
        self.table: Table | None = None
        if method == TABLE and not self._own.reshaping:
            self.table = self._tabulated(made, follow)

    @property
    def needs_conditions(self) -> bool:
        """Whether the answer depends on more than the command: direction, payload, speed ..."""
        return bool(self._effects)

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """Parts whose temperature the model uses."""
        return tuple(dict.fromkeys(part for effect in self._effects for part in effect.sensors))

    @property
    def by(self) -> str:
        """Method that finds the corrections of the geometry: one of `METHODS`."""
        return self._solver if self.table is None else TABLE

    @property
    def way(self) -> str:
        """Description of how the corrections of the geometry are found, for display."""
        if self.table is not None:
            return f"{TABLE} ({self.table.told()})"
        if self.method == TABLE:
            causes = ", ".join(self._own.reshaping)
            return f"{self.by} (no table, because the dimensions change with {causes})"
        return self.method

    def missing(self, at: Conditions) -> str:
        """Name the conditions that the model needs but `at` lacks; empty if there are none.

        The direction of a joint that has not moved yet does not count: it is in the middle of its
        backlash, which is right for it.
        """
        if not self._effects:
            return ""
        at = replace(at, direction=np.ones_like(at.direction))
        texts = (effect.missing(at) for effect in self._effects)
        return "; ".join(dict.fromkeys(text for text in texts if text))

    def single_command(self, parts: tuple[str, ...] = ()) -> SingleCommand:
        """Return the data to correct single commands, if temperatures of `parts` are known."""
        own, kernel = self._own.with_parts(parts), _kernel()
        machines = self._drawn.compiled, own.compiled
        room = kernel.command_room(*machines, self._drawn.places.size, own.places.size)
        search = Newton(own, self._newton).numbers
        return SingleCommand(self._drawn, own, self._guards, search, room)

    def single_way(self, at: Conditions | None = None) -> SingleWay | None:
        """Return the data to correct single commands under these conditions (one sample).

        It holds for other commands and other motion too, while all other conditions stay the same.
        None if a condition is missing, or if corrections are not found by `newton`.
        """
        if self.by != "newton":
            return None
        at = at_rest(self._nominal.home[None]) if at is None else at
        by_pose = any(effect.asks_pose for effect in self._effects)
        if not self._known(at) and (by_pose or self.missing(at)):
            return None
        single = self._singles(at.temperature_parts)
        own = single.own
        return SingleWay(single.held, own.places, own.signals(at).rows[0], own.aim.size)

    def targets(self, q: Array) -> Array:
        """Target places of commands by the nominal robot, (n, a) [m]; NaN without a pose.

        These are tool points; where the joints rotate the tool, see task_coordinates.py.
        """
        return self._drawn.point(q)

    def point(self, q: Array) -> Array:
        """Places of the identified geometry, (..., m) -> (..., a) [m]; NaN without a pose."""
        return self._own.bare.point(q)

    def compensate(self, q: Array, at: Conditions | None = None) -> Compensated:
        """Correct commands, (n, m) [rad].

        Args:
            q: nominal commands.
            at: conditions of the commands, (n); their joint angles are not used. If none are
                given, the joints stand still and nothing else is known.

        Raises:
            InputError: q has another shape, or the conditions are those of another number.
        """
        joints = len(self.robot.joints.names)
        if q.ndim != 2 or q.shape[1] != joints:
            raise InputError(f"commands have shape {q.shape}; it has to be (n, {joints})")
        if at is not None and len(at) != len(q):
            raise InputError(f"conditions of {len(at)} commands for {len(q)}; one for each")
        q = np.ascontiguousarray(q, dtype=np.float64)
        known = np.where(np.isfinite(q), q, 0.0)
        if len(q) == 1 and self.by == "newton" and (at is not None or not self._effects):
            alone = at_rest(known) if at is None else at
            if self._known(alone):
                return self._single(q, alone)
        at = at_rest(known) if at is None else replace(at, joint=known)
        missing, usable = self.missing(at), np.ones(len(q), dtype=np.bool_)
        if missing:
            usable[self._lacking(at)] = False
        code, dq, told = self._found(q, at, usable)
        verdicts = [BY_CODE[each] for each in code.tolist()]
        for row in np.flatnonzero(~usable).tolist():
            verdicts[row] = _unless(verdicts[row], CommandStatus.MISSING_CONDITION)
        if self.table is not None:
            for row in np.flatnonzero((code == PASSED) & ~self.table.covers(q)).tolist():
                verdicts[row] = _unless(verdicts[row], CommandStatus.OUTSIDE_TABLE)
        good = np.array([verdict is CommandStatus.CORRECTED for verdict in verdicts])
        return Compensated(
            q + dq,
            dq,
            np.where(good, told[:, LEFT], np.inf),
            told[:, COUNT].astype(np.int64),
            tuple(verdicts),
            missing,
            self._told_share(told[:, SHARE]),
            np.where(good, told[:, TURN], np.inf) if self._own.aim.turns else None,
        )

    def _known(self, at: Conditions) -> bool:
        """Whether all conditions of one command that any effect could need are known."""
        if not self._effects:
            return True
        heard = set(self.sensors).issubset(at.temperature_parts)
        numbers = (at.payload[0], *at.payload_centre[0], *at.temperature[0])
        return heard and all(map(isfinite, numbers))

    def _single(self, q: Array, at: Conditions) -> Compensated:
        """Result of `compensate` for one command (1, m), with the least possible overhead."""
        single = self._singles(at.temperature_parts)
        rows = single.own.signals(at).rows
        rows[0, single.joint] = q[0]
        joints, told = q.shape[1], np.empty((1, 4))
        target, dq = np.empty(single.own.aim.size), np.empty((1, joints))
        code = single.run(
            single.held,
            q[0],
            rows[0],
            at.payload[0],
            at.payload_centre[0],
            True,
            target,
            dq[0],
            told[0],
        )
        turns = told[:, TURN] if single.own.aim.turns else None
        return Compensated(
            q + dq,
            dq,
            told[:, LEFT],
            told[:, COUNT].astype(np.int64),
            (BY_CODE[code],),
            "",
            self._told_share(told[:, SHARE]),
            turns,
        )

    def _singles(self, parts: tuple[str, ...]) -> _Single:
        """Data for single commands, made once for the parts whose temperature is known."""
        single = self._held
        if single is None or single.own.parts != parts:
            kernel, own = _kernel(), self._machine(parts)
            by = self.single_command(parts)
            held = kernel.Single(by.drawn.compiled, own.compiled, by.guards, by.search, by.room)
            single = self._held = _Single(own, own.places.slices[JOINT], kernel.single, held)
        return single

    def _found(self, q: Array, at: Conditions, usable: Flags) -> tuple[Array, Array, Array]:
        """Codes (n,), corrections (n, m) and numbers (n, 4) of commands: see command_kernel.py."""
        own = self._machine(at.temperature_parts)
        signals, target = own.signals(at), np.empty((len(q), own.aim.size))
        dq, told = np.zeros_like(q), np.empty((len(q), 4))
        if self.by == "newton":
            code = self._run(FOUND, own, q, at, signals, usable, target, dq, told)
            return code, dq, told
        code = self._run(JUDGED, own, q, at, signals, usable, target, dq, told)
        rows = np.flatnonzero((code == PASSED) & usable)
        if self.table is not None:
            rows = rows[self.table.covers(q[rows])]
        if rows.size:
            part, numbers, places = signals.take(rows), told[rows], target[rows]
            found = self._search(own, q[rows], places, part)
            own_dq, numbers[:, COUNT] = found.dq.copy(), found.evaluations
            code[rows] = self._run(
                VERIFIED, own, q[rows], at.take(rows), part, usable[rows], places, own_dq, numbers
            )
            dq[rows], told[rows] = own_dq, numbers
        return code, dq, told

    def _run(
        self,
        mode: int,
        own: IdentifiedMachine,
        q: Array,
        at: Conditions,
        signals: Signals,
        usable: Flags,
        target: Array,
        dq: Array,
        told: Array,
    ) -> Any:
        """Return codes of commands (n,); fills in the last three, see command_kernel.py."""
        return _kernel().every(
            self._drawn.compiled,
            own.compiled,
            self._guards,
            Newton(own, self._newton).numbers,
            self._drawn.places.size,
            mode,
            q,
            signals.rows,
            np.ascontiguousarray(at.payload),
            np.ascontiguousarray(at.payload_centre),
            usable,
            target,
            dq,
            told,
        )

    def _search(self, own: IdentifiedMachine, q: Array, target: Array, signals: Any) -> Any:
        """Find corrections by a swarm or by the table.

        Newton steps refine those of a swarm, and those of the table if there are effects.
        """
        if self.table is None:
            solver = solver_of(own, self._solver, self.robot.limits.correction, self._seed)
            return self._polished(solver.correct(q, target, signals), own, q, target, signals)
        if not self._effects:
            return Tabulated(self.table, own.point).correct(q, target)
        return Newton(own, self._newton).correct(q, target, signals, self.table.at(q))

    def _polished(
        self, found: Correction, own: IdentifiedMachine, q: Array, target: Array, signals: Any
    ) -> Correction:
        """Refine a swarm's corrections by Newton steps, where these reduce the error."""
        after = Newton(own, self._newton).correct(q, target, signals, found.dq)
        better = after.error < found.error
        return Correction(
            np.where(better[:, None], after.dq, found.dq),
            np.where(better, after.error, found.error),
            found.evaluations + after.evaluations,
            found.converged | after.converged,
        )

    @cached_property
    def _newton(self) -> NewtonSettings:
        return NewtonSettings(bound_rad=self.robot.limits.correction)

    def _machine(self, parts: tuple[str, ...]) -> IdentifiedMachine:
        """The identified machine where the temperatures of these parts are known."""
        own = self._own
        if parts != own.parts:
            own = self._own = own.with_parts(parts)
        return own

    @cached_property
    def _guards(self) -> Any:
        limits, joints = self.robot.limits, self.robot.joints
        return _kernel().Guards(
            np.ascontiguousarray(self.calibration.region.planes, dtype=float),
            np.array(joints.lower, dtype=float),
            np.array(joints.upper, dtype=float),
            *self._seen_joints(),
            float(limits.condition),
            float(self._nominal.typical_gain),
            float(limits.region_margin),
            _ON_FACE,
            float(limits.correction),
            REACHED,
            _STEPPED,
            OF_PULLS if self._nominal.pulls else 0,
        )

    def _seen_joints(self) -> tuple[Array, Array]:
        """Limits of the joint angles that were measured, with a margin, (m,) each.

        Where tool places determine the joints, the region of places is the better guard: within
        it joints may exceed those at its corners. Where they do not, as for an arm, only the
        joints show what was never measured.
        """
        lower = np.array(self.calibration.joints_lower, dtype=float)
        upper = np.array(self.calibration.joints_upper, dtype=float)
        least = self.robot.limits.region_margin / float(self._nominal.typical_gain)
        beyond = np.maximum(_BEYOND * (upper - lower), least)
        return lower - beyond, upper + beyond

    def _told_share(self, share: Array) -> Array | None:
        """Return the share if it falls over a margin; None if corrections end at the region."""
        return share if self.robot.limits.region_margin else None

    def _lacking(self, at: Conditions) -> list[int]:
        """Rows of the commands that lack a condition, once `missing` has found any."""
        if len(at) == 1:
            return [0]
        return [row for row in range(len(at)) if self.missing(at.take(slice(row, row + 1)))]

    def _tabulated(self, made: Table | TableSettings, follow: Follow) -> Table:
        """Return the given table, or build one; checks that it is for this calibration."""
        if isinstance(made, TableSettings):
            made = build(self._task(), made, follow)
        made.stamp.require(self.calibration)
        return made

    def _task(self) -> Task:
        """Content of the table to build."""
        bound, region = self.robot.limits.correction, self.calibration.region
        places = region.sample(_PLACES, self.robot.limits.region_margin, np.random.default_rng(0))
        q = self._nominal.inverse(places, self._nominal.parameters.nominal)
        reached = q[np.isfinite(q).all(axis=1)]
        return Task(
            stamp=Stamp.of(self.calibration),
            solver=solver_of(self._own.bare, self._solver, _WIDE * bound, self._seed),
            meant=self.targets,
            point=self.point,
            admitted=self._admitted,
            largest=bound,
            asked=reached[self._admitted(reached)],
        )

    def _admitted(self, q: Array) -> Flags:
        """Whether commands pass all guards, (n,)."""
        at, own, n = at_rest(q), self._own.bare, len(q)
        rest, target = own.resting(q), np.empty((n, own.aim.size))
        code = self._run(
            JUDGED,
            own,
            np.ascontiguousarray(q),
            at,
            rest,
            np.ones(n, dtype=np.bool_),
            target,
            np.zeros((n, q.shape[1])),
            np.empty((n, 4)),
        )
        return np.asarray(code == PASSED)


def _kernel() -> Any:
    """The compiled guards and corrections; numba is loaded with the first use."""
    from delta_calibration.compensation import command_kernel

    return command_kernel


def _unless(verdict: CommandStatus, other: CommandStatus) -> CommandStatus:
    """Return the other verdict in place of CORRECTED, else the verdict itself."""
    return other if verdict is CommandStatus.CORRECTED else verdict
