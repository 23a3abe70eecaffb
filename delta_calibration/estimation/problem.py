"""The least-squares problem: whitened residuals of the chain, priors as rows, a robust loss.

The unknowns are scaled, theta = theta_0 + S z, with the priors' standard deviations (a typical
size where there is no prior) on the diagonal of S, so that z is of the order of one and the
prior's rows are z itself. S also shifts the tracker's frame against the reflector's offset: on a
platform that hardly tilts the two are nearly equivalent, and without this coupling the search
would move very slowly along that valley of the cost.

    minimise  sum_i rho(|W_i (y_i - chain(q_i, theta))|) / s^2 + sum_prior z_k^2

s is 1 if the noise explains the residuals, and else their robust standard deviation: model errors
must not move the parameters beyond what parts can be.

Measurements may be of several kinds (`measurements.py`) with d numbers each: 3 of a position, 6 of
a pose. With poses, the orientation of the probe's mount adds three unknowns to those of the chain.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from delta_calibration.chain import Chain, Predictor
from delta_calibration.data import Conditions, joined
from delta_calibration.errors import DataError
from delta_calibration.estimation.measurements import Linear, Measured, PointMeasured
from delta_calibration.estimation.positive import solved
from delta_calibration.lazy import cached_property
from delta_calibration.theta import Layout, vector_names
from delta_calibration.threads import one_thread

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

_FRAME_STEP = 1e-3  # typical size of a parameter without prior [m, rad]
_STEPS = 60
_SETTLING = 3
_ROUGHLY = 0.5  # decrease of the cost to stop at while the loss is still being adapted
_NOTHING = 1e-2  # share of the stopping decrease: a step that promises less is not evaluated
SETTLED = 1e-3  # decrease of the cost (chi square) under which the search has converged
_GIVE_UP = 1e9  # damping at which the search ends
_DAMPING = 1e-3  # least damping of a step; a prior adds 1 to the same diagonal
_HUBER = 4.0  # whitened distances beyond this many (robust) standard deviations count linearly
_CUT = 3.0  # times the Huber distance, beyond which a pose is a gross error and has weight 0
_TOLD = 10.0  # prior over posterior standard deviation from which the offset has one minimum
_UNTOLD = 1e-4  # share of the prior's variance below which a decrease tells nothing of the offset
_ROUNDS = 12  # most rounds in which the loss is adapted to the residuals
_SHRUNK = 0.9  # ratio of successive bends of the loss, above which they have converged
_KEPT = 300_000  # samples times unknowns, up to which their Jacobian is kept
_BLOCK = 256  # samples whose Jacobian is computed at a time otherwise
MOUNT_NAMES = vector_names("probe_turn")


@dataclass(frozen=True)
class Kept:
    """Jacobian of the whitened prediction by the free unknowns, in memory."""

    slope: Array  # (n, d, F)

    @property
    def rows(self) -> Array:
        """All rows, (n d, F)."""
        return self.slope.reshape(-1, self.slope.shape[2])

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Samples and their rows: all at once."""
        yield slice(None), self.rows

    def take(self, samples: NDArray[np.intp]) -> Kept:
        """The Jacobian of some of the samples."""
        return Kept(self.slope[samples])


@dataclass(frozen=True)
class Recomputed:
    """The Jacobian of many samples by many unknowns, computed block by block when needed."""

    problem: Problem
    theta: Array  # (P,)
    pose: Array  # (n, k)

    @property
    def rows(self) -> Array:
        """All rows, (n d, F)."""
        return np.concatenate([rows for _, rows in self.blocks()])

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Samples and their rows, block by block."""
        for own, linear in self.problem.in_blocks(self.theta, self.pose):
            yield own, self.problem.whitened(linear, own)[1]

    def take(self, samples: NDArray[np.intp]) -> Recomputed:
        """The Jacobian of some of the samples."""
        return Recomputed(self.problem.take(samples), self.theta, self.pose[samples])


@dataclass(frozen=True)
class Linearized:
    """A problem linearized at theta, d numbers a sample; kinds with fewer are zero-padded."""

    pose: Array  # (n, k) of the platform
    residual: Array  # (n, d) whitened: measured less predicted
    jacobian: Kept | Recomputed
    numbers: Index  # (n,) how many of the d numbers each sample has

    @property
    def rows(self) -> Array:
        """Rows of the Jacobian, whitened d(predicted)/dz of the free unknowns, (n d, F)."""
        return self.jacobian.rows

    @property
    def slope(self) -> Array:
        """The Jacobian rows grouped by pose, (n, d, F)."""
        return self.rows.reshape(*self.residual.shape, -1)

    def take(self, samples: NDArray[np.intp]) -> Linearized:
        """Some of the samples."""
        residual, numbers = self.residual[samples], self.numbers[samples]
        jacobian = self.jacobian.take(samples)
        return Linearized(self.pose[samples], residual, jacobian, numbers)


@dataclass(frozen=True)
class Near:
    """Start of a search: unknowns z (F,), and the problem linearized there if that is known."""

    z: Array
    at: Linearized | None = None


@dataclass(frozen=True)
class Problem:
    """Estimation problem: a chain, its measurements, priors and free parameters."""

    chain: Chain
    measured: tuple[Measured, ...]  # one kind each, n samples in all
    theta0: Array  # (P,) prior mean and start
    basis: Array  # (P, P), S
    has_prior: Mask  # (P,)
    free: Mask  # (P,) fitted entries; the others keep their theta0

    @cached_property
    def layout(self) -> Layout:
        """Layout of theta: which entry is which parameter."""
        chain = self.chain.layout
        return chain if len(self.theta0) == chain.size else chain.mounted

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of theta, (P,)."""
        names = self.chain.parameters.names
        return (
            names
            if not self.layout.has_mount
            else (
                *names[: self.layout.mount.start],
                *MOUNT_NAMES,
                *names[self.layout.mount.start :],
            )
        )

    @cached_property
    def at(self) -> Conditions:
        """Conditions of all n samples."""
        return joined(*(part.at for part in self.measured))

    @cached_property
    def whiten(self) -> Array:
        """Whitening matrices if one kind was measured, (n, d, d) [1/m, 1/rad]."""
        (part,) = self.measured
        return part.whiten

    @cached_property
    def y(self) -> Array:
        """Measured positions if these are the only kind, (n, 3) [m] in the tracker's frame."""
        (part,) = self.measured
        return cast(PointMeasured, part.observation).point

    def mounted(self, measured: Measured, mount: Array) -> Problem:
        """Return the problem of a probe's poses, with its mounting orientation as an unknown.

        Args:
            measured: poses of the probe.
            mount: start value of the mounting orientation, rotation vector (3,) [rad].
        """
        layout = self.chain.layout.mounted
        own = layout.chain
        start, basis = np.zeros(layout.size), np.diag(np.full(layout.size, _FRAME_STEP))
        start[layout.mount], start[own] = mount, self.theta0
        basis[np.ix_(own, own)] = self.basis
        has_prior, free = np.zeros(layout.size, dtype=bool), np.ones(layout.size, dtype=bool)
        has_prior[own], free[own] = self.has_prior, self.free
        return Problem(self.chain, (measured,), start, basis, has_prior, free)

    def take(self, rows: NDArray[np.intp]) -> Problem:
        """Return the problem with some of the samples."""
        parts, begin = [], 0
        for part in self.measured:
            own = rows[(rows >= begin) & (rows < begin + len(part.at))] - begin
            parts.append(part.take(own))
            begin += len(part.at)
        return replace(self, measured=tuple(parts))

    def only(self, free: Mask) -> Problem:
        """Return the problem with other parameters free."""
        return replace(self, free=free)

    def theta(self, z: Array) -> Array:
        """Return theta (P,) for scaled free unknowns z (F,)."""
        return np.asarray(self.theta0 + self._freed @ z)

    def unknowns(self, theta: Array) -> Array:
        """Return the scaled free unknowns z (F,) for theta (P,); the inverse of `theta`."""
        return np.asarray(np.linalg.solve(self.basis, theta - self.theta0)[self.free])

    @cached_property
    def _predictors(self) -> tuple[Predictor, ...]:
        return tuple(self.chain.predictor(part.at) for part in self.measured)

    def about(self, theta: Array, guess: Array | None = None) -> tuple[Linear, ...]:
        """Each kind's measurements linearized at theta, not whitened; see `linearized`."""
        if len(self.measured) > 1:
            guess = None
        return tuple(
            part.observation.linearized(at, theta, guess)
            for part, at in zip(self.measured, self._predictors, strict=True)
        )

    def linearized(self, theta: Array, guess: Array | None = None) -> Linearized:
        """Return the whitened residuals at theta and their Jacobian.

        Args:
            theta: (P,).
            guess: approximate poses of the platform, (n, k); searched if not given.
        """
        if len(self.blocks) > 1:
            return self._left(theta, guess)
        parts = []
        for kind, linear in enumerate(self.about(theta, guess)):
            residual, rows = self.whitened(linear, slice(None), kind)
            numbers = np.full(len(residual), residual.shape[1])
            slope = rows.reshape(*residual.shape, rows.shape[1])
            parts.append(Linearized(linear.pose, residual, Kept(slope), numbers))
        return parts[0] if len(parts) == 1 else _stacked(parts)

    @cached_property
    def blocks(self) -> tuple[slice, ...]:
        """Samples to linearize at a time: several blocks if the Jacobian is too large to keep."""
        n, width = sum(len(part.at) for part in self.measured), int(self.free.sum())
        if len(self.measured) > 1 or n * width <= _KEPT:
            return (slice(None),)
        return tuple(slice(begin, begin + _BLOCK) for begin in range(0, n, _BLOCK))

    def in_blocks(self, theta: Array, guess: Array | None) -> Iterator[tuple[slice, Linear]]:
        """Measurements of one kind linearized at theta, block by block; see `about`."""
        (part,), (at,) = self.measured, self._predictors
        for own in self.blocks:
            near = None if guess is None else guess[own]
            yield own, part.observation.take(own).linearized(at.take(own), theta, near)

    def whitened(self, linear: Linear, samples: slice, kind: int = 0) -> tuple[Array, Array]:
        """Whitened residuals (n, d) and Jacobian rows (n d, F) of samples of one kind."""
        whiten = self.measured[kind].whiten[samples]
        slope = np.ascontiguousarray(linear.by_theta)
        residual, rows = _equations().whitened(linear.missed, slope, whiten, self._freed)
        return residual, rows

    def _left(self, theta: Array, guess: Array | None) -> Linearized:
        """The whitened residuals of one kind; their Jacobian when it is needed."""
        (part,), (at,) = self.measured, self._predictors
        pose, missed = part.observation.left(at, theta, guess)
        residual = (part.whiten @ missed[..., None])[..., 0]
        numbers = np.full(len(residual), residual.shape[1])
        return Linearized(pose, residual, Recomputed(self, theta, pose), numbers)

    @cached_property
    def _freed(self) -> Array:
        """d(theta)/dz of the free unknowns, (P, F)."""
        return np.ascontiguousarray(self.basis[:, self.free])

    @cached_property
    def expected(self) -> Array:
        """1 for free unknowns that have a prior, else 0, (F,)."""
        return self.has_prior[self.free].astype(float)

    def offset_rows(self) -> Mask:
        """Mask of the free unknowns that are the reflector's offset, (F,)."""
        return np.asarray(self.layout.mask(self.layout.offset)[self.free])


@dataclass(frozen=True)
class Solution:
    """Result of the search."""

    problem: Problem
    theta: Array  # (P,)
    z: Array  # (F,)
    at: Linearized
    weight: Array  # (n,) of each pose under the robust loss; 1: full weight
    cost: float
    evaluations: int  # how often all poses were predicted

    @property
    def pose(self) -> Array:
        """Poses of the platform at theta, (n, k)."""
        return self.at.pose

    @property
    def residual(self) -> Array:
        """Whitened measured less predicted, (n, d)."""
        return self.at.residual

    def near(self, samples: NDArray[np.intp]) -> Near:
        """Start, at this solution, of a fit to some of the samples only."""
        return Near(self.z, self.at.take(samples))


def build_problem(chain: Chain, measured: Measured, start: Array) -> Problem:
    """Build a tracker's problem, all parameters free, scales and priors from the chain."""
    basis, finite = scales(chain)
    basis[chain.layout.place, chain.layout.offset] = (
        -chain.split(start)[2].rotation * chain.offset_prior
    )
    return Problem(chain, (measured,), start, basis, finite, np.ones(len(finite), dtype=bool))


def scales(chain: Chain) -> tuple[Array, Mask]:
    """Typical sizes of theta as a diagonal (P, P), and mask (P,) of entries with a prior."""
    prior = chain.parameters.prior
    finite = np.isfinite(prior)
    return np.diag(np.where(finite, prior, _FRAME_STEP)), finite


def widened(each: Array, width: int) -> Array:
    """Samples (n, d, ...) padded with zeros to `width` numbers d each."""
    missing = width - each.shape[1]
    return np.pad(each, [(0, 0), (0, missing)] + [(0, 0)] * (each.ndim - 2))


def _stacked(parts: list[Linearized]) -> Linearized:
    """Stack the parts of all kinds, padded to the largest d."""
    width = max(part.residual.shape[1] for part in parts)
    slope = np.concatenate([widened(part.slope, width) for part in parts])
    return Linearized(
        np.concatenate([part.pose for part in parts]),
        np.concatenate([widened(part.residual, width) for part in parts]),
        Kept(slope),
        np.concatenate([part.numbers for part in parts]),
    )


@dataclass(frozen=True)
class _Loss:
    """rho(d): d^2 up to `bend`, linear up to `cut`, constant beyond; Huber's where cut is inf."""

    bend: float = np.inf
    cut: float = np.inf

    @property
    def spread(self) -> float:
        """Standard deviation of the residuals that the loss is made for; 1: that of the noise."""
        return self.bend / _HUBER if np.isfinite(self.bend) else 1.0

    def judge(self, residual: Array) -> tuple[Array, float]:
        """Weight of each pose (n,) by its whitened residual (n, d), and the total cost."""
        weight, cost = _equations().judged(residual, self.bend, self.cut, self.spread)
        return weight, cost


@one_thread()
def solve(
    problem: Problem,
    start: Near | None = None,
    robust: bool = True,
    settled: float = SETTLED,
    everywhere: bool = False,
) -> Solution:
    """Minimise by Levenberg-Marquardt with a robust loss on the distances.

    Without `start`, or with `everywhere`, other local minima are searched for if the reflector's
    offset is ill determined.

    The loss is linear from 4 robust standard deviations of the residuals on, and never from less
    than 4 of the stated noise. That deviation is taken from the start's residuals, then from those
    of each fit until it no longer shrinks: a plain fit would have adapted itself to a gross error
    and taken its own residuals for normal. Poses three times as far off then get weight 0, and the
    reflector's offset of the file is tried as a second start.

    Raises:
        DataError: the start, or the fit, has poses that the model cannot reach.
    """
    begin = Near(np.zeros(int(problem.free.sum()))) if start is None else start
    now = first = _state(problem, begin.z, _Loss(), None, at=begin.at)
    if not robust:
        return _solution(problem, _search(problem, _Loss(), now, settled))
    bend, made = _bend(now.at.residual, now.at.numbers), 1
    for _ in range(_ROUNDS):
        now = _search(problem, _Loss(bend), now, max(settled, _ROUGHLY))
        made += now.evaluations
        last, bend = bend, min(bend, _bend(now.at.residual, now.at.numbers))
        if bend > _SHRUNK * last:
            break
    if np.linalg.norm(now.at.residual, axis=1).max() <= _CUT * bend:
        loss, starts = _Loss(bend), [now]
        # the rounds may have led to the wrong local minimum
        if (start is None or everywhere) and _may_be_elsewhere(problem, now):
            starts += [first, _likeliest_place(problem, loss, now, settled)]
            made += starts[-1].evaluations
    else:  # gross errors may have done so, too
        drawing = _state(problem, np.where(problem.offset_rows(), 0.0, now.z), _Loss(bend), None)
        drawing = _search(problem, _Loss(bend), drawing, settled)
        made += drawing.evaluations
        loss, starts = _Loss(bend, _CUT * bend), [now, drawing]
    ends: list[_State] = []
    for each in starts:
        ends.append(_search(problem, loss, each, settled, ends))
        made += ends[-1].evaluations
    best = min(ends, key=lambda end: end.cost)
    return _solution(problem, replace(best, evaluations=made))


def offset_is_doubtful(solution: Solution) -> bool:
    """Whether another offset of the reflector may fit as well, see `_may_be_elsewhere`."""
    problem, own = solution.problem, (solution.z, solution.theta, solution.at, solution.weight)
    return _may_be_elsewhere(problem, _State(*own, solution.cost, 0, problem.expected, 1.0))


def _may_be_elsewhere(problem: Problem, now: _State) -> bool:
    """Whether the reflector's offset may have another local minimum: if it is ill determined.

    A platform that rotates far has readings that are linear in the offset and determine it to a
    fraction of its prior: no minimum a prior standard deviation away is as low. On one that cannot
    rotate the offset moves all readings alike, as the frame does: what is left of it is its prior.
    """
    offset = np.flatnonzero(problem.offset_rows())
    if not offset.size:
        return False
    normal = now.equations[0].copy()
    normal.flat[:: len(normal) + 1] += _DAMPING
    spread = solved(normal, np.eye(len(normal))[:, offset])[offset]
    told = np.linalg.eigvalsh(spread)
    return bool(told[-1] > 1 / _TOLD**2 and told[0] * (1 + _DAMPING) < 1 - _UNTOLD)


def _likeliest_place(problem: Problem, loss: _Loss, now: _State, settled: float) -> _State:
    """Best start among seven reflector offsets: the file's and a standard deviation to each side.

    For each offset the other unknowns start at their linear prediction and take a few steps; the
    caller searches on from the best. If the platform hardly tilts, the readings determine little
    more of an offset than its size: there is another local minimum on the other side.
    """
    rest, offset = ~problem.offset_rows(), problem.offset_rows()
    normal = now.equations[0] + _DAMPING * np.eye(len(now.z))
    follows = solved(normal[np.ix_(rest, rest)], -normal[np.ix_(rest, offset)])
    best, made = None, 0
    for place in (np.zeros(offset.sum()), *np.eye(offset.sum()), *-np.eye(offset.sum())):
        begin = now.z.copy()
        begin[offset] = place
        begin[rest] += follows @ (place - now.z[offset])
        begun = _state(problem, begin, loss, now.at.pose)
        if not np.isfinite(begun.cost):  # taken beyond reach
            begun = _state(problem, np.where(rest, now.z, begin), loss, now.at.pose)
        end = _settle(problem, begun, rest, loss, max(settled, _ROUGHLY))
        made += end.evaluations
        if best is None or end.cost < best.cost:  # its columns are as large as the session
            best = end
    assert best is not None
    return replace(best, evaluations=made)


def solution_at(problem: Problem, z: Array) -> Solution:
    """Evaluate the problem at z found by another search, with the loss fitted to its residuals.

    Raises:
        DataError: the model with these unknowns cannot reach a pose.
    """
    own = _state(problem, z, _Loss(), None)
    _require_reach(
        problem,
        own,
        "the machine found by the search",
        "a longer search may find another solution",
    )
    bend = _bend(own.at.residual, own.at.numbers)
    now = _state(problem, z, _Loss(bend, _CUT * bend), own.at.pose)
    return _solution(problem, replace(now, evaluations=2))


def robust_weights(residual: Array) -> Array:
    """Weights of poses by whitened residuals (n, d): 1, less beyond 4 sigma, 0 beyond 12."""
    bend = _bend(residual, residual.shape[1])
    return _Loss(bend, _CUT * bend).judge(residual)[0]


def spread_of(residual: Array) -> float:
    """Robust standard deviation of whitened residuals (n, d), at least 1, that of the noise."""
    return _bend(residual, residual.shape[1]) / _HUBER


def _bend(residual: Array, numbers: Index | int) -> float:
    """Whitened distance from which the loss is linear, for samples (n, d) of `numbers` each."""
    widths = np.arange(residual.shape[1] + 1)
    median = np.sqrt(2 * gammaincinv(widths / 2, 0.5))  # of chi's distribution
    typical = float(np.median(np.linalg.norm(residual, axis=1) / median[numbers]))
    return _HUBER * max(1.0, typical)


def _search(
    problem: Problem, loss: _Loss, begin: _State, settled: float, known: Sequence[_State] = ()
) -> _State:
    """Levenberg-Marquardt; after every step all unknowns but the reflector's offset are refitted.

    The offset multiplies the platform's tilt: a step in both leaves a curved valley of the cost,
    along which plain steps converge slowly. With the others refitted at the new offset (variable
    projection) a few steps suffice. Evaluations are counted anew. The search ends where it
    meets a minimum, or a step leads to one, that is already known under the same loss.
    """
    now = _under(problem, loss, begin)
    _require_reach(
        problem, now, "the nominal robot", "is it another robot, or are the joint zeros different?"
    )
    every, rest = np.ones(len(now.z), dtype=bool), ~problem.offset_rows()
    in_two = not rest.all()
    if in_two:
        now = _settle(problem, now, rest, loss, settled)
    damping, steps = _DAMPING, 0
    while steps < _STEPS and damping < _GIVE_UP:
        steps += 1
        step, promised = _step(now, every, damping)
        if promised <= _NOTHING * settled and damping <= _DAMPING:
            break
        here = now.z, now.z + step
        same = next((end for end in known for z in here if _is_at(end, z)), None)
        if same is not None:
            return replace(same, evaluations=now.evaluations)
        tried = _state(problem, now.z + step, loss, now.at.pose, now.evaluations)
        if in_two:
            tried = _settle(problem, tried, rest, loss, settled)
        gain = now.cost - tried.cost
        if gain >= 0:
            now, damping = tried, max(damping / 10, _DAMPING)
        else:
            now, damping = replace(now, evaluations=tried.evaluations), 10 * damping
        if abs(gain) <= settled:
            break
    return now


def _settle(problem: Problem, now: _State, moving: Mask, loss: _Loss, settled: float) -> _State:
    """A few Gauss-Newton steps in some of the unknowns, each kept only if it lowers the cost."""
    for _ in range(_SETTLING):
        step, promised = _step(now, moving, _DAMPING)
        if promised <= _NOTHING * settled:
            break
        tried = _state(problem, now.z + step, loss, now.at.pose, now.evaluations)
        gain = now.cost - tried.cost
        if not gain >= 0:
            return replace(now, evaluations=tried.evaluations)
        now = tried
        if gain <= settled:
            break
    return now


def _is_at(end: _State, z: Array) -> bool:
    """Whether unknowns z (F,) are less than a standard deviation from a minimum."""
    off = z - end.z
    return bool(off @ end.equations[0] @ off < 1.0)


def _step(now: _State, moving: Mask, damping: float) -> tuple[Array, float]:
    """Damped Gauss-Newton step of z (F,), and the decrease of the cost that it predicts."""
    normal, gradient = now.equations
    normal, gradient = normal[np.ix_(moving, moving)], gradient[moving]
    normal.flat[:: len(normal) + 1] += damping
    step = np.zeros(len(now.z))
    step[moving] = solved(normal, gradient)
    return step, float(gradient @ step[moving])


@dataclass(frozen=True)
class _State:
    z: Array
    theta: Array
    at: Linearized
    weight: Array
    cost: float
    evaluations: int  # so far, with rejected steps
    expected: Array  # (F,), see `Problem.expected`
    spread: float  # standard deviation of the residuals that the loss is made for

    @cached_property
    def equations(self) -> tuple[Array, Array]:
        """Normal matrix (F, F) and gradient (F,), see normal_equations.py."""
        normal, gradient = np.diag(self.expected), -self.expected * self.z
        for own, rows in self.at.jacobian.blocks():
            some = self.at.residual[own], rows, self.weight[own], self.spread
            inner, along = _equations().products(*some)
            normal += inner
            gradient += along
        return normal, gradient


def _state(
    problem: Problem,
    z: Array,
    loss: _Loss,
    guess: Array | None,
    evaluations: int = 0,
    at: Linearized | None = None,
) -> _State:
    theta = problem.theta(z)
    at = problem.linearized(theta, guess) if at is None else at
    even = np.ones(len(at.residual))
    state = _State(z, theta, at, even, np.inf, evaluations + 1, problem.expected, loss.spread)
    return replace(_under(problem, loss, state), evaluations=state.evaluations)


def _under(problem: Problem, loss: _Loss, state: _State) -> _State:
    """The same state with weights and cost under another loss, its evaluations set to 0."""
    weight, explained = loss.judge(state.at.residual)
    cost = explained + float(problem.expected @ state.z**2)
    cost = cost if np.isfinite(cost) else np.inf
    return replace(state, weight=weight, cost=cost, evaluations=0, spread=loss.spread)


def _require_reach(problem: Problem, now: _State, whose: str, hint: str) -> None:
    """Refuse a state that leaves a pose without a prediction."""
    if np.isfinite(now.cost):
        return
    seen = np.isfinite(now.at.pose).all(axis=1) & np.isfinite(now.at.residual).all(axis=1)
    bad = int(np.flatnonzero(~seen)[0])
    joints = ", ".join(f"{v:.4f}" for v in problem.at.joint[bad])
    raise DataError(
        f"pose {bad + 1} of {len(problem.at)} cannot be reached by {whose}: joints "
        f"{joints} {problem.chain.mechanism.joint_unit}; {hint}"
    )


def _solution(problem: Problem, now: _State) -> Solution:
    return Solution(problem, now.theta, now.z, now.at, now.weight, now.cost, now.evaluations)


def _equations() -> Any:
    """The compiled normal equations; numba is loaded with the first use."""
    from delta_calibration.estimation import normal_equations

    return normal_equations
