"""Whether what is left is noise.

Lack of fit: the residuals of the poses against the noise that repeats show. Moran's I: whether
neighbours in place, joint angles, time or direction err alike,

    I = sum_ij w_ij r_i . r_j / sum_i r_i . r_i        w: the nearest neighbours of each

Both are compared with draws of chance that went through the same fit, which leaves its own traces
in residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import chi2, norm

from delta_calibration.diagnosis.evidence import Evidence

Array = NDArray[np.float64]

_DRAWS = 200
_NEIGHBOURS = 6
_LOOKED_AT = 24  # nearest ones among which neighbours are taken
_APART = 10.0  # [rad] that directions are set apart by
_SOON = 30.0  # [s]
_EXCEPTION = 0.3  # share of the poses


@dataclass(frozen=True)
class Audit:
    """Probabilities that chance leaves as much."""

    p: dict[str, float]
    excess: float  # [m] root mean square of what is left at the poses beyond the noise
    worst: Array  # (3,) [m] place in the base where it is largest


def audit(evidence: Evidence, noise_degrees: float, rng: np.random.Generator) -> Audit:
    """Test what a model leaves of the poses' residuals.

    Args:
        evidence: with everything that the model holds in its nuisance.
        noise_degrees: of freedom of the stated noise.
        rng: of the draws.
    """
    rows = np.flatnonzero(evidence.believed[: evidence.poses] & ~_on_the_way(evidence))
    chance = evidence.weigh(evidence.draw(_DRAWS, rng)).reshape(len(evidence), 3, _DRAWS)[rows]
    left = evidence.left()[rows]
    square, squares = float(np.sum(left**2)), np.sum(chance**2, axis=(0, 1))
    spread = np.sqrt(squares.var() + 2 * squares.mean() ** 2 / noise_degrees)
    degrees = 2 * (squares.mean() / spread) ** 2  # of the chi square with this mean and spread
    p = {"lack_of_fit": float(chi2.sf(square * degrees / squares.mean(), degrees))}
    for name, near in _neighbourhoods(evidence, rows).items():
        own, drawn = _moran(left[:, :, None], near), _moran(chance, near)
        if drawn.std() > 0:
            p[f"moran_{name}"] = float(norm.sf((own[0] - drawn.mean()) / drawn.std()))
    place = evidence.chain.mechanism.position(evidence.pose[rows])
    whole = np.linalg.solve(evidence.whiten[rows], left[..., None])[..., 0]
    around = cKDTree(place).query(place, k=min(_NEIGHBOURS, len(rows)))[1].reshape(len(rows), -1)
    alike = whole[around].mean(axis=1)
    return Audit(
        p=p,
        excess=float(np.sqrt(max(0.0, 1 - squares.mean() / square) * np.mean(whole**2) * 3)),
        worst=place[int(np.argmax(np.linalg.norm(alike, axis=1)))],
    )


def _on_the_way(evidence: Evidence) -> NDArray[np.bool_]:
    """Stops on the way of a longer motion, (poses,), where they are the exception.

    The joints need not have been moved to them and away from them anew: they may share one rest
    error, which would look like structure.
    """
    time = evidence.at.time[: evidence.poses]
    moving = np.sort(evidence.at.time[evidence.poses :])
    if not moving.size:
        return np.zeros(len(time), dtype=bool)
    after = np.searchsorted(moving, time)
    since = time - moving[np.clip(after - 1, 0, None)]
    until = moving[np.clip(after, None, len(moving) - 1)] - time
    within = (since >= 0) & (until >= 0) & (np.maximum(since, until) < _SOON / 2)
    return np.asarray(within & (within.mean() < _EXCEPTION))


def _neighbourhoods(
    evidence: Evidence, rows: NDArray[np.intp]
) -> dict[str, tuple[NDArray[np.intp], Array]]:
    """Neighbours of each pose in several spaces: who they are, (n, k), and their weights, (n, k).

    Poses of one half minute do not count as neighbours: between stops that follow each other the
    joints may not have left their rest.
    """
    at = evidence.at.take(rows)
    place = evidence.chain.mechanism.position(evidence.pose[rows])
    spaces = {"position": place, "joints": at.joint}
    if (np.ptp(at.direction, axis=0) > 0).any():
        spaces["direction"] = np.concatenate([at.joint, _APART * at.direction], axis=1)
    near = {name: _nearest(where, at.time) for name, where in spaces.items()}
    return {**near, "time": _next(at.time)}


def _nearest(where: Array, time: Array) -> tuple[NDArray[np.intp], Array]:
    """The nearest others that were not measured within the half minute."""
    count = min(_LOOKED_AT, len(where))
    near = cKDTree(where).query(where, k=count)[1].reshape(len(where), count)
    apart = np.abs(time[near] - time[:, None]) >= _SOON
    first = np.cumsum(apart, axis=1) <= _NEIGHBOURS
    return near, (apart & first).astype(float)


def _next(time: Array) -> tuple[NDArray[np.intp], Array]:
    """The next ones in time after the half minute."""
    order = np.argsort(time)
    begin = np.searchsorted(time[order], time + _SOON)
    places = begin[:, None] + np.arange(_NEIGHBOURS)
    inside = places < len(time)
    return order[np.minimum(places, len(time) - 1)], inside.astype(float)


def _moran(residual: Array, near: tuple[NDArray[np.intp], Array]) -> Array:
    """I of residuals (n, 3, draws), (draws,)."""
    others, weight = near
    alike = np.zeros(residual.shape[2])
    for column in range(others.shape[1]):
        alike += np.einsum(
            "n,nid,nid->d", weight[:, column], residual, residual[others[:, column]]
        )
    share = weight.sum() / len(residual)
    return np.asarray(alike / max(share, 1e-300) / np.sum(residual**2, axis=(0, 1)))
