"""The minimum of a least-squares problem: Levenberg-Marquardt with a robust loss.

    minimise  sum_i rho(|r_i|) / s^2 + sum_prior z_k^2

over the scaled unknowns z, with r_i the whitened residual of pose i, see `problem.py`. s is 1 if
the noise explains the residuals, and else their robust standard deviation: model errors must not
move the parameters beyond what parts can be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from delta_calibration.errors import DataError
from delta_calibration.estimation.positive import solved
from delta_calibration.estimation.problem import Linearized, Near, Problem, equations
from delta_calibration.lazy import cached_property
from delta_calibration.threads import one_thread

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

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

    @property
    def missed(self) -> Array:
        """Measured less predicted if one kind was measured, (n, d) [m, rad]."""
        missed = np.linalg.solve(self.problem.whiten, self.residual[..., None])
        return np.asarray(missed[..., 0])

    @property
    def distances(self) -> Array:
        """3-D distance between measured and predicted positions, (n,) [m]."""
        return np.asarray(np.linalg.norm(self.missed[:, :3], axis=1))

    def near(self, samples: NDArray[np.intp]) -> Near:
        """Start, at this solution, of a fit to some of the samples only."""
        return Near(self.z, self.at.take(samples))


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
        weight, cost = equations().judged(residual, self.bend, self.cut, self.spread)
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
            inner, along = equations().products(*some)
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
