"""A machine from session to session: it drifts, and now and then something steps.

    x_k+1 = x_k + w_k,   w_k ~ N(0, Q_k),   Q_k = s_c^2 dt_k for every number of class c
    session k says b_k = H_k x_k + noise of covariance H_k                 (`pooled.py`)

x in typical sizes, dt in days; a class is a cause by its fixed name (all arm lengths, all zeros).
Where something stepped in a gap, Q_k of it is as large as a step may be: what was known of it
before is forgotten, and the step says nothing about how fast the machine drifts.

Forward by a Kalman filter, in terms of information,

    P+ = P (1 + H P)^-1,   x+ = x + P+ (b - H x)
    2 ln L = sum of (b - H x)^T P+ (b - H x) + 2 b^T x - x^T H x - ln det(1 + P H)

and back by the smoother of its disturbances (de Jong 1989, JASA 84, 1085-1088),

    r- = (1 + H P)^-1 (b - H x + r),   N- = (1 + H P)^-1 (H + N (1 + P H)^-1)

A further shift of some numbers in a gap has the information N and the vector r of that gap, all
else integrated out (de Jong and Penzer 1998, JASA 93, 796-806); and (r r^T - N) / 2 is the slope
of ln L by Q (Koopman and Shephard 1992, Biometrika 79, 823-826), from which s_c are learnt.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIMENSION = 1.0  # spread of a dimension, in typical sizes; effects have a wider one
_STEP = 5.0  # standard deviation of a step that is known, in typical sizes
# s is expected around this, within a factor of e^2 or so: a twentieth of a typical size a month
_USUAL, _LOG_SPREAD = 0.01, 2.0
_LEAST, _MOST = 1e-4, 3.0  # [typical sizes / sqrt(day)]
_CLEAR = 6.0  # of ln L, by which a drift is likelier than none for it to be told
_SHORT = 1.0 / 24  # [days] sessions closer than that are taken for as far apart


@dataclass(frozen=True)
class Kept:
    """A number that a machine keeps from session to session unless it changes."""

    name: str
    what: str  # cause, by the fixed names
    location: str | None
    unit: str
    nominal: float
    scale: float  # its typical size
    spread: float  # standard deviation of what it constantly is, in typical sizes
    group: tuple[str | None, ...]  # numbers of one group step together


@dataclass(frozen=True)
class Part:
    """What a session says of x in typical sizes, all of its own integrated out."""

    name: str
    information: Array  # (q, q)
    right: Array  # (q,)
    misfit: float = 1.0  # by which it was believed less


@dataclass(frozen=True)
class Step:
    """A change of some numbers in the gap behind session `gap` (0 is the first)."""

    rows: tuple[int, ...]
    gap: int


@dataclass(frozen=True)
class State:
    """What is known of the machine's numbers in typical sizes."""

    value: Array  # (q,)
    covariance: Array  # (q, q)

    def told(self, part: Part) -> State:
        """The same with what a session says."""
        after = self.covariance @ np.linalg.inv(_one_and(part.information @ self.covariance))
        after = (after + after.T) / 2
        return State(self.value + after @ (part.right - part.information @ self.value), after)

    def wider(self, variance: Array) -> State:
        """The same with more that may have changed since, (q,)."""
        return State(self.value, self.covariance + np.diag(variance))

    def log_likelihood(self, part: Part) -> float:
        """Of a session that is not known yet, but for a constant of the session's own."""
        b, x = part.right, self.value
        u = b - part.information @ x
        gain = u @ self.told(part).covariance @ u
        size = np.linalg.slogdet(_one_and(part.information @ self.covariance))[1]
        return float(gain + 2 * b @ x - x @ part.information @ x - size) / 2

    def surprise(self, part: Part) -> tuple[float, int]:
        """Chi square of a session that is not known yet, and its degrees of freedom."""
        values, axes = np.linalg.eigh(part.information)
        told = values > _NOTHING * values.max(initial=0.0)
        root = np.sqrt(values[told])
        rows = root[:, None] * axes[:, told].T
        off = axes[:, told].T @ part.right / root - rows @ self.value
        spread = _one_and(rows @ self.covariance @ rows.T)
        return float(off @ np.linalg.solve(spread, off)), len(root)


_NOTHING = 1e-9  # of the largest information


@dataclass(frozen=True)
class Walk:
    """Sessions of a machine, how fast its numbers drift, and what stepped."""

    kept: tuple[Kept, ...]
    parts: tuple[Part, ...]
    days: Array  # (gaps,) between two sessions that follow each other
    steps: tuple[Step, ...] = ()
    speed: tuple[tuple[str, float], ...] = ()  # of each class that is known to drift

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """Causes by their fixed names, in the order of the numbers."""
        return tuple(dict.fromkeys(k.what for k in self.kept))

    def stepped(self, steps: Iterable[Step]) -> Walk:
        """The same with these steps instead."""
        return replace(self, steps=tuple(steps))

    def only(self, here: NDArray[np.bool_]) -> Walk:
        """The same of some of the numbers (q,), the others taken for nothing."""
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
        """What those before say of the machine in each session, (sessions,)."""
        spread = np.array([k.spread for k in self.kept])
        states = [State(np.zeros(len(spread)), np.diag(spread**2))]
        for gap, part in enumerate(self.parts[:-1]):
            states.append(states[-1].told(part).wider(self.moved(gap)))
        return tuple(states)

    def moved(self, gap: int) -> Array:
        """Q of a gap, its diagonal, (q,)."""
        added = self.drifted(float(self.days[gap]))
        for step in self.steps:
            if step.gap == gap:
                added[list(step.rows)] += _STEP**2
        return added

    def drifted(self, days: float) -> Array:
        """Variance of the drift in so many days, (q,)."""
        speed = dict(self.speed)
        each = np.array([speed.get(k.what, 0.0) for k in self.kept])
        return np.asarray(each**2 * max(days, _SHORT))

    def later(self, days: float) -> State:
        """What is known so many days behind the last session."""
        return self.expected[-1].told(self.parts[-1]).wider(self.drifted(days))

    @cached_property
    def back(self) -> tuple[tuple[Array, Array], ...]:
        """r and N of what comes with each session and behind it, (sessions,)."""
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
        """What the sessions say of a further step: its vector (r,) and information (r, r)."""
        r, n = self.back[step.gap + 1]
        return r[list(step.rows)], n[np.ix_(step.rows, step.rows)]

    def smoothed(self, session: int) -> State:
        """What all sessions say of the machine in one of them."""
        state, (r, n) = self.expected[session], self.back[session]
        p = state.covariance
        return State(state.value + p @ r, p - p @ n @ p)

    def change(self, gap: int) -> State:
        """What all sessions say of what changed in a gap."""
        q, (r, n) = np.diag(self.moved(gap)), self.back[gap + 1]
        return State(q @ r, q - q @ n @ q)

    def learnt(self) -> Walk:
        """The same with the most likely speeds."""
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
        """Speeds of those classes that the sessions clearly show to drift."""
        value, _ = self._score()
        found = []
        for name, speed in self.speed:
            others = tuple((n, _LEAST if n == name else s) for n, s in self.speed)
            if value - replace(self, speed=others)._score()[0] > _CLEAR:
                found.append((name, speed))
        return tuple(found)

    def _score(self) -> tuple[float, Array]:
        """ln L, and how it goes with ln s of every class."""
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
