"""How far a corrected position may lie from its target, by GUM (JCGM 100:2008).

The tool of a compensated machine comes to

    p = p(theta) + J_q (e_q + e_g) + e_m

with theta as identified (covariance C), e_q where the joints come to rest (s_q each), e_g the play
g of each joint that is in no model, one side or the other, and e_m what the model leaves out. Its
covariance at a place is

    V = J C J^T + J_q (s_q^2 + g g) J_q^T + M

M is measured: what poses that a fit had not seen were missed by, less what noise and C explain of
it; the less sure it is, the less of it counts (James and Stein 1961). Most models miss more
towards the edge of the region than in its middle: the size of M goes as 1 - b + b r^2, with r the
distance from the middle of the poses in units of their spread and b, 0 to 1, as the poses show it.
Errors of a model are not always normal. Those of a gear are bounded sines, with lighter tails: the
fourth moment of the same poses says how light,

    Var |e|^2 = 2 tr V^2 + k (tr M)^2

with k = 0 of a normal law, below it of lighter tails and above it of heavier ones. `widen` is by
how much the 95 % of those poses reach beyond what V and the tracker's noise say, and is 1 where as
many as do may by chance.

The 95 % radius goes by Student's t in the place of the normal law, as s_q and M are known from few
poses: degrees of freedom by Welch and Satterthwaite (GUM G.4). Play is no normal error but one of
two values: the radius is that of the normal laws about all combinations of sides.

All in the axes of the base. Between dimensions and the tracker's frame there are strong
correlations (the base may be moved as a whole): the frame is told as what is left of it with the
dimensions known, the dimensions with the frame following them. These two add up to J C J^T.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc, chdtri, fdtri, gammainc  # scipy.stats takes long to import

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions

Array = NDArray[np.float64]
Index = NDArray[np.int64]

COVERED = 0.95
_FEWEST = 20  # poses from which a quantile of 95 % is told
_THIN = 1e-4  # of the largest extent squared: poses thinner than this lie in a plane
_SURE = 3.0  # standard errors from which play is one
_CHANCE = 0.05  # that as many errors reach beyond a radius, below which it is widened
_MANY = 1e9  # degrees of freedom that are as good as any number of them
_HALVINGS = 30  # of the interval in which a radius is searched


@dataclass(frozen=True)
class ModelError:
    """What a model leaves out, as poses show it that it was not fitted to; in the base."""

    covariance: Array  # (3, 3) [m^2] M, mean of the poses
    middle: Array  # (3,) [m] of the poses
    shape: Array  # (3, 3) [1/m^2] r^2 = d^T shape d, 1 in the mean of the poses
    share: float  # b, 0 to 1, of it that grows with r^2
    widen: float  # at least 1
    play: Array  # (m,) [rad or m] each joint is off, by the side it comes from
    doubt: float = 0.0  # [m^2] standard error of M's trace
    kurtosis: float = 0.0  # k: variance of |m|^2 less that of a normal m, over (tr M)^2

    def at(self, places: Array) -> Array:
        """M at places (n, 3) [m], (n, 3, 3)."""
        return np.asarray(self.growth(places)[:, None, None] * self.covariance)

    def growth(self, places: Array) -> Array:
        """M at places (n, 3) [m] over its mean, (n,)."""
        way = places - self.middle
        grown = np.einsum("ni,ij,nj->n", way, self.shape, way)
        return np.asarray(1 - self.share + self.share * grown)


@dataclass(frozen=True)
class Uncertainty:
    """What makes the positions of an identified machine uncertain."""

    covariance: Array  # (P, P) of theta
    repeatability: float  # [rad or m] of each joint, one standard deviation
    model: ModelError
    freedom: float = np.inf  # degrees of freedom from which the repeatability is known


@dataclass(frozen=True)
class Parts:
    """Contributions to the covariance of positions, (n, 3, 3) [m^2] each, in the base."""

    frame: Array  # tracker's frame, dimensions known
    dimensions: Array  # dimensions, reflector and effects, the frame following them
    repeatability: Array
    sided: Array  # (n, 3, m) [m] by play of each joint, by the side it comes from
    model: Array
    doubt: Array  # (n,) [m^2] standard error of the trace of the whole
    fourth: Array  # (n,) [m^4] variance of the error squared beyond that of a normal law

    @property
    def play(self) -> Array:
        """Of play, either side as likely, (n, 3, 3)."""
        return self.sided @ _turned_round(self.sided)

    @property
    def fit(self) -> Array:
        """What the fit leaves open, (n, 3, 3)."""
        return self.frame + self.dimensions

    @property
    def whole(self) -> Array:
        """Of a corrected position, (n, 3, 3)."""
        return self.fit + self.repeatability + self.play + self.model


@dataclass(frozen=True)
class Identified:
    """A chain as it was identified, with what makes it uncertain."""

    chain: Chain
    theta: Array  # (P,)
    uncertainty: Uncertainty

    @cached_property
    def machine(self) -> Identified:
        """The same without what goes on between reflector and reading, or by one session's clock.

        What such an effect was found to be is uncertain no more for a position; that dimensions
        were found beside it is in their own covariance.
        """
        chain, layout = self.chain, self.chain.layout
        kept = [
            k
            for k, effect in enumerate(chain.effects)
            if not effect.on_readings and not effect.bound_to_session
        ]
        rows = np.concatenate(
            [np.arange(layout.size)[layout.base]]
            + [np.arange(layout.size)[layout.each[k]] for k in kept]
        )
        own = replace(self.uncertainty, covariance=self.uncertainty.covariance[np.ix_(rows, rows)])
        return Identified(
            chain.with_effects(tuple(chain.effects[k] for k in kept)), self.theta[rows], own
        )

    def parts(self, at: Conditions) -> Parts:
        """Contributions at these joints and conditions, n of them."""
        seen = self.chain.see(at, self.theta)
        turned = self.chain.split(self.theta)[2].rotation
        jacobian, by_joints = turned.T @ seen.jacobian, turned.T @ seen.by_joints
        rest, following = _divided(self.uncertainty.covariance, self.chain)
        frame = jacobian[..., self.chain.layout.frame]
        model, places = self.uncertainty.model, self.chain.mechanism.position(seen.x)
        still = self.uncertainty.repeatability**2 * by_joints @ _turned_round(by_joints)
        left = model.at(places)
        unsure = np.trace(still, axis1=1, axis2=2) * np.sqrt(2 / self.uncertainty.freedom)
        return Parts(
            frame=frame @ rest @ _turned_round(frame),
            dimensions=jacobian @ following @ _turned_round(jacobian),
            repeatability=still,
            sided=by_joints * model.play,
            model=left,
            doubt=np.hypot(unsure, model.doubt * model.growth(places)),
            fourth=model.kurtosis * np.trace(left, axis1=1, axis2=2) ** 2,
        )

    def radius(self, at: Conditions, stated: Array | float = 0.0) -> Array:
        """Within how far of the target the tool comes with 95 %, (n,) [m].

        Args:
            at: joints as they are commanded, corrected.
            stated: covariance of what is uncertain beside, (n, 3, 3) [m^2].

        Returns:
            NaN where the machine cannot stand.
        """
        parts = self.machine.parts(at)
        normal = parts.whole - parts.play + stated
        widen = self.uncertainty.model.widen
        return widen * radius95(normal, parts.sided, parts.doubt, parts.fourth)


def _turned_round(matrix: Array) -> Array:
    return np.swapaxes(matrix, -1, -2)


def _divided(covariance: Array, chain: Chain) -> tuple[Array, Array]:
    """Covariance of the frame with all else known (6, 6), and of theta without that, (P, P)."""
    frame = np.arange(len(covariance))[chain.layout.frame]
    others = np.setdiff1d(np.arange(len(covariance)), frame)
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    likeness = covariance / np.outer(scale, scale)
    own, beside = likeness[np.ix_(others, others)], likeness[np.ix_(others, frame)]
    explained = beside.T @ np.linalg.pinv(own, rcond=1e-12, hermitian=True) @ beside
    rest = _definite(likeness[np.ix_(frame, frame)] - explained)
    rest *= np.outer(scale[frame], scale[frame])
    following = covariance.copy()
    following[np.ix_(frame, frame)] -= rest
    return rest, following


def _definite(matrix: Array) -> Array:
    """The nearest symmetric matrix without negative eigenvalues."""
    value, way = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((way * np.maximum(value, 0.0)) @ way.T)


def radius95(
    normal: Array,
    sided: Array | None = None,
    doubt: Array | None = None,
    fourth: Array | float = 0.0,
) -> Array:
    """Radius within which an error lies with 95 %, (n,) [m].

    A normal vector's square is a sum of chi squares, weighted with the eigenvalues of its
    covariance; by a gamma distribution of the same mean and variance, which is exact along a line
    and for alike axes (Box 1954, Annals of Mathematical Statistics 25, 290-302), and within 2 % of
    the radius between.

    Args:
        normal: covariances (n, 3, 3) [m^2].
        sided: what has two values: plus or minus each column of (n, 3, m) [m], all combinations
            as likely.
        doubt: standard error of the trace of the covariance, (n,) [m^2].
        fourth: variance of the error squared less that of a normal law, (n,) [m^4].
    """
    trace = np.trace(normal, axis1=-2, axis2=-1)
    square = _half_variance(normal, fourth)
    with np.errstate(invalid="ignore", divide="ignore"):
        degrees = np.where(square > 0, trace**2 / square, 1.0)
        sure = quantile = chdtri(degrees, 1 - COVERED)
        if doubt is not None:
            known = np.minimum(2 * (trace / doubt) ** 2, _MANY)
            quantile = degrees * fdtri(degrees, known, COVERED)
        scale = np.where(trace > 0, square / trace, 0.0)
    found = np.sqrt(np.maximum(scale * quantile, 0.0))
    found = np.where(np.isfinite(trace), found, np.nan)
    if sided is None or not sided.any():
        return np.asarray(found)
    with np.errstate(invalid="ignore", divide="ignore"):
        wider = np.where(found > 0, quantile / sure, 1.0)
    return _about_all_sides(wider[:, None, None] * normal, sided, wider**2 * fourth)


def _half_variance(normal: Array, fourth: Array | float) -> Array:
    """Half of the variance of the square of vectors of covariance (n, 3, 3), (n,)."""
    return np.asarray(np.sum(normal * _turned_round(normal), axis=(-2, -1)) + fourth / 2)


def _about_all_sides(normal: Array, sided: Array, fourth: Array) -> Array:
    """The radius of the mixture of normal laws about plus or minus each column, (n,)."""
    joints = np.flatnonzero(sided.any(axis=(0, 1)))
    sides = np.array([(1.0, *way) for way in product((-1.0, 1.0), repeat=len(joints) - 1)])
    middle = np.einsum("nij,kj->nki", sided[..., joints], sides)
    mean = np.trace(normal, axis1=1, axis2=2)[:, None] + np.sum(middle**2, axis=2)
    within = np.einsum("nki,nij,nkj->nk", middle, normal, middle)
    square = _half_variance(normal, fourth)[:, None]
    variance = np.maximum(2 * square + 4 * within, np.finfo(float).eps * mean**2)
    shape, scale = mean**2 / variance, variance / mean
    low, high = np.zeros(len(mean)), np.max(mean + 10 * np.sqrt(variance), axis=1)
    for _ in range(_HALVINGS):
        half = (low + high) / 2
        enough = gammainc(shape, half[:, None] / scale).mean(axis=1) >= COVERED
        low, high = np.where(enough, low, half), np.where(enough, half, high)
    return np.asarray(np.sqrt(high))


@dataclass(frozen=True)
class HeldOut:
    """Poses, each missed by a fit to the parts that it is not in."""

    at: Conditions  # of the n poses
    missed: Array  # (n, 3) [m] measured less predicted, tracker's frame; NaN: does not count
    whiten: Array  # (n, 3, 3) [1/m] W C W^T = 1, C the covariance of a pose's noise
    fitted: Array  # (n, 3, 3) [m^2] covariance of what was predicted of each by its fit
    place: Index  # (n,) poses of one place have one error of the model


def model_error_of(chain: Chain, theta: Array, held: HeldOut) -> ModelError:
    """What a model leaves out, by poses that were held out of its fit.

    Args:
        chain: the model.
        theta: as identified, (P,).
        held: what the poses were missed by, in the tracker's frame.
    """
    rows = np.flatnonzero(np.isfinite(held.missed).all(axis=1))
    at = held.at.take(rows)
    seen = chain.see(at, theta)
    turned = chain.split(theta)[2].rotation
    by_joints = turned.T @ seen.by_joints
    colour = turned.T @ np.linalg.inv(held.whiten[rows])
    known = colour @ _turned_round(colour) + turned.T @ held.fitted[rows] @ turned
    error = held.missed[rows] @ turned
    sided = by_joints * np.nan_to_num(at.direction)[:, None, :]
    play = _play(sided, error, known)
    error = error - sided @ play
    places = chain.mechanism.position(seen.x)
    found = _grown(places, error, known, np.abs(play), held.place[rows])
    model = found.at(places)
    kurtosis = _kurtosis(error, known + model, model, held.place[rows])
    fourth = kurtosis * np.trace(model, axis1=1, axis2=2) ** 2
    ratio = np.linalg.norm(error, axis=1) / radius95(known + model, fourth=fourth)
    return replace(found, widen=_reached(ratio), kurtosis=kurtosis)


def _play(sided: Array, error: Array, known: Array) -> Array:
    """How far each joint is off by the side that it comes from, (m,); 0 where that is chance.

    Args:
        sided: by the joints, times the sides that they came from, (n, 3, m).
        error: (n, 3) [m].
        known: covariance of what else is in it, (n, 3, 3).
    """
    inverse = np.linalg.inv(known)
    normal = np.einsum("nij,nik,nkl->jl", sided, inverse, sided)
    spread = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    value = spread @ np.einsum("nij,nik,nk->j", sided, inverse, error)
    sigma = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return np.where(np.abs(value) > _SURE * sigma, value, 0.0)


def _grown(places: Array, error: Array, known: Array, play: Array, place: Index) -> ModelError:
    """M and how it grows from the middle, of errors (n, 3) of which `known` (n, 3, 3) is noise."""
    beyond = np.sum(error**2, axis=1) - np.trace(known, axis1=1, axis2=2)
    covariance, doubt = _counted(error.T @ error / len(error) - known.mean(axis=0), beyond, place)
    middle = places.mean(axis=0)
    way = places - middle
    scatter = way.T @ way / len(way)
    shape = np.linalg.pinv(scatter, rcond=_THIN, hermitian=True)
    shape /= max(np.linalg.matrix_rank(shape), 1)
    size = float(np.trace(covariance))
    if size <= 0.0:
        return ModelError(covariance, middle, shape, 0.0, 1.0, play, doubt)
    farther = np.einsum("ni,ij,nj->n", way, shape, way) - 1
    share = _growing(farther, beyond / float(np.mean(beyond)) - 1, place)
    return ModelError(covariance, middle, shape, share, 1.0, play, doubt)


def _growing(farther: Array, left: Array, place: Index) -> float:
    """How errors squared over their mean, less 1, (n,) go with r^2 - 1 (n,), as far as is sure."""
    whole = max(float(farther @ farther), np.finfo(float).tiny)
    share = float(farther @ left) / whole
    doubt = float(np.linalg.norm(np.bincount(place, farther * (left - share * farther)))) / whole
    if share <= doubt:
        return 0.0
    return min(share - doubt**2 / share, 1.0)


def _counted(excess: Array, beyond: Array, place: Index) -> tuple[Array, float]:
    """M of what errors have over the noise, (3, 3) [m^2], and the standard error of its trace.

    An excess x +- s counts as x - s^2 / x where that is above zero.
    """
    size = float(np.mean(beyond))
    doubt = float(np.linalg.norm(np.bincount(place, beyond - size)) / len(beyond))
    kept = _definite(excess)
    whole = float(np.trace(kept))
    if size <= doubt or whole <= 0.0:
        return np.zeros((3, 3)), 0.0
    share = 1 - (doubt / size) ** 2
    return kept * (size * share / whole), doubt * share


def _kurtosis(error: Array, whole: Array, model: Array, place: Index) -> float:
    """k, as far as it is sure, of errors (n, 3) of covariance `whole`, `model` of it the model's.

    At least so that what the model leaves out has a variance of its square.
    """
    square, size = (np.trace(each, axis1=1, axis2=2) for each in (whole, model))
    weight = float(np.sum(size**2))
    if weight <= 0.0:
        return 0.0
    each = (np.sum(error**2, axis=1) - square) ** 2 - 2 * _half_variance(whole, 0.0)
    found = float(np.sum(each)) / weight
    doubt = float(np.linalg.norm(np.bincount(place, each - found * size**2))) / weight
    if abs(found) <= doubt:
        return 0.0
    least = -2 * float(np.sum(model[0] ** 2)) / float(size[0]) ** 2
    return max(found - doubt**2 / found, least)


def _reached(ratio: Array) -> float:
    """By how much the 95 % of ratios (n,) reach beyond 1, where more do than do by chance."""
    above = int(np.sum(ratio > 1.0))
    if len(ratio) < _FEWEST or bdtrc(above - 1, len(ratio), 1 - COVERED) > _CHANCE:
        return 1.0
    return max(1.0, float(np.quantile(ratio, COVERED)))
