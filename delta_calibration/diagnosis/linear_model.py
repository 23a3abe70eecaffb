"""The evidence of a session: whitened residuals about a fit, and their nuisance parameters.

About a fit the model is linear,

    r = A z + X v + noise,      z ~ N(0, 1) where a prior is known,

with A the columns of geometry, reflector offset and tracker frame, X those of an effect, and noise
of covariance C: the identity plus that of the rest errors of the paths (`shared_path_error.py`).
Marginalised over z the residuals have the covariance V = C + A A^T (unbounded for the tracker's
frame). All tests need only inner products under V: with a, b and A multiplied by C^(-1/2),

    <a, b> = a^T V^-1 b = a^T b - (A^T a)^T (A^T A + P)^-1 (A^T b)      (Woodbury)

which is the inner product of a and b after everything that the nuisance can explain is projected
out. P holds the precisions of the priors of z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions, Paths, Survey
from delta_calibration.data import joined as all_of
from delta_calibration.diagnosis.columns import Columns, Plain, Product, Sparse, joined
from delta_calibration.diagnosis.constants import CHI3_MEDIAN, EXCEPTION, SPIKE
from delta_calibration.diagnosis.memo import Memo
from delta_calibration.diagnosis.shared_path_error import AT_REST, SharedPathError
from delta_calibration.effects import Effect, Stage
from delta_calibration.effects.apart import Apart, functions_of
from delta_calibration.effects.signals import Signals, all_asked, recorded, standing
from delta_calibration.estimation import (
    Known,
    Linear,
    Noise,
    PointMeasured,
    Population,
    Problem,
    whitening,
    widened,
)
from delta_calibration.geometry import rotations
from delta_calibration.lazy import cached_property
from delta_calibration.robot import Robot
from delta_calibration.theta import Layout
from delta_calibration.threads import mapped

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AT_A_TIME, _DRAWS = 4096, 64  # readings in motion, draws of noise: in memory together
_AROUND = 9  # readings in the median about each reading of a path
_TURNING = 2e-3  # [rad of a Delta] of travel after a reversal
_INNER, _RECORDED, _STANDING = "inner", "recorded", "standing"  # keys of the memo
_ROUNDING = 1e-9  # share of the information that differences of sums cannot be trusted to
_SHORTLY = 15.0  # [s] longest gap between a stop on the way and the motion before or after it


@dataclass(frozen=True)
class Cell:
    """Prior knowledge and weights that go with the readings: robot, noise, weights, population."""

    robot: Robot
    noise: Noise
    weight: Array  # (poses,) of each pose, 0 if it is set aside
    population: Population | None = None  # of the machines of its type, if known

    @property
    def noise_degrees(self) -> float:
        """Degrees of freedom of the noise estimate; infinite if the robot file states it."""
        return 3.0 * self.noise.degrees if self.noise.measured else np.inf


@dataclass(frozen=True)
class LinearizedModel:
    """Residuals of n samples and their linear model: poses first, then the readings of the paths.

    The unit of every whitened coordinate is a standard deviation of its noise. A sample has d
    coordinates: 3 for a tracker's reading; 6 for a probe's, position first and then orientation;
    for other kinds, as many as there are numbers. Orientations read in motion are not used.
    """

    chain: Chain
    theta: Array  # (P,) of the chain, the point of linearisation
    at: Conditions  # (n)
    pose: Array  # (n, k) of the platform
    whiten: Array  # (n, d, d) [1/m], with the root of the robust weight in it
    residual: Array  # (n, d) whitened, at z = 0
    nuisance: Array  # (n, d, A) columns of the parameters that every calibration fits
    rest: SharedPathError  # errors that the paths' samples share
    precision: Array  # (A,) of all z: 1 / variance of its prior, 0 if it has none
    poses: int  # how many of the samples are poses
    by_joints: Array  # (n, d, m) whitened d(reading) / d(joint angles behind the drives)
    by_geometry: Array  # (n, d, p) the same by geometry
    by_mounts: Array  # (n, d, 9) the same by base and reflector, see `by_mounts`
    seen: Conditions  # with readings as the model predicts them before the measurement effects
    robot: Robot | None = None  # whose masses the machine carries; else each effect's own
    others: tuple[Columns, ...] = ()  # further nuisance: columns of explanations in the model
    # (n, m) joints behind the drives and (n, p) dimensions at each sample, if known
    stood: tuple[Array, Array] | None = None
    # further possible measurements, in words, and their evidence; None if yet to be predicted
    further: tuple[tuple[str, LinearizedModel], ...] | None = None
    memo: Memo = field(default_factory=Memo, init=False, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.at)

    @property
    def size(self) -> int:
        """Length of a column: the d coordinates of each sample."""
        return self.residual.size

    @property
    def coordinates(self) -> int:
        """Number of coordinates of one sample, d."""
        return int(self.residual.shape[1])

    @property
    def axes(self) -> int:
        """Number of position coordinates of a sample, without orientation: 3, or d if less."""
        return min(3, self.coordinates)

    def metres(self, whitened: Array, rows: NDArray[np.intp]) -> Array:
        """Undo the whitening of samples' positions, (k, axes) [m]; orientations are left out.

        Args:
            whitened: of these samples, (k, d).
            rows: which samples these are, (k,), none of them set aside.
        """
        # whitening is lower triangular: this block depends on positions alone
        root = self.whiten[rows, : self.axes, : self.axes]
        return np.asarray(np.linalg.solve(root, whitened[:, : self.axes, None])[..., 0])

    @property
    def _columns(self) -> Array:
        """Columns of the parameters that every calibration fits, (d n, A)."""
        return self.nuisance.reshape(self.size, self.nuisance.shape[2])

    @cached_property
    def possible(self) -> Columns:
        """Columns of all nuisance parameters, A."""
        return joined([Plain(self._columns), *self.others])

    @cached_property
    def _shared(self) -> Array:
        """Projection of the nuisance columns onto the shared path errors, (r, A)."""
        return self.rest.seen_of(self.possible)

    @property
    def _inner(self) -> Array:
        """A^T A, (A, A)."""
        return self.memo.of(_INNER, self.possible.inner)

    @cached_property
    def normal(self) -> Array:
        """A^T C^-1 A, (A, A)."""
        return np.asarray(self._inner - self._shared.T @ self._shared)

    @cached_property
    def _factor(self) -> tuple[Array, bool]:
        factor: tuple[Array, bool] = cho_factor(self.normal + np.diag(self.precision))
        return factor

    def _rooted(self, along: Array) -> Array:
        """L^-1 of columns (A, k), with L L' = A^T C^-1 A + P."""
        factor, lower = self._factor
        trans = 0 if lower else 1
        rooted = solve_triangular(factor, along, trans=trans, lower=lower, check_finite=False)
        return np.asarray(rooted)

    def along(self, a: Columns) -> Array:
        """A^T C^-1 a of k columns, (A, k)."""
        return self._along(a, self.rest.seen_of(a))

    def _along(self, a: Columns, shared: Array) -> Array:
        """The same, with the columns' projection onto the shared path errors given, (r, k)."""
        return np.asarray(self.possible.across(a) - self._shared.T @ shared)

    @property
    def geometry(self) -> Array:
        """Whitened columns of the mechanism's dimensions in units of their priors, (d n, p)."""
        return self._columns[:, self.chain.layout.geometry]

    @property
    def column(self) -> Array:
        """The residuals as one column, (d n, 1)."""
        return self.residual.reshape(-1, 1)

    def take(self, rows: NDArray[np.intp]) -> LinearizedModel:
        """The evidence of some of the samples."""
        return replace(
            self,
            at=self.at.take(rows),
            pose=self.pose[rows],
            whiten=self.whiten[rows],
            residual=self.residual[rows],
            nuisance=self.nuisance[rows],
            rest=self.rest.take(rows),
            poses=int(np.sum(rows < self.poses)),
            by_joints=self.by_joints[rows],
            by_geometry=self.by_geometry[rows],
            by_mounts=self.by_mounts[rows],
            seen=self.seen.take(rows),
            others=tuple(each.part(rows, self.coordinates) for each in self.others),
            stood=None if self.stood is None else (self.stood[0][rows], self.stood[1][rows]),
        )

    def but(self, rows: NDArray[np.intp]) -> LinearizedModel:
        """The evidence without some samples; their share is subtracted from the sums over all."""
        others = self.take(np.delete(np.arange(len(self)), rows))
        own = self.possible.part(rows, self.coordinates)
        others.memo.of(_INNER, lambda: self._inner - own.inner())
        return others

    def beside(self, columns: Columns, precision: Array) -> LinearizedModel:
        """The evidence with k more nuisance columns and the precisions of their priors, (k,)."""
        precision = np.concatenate([self.precision, precision])
        return replace(self, others=(*self.others, columns), precision=precision)

    def weigh(self, b: Array) -> Array:
        """V^-1 b of columns (d n, j)."""
        z = cho_solve(self._factor, self.along(Plain(b)))
        left = self.possible.times(z)
        np.subtract(b, left, out=left)
        return self.rest.without(left)

    def information(self, a: Array) -> Array:
        """<a, a> of columns (d n, k), (k, k)."""
        return self.information_of(Plain(a))

    def information_of(self, a: Columns) -> Array:
        """<a, a> of columns that may be products, (k, k)."""
        return self.left_of(a.inner(), self.possible.across(a), self.rest.seen_of(a))

    def left_of(self, inner: Array, across: Array, shared: Array) -> Array:
        """<a, a> of k columns from their plain products, (k, k).

        Args:
            inner: products with each other, (k, k).
            across: products of the nuisance with them, (A, k).
            shared: their projection onto the shared path errors, (r, k).
        """
        along = self._rooted(across - self._shared.T @ shared)
        return np.asarray(inner - shared.T @ shared - along.T @ along)

    def taken_of(self, a: Columns) -> Array:
        """Factor t(a) of k columns by which <a, b> = a^T b - t(a)^T t(b), (r + A, k)."""
        shared = self.rest.seen_of(a)
        return np.concatenate([shared, self._rooted(self._along(a, shared))])

    def left_of_each(self, inner: Array, across: Array, shared: Array) -> Array:
        """`left_of` for each of L sets: (L, k, k), (L, k, A), (L, k, r) -> (L, k, k)."""
        along = across - shared @ self._shared
        rooted = self._rooted(along.reshape(-1, along.shape[2]).T).T.reshape(along.shape)
        taken = (x @ x.swapaxes(1, 2) for x in (shared, rooted))
        return np.asarray(inner - sum(taken))

    def information_of_each(self, a: Array, k: int) -> Array:
        """<a, a> of each group of k columns among (d n, L k), (L, k, k)."""
        shared = self.rest.seen(a)
        parts, signs = (a, shared, self._rooted(self._along(Plain(a), shared))), (1, -1, -1)
        spans = [slice(begin, begin + k) for begin in range(0, a.shape[1], k)]
        return np.array(
            [
                sum(sign * (x[:, own].T @ x[:, own]) for x, sign in zip(parts, signs, strict=True))
                for own in spans
            ]
        )

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Simulated residuals of a machine that the model describes completely, (d n, count).

        Parameters without prior are not drawn: they are projected out again anyway.
        """
        known = self.precision > 0
        z = np.zeros((len(known), count))
        z[known] = rng.standard_normal((int(known.sum()), count))
        z[known] /= np.sqrt(self.precision[known])[:, None]
        drawn = self._noise(count, rng)
        for own in _spans(count):
            drawn[:, own] += self.possible.times(z[:, own])
        return drawn

    def _noise(self, count: int, rng: np.random.Generator) -> Array:
        """Simulated noise and rest errors, (d n, count)."""
        drawn = rng.standard_normal((self.size, count))
        drawn *= self._believed  # all draws of a session are a hundred megabytes: in place
        self.rest.draw_into(drawn, rng)
        return drawn

    def noise_left(
        self, rows: NDArray[np.intp], count: int, rng: np.random.Generator
    ) -> Iterator[Array]:
        """Yield simulated residuals V^-1 r of such a machine at some samples, (k, d, count) each.

        The other samples and the priors enter as what they tell about z. With A, C and the noise e
        of these samples, and N = A^T C^-1 A of all:

            V^-1 r = C^-1 (e - A (N + P)^-1 (A^T C^-1 e + y))      y ~ N(0, P + N - A^T C^-1 A)

        Args:
            rows: samples whose rest errors no others share: poses, or all readings in motion.
            count: number of draws each time.
            rng: of the draws.
        """
        own = self.take(rows)
        root = self._told_but_by(own, rows)
        while True:
            drawn = own._noise(count, rng)
            told = root @ rng.standard_normal((len(root), count))
            mapped(partial(self._fit_noise, own, drawn, told), _spans(count))
            yield drawn.reshape(len(rows), self.coordinates, count)

    def _fit_noise(self, own: LinearizedModel, drawn: Array, told: Array, some: slice) -> None:
        """Replace some draws of noise of the samples `own` by what a fit leaves of them."""
        z = cho_solve(self._factor, own.along(Plain(drawn[:, some])) + told[:, some])
        drawn[:, some] = own.rest.without(drawn[:, some] - own.possible.times(z))

    def _told_but_by(self, own: LinearizedModel, rows: NDArray[np.intp]) -> Array:
        """Root of P + A^T C^-1 A over all samples but these, (A, A)."""
        rest = np.delete(np.arange(len(self)), rows)
        if not len(rest):
            others = np.zeros_like(self.normal)
        elif len(rest) < len(rows):
            others = self.take(rest).normal
        else:  # the sum over fewer samples, subtracted
            others = self.normal - own.normal
        others = others + np.diag(self.precision)
        size = np.sqrt(np.diag(self.normal) + self.precision)
        shares = others / size[:, None] / size + _ROUNDING * np.eye(len(size))
        return np.asarray(size[:, None] * np.linalg.cholesky(shares))

    @cached_property
    def _believed(self) -> Array:
        """1 for coordinates in use, 0 for those set aside or not measured, (d n, 1)."""
        counts = np.abs(self.whiten).sum(axis=2) > 0
        return np.asarray(counts.reshape(-1, 1), dtype=float)

    @cached_property
    def degrees(self) -> float:
        """Degrees of freedom of the residuals: coordinates in use less effective parameters."""
        twice = self.normal - (self._shared.T * self.rest.weak) @ self._shared
        taken = self.rest.degrees + np.trace(cho_solve(self._factor, twice))
        return float(self._believed.sum() - taken)

    def columns(self, effect: Effect) -> Array:
        """Whitened columns of an effect, in units of its parameters' priors, (d n, k)."""
        slope = self.by_stage(effect.stage)
        columns = effect.columns_of(self.signals(effect), by_stage=slope)
        own = columns if effect.free_form else None  # a map's are hundreds of megabytes: in place
        return np.multiply(columns, effect.parameters.prior, out=own).reshape(self.size, -1)

    def product(self, effect: Effect) -> Product:
        """The columns of an effect that moves its whole stage by functions, as products."""
        functions = effect.functions(self.signals(effect))
        return Product(self.by_stage(effect.stage), functions * effect.parameters.prior[0])

    def sparse(self, effect: Effect, values: Sequence[int]) -> Sparse | None:
        """Whitened columns of some values of an effect as a sparse matrix, (d n, k).

        None if a value moves several numbers of its stage.
        """
        signals = self.signals(effect)
        own = Apart.of(effect, values, signals.places)
        if own is None:
            return None
        functions = functions_of([own], signals, np.arange(len(values))[None])
        return Sparse.of(self.by_stage(effect.stage), functions, np.array(own.moves))

    def by_stage(self, stage: Stage) -> Array:
        """Whitened d(reading) / d(output of a stage), (n, d, size of the stage)."""
        return {
            Stage.DRIVE: self.by_joints,
            Stage.STRUCTURE: self.by_geometry,
            Stage.BASE: self.by_mounts[..., :6],
            Stage.REFLECTOR: self.by_mounts[..., 6:],
            Stage.MEASUREMENT: self.whiten[..., : self.axes],
        }[stage]

    def signals(self, effect: Effect) -> Signals:
        """Signals for an effect; with poses and loads of the machine only if it needs them."""
        if effect.stage is Stage.MEASUREMENT:
            return self._read
        if not effect.stands:
            return self._recorded
        if self.robot is not None:
            return self.standing
        return self.chain.signals(self.at, self.theta, self.pose, effect.robot)

    @property
    def _recorded(self) -> Signals:
        """Recorded signals; `standing` itself once it is computed, as it includes them."""
        if self._stands and _STANDING in self.memo:
            return self.standing
        return self.memo.of(_RECORDED, lambda: recorded(self.chain.mechanism, self.at))

    @property
    def _stands(self) -> bool:
        """Whether joints and dimensions at each sample, and the machine's masses, are known."""
        return self.stood is not None and self.robot is not None

    @cached_property
    def _read(self) -> Signals:
        return recorded(self.chain.mechanism, self.seen)

    @property
    def standing(self) -> Signals:
        """Signals of the machine in its pose at each sample, with all its loads."""
        return self.memo.of(_STANDING, self._standing)

    def _standing(self) -> Signals:
        if self.stood is None or self.robot is None:
            return self.chain.signals(self.at, self.theta, self.pose, self.robot)
        (joint, geometry), mechanism = self.stood, self.chain.mechanism
        asked, known = all_asked(mechanism), self._recorded
        self.memo.forget(_RECORDED)  # as large as the session, and all of it is in these
        return standing(known, self.robot, mechanism, self.pose, geometry, asked, joint)

    @property
    def believed(self) -> NDArray[np.bool_]:
        """Samples that are not set aside, (n,)."""
        return self.counted > 0

    @property
    def counted(self) -> Index:
        """How many coordinates of each sample are in use, (n,)."""
        counts = self._believed.reshape(self.residual.shape).sum(axis=1)
        return np.asarray(counts, dtype=np.int64)

    def covariance(self) -> Array:
        """Posterior covariance of the nuisance z, given residuals and priors, (A, A)."""
        return np.asarray(cho_solve(self._factor, np.eye(len(self.precision))))

    def known(self, misfit: float = 1.0) -> Known:
        """Information on the nuisance z from priors and from residuals of `misfit` times noise."""
        along = self.along(Plain(self.column))[:, 0]
        return Known(self.normal / misfit, along / misfit, self.precision)

    def best(
        self, misfit: float = 1.0, held: Index | None = None, values: Array | None = None
    ) -> Array:
        """The most likely nuisance z, (A,).

        Args:
            misfit: chi square per degree of freedom. It scales the priors, so that structure
                missing in the model does not bend z beyond plausible tolerances.
            held: entries held at given values.
            values: the given values.
        """
        right = self.along(Plain(self.column))[:, 0]
        normal = self.normal + max(1.0, misfit) * np.diag(self.precision)
        if held is None or values is None or not held.size:
            return np.asarray(cho_solve(cho_factor(normal), right))
        free = np.setdiff1d(np.arange(len(right)), held)
        z = np.empty(len(right))
        z[held] = values
        across = right[free] - normal[np.ix_(free, held)] @ values
        z[free] = np.linalg.solve(normal[np.ix_(free, free)], across)
        return z

    def cost(self, z: Array, misfit: float = 1.0) -> float:
        """Cost that `best` minimises: chi square of readings and priors at a nuisance z, (A,)."""
        r = self.column - self.possible.times(z[:, None])
        return float(self.rest.inner(r)[0, 0] + max(1.0, misfit) * np.sum(self.precision * z**2))

    @property
    def misfit(self) -> float:
        """Chi square per degree of freedom."""
        return float(np.sum(self.left() ** 2) / self.degrees)

    def missed(self, z: Array) -> Array:
        """Measured less predicted position with nuisance z, (n, axes) [m]; NaN if set aside."""
        off, good = self._left(z), np.flatnonzero(self.believed)
        missed = np.full((len(off), self.axes), np.nan)
        missed[good] = self.metres(off[good], good)
        return missed

    @property
    def variance(self) -> Array:
        """Noise variance of each reading's position, axes summed, (n,) [m^2]; NaN if set aside."""
        variance = np.full(len(self), np.nan)
        root = np.linalg.inv(self.whiten[self.believed, : self.axes, : self.axes])
        variance[self.believed] = np.sum(root**2, axis=(1, 2))
        return variance

    def left(self) -> Array:
        """Whitened residuals at the most likely nuisance, (n, d)."""
        return self._left(self.best())

    def _left(self, z: Array) -> Array:
        """Residuals less nuisance z and less the rest errors estimated from these, (n, d)."""
        left = self.rest.without(self.column - self.possible.times(z[:, None]))
        return left.reshape(self.residual.shape)


def _spans(count: int) -> list[slice]:
    """Draws that are in memory together."""
    return [slice(begin, begin + _DRAWS) for begin in range(0, count, _DRAWS)]


def gather(
    survey: Survey, problem: Problem, theta: Array, cell: Cell, guess: Array | None = None
) -> LinearizedModel:
    """Linearise poses and paths about a model, with residuals as if it had no effects.

    Args:
        survey: what was measured.
        problem: that of fitting the poses.
        theta: of the problem, (P,); the point of linearisation.
        cell: noise, robot and weights.
        guess: approximate poses of the platform, (n, k).
    """
    chain, poses, paths, at = problem.chain, survey.poses, survey.paths, survey.conditions
    whiten_paths, count = np.zeros((0, 3, 3)), len(poses)
    about = _at_rest(problem, theta, None if guess is None else guess[:count])
    if len(paths):
        missed, moving = _in_motion(
            paths, chain, theta, None if guess is None else guess[count:], problem.layout
        )
        whiten_paths = _whiten_paths(paths, moving.by_joints, cell)
        turning = _TURNING * chain.mechanism.joint_size
        whiten_paths = _believed(whiten_paths, missed, paths, turning) * whiten_paths
        about = _one_after_the_other([about, moving])
    size, d = chain.mechanism.joint_size, about.missed.shape[1]
    apart = ~on_the_way(survey)
    root = np.sqrt(cell.weight * apart)[:, None, None]
    unseen = [(0, 0), (0, d - 3), (0, d - 3)]
    whiten = np.concatenate([root * problem.whiten, np.pad(whiten_paths, unseen)])
    path = np.concatenate([np.full(len(poses), AT_REST), paths.path])
    rest = SharedPathError.of(path, at, whiten @ about.by_joints * cell.noise.repeatability, size)
    evidence = linearized_about(problem, theta, at, about, whiten, rest)
    return replace(evidence, poses=len(poses), robot=cell.robot)


def _in_motion(
    paths: Paths, chain: Chain, theta: Array, guess: Array | None, layout: Layout
) -> tuple[Array, Linear]:
    """Residuals in motion about a model (n, 3) [m], and their linear form without effects.

    Of readings in motion only positions are used. They are processed in batches, because a map
    has hundreds of columns.
    """
    at, missed, parts = paths.conditions, [], []
    for begin in range(0, len(at), _AT_A_TIME):
        rows = np.arange(begin, min(begin + _AT_A_TIME, len(at)))
        own = at.take(rows)
        tracker = PointMeasured(own.joint, own.reading, None, 1.0)
        near = None if guess is None else guess[rows]
        part = tracker.linearized(chain.predictor(own), theta, near)
        missed.append(part.missed)
        parts.append(less_effects(part, layout, theta))
    return np.concatenate(missed), _one_after_the_other(parts)


def _at_rest(problem: Problem, theta: Array, guess: Array | None) -> Linear:
    """Linear form of the poses without effects, block by block where they are many."""
    every = problem.in_blocks(theta, guess)
    return _one_after_the_other([less_effects(part, problem.layout, theta) for _, part in every])


def _one_after_the_other(parts: Sequence[Linear]) -> Linear:
    """Concatenate linear forms; the first has the most coordinates."""
    if len(parts) == 1:
        return parts[0]
    d, stood = parts[0].missed.shape[1], [part.stood for part in parts if part.stood is not None]
    return Linear(
        np.concatenate([part.pose for part in parts]),
        np.concatenate([widened(part.missed, d) for part in parts]),
        np.concatenate([widened(part.by_theta, d) for part in parts]),
        np.concatenate([widened(part.by_joints, d) for part in parts]),
        all_of(*(part.at for part in parts)),
        _both(stood) if len(stood) == len(parts) else None,
    )


def _both(stood: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    joint, geometry = zip(*stood, strict=True)
    return np.concatenate(joint), np.concatenate(geometry)


def less_effects(about: Linear, layout: Layout, theta: Array) -> Linear:
    """Linear form without effects: residuals as if there were none, columns of the rest of theta.

    A map has hundreds of columns, each as long as the session: they are dropped early.
    """
    own = layout.effects
    missed = about.missed + about.by_theta[..., own] @ theta[own]
    return replace(about, missed=missed, by_theta=about.by_theta[..., layout.base].copy())


def linearized_about(
    problem: Problem,
    theta: Array,
    at: Conditions,
    about: Linear,
    whiten: Array,
    rest: SharedPathError,
) -> LinearizedModel:
    """Whiten the residuals of one kind of measurement about a model, as if it had no effects.

    Args:
        problem: the model's scales and priors; parameters not free in it are held.
        theta: of the problem, (P,); the point of linearisation.
        at: conditions of the n samples.
        about: residuals and their columns there, without the effects (`less_effects`).
        whiten: (n, d, d), with the root of the robust weight in it.
        rest: errors that samples share.
    """
    layout, base = problem.layout, problem.layout.base
    free = problem.free[base]
    columns = (whiten @ about.by_theta).reshape(-1, base.stop - base.start)
    columns = (columns @ (problem.basis[base, base] * free)).reshape(*about.missed.shape, -1)
    z = np.linalg.solve(problem.basis, theta - problem.theta0)[base]
    return LinearizedModel(
        chain=problem.chain,
        theta=theta[layout.chain],
        at=at,
        pose=about.pose,
        whiten=whiten,
        residual=(whiten @ about.missed[..., None])[..., 0] + columns @ z,
        nuisance=columns,
        rest=rest,
        precision=np.where(free, problem.has_prior[base], 1.0),
        poses=len(at),
        by_joints=whiten @ about.by_joints,
        by_geometry=whiten @ about.by_theta[..., layout.geometry],
        by_mounts=whiten @ by_mounts(problem.chain, theta, about.by_theta),
        seen=about.at,
        stood=about.stood,
    )


def by_mounts(chain: Chain, theta: Array, by_theta: Array) -> Array:
    """Derivative by base and reflector, from that by theta, (n, d, 9).

    They are shift [m] and turn [rad] of the base, and shift [m] of the reflector in the platform.

    R(w), t is the base's pose in the tracker's frame; b turns and d shifts it in its own axes:

        dw = J_r(w)^-1 b        dt = R d
    """
    layout, w = chain.layout, theta[chain.layout.turn]
    shift = by_theta[..., layout.place] @ rotations.exp(w)
    turn = by_theta[..., layout.turn] @ np.linalg.inv(rotations.left_jacobian(-w))
    return np.concatenate([shift, turn, by_theta[..., layout.offset]], axis=-1)


def on_the_way(survey: Survey) -> NDArray[np.bool_]:
    """Mask of poses that are stops within a longer motion, (n,); none unless they are a minority.

    The joints may not have made a separate move to each of them. Such stops then share one rest
    error; treated as independent draws they would count as more information than they hold.
    """
    time, moving = survey.poses.time, np.sort(survey.paths.conditions.time)
    if not moving.size:
        return np.zeros(len(time), dtype=bool)
    after = np.searchsorted(moving, time)
    since = time - moving[np.clip(after - 1, 0, None)]
    until = moving[np.clip(after, None, len(moving) - 1)] - time
    within = (since >= 0) & (until >= 0) & (np.maximum(since, until) < _SHORTLY)
    return np.asarray(within & (within.mean() < EXCEPTION))


def _whiten_paths(paths: Paths, slope: Array, cell: Cell) -> Array:
    """Whitening of averaged readings in motion: tracker and encoders, (n, 3, 3) [1/m]."""
    if len(paths) == 0:
        return np.zeros((0, 3, 3))
    covariance = cell.noise.reading(paths.conditions.reading, cell.robot.tracker)
    covariance = covariance + cell.robot.joints.encoder**2 * slope @ np.swapaxes(slope, 1, 2)
    return whitening(covariance / paths.count[:, None, None])


def _believed(whiten: Array, missed: Array, paths: Paths, turning_travel: float) -> Array:
    """Mask of readings in motion: 1 if like its neighbours on the path, 0 if a spike, (n, 1, 1).

    A reading is compared with the median of those around it, because errors missing in the model
    last longer than one or two readings. Readings within `turning_travel` [joint unit] after the
    reversal of a joint are also left out: averaged over a stretch of the path, they represent
    neither direction.
    """
    from scipy.ndimage import median_filter  # slow to load, and not needed at rest

    path, at = paths.path, paths.conditions
    turning = ((at.velocity != 0) & (at.travel < turning_travel)).any(axis=1)
    whitened = (whiten @ missed[..., None])[..., 0]
    distance = np.zeros(len(path))
    for number in np.unique(path):
        rows = np.flatnonzero(path == number)
        around = median_filter(whitened[rows], size=(_AROUND, 1), mode="mirror")
        distance[rows] = np.linalg.norm(whitened[rows] - around, axis=1)
    typical = max(1.0, float(np.median(distance)) / CHI3_MEDIAN) if len(path) else 1.0
    good = (distance <= SPIKE * typical) & ~turning
    return np.asarray(good.astype(float)[:, None, None])
