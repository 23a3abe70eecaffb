"""An identified machine and its solvers, in the form that the compiled functions take."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.compensation.apso import ApsoSettings, first_places, stream
from delta_calibration.compensation.base import Correction, checked_commands
from delta_calibration.compensation.newton import NewtonSettings
from delta_calibration.compensation.table import AXES
from delta_calibration.compensation.task_coordinates import ARM, TaskCoordinates
from delta_calibration.data import Conditions
from delta_calibration.effects import Stage
from delta_calibration.effects.signals import JOINT, TIME, TRAVEL, Places, Signals
from delta_calibration.errors import InputError
from delta_calibration.lazy import cached_property
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.chain_constants import STRAY
from delta_calibration.model.swarm_law import entropy_terms

Array = NDArray[np.float64]

SOLVERS = ("apso", "newton")
TABLE = "table"
METHODS = (*SOLVERS, TABLE)


def methods_for(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the methods of `METHODS` that suit a mechanism, the usual one first.

    A swarm needs as many joints as commanded coordinates; with more joints it would end at any of
    the commands in which joints work against each other. A table has three axes.
    """
    if mechanism.joints != mechanism.task_size:
        return ("newton",)
    swarm = ("apso", "newton") if mechanism.joints <= AXES else ("newton", "apso")
    return (*swarm, TABLE) if mechanism.joints == AXES else swarm


def require_method(mechanism: Mechanism, method: str, robot: str) -> None:
    """Refuse a method that does not exist, or that does not suit the robot.

    Raises:
        InputError: names the methods that can be used.
    """
    if method not in METHODS:
        raise InputError(f"no method {method!r}; choose from: {', '.join(METHODS)}")
    allowed = methods_for(mechanism)
    if method not in allowed:
        raise InputError(
            f"method {method!r} is not for robot {robot}: a {mechanism.name} of "
            f"{mechanism.joints} joints that command {mechanism.task_size} coordinates; "
            f"allowed: {', '.join(allowed)}"
        )


@dataclass(frozen=True)
class IdentifiedMachine:
    """An identified chain, its parameters and its tool, for which commands are found.

    Effects of the measurement belong to the tracker and are left out.
    """

    chain: Chain
    theta: Array  # (P,)
    tool: Array  # (3,) [m] in the platform's frame
    masses: Any = None  # of the robot, where loads count
    parts: tuple[str, ...] = ()  # whose temperatures are known

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism of the chain."""
        return self.chain.mechanism

    @cached_property
    def aim(self) -> TaskCoordinates:
        """Tool coordinates that its joints command."""
        return TaskCoordinates.of(self.mechanism, self.tool)

    @cached_property
    def reshaping(self) -> tuple[str, ...]:
        """Causes by which the dimensions change from command to command."""
        return tuple(e.cause for e in self.chain.effects if e.stage is Stage.STRUCTURE)

    @cached_property
    def by_pose(self) -> bool:
        """Whether the pose is found before the command, see backward_kernel.py."""
        m = self.mechanism
        whole = m.task_size == m.pose_size
        return whole and (self.aim.turns or m.joints > m.task_size)

    @cached_property
    def bare(self) -> IdentifiedMachine:
        """The same geometry without effects."""
        base = self.theta[self.chain.layout.base]
        return replace(self, chain=self.chain.with_effects(()), theta=base)

    @cached_property
    def places(self) -> Places:
        """Index of each signal in a sample's row."""
        return Places.of(self.mechanism, self.parts)

    @cached_property
    def compiled(self) -> Any:
        """The machine for the compiled functions: a `backward_kernel.MachineRecord`."""
        kernel = _kernel()
        aim = kernel.TaskRecord(
            np.array(self.tool, dtype=float), np.array(self.aim.axes), bool(self.aim.turns), ARM
        )
        theta = np.array(self.theta, dtype=float)
        g = theta[self.chain.layout.geometry].copy()
        stages, _ = self.chain.compiled(self.places)
        reshaped = bool(self.reshaping)
        body = self.mechanism.body(self.masses)
        exact = bool(self.mechanism.exact)
        return kernel.MachineRecord(
            body, stages, g, theta, aim, self.by_pose, reshaped, exact, STRAY
        )

    def with_parts(self, parts: tuple[str, ...]) -> IdentifiedMachine:
        """The same machine, with the temperatures of these parts known."""
        return self if parts == self.parts else replace(self, parts=parts)

    def signals(self, at: Conditions) -> Signals:
        """Signals of commands as recorded; any backlash counts as crossed by the correction."""
        found = self.chain.recorded(at)
        found.of(TRAVEL)[:] = np.inf
        return found

    def resting(self, q: Array) -> Signals:
        """Signals of commands (n, m) at rest, with no other condition known."""
        rows = np.zeros((len(q), self.places.size))
        found = Signals(self.places, rows)
        found.of(JOINT)[:] = q
        found.of(TRAVEL)[:] = np.inf
        found.of(TIME)[:] = self.chain.moment or 0.0
        return found

    def stand(self, q: Array, at: Conditions | None = None) -> tuple[Array, Array]:
        """Tool places (n, a) (see task_coordinates.py) and poses (n, k); NaN if there is none."""
        known = self.resting(q) if at is None else self.signals(replace(at, joint=q))
        places, x = _kernel().targets(self.compiled, known.rows)
        return places, x

    def point(self, q: Array, at: Conditions | None = None) -> Array:
        """Places of the tool, (..., m) -> (..., a) [m]; NaN without a pose."""
        places, _ = self.stand(q.reshape(-1, q.shape[-1]), at)
        return places.reshape((*q.shape[:-1], places.shape[1]))


@dataclass(frozen=True)
class Newton:
    """Newton's method as a `Compensator`: through the whole chain, see backward_kernel.py."""

    machine: IdentifiedMachine
    settings: NewtonSettings = field(default_factory=NewtonSettings)

    @property
    def numbers(self) -> Any:
        """Settings for the compiled functions: a `backward_kernel.Search`."""
        s = self.settings
        steps = int(s.iterations), int(s.halvings)
        return _kernel().Search(float(s.bound_rad), float(s.tolerance), *steps)

    def correct(
        self,
        q: Array,
        target: Array,
        signals: Signals | None = None,
        start: Array | None = None,
    ) -> Correction:
        """Find the correction of every command.

        Args:
            q: nominal commands (n, m) [rad].
            target: tool places they are meant to reach (n, a) [m].
            signals: of the commands; at rest if not given.
            start: corrections to begin from (n, m) [rad].

        Raises:
            InputError: the shapes do not match.
        """
        q, target, usable = checked_commands(q, target, self.machine.aim.size)
        known = self.machine.resting(q) if signals is None else signals
        known = known.take(usable)
        begin = np.zeros_like(q) if start is None else start
        dq, error, count = _kernel().corrections(
            self.machine.compiled,
            self.numbers,
            np.ascontiguousarray(known.rows),
            np.ascontiguousarray(target[usable]),
            np.ascontiguousarray(begin[usable]),
        )
        good = error <= self.settings.tolerance
        return Correction(dq, error, count, converged=good).spread(usable)


@dataclass(frozen=True)
class Swarm:
    """APSO as a `Compensator`, through the whole chain: the swarms of `Apso`, compiled.

    The corrections equal those of `Apso` up to rounding (1e-12 rad where the target is reached).
    They do not depend on the row or its neighbours in the batch, to the last bit.
    """

    machine: IdentifiedMachine
    settings: ApsoSettings = field(default_factory=ApsoSettings)

    def correct(
        self,
        q: Array,
        target: Array,
        signals: Signals | None = None,
        start: Array | None = None,
    ) -> Correction:
        """Search the correction of every command; `start` is not used. See `Newton.correct`."""
        del start
        q, target, usable = checked_commands(q, target, self.machine.aim.size)
        known = (self.machine.resting(q) if signals is None else signals).take(usable)
        s, m = self.settings, q.shape[1]
        out = _swarm_kernel().search(
            self.machine.compiled,
            self._nearby,
            np.ascontiguousarray(known.rows),
            np.ascontiguousarray(target[usable]),
            *self._draws,
            (s.bound_rad, s.tolerance, s.velocity_fraction, s.cognitive, s.social),
        )
        dq, error, count = out[:, :m].copy(), out[:, m].copy(), out[:, m + 1].astype(np.int64)
        return Correction(dq, error, count, converged=error <= s.tolerance).spread(usable)

    @cached_property
    def _draws(self) -> tuple[Array, Array, Array]:
        return drawn_beforehand(self.settings, self.machine.mechanism.joints)

    @cached_property
    def _nearby(self) -> Any:
        """Law of tool places near a command, if the chain has no effects; else empty."""
        machine = self.machine
        reach = np.inf if machine.chain.effects else self.settings.bound_rad
        return machine.mechanism.around(reach)


@lru_cache(maxsize=8)
def drawn_beforehand(s: ApsoSettings, joints: int = 3) -> tuple[Array, Array, Array]:
    """Start positions, random numbers and entropy gains: see swarm_kernel.py.

    All random numbers that a search can use take a quarter of a megabyte at the usual settings.
    """
    draws = stream(s)
    start = first_places(draws, joints, s).ravel()
    moves = draws.random(s.iterations * 2 * start.size)
    gains = np.diff(entropy_terms(s.particles)) / np.log(s.particles)
    return start, moves, gains


def solver_of(machine: IdentifiedMachine, method: str, bound: float, seed: int) -> Newton | Swarm:
    """Return the solver of this name, one of `SOLVERS`, for a machine.

    Raises:
        InputError: no such solver.
    """
    if method not in SOLVERS:
        raise InputError(f"no solver {method!r}; choose from: {', '.join(SOLVERS)}")
    if method == "apso":
        return Swarm(machine, ApsoSettings(bound_rad=bound, seed=seed))
    return Newton(machine, NewtonSettings(bound_rad=bound))


def drawn(mechanism: Mechanism, tool: Array, masses: Any = None) -> IdentifiedMachine:
    """The nominal machine, without effects."""
    chain = Chain(mechanism, np.zeros(3), 1.0)
    theta = np.concatenate([mechanism.parameters.nominal, np.zeros(9)])
    return IdentifiedMachine(chain, theta, tool, masses)


def _kernel() -> Any:
    """The compiled inverse of the chain; numba is loaded with the first use."""
    from delta_calibration.compensation import backward_kernel

    return backward_kernel


def _swarm_kernel() -> Any:
    """The compiled swarm."""
    from delta_calibration.compensation import swarm_kernel

    return swarm_kernel
