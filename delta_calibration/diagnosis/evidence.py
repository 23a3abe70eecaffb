"""The evidence of a session: whitened residuals about a fit, and what is nuisance in them.

About the fit everything is linear,

    r = A z + X v + noise,      z ~ N(0, 1) where a prior is known,

with A the columns of geometry, reflector offset, tracker frame and each path's rest error, and X
those of an effect. Integrated over z the residuals have the covariance V = 1 + A A^T (unbounded
for the tracker's frame), and all tests need only inner products under it,

    <a, b> = a^T V^-1 b = a^T b - (A^T a)^T (A^T A + P)^-1 (A^T b)      (Woodbury)

which is what is left of a and b once all that the nuisance can explain is projected out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import median_filter

from delta_calibration.chain import Chain
from delta_calibration.effects import Effect, Stage
from delta_calibration.identification import Noise, Solution, whitening
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions, Poses, Survey, joined

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AROUND = 9  # readings, about each on a path
_SPIKE = 6.0  # standard deviations from them beyond which a reading is an outlier
_CHI3_MEDIAN = 1.538172  # median of the norm of three standard normal numbers


@dataclass(frozen=True)
class Evidence:
    """Residuals of n samples, poses first and then the readings of the paths.

    `number` tells independent places and stretches of path from each other: what is held out
    together.
    """

    chain: Chain
    theta: Array  # (P,) about which all is linear
    at: Conditions  # (n)
    pose: Array  # (n, k) of the platform
    whiten: Array  # (n, 3, 3) [1/m], with the root of the robust weight in it
    residual: Array  # (n, 3) whitened, at z = 0
    nuisance: Array  # (n, 3, A)
    prior: Array  # (A,) 1 where z has a prior, 0 where not
    poses: int  # how many of the samples are poses

    def __len__(self) -> int:
        return len(self.at)

    @cached_property
    def _inverse(self) -> tuple[Array, bool]:
        a = self.nuisance.reshape(-1, self.nuisance.shape[-1])
        factor: tuple[Array, bool] = cho_factor(a.T @ a + np.diag(self.prior))
        return factor

    @cached_property
    def _slopes(self) -> dict[Stage, Array]:
        """Whitened d(reading) by what each stage hands on, (n, 3, size)."""
        by_joints, by_geometry = self.chain.slopes(self.at, self.pose, self.theta)
        return {
            Stage.DRIVE: self.whiten @ by_joints,
            Stage.STRUCTURE: self.whiten @ by_geometry,
            Stage.MEASUREMENT: self.whiten,
        }

    @cached_property
    def _seen(self) -> Conditions:
        return self.chain.seen(self.at, self.pose, self.theta)

    def columns(self, effect: Effect) -> Array:
        """Whitened columns of an effect, in units of its parameters' priors, (3 n, k)."""
        at = self._seen if effect.stage is Stage.MEASUREMENT else self.at
        columns = self._slopes[effect.stage] @ (effect.columns(at) * effect.parameters.prior)
        return np.asarray(columns.reshape(3 * len(self), -1))

    def inner(self, a: Array, b: Array) -> Array:
        """<a, b> of columns (3 n, i) and (3 n, j), (i, j)."""
        seen = self.nuisance.reshape(-1, self.nuisance.shape[-1])
        return np.asarray(a.T @ b - (seen.T @ a).T @ cho_solve(self._inverse, seen.T @ b))

    @property
    def flat(self) -> Array:
        """The residuals as one column, (3 n, 1)."""
        return self.residual.reshape(-1, 1)

    def left(self, beside: Array) -> Array:
        """What remains of the residuals at the best nuisance and effects, whitened, (n, 3).

        Args:
            beside: columns of effects that are taken for true, (3 n, k).
        """
        a = np.concatenate([self.nuisance.reshape(3 * len(self), -1), beside], axis=1)
        prior = np.concatenate([self.prior, np.zeros(beside.shape[1])])
        z = np.linalg.solve(a.T @ a + np.diag(prior + 1e-12), a.T @ self.flat)
        return (self.flat - a @ z).reshape(-1, 3)


def gather(survey: Survey, robot: Robot, noise: Noise, solution: Solution) -> Evidence:
    """The evidence of poses and paths about a fit to the poses."""
    problem, chain, theta = solution.problem, solution.problem.chain, solution.theta
    poses, paths = survey.poses, survey.paths
    at = joined(poses.conditions, paths.conditions)
    x = np.concatenate([solution.pose, chain.pose(paths.conditions, theta)])
    frame = chain.split(theta)[2]
    slope = frame.rotation @ chain.point_by_joints(paths.conditions, x[len(poses) :], theta)
    moving = _whiten_paths(paths.conditions, paths.count, slope, noise, robot)
    off = at.reading - chain.reading(at, x, theta)
    moving = moving * _believed(moving, off[len(poses) :], paths.path)
    root = np.sqrt(solution.weight)[:, None, None]
    whiten = np.concatenate([root * problem.whiten, moving])
    base = chain.base_size
    columns = whiten @ chain.jacobian(at, x, theta)[..., :base] @ problem.basis[:base, :base]
    missed = (whiten @ off[..., None])[..., 0]
    z = np.linalg.solve(problem.basis[:base, :base], (theta - problem.theta0)[:base])
    offsets = _path_offsets(paths.path, moving @ slope * noise.repeatability, len(poses))
    return Evidence(
        chain=chain,
        theta=theta,
        at=at,
        pose=x,
        whiten=whiten,
        residual=missed + columns @ z,
        nuisance=np.concatenate([columns, offsets], axis=-1),
        prior=np.concatenate([problem.has_prior[:base], np.ones(offsets.shape[-1])]).astype(float),
        poses=len(poses),
    )


def _whiten_paths(
    at: Conditions, count: Index, slope: Array, noise: Noise, robot: Robot
) -> Array:
    """Whitening of averaged readings in motion: tracker and encoders, (n, 3, 3) [1/m]."""
    if len(at) == 0:
        return np.zeros((0, 3, 3))
    covariance = noise.reading(at.reading, robot.tracker)
    covariance = covariance + robot.joints.encoder**2 * slope @ np.swapaxes(slope, 1, 2)
    return whitening(covariance / count[:, None, None])


def _believed(whiten: Array, missed: Array, path: Index) -> Array:
    """1 for readings like their neighbours on the path, 0 for spikes, (n, 1, 1).

    A reading is compared with the median of those around it: what a model leaves out goes on for
    longer than a reading or two.
    """
    whitened = (whiten @ missed[..., None])[..., 0]
    distance = np.zeros(len(path))
    for number in np.unique(path):
        rows = np.flatnonzero(path == number)
        around = median_filter(whitened[rows], size=(_AROUND, 1), mode="nearest")
        distance[rows] = np.linalg.norm(whitened[rows] - around, axis=1)
    typical = max(1.0, float(np.median(distance)) / _CHI3_MEDIAN) if len(path) else 1.0
    return np.asarray((distance <= _SPIKE * typical).astype(float)[:, None, None])


def _path_offsets(path: Index, slope: Array, poses: int) -> Array:
    """Columns of the paths' rest errors in units of their priors, (n, 3, m paths).

    A walk: from one stretch of motion to the next the rest error is another one, or the same still
    where the machine only turned round; its step has the spread of the difference of two.
    """
    numbers, which = np.unique(path, return_inverse=True)
    own = (which[:, None] >= np.arange(len(numbers))) * np.sqrt(2)
    columns = (slope[:, :, None, :] * own[:, None, :, None]).reshape(len(path), 3, -1)
    return np.concatenate([np.zeros((poses, 3, columns.shape[-1])), columns])


def pose_groups(poses: Poses) -> Index:
    """Number of the place each pose belongs to, (n,)."""
    return poses.place
