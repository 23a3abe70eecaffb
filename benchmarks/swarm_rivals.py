"""Other libraries on the objective of the swarm, each used as intended and not slowed down.

All search the same box, scaled to +-1, for the same distance, which is compiled. A library that
accepts whole swarms is given whole swarms. All stop at the same tolerance, at once: the objective
itself ends the search. Where a library leaves the constants of a swarm to its user they are those
of Clerc and Kennedy, w = 0.729 and c1 = c2 = 1.494, which converge fastest.
"""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST = 20_000  # evaluations before a target is given up
PARTICLES = 24
W, C1, C2 = 0.729, 1.494, 1.494


class Reached(Exception):  # noqa: N818 (it is no error)
    """The objective has reached the tolerance, or the limit of evaluations."""


class Objective:
    """Distance from a target [m] over the box scaled to +-1; counts calls, ends the search."""

    def __init__(
        self, point: Callable[[Array], Array], q: Array, target: Array, bound: float, tol: float
    ) -> None:
        self._point, self._q, self._target = point, q, target
        self._bound, self._tolerance = bound, tol
        self.evaluations, self.least = 0, np.inf
        self.best = np.zeros(3)

    def gap(self, x: Array) -> Array:
        """Points at positions (n, 3) minus the target, (n, 3) [m]."""
        return self._point(self._q + self._bound * x) - self._target

    def many(self, x: Array) -> Array:
        """Distances at positions (n, 3), as (n,)."""
        x = np.clip(x, -1.0, 1.0)
        gap = self.gap(x)
        far = np.sqrt(np.sum(gap * gap, axis=1))
        far[~np.isfinite(far)] = 1.0
        self.evaluations += len(far)
        nearest = int(far.argmin())
        if far[nearest] < self.least:
            self.least, self.best = float(far[nearest]), x[nearest].copy()
        if self.least <= self._tolerance or self.evaluations >= MOST:
            raise Reached
        return far

    def one(self, x: Array) -> float:
        """Distance at one position (3,)."""
        return float(self.many(np.asarray(x)[None])[0])


def pyswarms(f: Objective, seed: int) -> None:
    """GlobalBestPSO, with whole swarms."""
    np.random.seed(seed)  # noqa: NPY002 (what the library draws from)
    single = importlib.import_module("pyswarms.single")
    swarm = single.GlobalBestPSO(
        n_particles=PARTICLES,
        dimensions=3,
        options={"c1": C1, "c2": C2, "w": W},
        bounds=(-np.ones(3), np.ones(3)),
    )
    swarm.optimize(f.many, iters=MOST // PARTICLES, verbose=False)


def cma(f: Objective, seed: int) -> None:
    """CMA-ES from the middle, with its default population."""
    library = importlib.import_module("cma")
    options = {"bounds": [-1, 1], "verbose": -9, "seed": seed + 1, "tolfun": 0, "tolx": 0}
    options |= {"tolfunhist": 0, "tolflatfitness": 1000}
    search = library.CMAEvolutionStrategy(3 * [0.0], 0.3, options)
    while True:
        places = search.ask()
        search.tell(places, f.many(np.array(places)))


def mealpy(f: Objective, seed: int) -> None:
    """OriginalPSO; the library evaluates one position at a time."""
    library = importlib.import_module("mealpy")
    box = library.FloatVar(lb=3 * [-1.0], ub=3 * [1.0])
    problem = {"bounds": box, "minmax": "min", "obj_func": f.one, "log_to": None}
    model = library.PSO.OriginalPSO(epoch=MOST // PARTICLES, pop_size=PARTICLES, c1=C1, c2=C2, w=W)
    model.solve(problem, seed=seed)


def pymoo(f: Objective, seed: int) -> None:
    """The library's own adaptive PSO, with whole swarms."""
    base = importlib.import_module("pymoo.core.problem").Problem
    swarm = importlib.import_module("pymoo.algorithms.soo.nonconvex.pso").PSO
    minimize = importlib.import_module("pymoo.optimize").minimize

    class Distance(base):  # type: ignore[misc, valid-type]
        def __init__(self) -> None:
            super().__init__(n_var=3, n_obj=1, xl=-np.ones(3), xu=np.ones(3))

        def _evaluate(self, x: Array, out: dict[str, Any], *_: object, **__: object) -> None:
            out["F"] = f.many(x)[:, None]

    minimize(Distance(), swarm(pop_size=PARTICLES), ("n_eval", MOST), seed=seed)


def root(f: Objective, seed: int) -> None:
    """Powell's hybrid method on the three components of the gap, started at the command."""
    del seed  # no random numbers
    optimize = importlib.import_module("scipy.optimize")

    def gap(x: Array) -> Array:
        f.many(x[None])
        return np.asarray(f.gap(x[None])[0])

    optimize.root(gap, np.zeros(3))


Solver = Callable[[Objective, int], None]  # with a seed

RIVALS: dict[str, Solver] = {
    "pyswarms": pyswarms,
    "cma": cma,
    "mealpy": mealpy,
    "pymoo": pymoo,
}


def installed(name: str) -> bool:
    """Whether the library of this name can be imported."""
    logging.disable(logging.INFO)  # some libraries print when they are imported
    try:
        importlib.import_module(name)
    except ImportError:
        return False
    return True


def solve(solver: Solver, f: Objective, seed: int) -> None:
    """Run a solver until the objective ends it, or it ends by itself."""
    with suppress(Reached):
        solver(f, seed)
