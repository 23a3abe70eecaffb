"""The methods that a session can be fitted by, by their names: each solves the same problem.

Whitened residuals of positions, and of turns where they take part, by all that is unknown, priors
as rows, a robust loss: `problem.py`. Least squares asks the chain itself. The others are those of
the papers and search the error model about the drawing (`error_model.py`), then about what was
found, so that the squares of the errors are taken in and the loss fits what is left.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.estimation.problem import (
    SETTLED,
    Problem,
    Solution,
    solution_at,
    solve,
    spread_of,
)
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

Watch = Callable[[int], object]
"""Is told how many evaluations were made since it was told last."""

ROUNDS = 4  # error models, one about the other's find; the farthest bent robot takes as many
ORDERS = SINGULAR, SETTLING = "singular", "settled"  # in which stepwise QPSO may go
_GOOD_ENOUGH = 0.05  # of chi square, in fits that only predict what was held out
_TURNS = 300_000  # of geometry and frame; the slowest robot of the package takes 93 000
_ONE_DIRECTION = 120  # iterations: a direction alone is found sooner than twenty together


@dataclass(frozen=True)
class Fit:
    """Where a method came to rest, and what it cost."""

    solution: Solution
    # machines that were tried: by the chain in least squares, else by the error model
    evaluations: int


class Method(ABC):
    """A way from a problem to its solution."""

    name: str

    @abstractmethod
    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Array | None = None,
    ) -> Fit:
        """Solve the problem.

        Args:
            problem: with all that may be wrong free.
            rng: source of all chance.
            watch: is told of evaluations while they are made.
            near: a fit to these poses and others. What is asked for is then a prediction of the
                others, and only a method that ends at the same place wherever it begins may begin
                there.

        Raises:
            DataError: no rest, or a machine that cannot reach a pose.
        """

    def most(self, unknowns: int) -> int:
        """Evaluations of a fit at most that `watch` hears of, 0 where it takes no time."""
        del unknowns
        return 0

    @property
    def settings(self) -> Mapping[str, int | str]:
        """What was chosen of it, for the record."""
        return {}


@dataclass(frozen=True)
class LeastSquares(Method):
    """Levenberg-Marquardt on the chain."""

    name: str = "least_squares"

    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Array | None = None,
    ) -> Fit:
        """See `Method.fit`; nothing is left to chance."""
        del rng, watch
        found = solve(problem, near, settled=SETTLED if near is None else _GOOD_ENOUGH)
        return Fit(found, found.evaluations)


class InRounds(Method):
    """A search of the error model, about the drawing and then about what it found."""

    @abstractmethod
    def search(
        self,
        line: LinearResidual,
        problem: Problem,
        start: Array,
        rng: np.random.Generator,
        watch: Watch,
    ) -> SwarmResult:
        """The least of the error model, by the problem's unknowns, (F,)."""

    def fit(
        self,
        problem: Problem,
        rng: np.random.Generator,
        watch: Watch,
        near: Array | None = None,
    ) -> Fit:
        """See `Method.fit`; always begins at the drawing."""
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
    """Paper 002: geometry and the device's frame in turn, until both stand still.

    With the frame goes where the reflector, or how the probe, is put: the device's as well.
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
    """All unknowns at once, by a swarm in the box of the priors."""

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
        """See `InRounds.search`; every round from places by chance."""
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
    """Unknowns one after the other.

    By singular direction of the identification Jacobian, strongest first; or, as paper 004 has it,
    each as soon as it has settled, then all together.
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
    """A method by its name.

    Args:
        name: one of `METHODS`.
        particles: of a swarm; paper 004's N = 80 where not given.
        iterations: of each of a swarm's searches; paper 004's t_max = 300 where not given, 120 of
            a single direction.
        order: of stepwise QPSO, "singular" (where not given) or "settled".

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
    """The residual, telling how often it is asked."""

    def of(values: Array) -> Array:
        watch(len(values))
        return residual(values)

    return of
