"""Uncertainty of a corrected position about its target, by GUM (JCGM 100:2008).

The tool of a compensated machine comes to

    p = p(theta) + J_q (e_q + e_g) + e_m

with theta the identified parameters (covariance C), e_q the rest errors of the joints (standard
deviation s_q each), e_g the backlash of each joint that is in no model, +g or -g, and e_m the
model discrepancy. The covariance at a place is

    V = J C J^T + J_q (s_q^2 + g g) J_q^T + M

M is scaled by 1 - b + b r^2, with r the distance from the middle of the poses in units of their
spread: most models have larger errors towards the edge of the region than in its middle. Errors of
a model are not always normal. Those of a gear are bounded sines, with lighter tails: the fourth
moment gives their weight,

    Var |e|^2 = 2 tr V^2 + k (tr M)^2

with k = 0 for a normal distribution, k < 0 for lighter and k > 0 for heavier tails. `widen` is the
factor by which the 95 % radius of the poses exceeds what V and the tracker's noise predict. All of
this is estimated from the residuals of a fit in `estimation/positions.py`.

The 95 % radius uses Student's t instead of the normal distribution, as s_q and M are known from
few poses: degrees of freedom by Welch and Satterthwaite (GUM G.4). Backlash is no normal error but
takes one of two values: the radius is that of the mixture of normal distributions about all
combinations of sides.

All quantities are in the axes of the base. Dimensions and the tracker's frame are strongly
correlated (the base may be moved as a whole): the covariance is therefore split into that of the
frame given the dimensions, and that of the dimensions with the frame following them. These two add
up to J C J^T.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, fdtri, gammainc  # scipy.stats takes long to import

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions
from delta_calibration.effects import Effect
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]

COVERED = 0.95
MANY = 1e9  # degrees of freedom that count as infinitely many
_HALVINGS = 30  # of the interval in which a radius is searched by bisection


@dataclass(frozen=True)
class ModelError:
    """Model discrepancy, estimated from the residuals of a fit; in the base frame."""

    covariance: Array  # (3, 3) [m^2] M, mean over the poses
    middle: Array  # (3,) [m] of the poses
    shape: Array  # (3, 3) [1/m^2] r^2 = d^T shape d; the mean of r^2 over the poses is 1
    share: float  # b, 0 to 1, share of M that grows with r^2
    widen: float  # at least 1
    play: Array  # (m,) [rad or m] g of each joint; the sign depends on the side of approach
    doubt: float = 0.0  # [m^2] standard error of M's trace
    kurtosis: float = 0.0  # k: variance of |m|^2 less that of a normal m, over (tr M)^2

    def at(self, places: Array) -> Array:
        """M at places (n, 3) [m], (n, 3, 3)."""
        return np.asarray(self.growth(places)[:, None, None] * self.covariance)

    def growth(self, places: Array) -> Array:
        """Ratio of M at places (n, 3) [m] to its mean, (n,)."""
        way = places - self.middle
        grown = np.einsum("ni,ij,nj->n", way, self.shape, way)
        return np.asarray(1 - self.share + self.share * grown)


@dataclass(frozen=True)
class Uncertainty:
    """Sources of the uncertainty of an identified machine's positions."""

    covariance: Array  # (P, P) of theta
    repeatability: float  # [rad or m] of each joint, one sigma, from repeats and residuals
    model: ModelError
    freedom: float = np.inf  # degrees of freedom of the repeatability


@dataclass(frozen=True)
class Parts:
    """Contributions to the covariance of positions, (n, 3, 3) [m^2] each, in the base frame."""

    frame: Array  # tracker's frame, given the dimensions
    dimensions: Array  # dimensions, reflector and effects, with the frame following them
    repeatability: Array
    sided: Array  # (n, 3, m) [m] displacement by the backlash of each joint, plus or minus
    model: Array
    doubt: Array  # (n,) [m^2] standard error of the trace of the whole covariance
    fourth: Array  # (n,) [m^4] variance of |e|^2 less that of a normal error

    @property
    def play(self) -> Array:
        """Covariance of backlash, both sides equally likely, (n, 3, 3) [m^2]."""
        return self.sided @ turned_round(self.sided)

    @property
    def fit(self) -> Array:
        """Covariance due to the identified parameters, (n, 3, 3) [m^2]."""
        return self.frame + self.dimensions

    @property
    def whole(self) -> Array:
        """Covariance of a corrected position, (n, 3, 3) [m^2]."""
        return self.fit + self.repeatability + self.play + self.model


@dataclass(frozen=True)
class Identified:
    """An identified chain with its uncertainty."""

    chain: Chain
    theta: Array  # (P,)
    uncertainty: Uncertainty
    ended: float | None = None  # [s] end of the session on its clock; None: not known

    @cached_property
    def machine(self) -> Identified:
        """The machine after the session: the same without the effects on the readings.

        The uncertainty of such an effect does not matter for a position; that it was identified
        together with the dimensions is already in the covariance of the dimensions.
        """
        return self._after(lambda effect: not effect.on_readings)

    @property
    def later(self) -> Identified:
        """The same as another session meets it: effects by the clock as at this one's end."""
        return self._after(lambda effect: True)

    def _after(self, kept_of: Callable[[Effect], bool]) -> Identified:
        """The same after the session, with those of its effects that a function accepts."""
        left = self._with(lambda effect: kept_of(effect) and effect.outlasts(self.ended))
        return replace(left, chain=left.chain.held(self.ended))

    def _with(self, kept_of: Callable[[Effect], bool]) -> Identified:
        """The same with those of its effects that a function accepts."""
        chain, layout = self.chain, self.chain.layout
        kept = [k for k, effect in enumerate(chain.effects) if kept_of(effect)]
        rows = np.concatenate(
            [np.arange(layout.size)[layout.base]]
            + [np.arange(layout.size)[layout.each[k]] for k in kept]
        )
        own = replace(self.uncertainty, covariance=self.uncertainty.covariance[np.ix_(rows, rows)])
        return Identified(
            chain.with_effects(tuple(chain.effects[k] for k in kept)),
            self.theta[rows],
            own,
            self.ended,
        )

    def parts(self, at: Conditions) -> Parts:
        """Contributions to the covariance at n joint vectors and conditions."""
        seen = self.chain.see(at, self.theta)
        turned = self.chain.split(self.theta)[2].rotation
        jacobian, by_joints = turned.T @ seen.jacobian, turned.T @ seen.by_joints
        rest, following = _divided(self.uncertainty.covariance, self.chain)
        frame = jacobian[..., self.chain.layout.frame]
        model, places = self.uncertainty.model, self.chain.mechanism.position(seen.x)
        still = self.uncertainty.repeatability**2 * by_joints @ turned_round(by_joints)
        left = model.at(places)
        unsure = np.trace(still, axis1=1, axis2=2) * np.sqrt(2 / self.uncertainty.freedom)
        return Parts(
            frame=frame @ rest @ turned_round(frame),
            dimensions=jacobian @ following @ turned_round(jacobian),
            repeatability=still,
            sided=by_joints * model.play,
            model=left,
            doubt=np.hypot(unsure, model.doubt * model.growth(places)),
            fourth=model.kurtosis * np.trace(left, axis1=1, axis2=2) ** 2,
        )

    def radius(self, at: Conditions, stated: Array | float = 0.0) -> Array:
        """Radius about the target that holds the tool with a probability of 95 %, (n,) [m].

        Args:
            at: conditions with the corrected joint commands.
            stated: covariance of further independent errors, (n, 3, 3) [m^2].

        Returns:
            The radius; NaN out of reach.
        """
        parts = self.machine.parts(at)
        normal = parts.whole - parts.play + stated
        widen = self.uncertainty.model.widen
        return widen * radius95(normal, parts.sided, parts.doubt, parts.fourth)


def turned_round(matrix: Array) -> Array:
    """Matrices (n, i, j), each transposed."""
    return np.swapaxes(matrix, -1, -2)


def _divided(covariance: Array, chain: Chain) -> tuple[Array, Array]:
    """Covariance of the frame given all other parameters (6, 6), and the rest of C, (P, P)."""
    frame = np.arange(len(covariance))[chain.layout.frame]
    others = np.setdiff1d(np.arange(len(covariance)), frame)
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    likeness = covariance / np.outer(scale, scale)
    own, beside = likeness[np.ix_(others, others)], likeness[np.ix_(others, frame)]
    explained = beside.T @ np.linalg.pinv(own, rcond=1e-12, hermitian=True) @ beside
    rest = definite(likeness[np.ix_(frame, frame)] - explained)
    rest *= np.outer(scale[frame], scale[frame])
    following = covariance.copy()
    following[np.ix_(frame, frame)] -= rest
    return rest, following


def definite(matrix: Array) -> Array:
    """The nearest symmetric matrix without negative eigenvalues."""
    value, way = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((way * np.maximum(value, 0.0)) @ way.T)


def radius95(
    normal: Array,
    sided: Array | None = None,
    doubt: Array | None = None,
    fourth: Array | float = 0.0,
) -> Array:
    """Radius within which an error lies with a probability of 95 %, (n,) [m].

    The squared length of a normal vector is a sum of chi squares, weighted with the eigenvalues of
    its covariance. It is approximated by a gamma distribution of the same mean and variance, which
    is exact along a line and for equal axes (Box 1954, Annals of Mathematical Statistics 25,
    290-302), and within 2 % of the radius between.

    Args:
        normal: covariances of the normal errors, (n, 3, 3) [m^2].
        sided: errors of two values: plus or minus each column of (n, 3, m) [m], all combinations
            equally likely.
        doubt: standard error of the trace of the covariance, (n,) [m^2].
        fourth: variance of |e|^2 less that of a normal error, (n,) [m^4].
    """
    trace = np.trace(normal, axis1=-2, axis2=-1)
    square = half_variance(normal, fourth)
    with np.errstate(invalid="ignore", divide="ignore"):
        degrees = np.where(square > 0, trace**2 / square, 1.0)
        sure = quantile = chdtri(degrees, 1 - COVERED)
        if doubt is not None:
            known = np.where(doubt > 0, np.minimum(2 * (trace / doubt) ** 2, MANY), MANY)
            quantile = degrees * fdtri(degrees, known, COVERED)
        scale = np.where(trace > 0, square / trace, 0.0)
    found = np.sqrt(np.maximum(scale * quantile, 0.0))
    found = np.where(np.isfinite(trace), found, np.nan)
    if sided is None or not sided.any():
        return np.asarray(found)
    with np.errstate(invalid="ignore", divide="ignore"):
        wider = np.where(found > 0, quantile / sure, 1.0)
    return _about_all_sides(wider[:, None, None] * normal, sided, wider**2 * fourth)


def half_variance(normal: Array, fourth: Array | float) -> Array:
    """Half the variance of |e|^2 for errors e of covariance (n, 3, 3), (n,) [m^4]."""
    return np.asarray(np.sum(normal * turned_round(normal), axis=(-2, -1)) + fourth / 2)


def _about_all_sides(normal: Array, sided: Array, fourth: Array) -> Array:
    """95 % radius of the mixture of normal distributions about plus or minus each column, (n,)."""
    joints = np.flatnonzero(sided.any(axis=(0, 1)))
    sides = np.array([(1.0, *way) for way in product((-1.0, 1.0), repeat=len(joints) - 1)])
    middle = np.einsum("nij,kj->nki", sided[..., joints], sides)
    mean = np.trace(normal, axis1=1, axis2=2)[:, None] + np.sum(middle**2, axis=2)
    within = np.einsum("nki,nij,nkj->nk", middle, normal, middle)
    square = half_variance(normal, fourth)[:, None]
    variance = np.maximum(2 * square + 4 * within, np.finfo(float).eps * mean**2)
    shape, scale = mean**2 / variance, variance / mean
    low, high = np.zeros(len(mean)), np.max(mean + 10 * np.sqrt(variance), axis=1)
    for _ in range(_HALVINGS):
        half = (low + high) / 2
        enough = gammainc(shape, half[:, None] / scale).mean(axis=1) >= COVERED
        low, high = np.where(enough, low, half), np.where(enough, half, high)
    return np.asarray(np.sqrt(high))
