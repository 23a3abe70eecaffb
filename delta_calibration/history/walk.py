"""Random-walk model of a machine over its sessions: slow drift, and occasional steps.

    x_k+1 = x_k + w_k,   w_k ~ N(0, Q_k),   Q_k = s_c^2 dt_k for every parameter of class c
    session k observes b_k = H_k x_k + noise of covariance H_k             (`pooled.py`)

x is in typical sizes, dt in days; a class is a cause by its fixed name (all arm lengths, all
zeros). For a parameter that stepped in a gap, Q_k is as large as a step may be: its earlier
estimate is discarded, and the step does not influence the speed of the drift.

The forward pass is a Kalman filter in terms of information,

    P+ = P (1 + H P)^-1,   x+ = x + P+ (b - H x)
    2 ln L = sum of (b - H x)^T P+ (b - H x) + 2 b^T x - x^T H x - ln det(1 + P H)

and the backward pass is the disturbance smoother (de Jong 1989, JASA 84, 1085-1088),

    r- = (1 + H P)^-1 (b - H x + r),   N- = (1 + H P)^-1 (H + N (1 + P H)^-1)

A further shift of some parameters in a gap has the information N and the vector r of that gap, all
else integrated out (de Jong and Penzer 1998, JASA 93, 796-806). The gradient of ln L with respect
to Q is (r r^T - N) / 2 (Koopman and Shephard 1992, Biometrika 79, 823-826); s_c are learnt by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]

DIMENSION = 1.0  # prior spread of a dimension, in typical sizes; effects have a wider one
_STEP = 5.0  # standard deviation of a step that was found, in typical sizes
# log-normal prior of s: about a twentieth of a typical size a month, within a factor of e^2 or so
_USUAL, _LOG_SPREAD = 0.01, 2.0
_LEAST, _MOST = 1e-4, 3.0  # [typical sizes / sqrt(day)]
_CLEAR = 6.0  # least gain in ln L of a drift for it to be reported
_SHORT = 1.0 / 24  # [days] least gap between sessions that the drift is computed for


@dataclass(frozen=True)
class Kept:
    """A parameter of the machine that stays the same from session to session unless it changes."""

    name: str
    what: str  # fixed name of the cause
    location: str | None
    unit: str
    nominal: float
    scale: float  # its typical size
    spread: float  # prior standard deviation of its constant value, in typical sizes
    group: tuple[str | None, ...]  # parameters of one group step together


@dataclass(frozen=True)
class Part:
    """Evidence of a session about x in typical sizes, its nuisance parameters integrated out."""

    name: str
    information: Array  # (q, q) H
    right: Array  # (q,) b
    misfit: float = 1.0  # factor that H and b were divided by


@dataclass(frozen=True)
class Step:
    """A change of some parameters in the gap after session `gap` (0 is the first)."""

    rows: tuple[int, ...]
    gap: int


@dataclass(frozen=True)
class State:
    """Mean and covariance of the machine's parameters, in typical sizes."""

    value: Array  # (q,)
    covariance: Array  # (q, q)

    def told(self, part: Part) -> State:
        """The state after an update with a session (Kalman filter)."""
        after = self.covariance @ np.linalg.inv(_one_and(part.information @ self.covariance))
        after = (after + after.T) / 2
        return State(self.value + after @ (part.right - part.information @ self.value), after)

    def wider(self, variance: Array) -> State:
        """The state with additional variance (q,) of drift or steps."""
        return State(self.value, self.covariance + np.diag(variance))

    def log_likelihood(self, part: Part) -> float:
        """ln L of a session that is not in the state yet, up to a constant of that session."""
        b, x = part.right, self.value
        u = b - part.information @ x
        gain = u @ self.told(part).covariance @ u
        size = np.linalg.slogdet(_one_and(part.information @ self.covariance))[1]
        return float(gain + 2 * b @ x - x @ part.information @ x - size) / 2

    def surprise(self, part: Part) -> tuple[float, int]:
        """Chi square of a session that is not in the state yet, and its degrees of freedom."""
        values, axes = np.linalg.eigh(part.information)
        told = values > _NOTHING * values.max(initial=0.0)
        root = np.sqrt(values[told])
        rows = root[:, None] * axes[:, told].T
        off = axes[:, told].T @ part.right / root - rows @ self.value
        spread = _one_and(rows @ self.covariance @ rows.T)
        return float(off @ np.linalg.solve(spread, off)), len(root)


_NOTHING = 1e-9  # share of the largest eigenvalue of the information that counts as zero


@dataclass(frozen=True)
class Walk:
    """Model of a machine over its sessions, with given drift speeds and steps."""

    kept: tuple[Kept, ...]
    parts: tuple[Part, ...]
    days: Array  # (gaps,) between consecutive sessions
    steps: tuple[Step, ...] = ()
    speed: tuple[tuple[str, float], ...] = ()  # s of each class that drifts

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """Fixed names of the causes, in the order of the parameters."""
        return tuple(dict.fromkeys(k.what for k in self.kept))

    def stepped(self, steps: Iterable[Step]) -> Walk:
        """The model with these steps in place of its own."""
        return replace(self, steps=tuple(steps))

    def only(self, here: NDArray[np.bool_]) -> Walk:
        """The model with the parameters of a mask (q,) only; the others are set to 0."""
        rows = np.flatnonzero(here)
        place = {int(row): number for number, row in enumerate(rows)}
        steps = (
            Step(tuple(place[row] for row in step.rows if row in place), step.gap)
            for step in self.steps
        )
        parts = (
            replace(p, information=p.information[np.ix_(rows, rows)], right=p.right[rows])
            for p in self.parts
        )
        return replace(
            self,
            kept=tuple(self.kept[row] for row in rows),
            parts=tuple(parts),
            steps=tuple(step for step in steps if step.rows),
        )

    @cached_property
    def expected(self) -> tuple[State, ...]:
        """Predicted state in each session, from the sessions before it, (sessions,)."""
        spread = np.array([k.spread for k in self.kept])
        states = [State(np.zeros(len(spread)), np.diag(spread**2))]
        for gap, part in enumerate(self.parts[:-1]):
            states.append(states[-1].told(part).wider(self.moved(gap)))
        return tuple(states)

    def moved(self, gap: int) -> Array:
        """Diagonal of Q of a gap, (q,)."""
        added = self.drifted(float(self.days[gap]))
        for step in self.steps:
            if step.gap == gap:
                added[list(step.rows)] += _STEP**2
        return added

    def drifted(self, days: float) -> Array:
        """Variance of the drift over a number of days, (q,)."""
        speed = dict(self.speed)
        each = np.array([speed.get(k.what, 0.0) for k in self.kept])
        return np.asarray(each**2 * max(days, _SHORT))

    def later(self, days: float) -> State:
        """Predicted state a number of days after the last session."""
        return self.expected[-1].told(self.parts[-1]).wider(self.drifted(days))

    @cached_property
    def back(self) -> tuple[tuple[Array, Array], ...]:
        """r and N of the smoother, from each session and all after it, (sessions,)."""
        size = len(self.kept)
        r, n, found = np.zeros(size), np.zeros((size, size)), []
        for state, part in zip(reversed(self.expected), reversed(self.parts), strict=True):
            inverse = np.linalg.inv(_one_and(part.information @ state.covariance))
            r = inverse @ (part.right - part.information @ state.value + r)
            n = inverse @ (part.information + n @ inverse.T)
            n = (n + n.T) / 2
            found.append((r, n))
        return tuple(reversed(found))

    def shift(self, step: Step) -> tuple[Array, Array]:
        """Evidence of all sessions about a further step: vector (r,) and information (r, r)."""
        r, n = self.back[step.gap + 1]
        return r[list(step.rows)], n[np.ix_(step.rows, step.rows)]

    def smoothed(self, session: int) -> State:
        """State in one session, estimated from all sessions."""
        state, (r, n) = self.expected[session], self.back[session]
        p = state.covariance
        return State(state.value + p @ r, p - p @ n @ p)

    def change(self, gap: int) -> State:
        """Change of the parameters in a gap, estimated from all sessions."""
        q, (r, n) = np.diag(self.moved(gap)), self.back[gap + 1]
        return State(q @ r, q - q @ n @ q)

    def learnt(self) -> Walk:
        """The model with the drift speeds of the highest posterior density."""
        from scipy.optimize import minimize  # slow to load

        classes, usual = self.classes, np.log(_USUAL)
        known = dict(self.speed)

        def unlikely(log_speed: Array) -> tuple[float, Array]:
            speed = tuple(zip(classes, np.exp(log_speed).tolist(), strict=True))
            value, slope = replace(self, speed=speed)._score()
            off = (log_speed - usual) / _LOG_SPREAD
            return -(value - float(off @ off) / 2), -(slope - off / _LOG_SPREAD)

        bounds = [(np.log(_LEAST), np.log(_MOST))] * len(classes)
        start = np.log([known.get(name, _USUAL) for name in classes])
        found = minimize(unlikely, start, jac=True, method="L-BFGS-B", bounds=bounds)
        return replace(self, speed=tuple(zip(classes, np.exp(found.x).tolist(), strict=True)))

    def clear(self) -> tuple[tuple[str, float], ...]:
        """Speeds of the classes whose drift is significant."""
        value, _ = self._score()
        found = []
        for name, speed in self.speed:
            others = tuple((n, _LEAST if n == name else s) for n, s in self.speed)
            if value - replace(self, speed=others)._score()[0] > _CLEAR:
                found.append((name, speed))
        return tuple(found)

    def _score(self) -> tuple[float, Array]:
        """ln L, and its gradient with respect to ln s of every class."""
        each = zip(self.expected, self.parts, strict=True)
        value = sum(state.log_likelihood(part) for state, part in each)
        slope = dict.fromkeys(self.classes, 0.0)
        for days, (r, n) in zip(self.days, self.back[1:], strict=True):
            own = (r**2 - np.diag(n)) * self.drifted(float(days))
            for kept, more in zip(self.kept, own.tolist(), strict=True):
                slope[kept.what] += more
        return value, np.array(list(slope.values()))


def days_between(began: Sequence[float]) -> Array:
    """Days between sessions that began at these times [s], (sessions - 1,)."""
    return np.diff(np.asarray(began, dtype=np.float64)) / 86400.0


def _one_and(matrix: Array) -> Array:
    return np.asarray(np.eye(len(matrix)) + matrix)
