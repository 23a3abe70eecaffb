"""How far a corrected position may lie from its target, by GUM (JCGM 100:2008).

The tool of a compensated machine comes to

    p = p(theta) + J_q (e_q + e_g) + e_m

with theta as identified (covariance C), e_q where the joints come to rest (s_q each), e_g the play
g of each joint that is in no model, one side or the other, and e_m what the model leaves out. Its
covariance at a place is

    V = J C J^T + J_q (s_q^2 + g g) J_q^T + M

M is measured: what poses that a fit had not seen were missed by, less what noise and C explain of
it. Most models miss more towards the edge of the region than in its middle: the size of M goes as
1 - b + b r^2, with r the distance from the middle of the poses in units of their spread and b, 0
to 1, as the poses show it. Errors of a model are not always normal: `widen` is by how much the
95 % of those poses reach beyond what V and the tracker's noise say, and is 1 where they do not.

All in the axes of the base. Between dimensions and the tracker's frame there are strong
correlations (the base may be moved as a whole): the frame is told as what is left of it with the
dimensions known, the dimensions with the frame following them. These two add up to J C J^T.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from delta_calibration.chain import Chain
from delta_calibration.effects import Stage
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]
Index = NDArray[np.int64]

COVERED = 0.95
_FEWEST = 20  # poses from which a quantile of 95 % is told
_THIN = 1e-4  # of the largest extent squared: poses thinner than this lie in a plane
_LEAST = 0.02  # of what is known along an axis that a part leaves, however much of it it carries
_SURE = 3.0  # standard errors from which play is one


@dataclass(frozen=True)
class ModelError:
    """What a model leaves out, as poses show it that it was not fitted to; in the base."""

    covariance: Array  # (3, 3) [m^2] M, mean of the poses
    middle: Array  # (3,) [m] of the poses
    shape: Array  # (3, 3) [1/m^2] r^2 = d^T shape d, 1 in the mean of the poses
    share: float  # b, 0 to 1, of it that grows with r^2
    widen: float  # at least 1
    play: Array  # (m,) [rad or m] each joint is off, by the side it comes from

    def at(self, places: Array) -> Array:
        """M at places (n, 3) [m], (n, 3, 3)."""
        way = places - self.middle
        size = 1 - self.share + self.share * np.einsum("ni,ij,nj->n", way, self.shape, way)
        return np.asarray(size[:, None, None] * self.covariance)


@dataclass(frozen=True)
class Uncertainty:
    """What makes the positions of an identified machine uncertain."""

    covariance: Array  # (P, P) of theta
    repeatability: float  # [rad or m] of each joint, one standard deviation
    model: ModelError


@dataclass(frozen=True)
class Parts:
    """Contributions to the covariance of positions, (n, 3, 3) [m^2] each, in the base."""

    frame: Array  # tracker's frame, dimensions known
    dimensions: Array  # dimensions, reflector and effects, the frame following them
    repeatability: Array
    play: Array
    model: Array

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
            if effect.stage is not Stage.MEASUREMENT and not effect.bound_to_session
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
        played = by_joints * self.uncertainty.model.play
        return Parts(
            frame=frame @ rest @ _turned_round(frame),
            dimensions=jacobian @ following @ _turned_round(jacobian),
            repeatability=self.uncertainty.repeatability**2 * by_joints @ _turned_round(by_joints),
            play=played @ _turned_round(played),
            model=self.uncertainty.model.at(self.chain.mechanism.position(seen.x)),
        )

    def radius(self, at: Conditions, stated: Array | float = 0.0) -> Array:
        """Within how far of the target the tool comes with 95 %, (n,) [m].

        Args:
            at: joints as they are commanded, corrected.
            stated: covariance of what is uncertain beside, (n, 3, 3) [m^2].

        Returns:
            NaN where the machine cannot stand.
        """
        return self.uncertainty.model.widen * radius95(self.machine.parts(at).whole + stated)


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


def radius95(covariance: Array) -> Array:
    """Radius within which a normal vector lies with 95 %, (n,), of covariances (n, 3, 3).

    Its square is a sum of chi squares, weighted with the eigenvalues; by a gamma distribution of
    the same mean and variance, which is exact along a line and for alike axes (Box 1954, Annals
    of Mathematical Statistics 25, 290-302), and within 2 % of the radius between.
    """
    trace = np.trace(covariance, axis1=-2, axis2=-1)
    square = np.sum(covariance * _turned_round(covariance), axis=(-2, -1))
    with np.errstate(invalid="ignore", divide="ignore"):
        degrees = np.where(square > 0, trace**2 / square, 1.0)
        scale = np.where(trace > 0, square / trace, 0.0)
    found = np.sqrt(np.maximum(scale * chi2.ppf(COVERED, degrees), 0.0))
    return np.asarray(np.where(np.isfinite(trace), found, np.nan))


@dataclass(frozen=True)
class HeldOut:
    """Poses, each missed by a fit to the parts that it is not in."""

    at: Conditions  # of the n poses
    missed: Array  # (n, 3) [m] measured less predicted, tracker's frame; NaN: does not count
    whiten: Array  # (n, 3, 3) [1/m] W C W^T = 1, C the covariance of a pose's noise
    part: Index  # (n,)


def model_error_of(
    chain: Chain, theta: Array, covariance: Array, held: HeldOut, spread: float = 1.0
) -> ModelError:
    """What a model leaves out, by poses that were held out of its fit.

    Args:
        chain: the model.
        theta: as identified, (P,).
        covariance: of it, (P, P).
        held: what the poses were missed by.
        spread: by how much the fit took the noise's variance to be larger.
    """
    rows = np.flatnonzero(np.isfinite(held.missed).all(axis=1))
    at, part = held.at.take(rows), held.part[rows]
    seen = chain.see(at, theta)
    turned = chain.split(theta)[2].rotation
    by_theta, by_joints = turned.T @ seen.jacobian, turned.T @ seen.by_joints
    colour = turned.T @ np.linalg.inv(held.whiten[rows])
    noise = colour @ _turned_round(colour)
    known = noise + _unfitted(by_theta, covariance, max(1.0, spread) * noise, part)
    error = held.missed[rows] @ turned
    sided = by_joints * np.nan_to_num(at.direction)[:, None, :]
    play = _play(sided, error, known)
    error = error - sided @ play
    places = chain.mechanism.position(seen.x)
    found = _grown(places, error, known, np.abs(play))
    ratio = np.linalg.norm(error, axis=1) / radius95(known + found.at(places))
    return replace(found, widen=max(1.0, _reached(ratio)))


def _unfitted(by_theta: Array, covariance: Array, noise: Array, part: Index) -> Array:
    """Covariance (n, 3, 3) of what fits without a pose's own part predict of it.

    A pose at the edge of what was measured carries much of the fit: without it the prediction
    there is far less sure than with it, C' = (C^-1 - G)^-1 with G = J^T N^-1 J of the part.
    """
    value, way = np.linalg.eigh((covariance + covariance.T) / 2)
    seen = by_theta @ (way * np.sqrt(np.maximum(value, 0.0)))  # (n, 3, P) of unit unknowns
    found = np.zeros((len(by_theta), 3, 3))
    for number in np.unique(part):
        own = np.flatnonzero(part == number)
        carried = np.einsum("nij,nik,nkl->jl", seen[own], np.linalg.inv(noise[own]), seen[own])
        share, axes = np.linalg.eigh(carried)  # of what is known along each axis, 0 to 1
        wider = (seen[own] @ axes) / np.sqrt(np.maximum(1 - share, _LEAST))
        found[own] = wider @ _turned_round(wider)
    return found


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


def _grown(places: Array, error: Array, known: Array, play: Array) -> ModelError:
    """M and how it grows from the middle, of errors (n, 3) of which `known` (n, 3, 3) is noise."""
    covariance = _definite(error.T @ error / len(error) - known.mean(axis=0))
    middle = places.mean(axis=0)
    way = places - middle
    scatter = way.T @ way / len(way)
    shape = np.linalg.pinv(scatter, rcond=_THIN, hermitian=True)
    shape /= max(np.linalg.matrix_rank(shape), 1)
    size = float(np.trace(covariance))
    if size <= 0.0:
        return ModelError(covariance, middle, shape, 0.0, 1.0, play)
    beyond = np.einsum("ni,ij,nj->n", way, shape, way) - 1
    left = (np.sum(error**2, axis=1) - np.trace(known, axis1=1, axis2=2)) / size - 1
    share = float(beyond @ left / max(beyond @ beyond, np.finfo(float).tiny))
    return ModelError(covariance, middle, shape, min(max(share, 0.0), 1.0), 1.0, play)


def _reached(ratio: Array) -> float:
    """The 95 % of ratios (n,); of few, none is told."""
    if len(ratio) < _FEWEST:
        return 1.0
    return float(np.quantile(ratio, COVERED))
