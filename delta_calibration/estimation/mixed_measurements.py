"""One least-squares fit over observations of different kinds, priors as rows.

    minimise  sum_kinds |missed / sigma|^2 + sum_prior ((g - g_0) / prior)^2

over the geometry and, if any kind depends on it, the frame of the device: the problem of
`problem.py` without a robust loss. Unknowns that neither observations nor priors determine are
named and have an infinite standard error; they stay near their nominal values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import at_rest
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation.measurements import (
    Measured,
    Observation,
    PlacedMachine,
    bare_chain,
)
from delta_calibration.estimation.observability import Observability, observe
from delta_calibration.estimation.problem import Problem, scales
from delta_calibration.estimation.solver import Solution, solve
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import Mechanism
from delta_calibration.theta import frame_names

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SETTLED = 1e-12  # decrease of chi square under which the search has converged
_RESTLESS = 1e-3  # predicted further decrease of chi square: the search has not converged
_NONE = 1e-8  # singular values under this share of the largest count as zero
_PART = 1e-6  # squared share of an unknown in the null space, from which it is undetermined
_SPARE = 1e-6  # degrees of freedom under which chi square cannot be computed
_PIVOT = 5e-3  # [m] prior standard deviation of the position of a ballbar's ball
FRAME_NAMES = frame_names("device")


@dataclass(frozen=True)
class MixedFit:
    """Result of a fit: the machine, and how well the measurements determine it.

    `told` is the effective number of parameters, the combinations of unknowns that the
    observations determine: one that they leave as uncertain as its prior counts 0.
    """

    machine: PlacedMachine
    names: tuple[str, ...]  # of the fitted unknowns, (F,)
    covariance: Array  # (F, F) by noise and priors
    prior: Array  # (F,) inf where there is none or none was used
    observability: Observability  # of the observations alone
    missed: tuple[Array, ...]  # residuals of each observation, (n, d) [m, rad, px]
    unset: tuple[str, ...]  # unknowns that are not fully determined, even by priors
    told: float
    chi_square: float  # per degree of freedom, by the stated noise; inf if there are none

    @property
    def std(self) -> Array:
        """Standard errors, (F,); infinite for undetermined unknowns."""
        unset = np.isin(self.names, self.unset)
        return np.where(unset, np.inf, np.sqrt(np.diag(self.covariance)))

    def rms(self, observation: int, numbers: slice = slice(None)) -> float:
        """Root mean square length of an observation's residuals over `numbers` [m, rad, px]."""
        missed = self.missed[observation][:, numbers]
        return float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))


def fit_observations(
    mechanism: Mechanism,
    observations: Sequence[Observation],
    frame: Frame | None = None,
    free: Mask | None = None,
    priors: bool = True,
) -> MixedFit:
    """Fit geometry and device frame to all observations together.

    Args:
        mechanism: drawing and priors.
        observations: any kinds, at least one.
        frame: `T_device_base` to start from; needed where a kind depends on it.
        free: which geometry parameters are fitted, (p,); all where not given.
        priors: whether the priors of the parameters are used.

    Raises:
        InputError: no observation, no frame where one is needed, or two devices at unknown
            places.
        DataError: without priors, fewer numbers than unknowns; joints out of the nominal machine's
            reach, points behind the camera, or no convergence.
    """
    problem = problem_of([Measured(o, at_rest(o.joint)) for o in observations], mechanism, frame)
    if free is not None:
        held = np.ones(problem.layout.size, dtype=bool)
        held[problem.layout.geometry] = free
        problem = problem.only(problem.free & held)
    if not priors:
        problem = replace(problem, has_prior=np.zeros_like(problem.has_prior))
    _require_enough(problem)
    _require_seen(problem)
    return _judged(problem, solve(problem, robust=False, settled=_SETTLED))


def problem_of(measured: Sequence[Measured], mechanism: Mechanism, frame: Frame | None) -> Problem:
    """The problem of observations: geometry free, and the frame if any kind depends on it.

    Args:
        measured: any kinds, at least one.
        mechanism: drawing and priors.
        frame: `T_device_base` to start from; needed where a kind depends on it.

    Raises:
        InputError: no observation, no frame where one is needed, or two devices at unknown
            places.
    """
    devices = sorted({m.observation.device for m in measured if m.observation.device})
    if not measured:
        raise InputError("observations: none is not allowed; one or more")
    if devices and frame is None:
        raise InputError(f"frame: none is not allowed with a {devices[0]}; where to start from")
    if len(devices) > 1:
        raise InputError(
            f"{' and '.join(devices)} at unknown places are not allowed; one of them at most"
        )
    chain = bare_chain(mechanism)
    layout, (basis, known) = chain.layout, scales(chain)
    start = chain.join(mechanism.parameters.nominal, chain.offset, frame or Frame.identity())
    turns = any(m.observation.turns for m in measured)
    placed = [layout.frame if turns else layout.place] if devices else []
    free = layout.mask(layout.geometry, *placed)
    if devices and not turns:  # a circle does not determine its centre normal to its plane
        basis[layout.place, layout.place] = _PIVOT * np.eye(3)
        known[layout.place] = True
    return Problem(chain, tuple(measured), start, basis, known, free)


def _judged(problem: Problem, solution: Solution) -> MixedFit:
    """Return the fit with its covariance, observability and chi square.

    Raises:
        DataError: the search has not converged.
    """
    layout, free = problem.layout, problem.free
    names = np.array(problem.chain.parameters.names)
    names[layout.frame] = FRAME_NAMES
    own = tuple(names[free].tolist())
    data, error = solution.at.rows, solution.residual.ravel()
    white = np.concatenate([data, np.diag(problem.expected)])
    spread, loose = _spread(white)
    ahead = data.T @ error - problem.expected * solution.z
    if not ahead @ spread @ ahead < _RESTLESS:
        raise DataError("the fit did not converge: more steps still improve it")
    told = float(np.trace(spread @ data.T @ data))
    scale = np.diag(problem.basis)[free]
    degrees = solution.at.numbers.sum() - told
    return MixedFit(
        machine=PlacedMachine(problem.chain, solution.theta),
        names=own,
        covariance=scale[:, None] * spread * scale,
        prior=np.where(problem.has_prior[free], scale, np.inf),
        observability=observe(data[:, None] / scale, scale, own),
        missed=tuple(linear.missed for linear in problem.about(solution.theta)),
        unset=tuple(name for name, yes in zip(own, loose, strict=True) if yes),
        told=told,
        chi_square=float(error @ error / degrees) if degrees > _SPARE else np.inf,
    )


def _spread(white: Array) -> tuple[Array, Mask]:
    """Covariance (F, F) by the whitened Jacobian, and mask of the undetermined unknowns."""
    size = np.linalg.norm(white, axis=0)
    size[size == 0.0] = 1.0
    _, values, across = np.linalg.svd(white / size, full_matrices=False)
    shows = values > _NONE * values[0]
    half = across[shows] / values[shows, None]
    loose = 1.0 - np.sum(across[shows] ** 2, axis=0) > _PART
    return half.T @ half / np.outer(size, size), loose


def _require_enough(problem: Problem) -> None:
    """Refuse fewer numbers than unknowns without priors."""
    numbers = sum(len(m.at) * len(m.observation.sigma) for m in problem.measured)
    known, size = int(problem.expected.sum()), len(problem.expected)
    if numbers + known < size:
        raise DataError(f"{numbers} measured numbers cannot set {size} unknowns")


def _require_seen(problem: Problem) -> None:
    """Refuse what the start cannot predict: joints out of reach, a point behind its camera."""
    mechanism, nominal = problem.chain.mechanism, problem.chain.mechanism.parameters.nominal
    parts = zip(problem.measured, problem.about(problem.theta0), strict=True)
    for observation, linear in ((m.observation, linear) for m, linear in parts):
        for joint in observation.joints():
            what = f"{observation.kind}: joints"
            mechanism.require_reach(mechanism.forward(joint, nominal), joint, what, "rad, m")
        bad = np.flatnonzero(~np.isfinite(linear.missed).all(axis=1))
        if bad.size:
            raise DataError(
                f"{observation.kind}: number {bad[0] + 1} cannot be seen from where the "
                f"{observation.device or 'device'} is said to stand: behind it"
            )
