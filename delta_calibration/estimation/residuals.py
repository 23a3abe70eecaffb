"""Residuals of a fit: of the poses it has seen, held out, and studentized."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Poses
from delta_calibration.estimation.cross_validation import Known, studentized
from delta_calibration.estimation.method import Method, Watch
from delta_calibration.estimation.positions import Missed
from delta_calibration.estimation.solver import Solution

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FOLDS = 5


@dataclass(frozen=True)
class Residuals:
    """Root mean square and largest 3-D distance between measured and predicted poses [m].

    Over the poses that the fit does not reject, with equal weights. The held-out figures are the
    *error left* of all outputs: the places are divided at random into five parts, each predicted
    by a fit to the other four, so that most of them lie between places that the fit has seen.
    """

    in_sample: float
    held_out: float  # the error left
    held_out_max: float
    held_out_whitened: float  # RMS in units of each coordinate's noise; 1 is the best possible


def parts_of(poses: Poses, seed: int) -> Index:
    """Random held-out part of each pose, (n,); all poses of a place are in the same part."""
    places = np.unique(poses.place)
    part = np.random.default_rng(seed).permutation(len(places)) % min(FOLDS, len(places))
    return np.asarray(part[np.searchsorted(places, poses.place)])


def held_out(
    solution: Solution,
    folds: Index,
    method: Method,
    rng: np.random.Generator,
    watch: Watch,
) -> Array:
    """Held-out residuals: measured less predicted by a fit to the other parts, (n, 3) [m]."""
    problem = solution.problem
    missed = np.zeros_like(problem.y)
    for part in np.unique(folds):
        held, seen = np.flatnonzero(folds == part), np.flatnonzero(folds != part)
        fitted = method.fit(problem.take(seen), rng, watch, solution.near(seen)).solution
        at = problem.at.take(held)
        machine = problem.chain.see(at, fitted.theta[problem.layout.chain], asked="nothing")
        problem.chain.mechanism.require_reach(machine.x, at.joint, "held-out command")
        missed[held] = problem.y[held] - machine.reading
    return missed


def only(values: Array, counted: NDArray[np.bool_]) -> Array:
    """Rows (n, k) of the accepted poses, NaN for the others."""
    return np.where(counted[:, None], values, np.nan)


def figures_of(solution: Solution, missed: Array, counted: NDArray[np.bool_]) -> Residuals:
    """Residual figures of a fit, given its held-out residuals (n, 3) [m]."""
    whiten = solution.problem.whiten[counted, :3, :3]  # triangular: the position's own
    return residuals_of(solution.distances[counted], missed[counted], whiten)


def residuals_of(in_sample: Array, missed: Array, whiten: Array) -> Residuals:
    """Compute the residual figures of the accepted poses.

    Args:
        in_sample: 3-D distance to the prediction by the fit to all poses, (n,) [m].
        missed: held-out residuals, measured less predicted, (n, 3) [m].
        whiten: whitening matrices, (n, 3, 3) [1/m].
    """
    distance = np.linalg.norm(missed, axis=1)
    whitened = (whiten @ missed[..., None])[..., 0]
    return Residuals(
        in_sample=float(np.sqrt(np.mean(in_sample**2))),
        held_out=float(np.sqrt(np.mean(distance**2))),
        held_out_max=float(distance.max()),
        held_out_whitened=float(np.sqrt(np.mean(whitened**2))),
    )


def known_of(solution: Solution) -> Known:
    """Information of data and priors about the free unknowns, each pose with its weight."""
    slope, residual = _weighed(solution)
    flat = slope.reshape(-1, slope.shape[-1])
    return Known(flat.T @ flat, flat.T @ residual.reshape(-1), solution.problem.expected)


def _weighed(solution: Solution) -> tuple[Array, Array]:
    """Whitened Jacobian (n, d, F) and residuals at z = 0 (n, d), times the root of the weight."""
    root = np.sqrt(solution.weight)[:, None]
    slope = root[..., None] * solution.at.slope
    return slope, root * solution.residual + slope @ solution.z


def chi_squares(solution: Solution, place: Index, used: float) -> tuple[float, float]:
    """Chi square per degree of freedom: of all poses, and of the means of the places.

    A model error is the same at every visit of a place; backlash to either side cancels.
    """
    weight, width = solution.weight, solution.residual.shape[1]
    residual = weight[:, None] * solution.residual
    visits = np.bincount(place, weight > 0)
    mean = np.array([np.bincount(place, each) for each in residual.T]).T[visits > 0]
    mean /= np.sqrt(visits[visits > 0])[:, None]
    degrees = width * np.array([np.count_nonzero(weight), len(mean)]) - used
    squares = np.array([np.sum(residual**2), np.sum(mean**2)])
    found = squares / np.maximum(degrees, 1.0)
    return float(found[0]), float(found[1])


def studentized_of(solution: Solution, known: Known, place: Index) -> Missed:
    """Studentized residuals of all poses: as large as if the fit had absorbed none of them."""
    problem, counted = solution.problem, solution.weight > 0
    slope, residual = _weighed(solution)
    root = np.sqrt(np.where(counted, solution.weight, 1.0))
    colour = np.linalg.inv(problem.whiten[:, :3, :3]) / root[:, None, None]
    missed = colour @ studentized(known, slope, residual, place)[:, :3, None]
    return Missed(problem.at, only(missed[..., 0], counted), problem.whiten[:, :3, :3], place)


def turn_missed(solution: Solution) -> float | None:
    """RMS angle of the orientation residual [rad]; None if orientations were not fitted."""
    if not solution.problem.layout.has_mount:
        return None
    return float(np.sqrt(np.mean(np.sum(solution.missed[:, 3:] ** 2, axis=1))))
