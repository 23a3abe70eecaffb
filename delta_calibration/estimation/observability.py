"""Identifiability: rank, unidentifiable parameter combinations and observability indices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError

Array = NDArray[np.float64]

_ZERO = 1e-8  # singular values under this share of the largest count as zero
# length of a unit column's part outside the span of the ones before it, if it depends on them
_DEPENDENT = 1e-6
# coefficients of a combination smaller than this (in scaled units) are left out of its sentence
_PART = 1e-3
_NAMED = 4  # largest number of parameters that a sentence names


@dataclass(frozen=True)
class Redundancy:
    """An unidentifiable combination: `parameter` acts like a linear combination of others."""

    parameter: str
    # name, coefficient in the parameters' own units; empty: no effect
    same_as: tuple[tuple[str, float], ...]

    def sentence(self) -> str:
        """The combination as a sentence."""
        if not self.same_as:
            return f"{self.parameter} has no visible effect"
        parts = [f"{value:+.3g} {name}" for name, value in self.same_as[:_NAMED]]
        more = len(self.same_as) - _NAMED
        rest = f" and {more} more" if more > 0 else ""
        return f"{self.parameter} has the same effect as {' '.join(parts)}{rest}"


@dataclass(frozen=True)
class Observability:
    """Rank, redundancies and indices of the whitened, scaled identification Jacobian."""

    rank: int
    columns: int
    redundancies: tuple[Redundancy, ...]
    indices: dict[str, float]


def observe(jacobian: Array, scale: Array, names: Sequence[str]) -> Observability:
    """Rank, redundant combinations and observability indices of a whitened Jacobian.

    The indices are those in use since Borm and Menq (O1, geometric mean of the singular values
    over the root of the number of poses), Driels and Pathre (O2, inverse condition number), Nahvi
    (O3, smallest singular value; O4, noise amplification: smallest squared over largest), computed
    over the identifiable combinations.

    Args:
        jacobian: d(whitened reading)/d(theta), (n, d, P).
        scale: (P,), expected size of each parameter.
        names: (P,).
    """
    scaled = jacobian.reshape(-1, jacobian.shape[-1]) * scale
    # the same column lengths and angles as the Jacobian, in fewer rows
    matrix = np.asarray(np.linalg.qr(scaled, mode="r"))
    norms = np.linalg.norm(matrix, axis=0)
    if not norms.any():
        raise DataError("nothing is identifiable: no reading depends on any parameter")
    shows = norms > _ZERO * norms.max()  # the rest is rounding, which must not be scaled up
    unit = np.where(shows, matrix / np.where(shows, norms, 1.0), 0.0)
    values = np.linalg.svd(unit, compute_uv=False)
    rank = int(np.sum(values > _ZERO * values[0]))
    shown = np.linalg.svd(matrix, compute_uv=False)[:rank]
    indices = {
        "O1": float(np.exp(np.log(shown).mean()) / np.sqrt(len(jacobian))),
        "O2": float(shown[-1] / shown[0]),
        "O3": float(shown[-1]),
        "O4": float(shown[-1] ** 2 / shown[0]),
    }
    redundancies = _redundancies(unit, norms, scale, names)
    return Observability(rank, matrix.shape[1], redundancies, indices)


def _redundancies(
    unit: Array, norms: Array, scale: Array, names: Sequence[str]
) -> tuple[Redundancy, ...]:
    """Each column that depends on the ones before it, as a linear combination of those.

    Columns are taken in the order of the parameters, so that the sentences relate neighbours: a
    platform joint to its base joint, the frame to the base joints.
    """
    chosen: list[int] = []
    basis = np.zeros((len(unit), 0))
    found = []
    for column, name in enumerate(names):
        vector = unit[:, column]
        if not vector.any():
            found.append(Redundancy(name, ()))
            continue
        left = vector - basis @ (basis.T @ vector)
        left = left - basis @ (basis.T @ left)  # twice is enough (Kahan, Parlett)
        if np.linalg.norm(left) > _DEPENDENT:
            basis = np.column_stack([basis, left / np.linalg.norm(left)])
            chosen.append(column)
            continue
        mixture = np.linalg.solve(basis.T @ unit[:, chosen], basis.T @ vector)
        own = norms[column] / scale[column]
        parts = [
            (abs(share), names[other], float(share * own * scale[other] / norms[other]))
            for share, other in zip(mixture, chosen, strict=True)
            if abs(share) > _PART
        ]
        found.append(Redundancy(name, tuple((n, v) for _, n, v in sorted(parts, reverse=True))))
    return tuple(found)


def strong_correlations(
    covariance: Array, names: Sequence[str], limit: float = 0.95
) -> tuple[tuple[str, str, float], ...]:
    """Pairs of estimates with a correlation beyond `limit` in size, strongest first."""
    sigma = np.sqrt(np.diag(covariance))
    correlation = np.clip(covariance / np.outer(sigma, sigma), -1.0, 1.0)  # rounding may exceed 1
    strong = np.argwhere(np.triu(np.abs(correlation) > limit, k=1)).tolist()
    pairs = [(names[a], names[b], float(correlation[a, b])) for a, b in strong]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair[2])))
