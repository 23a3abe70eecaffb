"""Predicted information of samples that are not yet taken, together with those that are.

Tests need only inner products, and those of independent samples add up. With N the whitened
columns of geometry, reflector offset and frame, which all samples share, and X those of an
explanation,

    G = X'X - X'N (N'N + P)^-1 N'X        each product a sum over all samples, taken and planned

Nuisance of only some of the samples, such as the rest errors of their paths, is projected out of
these samples beforehand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from delta_calibration.chain import Chain, read_at
from delta_calibration.data import Conditions, joined
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.linear_model import LinearizedModel, by_mounts
from delta_calibration.diagnosis.shared_path_error import AT_REST, SharedPathError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_REST = 50e-6  # [rad of a Delta] by which the joints may be off their command along a path
_COMPARED = 400  # to 800 samples of a session, among which the nearest is searched


@dataclass(frozen=True)
class Samples:
    """Planned samples: their conditions, and the path that each of the n samples is on."""

    at: Conditions  # reading and its speed are not used
    path: Index  # (n,) `AT_REST` for a stop, which has a move of its own

    def __len__(self) -> int:
        return len(self.path)

    def take(self, rows: NDArray[Any]) -> Samples:
        """Some of the samples."""
        return Samples(self.at.take(rows), self.path[rows])


def stacked(parts: Sequence[Samples]) -> Samples:
    """Concatenate sets of samples; paths of different sets get different numbers."""
    at, path = parts[0].at, [parts[0].path]
    for part in parts[1:]:
        at = joined(at, part.at)
        first = 1 + max(int(each.max(initial=AT_REST)) for each in path)
        path.append(np.where(part.path == AT_REST, AT_REST, part.path + first))
    return Samples(at, np.concatenate(path))


@dataclass(frozen=True)
class Foresight:
    """Predictor of the evidence that planned samples would give, about a fit."""

    chain: Chain
    theta: Array  # (P,)
    scale: Array  # (s, s) from the unknowns that all samples share, z, to theta
    precision: Array  # (s,) of z: 1 / variance of its prior, 0 if it has none
    whiten: Callable[[Samples, Array], Array]  # of samples and poses, (n, 3, 3) [1/m]

    @classmethod
    def about(cls, evidence: LinearizedModel) -> Foresight:
        """Predictor about the fit of a session, with the noise of its nearest samples."""
        chain, base = evidence.chain, evidence.chain.layout.base
        return cls(
            chain, evidence.theta, _scale(evidence), evidence.precision[base], _Noise(evidence)
        )

    def pose(self, samples: Samples) -> Array:
        """Pose of the platform at the samples, (n, k); rows out of reach are NaN."""
        return self.chain.pose(samples.at, self.theta)

    def evidence(self, samples: Samples, x: Array) -> LinearizedModel:
        """Evidence of samples within reach at poses x (n, k), with residuals of zero."""
        at, whiten = samples.at, self.whiten(samples, x)
        seen = self.chain.see(at, self.theta, x)
        columns = whiten @ seen.jacobian[..., self.chain.layout.base] @ self.scale
        own = self.chain.layout.geometry
        by_joints, by_geometry = whiten @ seen.by_joints, whiten @ seen.jacobian[..., own]
        size = self.chain.mechanism.joint_size
        return LinearizedModel(
            chain=self.chain,
            theta=self.theta,
            at=at,
            pose=x,
            whiten=whiten,
            residual=np.zeros((len(at), 3)),
            nuisance=columns,
            rest=SharedPathError.of(samples.path, at, _REST * size * by_joints, size),
            precision=self.precision,
            poses=int(np.sum(samples.path == AT_REST)),
            by_joints=by_joints,
            by_geometry=by_geometry,
            by_mounts=whiten @ by_mounts(self.chain, self.theta, seen.jacobian),
            seen=read_at(at, seen),
        )


@dataclass(frozen=True)
class _Noise:
    """Whitening of new samples, copied from the nearest sample of their kind in a session."""

    evidence: LinearizedModel

    def __call__(self, samples: Samples, x: Array) -> Array:
        """Whitening of the samples, (n, 3, 3) [1/m]."""
        del x
        good = np.flatnonzero(self.evidence.believed)
        resting = good < self.evidence.poses
        whiten = np.zeros((len(samples.path), 3, 3))
        for on_path in (False, True):
            new = np.flatnonzero((samples.path != AT_REST) == on_path)
            like = good[~resting] if on_path and not resting.all() else good[resting]
            if not like.size:
                like = good
            like = like[:: max(1, len(like) // _COMPARED)]
            distance = cdist(samples.at.joint[new], self.evidence.at.joint[like])
            whiten[new] = self.evidence.whiten[like[distance.argmin(axis=1)], :3, :3]
        return whiten


def _scale(evidence: LinearizedModel) -> Array:
    """Scale S with d(theta) = S z for the first columns of the nuisance, from one sample."""
    chain, layout = evidence.chain, evidence.chain.layout
    row = [int(np.flatnonzero(evidence.believed)[0])]
    slope = chain.jacobian(evidence.at.take(np.array(row)), evidence.theta, evidence.pose[row])[0]
    own = evidence.nuisance[row[0], :3, layout.base]
    scaled = np.linalg.solve(evidence.whiten[row[0], :3, :3], own)
    offset, place = layout.offset, layout.place
    prior = chain.parameters.prior[layout.base]
    step = float(scaled[:, place].trace() / 3)  # a shift of the frame shifts the reading
    scale = np.diag(np.where(np.isfinite(prior), prior, step))
    scale[place, offset] = scaled[:, offset] - slope[:, offset] @ scale[offset, offset]
    return scale


@dataclass(frozen=True)
class Products:
    """Inner products of whitened columns over some samples."""

    shared: Array  # (s, s) N'N
    across: Array  # (s, k) N'X
    own: Array  # (k, k) X'X

    @classmethod
    def of(cls, evidence: LinearizedModel, columns: Array) -> Products:
        """Products of columns (d n, k); nuisance that not all samples share is projected out."""
        size, every = evidence.chain.layout.base.stop, len(evidence.precision)
        across = evidence.along(Plain(columns))
        own = evidence.rest.inner(columns)
        whole = np.block([[evidence.normal, across], [across.T, own]])
        others = np.arange(size, every)
        kept = np.r_[:size, every : len(whole)]
        normal = whole[np.ix_(kept, kept)]
        if others.size:
            prior = np.diag(evidence.precision[others])
            factor = cho_factor(whole[np.ix_(others, others)] + prior)
            seen = whole[np.ix_(others, kept)]
            normal -= seen.T @ cho_solve(factor, seen)
        return cls(normal[:size, :size], normal[:size, size:], normal[size:, size:])

    def __add__(self, other: Products) -> Products:
        return Products(
            self.shared + other.shared, self.across + other.across, self.own + other.own
        )

    def times(self, count: float) -> Products:
        """Products of `count` times as many samples."""
        return Products(count * self.shared, count * self.across, count * self.own)

    def information(self, precision: Array, nuisance: Mask) -> Array:
        """Information G, (k, k), with those of the shared unknowns (s,) in `nuisance` free."""
        normal = self.shared[np.ix_(nuisance, nuisance)] + np.diag(precision[nuisance])
        across = self.across[nuisance]
        return np.asarray(self.own - across.T @ cho_solve(cho_factor(normal), across))
