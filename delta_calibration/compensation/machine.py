"""A machine at one geometry: where its tool is, and how a command for it is found."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.compensation.apso import Apso, ApsoSettings
from delta_calibration.compensation.base import Compensator
from delta_calibration.compensation.compiled import (
    CompiledApso,
    CompiledGeometry,
    CompiledNewton,
    available,
)
from delta_calibration.compensation.newton import Newton, NewtonSettings
from delta_calibration.compensation.table import Table, Tabulated
from delta_calibration.errors import InputError

Array = NDArray[np.float64]

SOLVERS = ("apso", "newton")
TABLE = "table"
METHODS = (*SOLVERS, TABLE)


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
        self._chain, self._geometry, self._tool = chain, geometry, tool
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

    def _make_solver(self) -> Compensator:
        if self._method == "apso":
            law = ApsoSettings(bound_rad=self._bound, seed=self._seed)
            return Apso(self.point, law) if self.fast is None else CompiledApso(self.fast, law)
        settings = NewtonSettings(bound_rad=self._bound)
        if self.fast is not None:
            return CompiledNewton(self.fast, settings)
        return Newton(self.point, self.jacobian, settings)
