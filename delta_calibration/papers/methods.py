"""Methods that can fit a session, by name; all of them solve the same problem.

The problem (`problem.py`) has whitened residuals of positions, and of rotations if used, as a
function of all unknowns, priors as rows, and a robust loss. Least squares evaluates the chain
itself. The methods of the papers search the error model about the nominal machine
(`error_model.py`), then about each result, so that second-order terms are included and the robust
weights suit the residuals.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.estimation.method import Fit, LeastSquares, Method, Watch
from delta_calibration.estimation.problem import Near, Problem
from delta_calibration.estimation.solver import solution_at, spread_of
from delta_calibration.papers.alternating import in_turn
from delta_calibration.papers.error_model import box_of, error_model
from delta_calibration.papers.pose_residual import LinearResidual
from delta_calibration.papers.stepwise import stepwise, stepwise_singular
from delta_calibration.papers.swarm import (
    Apso,
    Law,
    Pso,
    Qpso,
    Residual,
    SwarmResult,
    SwarmSettings,
    minimise,
)

Array = NDArray[np.float64]

ROUNDS = 4  # linearisations, each about the last result; the robot farthest off needs as many
ORDERS = SINGULAR, SETTLING = "singular", "settled"  # of the unknowns in stepwise QPSO
_TURNS = 300_000  # rounds of geometry and frame; the slowest robot of the package takes 93 000
_ONE_DIRECTION = 120  # iterations: one direction converges sooner than twenty together


class InRounds(Method):
    """Base of methods that search the error model, relinearised about the result of each round."""

    @abstractmethod
    def search(
        self,
        line: LinearResidual,
        problem: Problem,
        start: Array,
        rng: np.random.Generator,
        watch: Watch,
    ) -> SwarmResult:
        """Search the minimum of the error model over the problem's unknowns, (F,)."""

    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Near | None = None,
    ) -> Fit:
        """See `Method.fit`; always begins at the nominal machine."""
        del near
        z, spread, evaluations = np.zeros(np.count_nonzero(problem.free)), 1.0, 0
        for _ in range(ROUNDS):
            found = self.search(error_model(problem, z, spread), problem, z, rng, watch)
            solution = solution_at(problem, found.best)
            z, spread = solution.z, spread_of(solution.residual)
            evaluations += found.evaluations
        return Fit(solution, evaluations)


@dataclass(frozen=True)
class Alternating(InRounds):
    """Paper 002: geometry and the device's frame are fitted in turn until both converge.

    Reflector offset and probe rotation are fitted with the frame: they belong to the device too.
    """

    name: str = "alternating"

    def search(
        self,
        line: LinearResidual,
        problem: Problem,
        start: Array,
        rng: np.random.Generator,
        watch: Watch,
    ) -> SwarmResult:
        """See `InRounds.search`; the frame first."""
        del rng, watch
        device = ~problem.layout.mask(problem.layout.geometry)
        return in_turn(line, device[problem.free], start, _TURNS)


@dataclass(frozen=True)
class Swarm(InRounds):
    """A swarm searches all unknowns together, in the box of the priors."""

    name: str
    swarm: SwarmSettings

    def search(
        self,
        line: LinearResidual,
        problem: Problem,
        start: Array,
        rng: np.random.Generator,
        watch: Watch,
    ) -> SwarmResult:
        """See `InRounds.search`; every round begins at random positions."""
        del start
        return minimise(_told(line, watch), box_of(problem), self.swarm, rng)

    def most(self, unknowns: int) -> int:
        """See `Method.most`."""
        del unknowns
        return ROUNDS * self.swarm.particles * self.swarm.iterations

    @property
    def settings(self) -> Mapping[str, int | str]:
        """See `Method.settings`."""
        return {"particles": self.swarm.particles, "iterations": self.swarm.iterations}


@dataclass(frozen=True)
class StepwiseSwarm(Swarm):
    """A swarm searches the unknowns one after the other.

    Order: singular directions of the identification Jacobian, strongest first; or, as in paper
    004, each unknown is frozen as soon as it has settled, then all are searched together.
    """

    order: str

    def search(
        self,
        line: LinearResidual,
        problem: Problem,
        start: Array,
        rng: np.random.Generator,
        watch: Watch,
    ) -> SwarmResult:
        """See `InRounds.search`."""
        del start
        box, told = box_of(problem), _told(line, watch)
        if self.order == SETTLING:
            return stepwise(told, box, self.swarm, rng)
        return stepwise_singular(told, line.factor, box, self.swarm, rng)

    def most(self, unknowns: int) -> int:
        """See `Method.most`."""
        searches = unknowns + (self.order == SETTLING)
        return searches * super().most(unknowns)

    @property
    def settings(self) -> Mapping[str, int | str]:
        """See `Method.settings`."""
        return {**super().settings, "order": self.order}


_LAWS: Mapping[str, Law] = {"qpso": Qpso(), "apso": Apso(), "pso": Pso()}
_STEPWISE = "stepwise_qpso"
METHODS = (LeastSquares.name, Alternating.name, _STEPWISE, *_LAWS)


def method_named(
    name: str,
    particles: int | None = None,
    iterations: int | None = None,
    order: str | None = None,
) -> Method:
    """Create a method by its name.

    Args:
        name: one of `METHODS`.
        particles: of a swarm; by default paper 004's N = 80.
        iterations: of each search of a swarm; by default paper 004's t_max = 300, or 120 for a
            single direction.
        order: of stepwise QPSO, "singular" (default) or "settled".

    Raises:
        InputError: no such method, or one that takes no such option.
    """
    if name not in METHODS:
        raise InputError(f"method: {name!r} is not allowed; {', '.join(METHODS)}")
    swarms = (_STEPWISE, *_LAWS)
    for option, value, takers in (
        ("particles", particles, swarms),
        ("iterations", iterations, swarms),
        ("order", order, (_STEPWISE,)),
    ):
        if value is not None and name not in takers:
            raise InputError(
                f"{option}: {value} is not allowed with method {name}; with {', '.join(takers)}"
            )
    if order not in (None, *ORDERS):
        raise InputError(f"order: {order!r} is not allowed; {', '.join(ORDERS)}")
    if name == LeastSquares.name:
        return LeastSquares()
    if name == Alternating.name:
        return Alternating()
    usual = SwarmSettings(law=_LAWS.get(name, Qpso()))
    if name == _STEPWISE and order != SETTLING:
        usual = replace(usual, iterations=_ONE_DIRECTION)
    swarm = replace(
        usual,
        particles=usual.particles if particles is None else particles,
        iterations=usual.iterations if iterations is None else iterations,
    )
    if name == _STEPWISE:
        return StepwiseSwarm(name, swarm, order or SINGULAR)
    return Swarm(name, swarm)


def _told(residual: Residual, watch: Watch) -> Residual:
    """The residual with a callback that receives the number of evaluations."""

    def of(values: Array) -> Array:
        watch(len(values))
        return residual(values)

    return of
