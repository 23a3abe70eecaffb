"""A machine at one geometry: where its tool is, and how a command for it is found."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.compensation.aim import Aim
from delta_calibration.compensation.apso import Apso, ApsoSettings
from delta_calibration.compensation.base import Compensator
from delta_calibration.compensation.by_pose import ByPose
from delta_calibration.compensation.compiled import (
    CompiledApso,
    CompiledGeometry,
    CompiledNewton,
    available,
)
from delta_calibration.compensation.newton import Newton, NewtonSettings
from delta_calibration.compensation.table import AXES, Table, Tabulated
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import Mechanism

Array = NDArray[np.float64]

SOLVERS = ("apso", "newton")
TABLE = "table"
METHODS = (*SOLVERS, TABLE)


def methods_for(mechanism: Mechanism) -> tuple[str, ...]:
    """Those of `METHODS` that such a mechanism can be compensated by, the usual one first.

    A swarm finds what as many joints as freedoms come to; with more it would settle anywhere among
    commands that work against each other. A table has three axes.
    """
    if mechanism.joints != mechanism.task_size:
        return ("newton",)
    swarm = ("apso", "newton") if mechanism.joints <= AXES else ("newton", "apso")
    return (*swarm, TABLE) if mechanism.joints == AXES else swarm


def require_method(mechanism: Mechanism, method: str, robot: str) -> None:
    """Refuse a way that does not exist, or not for such a robot.

    Raises:
        InputError: names those that do.
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


class Machine:
    """Model and solver at one geometry, compiled where that is wanted and can be had.

    Args:
        chain: whose mechanism it is.
        geometry: its parameters (p,).
        tool: tool centre point in the platform's frame (3,) [m].
        method: one of `SOLVERS`.
        bound: largest correction of a joint [rad].
        seed: of the swarm.
        compiled: whether geometry and solver are to be compiled.

    Raises:
        InputError: no such solver.
    """

    def __init__(
        self,
        chain: Chain,
        geometry: Array,
        tool: Array,
        method: str = "newton",
        bound: float = 0.03,
        seed: int = 0,
        *,
        compiled: bool = False,
    ) -> None:
        if method not in SOLVERS:
            raise InputError(f"no solver {method!r}; choose from: {', '.join(SOLVERS)}")
        self._mechanism, self._geometry = chain.mechanism, geometry
        self.aim = Aim.of(chain.mechanism, tool)
        self._method, self._bound, self._seed = method, bound, seed
        self.fast: CompiledGeometry | None = None
        if compiled and available(chain.mechanism):
            self.fast = CompiledGeometry(chain.mechanism, geometry, tool)
        self.solver = self._make_solver()

    def at(self, geometry: Array) -> Machine:
        """The same machine with other dimensions (p,)."""
        other = copy(self)
        other._geometry = geometry
        other.fast = None if self.fast is None else self.fast.at(geometry)
        other.solver = other._make_solver()
        return other

    def within(self, bound: float) -> Machine:
        """The same machine with another largest correction [rad]."""
        other = copy(self)
        other._bound = bound
        other.solver = other._make_solver()
        return other

    def tabulated(self, table: Table) -> Machine:
        """The same machine with a table of its corrections; with other dimensions it has none."""
        other = copy(self)
        other.solver = Tabulated(table, self.point)
        return other

    def point(self, q: Array) -> Array:
        """Tool points, (..., m) -> (..., d) [m], see aim.py; NaN without a pose."""
        if self.fast is not None:
            return self.fast.point(q)
        x = self._mechanism.forward(q.reshape(-1, q.shape[-1]), self._geometry)
        return self.aim.places(self._mechanism, x).reshape((*q.shape[:-1], -1))

    def jacobian(self, q: Array) -> Array:
        """d(tool point)/dq, (..., m) -> (..., d, m) [m/rad]."""
        if self.fast is not None:
            return self.fast.jacobian(q)
        flat = q.reshape(-1, q.shape[-1])
        x = self._mechanism.forward(flat, self._geometry)
        slope = self.aim.slopes(self._mechanism, x)
        slope = slope @ self._mechanism.velocity_jacobian(flat, x, self._geometry)
        return slope.reshape((*q.shape[:-1], self.aim.size, q.shape[-1]))

    def _make_solver(self) -> Compensator:
        if self._method == "apso":
            law = ApsoSettings(bound_rad=self._bound, seed=self._seed)
            return Apso(self.point, law) if self.fast is None else CompiledApso(self.fast, law)
        mechanism = self._mechanism
        settings = NewtonSettings(bound_rad=self._bound, freedoms=mechanism.task_size)
        if self.fast is not None:
            return CompiledNewton(self.fast, settings)
        all_of_it = mechanism.task_size == mechanism.pose_size
        if all_of_it and (self.aim.turns or mechanism.joints > mechanism.task_size):
            return ByPose(mechanism, self._geometry, self.aim)
        return Newton(self.point, self.jacobian, settings)
