"""How far a corrected position may lie from its target, by GUM (JCGM 100:2008).

The tool of a compensated machine comes to

    p = p(theta) + J_q e_q + e_m

with theta as identified (covariance C), e_q where the joints come to rest (s_q each) and e_m what
the model leaves out. Its covariance at a place is

    V = J C J^T + s_q^2 J_q J_q^T + M

M, (3, 3), is measured: what poses that a fit had not seen were missed by, less what noise and C
explain of it. Errors of a model are not always normal; `widen` is by how much the 95 % of those
poses reach beyond what V and the tracker's noise say, and is 1 where they do not.

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

COVERED = 0.95
_FEWEST = 20  # poses from which a quantile of 95 % is told
_GROWN = 1.25  # of the covariance of a fit to four fifths of the poses, over that of all


@dataclass(frozen=True)
class Uncertainty:
    """What makes the positions of an identified machine uncertain."""

    covariance: Array  # (P, P) of theta
    repeatability: float  # [rad or m] of each joint, one standard deviation
    model: Array  # (3, 3) [m^2] of what the model leaves out, in the base
    widen: float = 1.0  # at least 1


@dataclass(frozen=True)
class Parts:
    """Contributions to the covariance of positions, (n, 3, 3) [m^2] each, in the base."""

    frame: Array  # tracker's frame, dimensions known
    dimensions: Array  # dimensions, reflector and effects, the frame following them
    repeatability: Array
    model: Array

    @property
    def fit(self) -> Array:
        """What the fit leaves open, (n, 3, 3)."""
        return self.frame + self.dimensions

    @property
    def whole(self) -> Array:
        """Of a corrected position, (n, 3, 3)."""
        return self.fit + self.repeatability + self.model


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
        return Parts(
            frame=frame @ rest @ _turned_round(frame),
            dimensions=jacobian @ following @ _turned_round(jacobian),
            repeatability=self.uncertainty.repeatability**2 * by_joints @ _turned_round(by_joints),
            model=np.broadcast_to(self.uncertainty.model, (len(at), 3, 3)),
        )

    def radius(self, at: Conditions, stated: Array | float = 0.0) -> Array:
        """Within how far of the target the tool comes with 95 %, (n,) [m].

        Args:
            at: joints as they are commanded, corrected.
            stated: covariance of what is uncertain beside, (n, 3, 3) [m^2].

        Returns:
            NaN where the machine cannot stand.
        """
        return self.uncertainty.widen * radius95(self.machine.parts(at).whole + stated)


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


def uncertainty_of(
    chain: Chain,
    theta: Array,
    covariance: Array,
    repeatability: float,
    at: Conditions,
    missed: Array,
    whiten: Array,
) -> Uncertainty:
    """What makes positions uncertain, with the model's errors as poses held out show them.

    Args:
        chain: the model.
        theta: as identified, (P,).
        covariance: of it, (P, P).
        repeatability: of each joint [rad or m].
        at: conditions of the n poses.
        missed: measured less predicted by a fit that has not seen the place, (n, 3) [m], in the
            tracker's frame; NaN rows do not count.
        whiten: W of each pose with W C W^T = 1, C its noise's covariance, (n, 3, 3) [1/m].
    """
    bare = Uncertainty(covariance, repeatability, np.zeros((3, 3)))
    turned = chain.split(theta)[2].rotation
    rows = np.flatnonzero(np.isfinite(missed).all(axis=1))
    error = missed[rows] @ turned
    colour = turned.T @ np.linalg.inv(whiten[rows])
    noise = colour @ _turned_round(colour)
    known = noise + _GROWN * Identified(chain, theta, bare).parts(at.take(rows)).fit
    model = _definite(error.T @ error / len(rows) - known.mean(axis=0))
    ratio = np.linalg.norm(error, axis=1) / radius95(known + model)
    return replace(bare, model=model, widen=max(1.0, _reached(ratio)))


def _reached(ratio: Array) -> float:
    """The 95 % of ratios (n,); of few, none is told."""
    if len(ratio) < _FEWEST:
        return 1.0
    return float(np.quantile(ratio, COVERED))
