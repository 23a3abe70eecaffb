"""Tests whether the residuals of a fit are noise.

Lack of fit: the residuals of the poses against the noise estimated from repeats. Moran's I:
whether neighbours in position, joint angles, time or direction, or along a motion, have similar
residuals,

    I = sum_ij w_ij r_i . r_j / sum_i r_i . r_i        w: the nearest neighbours of each

Both are compared with simulated noise that went through the same fit, because a fit leaves traces
of its own in the residuals. No model is perfect: structure too small to matter is allowed beside
the noise, m = 0.05 times as large at rest, 0.15 times in motion. With E c the mean chi square c of
simulated noise, it raises c by m^2 E c, and I by m^2 (E c / c)^2: if the residuals are far below
the noise of the repeats, this noise comes from gross errors, and a fit weighted by it leaves
structure of its own.

True gross errors are independent: each pose misses in a direction of its own. If neighbours among
the poses set aside as gross errors miss alike, they are no outliers.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import groupby, islice

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import chdtrc

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.constants import ALPHA, SLIGHT, SLIGHT_MOVING
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.statement import LACK_OF_FIT, MOTION
from delta_calibration.diagnosis.tails import moments, pearson3
from delta_calibration.threads import mapped

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Near = tuple[Index, Array]  # neighbours of each, (n, k), and their weights, (n, k)

_DRAWS, _AT_A_TIME = 200, 50
_MORE = 20  # sets of draws instead of one if p is close to ALPHA
_CLOSE = 20.0  # factor above ALPHA up to which these are made
_FAR = 1000.0  # the same below: tails of a few draws may be that much too short
_NEIGHBOURS = 6
_LOOKED_AT = 24  # nearest ones among which neighbours are taken
_APART = 10.0  # [rad] of a coordinate per unit of direction, which is -1 to 1
_SOON = 30.0  # [s] least time between neighbours
_FEWEST_ASIDE = 3  # fewest poses set aside that can be tested for missing alike
_TURNS = 2000  # draws of their directions


@dataclass(frozen=True)
class ResidualTests:
    """Results of the tests: p values, and size and place of the structure in the residuals."""

    p: dict[str, float]  # by test: probability that noise alone leaves as much
    excess: float  # [m] root mean square of the poses' residuals beyond the noise
    in_motion: float  # [m] root mean square of the structure along motions
    worst: Array  # (3,) [m] position in the base with the largest mean residual of neighbours
    ratio: float = 1.0  # root mean square of the poses' residuals over that of simulated noise


def audit(
    evidence: LinearizedModel, noise_degrees: float, rng: np.random.Generator
) -> ResidualTests:
    """Test whether the residuals of a model are noise.

    If a p value is close to the threshold, many more draws are made.

    Args:
        evidence: with all terms of the model in its nuisance.
        noise_degrees: degrees of freedom of the noise estimate.
        rng: of the draws.
    """
    asked, every = _asked(evidence), evidence.left()
    chance = _drawn(evidence, asked, 1, rng)
    p = _probabilities(every, asked, chance, noise_degrees)
    if _close(p.values(), len(p)):
        for own, moving in ((slice(-1), False), (slice(-1, None), True)):
            if _close([p[name] for name in p if (name == MOTION) is moving], len(p)):
                chance[own] = _drawn(evidence, asked[own], _MORE, rng)
        p = _probabilities(every, asked, chance, noise_degrees)
    rows = asked[0].rows
    place = evidence.chain.mechanism.position(evidence.pose[rows])
    whole = evidence.metres(every[rows], rows)
    around = cKDTree(place).query(place, k=min(_NEIGHBOURS, len(rows)))[1].reshape(len(rows), -1)
    alike = whole[around].mean(axis=1)
    ratio = float(np.sqrt(np.sum(every[rows] ** 2) / chance[0][0].mean()))
    beyond = max(0.0, 1 - 1 / max(ratio, 1e-9) ** 2)
    return ResidualTests(
        p=p,
        ratio=ratio,
        excess=float(np.sqrt(beyond * np.mean(np.sum(whole**2, axis=1)))),
        in_motion=_going_along(evidence, every, asked[-1], chance[-1]),
        worst=place[int(np.argmax(np.linalg.norm(alike, axis=1)))],
    )


def _close(some: Collection[float], tests: int) -> bool:
    """Whether the least p of some tests is so near the threshold that it must be known better."""
    return ALPHA / _FAR < tests * min(some, default=1.0) < ALPHA * _CLOSE


@dataclass(frozen=True)
class _Neighbourhood:
    """One Moran test: the samples tested, their neighbours and the structure allowed."""

    name: str
    rows: Index
    near: Near
    slight: float  # allowed structure as a share of the noise


def _asked(evidence: LinearizedModel) -> list[_Neighbourhood]:
    """The Moran tests to make: of the poses in several spaces, and of readings in motion."""
    rows = np.flatnonzero(evidence.believed[: evidence.poses])
    spaces = _neighbourhoods(evidence, rows).items()
    asked = [_Neighbourhood(f"moran_{name}", rows, near, SLIGHT) for name, near in spaces]
    moving = np.flatnonzero(evidence.believed[evidence.poses :]) + evidence.poses
    along = _along(evidence.rest.path[moving])
    return [*asked, _Neighbourhood(MOTION, moving, along, SLIGHT_MOVING)]


def _drawn(
    evidence: LinearizedModel,
    asked: Sequence[_Neighbourhood],
    sets: int,
    rng: np.random.Generator,
) -> list[Array]:
    """Chi square and Moran's I of simulated noise, (2, sets times 200) for each neighbourhood."""
    found: list[Array] = []
    for _, same in groupby(asked, lambda one: one.name == MOTION):
        own = list(same)
        if not len(own[0].rows):
            found += [np.zeros((2, 1)) for _ in own]
            continue
        drawn = islice(evidence.noise_left(own[0].rows, _DRAWS, rng), sets)
        parts = [part for left in drawn for part in _tested(left, own)]
        found += [np.concatenate(part, axis=1) for part in zip(*parts, strict=True)]
    return found


def _tested(left: Array, asked: Sequence[_Neighbourhood]) -> list[list[Array]]:
    """The same for draws (n, d, draws), in blocks: all draws are a hundred megabytes."""
    some = [slice(begin, begin + _AT_A_TIME) for begin in range(0, left.shape[2], _AT_A_TIME)]
    return mapped(
        lambda own: [_square_and_likeness(left[..., own], one.near) for one in asked], some
    )


def _square_and_likeness(chance: Array, near: Near) -> Array:
    """Chi square and Moran's I of draws (n, d, draws), (2, draws)."""
    square = np.sum(chance**2, axis=(0, 1))
    return np.stack([square, _moran(chance, near) if near[1].any() else 0 * square])


def _probabilities(
    left: Array, asked: Sequence[_Neighbourhood], chance: Sequence[Array], noise_degrees: float
) -> dict[str, float]:
    """p of each test, from residuals (n, d) and simulated noise."""
    square, squares = float(np.sum(left[asked[0].rows] ** 2)), chance[0][0]
    spread = np.sqrt(squares.var() + 2 * squares.mean() ** 2 / noise_degrees)
    degrees = 2 * (squares.mean() / spread) ** 2  # of the chi square with this mean and spread
    usual = (1 + SLIGHT**2) * squares.mean()
    p = {LACK_OF_FIT: float(chdtrc(degrees, square * degrees / usual))}
    for one, drawn in zip(asked, chance, strict=True):
        if one.name != MOTION or one.near[1].any():
            p[one.name] = _alike(left[one.rows], one, drawn)
    return p


def misses_alike(missed: Array, at: Conditions, rng: np.random.Generator) -> float | None:
    """p that poses set aside miss as much alike by chance; None if they are too few.

    Args:
        missed: measured less predicted by the fit that set them aside, (k, 3) [m].
        at: their conditions; neighbours are nearest in joint angles, however soon after each
            other: what noise has in common within half a minute makes no gross error.
        rng: of the draws.
    """
    near = _nearest(at.joint, at.time, 0.0) if len(missed) >= _FEWEST_ASIDE else None
    if near is None or not near[1].any():
        return None
    turned = _moran(_directions(rng.standard_normal((*missed.shape, _TURNS))), near)
    return _beyond(_moran(_directions(missed[:, :, None]), near)[0], turned, 0.0)


def _directions(missed: Array) -> Array:
    """Unit vectors of (k, 3, draws), so that one reading of another reflector does not decide."""
    return np.asarray(missed / np.linalg.norm(missed, axis=1, keepdims=True))


def _alike(left: Array, asked: _Neighbourhood, chance: Array) -> float:
    """p of Moran's I of residuals (n, d), from chi square and I of simulated noise (2, draws)."""
    if not asked.near[1].any():
        return 1.0
    over = float(np.mean(chance[0])) / max(float(np.sum(left**2)), 1e-300)
    own = _moran(left[:, :, None], asked.near)[0]
    return _beyond(own, chance[1], (asked.slight * over) ** 2)


def _beyond(own: float, drawn: Array, allowed: float) -> float:
    """p that Moran's I of noise exceeds `own` less what is allowed, from draws."""
    if drawn.std() == 0:
        return 1.0
    far = (own - allowed - drawn.mean()) / drawn.std()
    skewed, heavy = moments(drawn)
    return pearson3(far, skewed) + _of_tails(far, heavy, skewed)


def _of_tails(far: float, heavy: float, skewed: float) -> float:
    """Addition to p by tails heavier than Pearson's of this skewness (Edgeworth's fourth moment).

    Without it p below 3 in 10 000 would occur twice as often: Moran's I of a hundred poses has an
    excess kurtosis of 0.2.
    """
    more = max(0.0, heavy - 1.5 * skewed**2)
    density = np.exp(-(far**2) / 2.0) / np.sqrt(2 * np.pi)
    return float(density * max(0.0, far**3 - 3 * far) * more / 24)


def _along(path: Index) -> Near:
    """Neighbours along a motion: the next readings, with weight 1 / distance.

    Waves may be short: one of four readings and one of forty are then both detected.
    """
    ahead = np.arange(1, _NEIGHBOURS + 1)
    places = np.arange(len(path))[:, None] + ahead
    within = np.minimum(places, max(len(path) - 1, 0))
    return within, ((places < len(path)) & (path[within] == path[:, None])) / ahead


def _going_along(
    evidence: LinearizedModel, left: Array, asked: _Neighbourhood, chance: Array
) -> float:
    """Root mean square of the residual that neighbours on a path share, beyond chance [m]."""
    if not asked.near[1].any():
        return 0.0
    common = _moran(left[asked.rows][:, :, None], asked.near)[0] - chance[1].mean()
    whole = evidence.metres(left[asked.rows], asked.rows)
    return float(np.sqrt(max(0.0, common) * np.mean(np.sum(whole**2, axis=1))))


def _neighbourhoods(evidence: LinearizedModel, rows: Index) -> dict[str, Near]:
    """Neighbours of each pose in several spaces: their indices and weights, (n, k) each.

    Poses within half a minute do not count as neighbours: between consecutive stops the joints
    may have kept their rest error.
    """
    at = evidence.at.take(rows)
    place = evidence.chain.mechanism.position(evidence.pose[rows])
    spaces = {"position": place, "joints": at.joint}
    if (np.ptp(at.direction, axis=0) > 0).any():
        spaces["direction"] = np.concatenate([at.joint, _APART * at.direction], axis=1)
    near = {name: _nearest(where, at.time) for name, where in spaces.items()}
    return {**near, "time": _next(at.time)}


def _nearest(where: Array, time: Array, soon: float = _SOON) -> Near:
    """Neighbours in a space: the nearest samples, at least `soon` [s] away in time."""
    count = min(_LOOKED_AT, len(where))
    near = cKDTree(where).query(where, k=count)[1].reshape(len(where), count)
    apart = np.abs(time[near] - time[:, None]) >= soon
    apart &= near != np.arange(len(where))[:, None]
    first = np.cumsum(apart, axis=1) <= _NEIGHBOURS
    return near, (apart & first).astype(float)


def _next(time: Array) -> Near:
    """Neighbours in time: the next samples after half a minute."""
    order = np.argsort(time)
    begin = np.searchsorted(time[order], time + _SOON)
    places = begin[:, None] + np.arange(_NEIGHBOURS)
    inside = places < len(time)
    return order[np.minimum(places, len(time) - 1)], inside.astype(float)


def _moran(residual: Array, near: Near) -> Array:
    """Moran's I of residuals (n, d, draws), (draws,): the mean correlation of neighbours."""
    others, weight = near
    alike = np.zeros(residual.shape[2])
    for column in range(others.shape[1]):
        alike += np.einsum(
            "n,nid,nid->d", weight[:, column], residual, residual[others[:, column]]
        )
    share = weight.sum() / len(residual)
    return np.asarray(alike / max(share, 1e-300) / np.sum(residual**2, axis=(0, 1)))
