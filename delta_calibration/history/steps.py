"""What stepped between which sessions, by evidence, as linear algebra on their information.

Session l sees the machine x_l = x_0 + sum of the steps s_i at gaps before it. All is Gaussian:

    x_0 ~ N(0, P_0),   s_i ~ N(0, s^2),   ln s anywhere in three decades

so that a further step of parameters R at gap k, with all else integrated out, has

    S = H_RR - C^T N^-1 C,   g = b_R - C^T N^-1 b        sums over the sessions behind the gap
    ln B = g^T (S + 1/s^2)^-1 g / 2 - ln det(1 + s^2 S) / 2         averaged over s

against none. What the machine constantly is, whether in the drawing, found by a diagnosis or
neither, is in x_0 and costs a step nothing: differences count. A step pays for the choice among
all causes, places and gaps by its prior. Greedy forward, each step looked at again by the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

Array = NDArray[np.float64]

_CHANGES = 0.05  # probability of a change in a gap before anything was measured
_SURE = 0.99  # that there was one, for it to be told
_SIZES = 5.0 * np.logspace(-3, 0, 7)  # s, in typical sizes
_STEP = 5.0  # standard deviation of a step that is in the model, in typical sizes
_MOST = 8  # steps that are looked for
# Share of the strongest step's lambda from which on another is told: about a fit all is taken for
# linear, and what a step leaves of that looks like weaker ones.
_LINEAR = 1e-3
_NOTHING = 1e-6  # information that tells nothing
_KNOWN = 10.0  # times as likely is a change of what the machine is known to have
_LIKE = 0.02  # probability from which on a rival is told


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
class FoundSteps:
    """A step in the history, and how sure it is."""

    step: Step
    confidence: float  # of cause, place and gap
    happened: float  # that anything changed there at all
    rivals: tuple[tuple[Step, float], ...]  # other causes or gaps, with their probability
    signal: float  # lambda, decrease of chi square


@dataclass(frozen=True)
class Steps:
    """A history of sessions, to be explained by steps."""

    kept: tuple[Kept, ...]
    parts: tuple[Part, ...]
    known: frozenset[str] = frozenset()  # causes that a diagnosis found in the machine

    @cached_property
    def _behind(self) -> Array:
        """Information of all sessions behind each gap, (gaps + 1, q, q); entry 0 is of all."""
        every = np.array([part.information for part in self.parts])
        return np.cumsum(every[::-1], axis=0)[::-1]

    @cached_property
    def _right(self) -> Array:
        every = np.array([part.right for part in self.parts])
        return np.cumsum(every[::-1], axis=0)[::-1]

    @cached_property
    def candidates(self) -> tuple[Step, ...]:
        """All that could have stepped."""
        groups: dict[tuple[str | None, ...], list[int]] = {}
        for row, kept in enumerate(self.kept):
            groups.setdefault(kept.group, []).append(row)
        told = np.diag(self._behind[0]) > _NOTHING
        return tuple(
            Step(tuple(rows), gap)
            for rows in groups.values()
            if told[rows].all()
            for gap in range(len(self.parts) - 1)
        )

    @cached_property
    def _log_prior(self) -> Array:
        """Of each candidate: causes and places alike, and what is of one place shares it."""
        names = [self.key(step)[:2] for step in self.candidates]
        places = len(set(names))
        gaps = len(self.parts) - 1
        share = np.array([names.count(name) / gaps for name in names])
        known = np.array([what in self.known for what, _ in names])
        return np.log(_CHANGES / places / share) + np.where(known, np.log(_KNOWN), 0.0)

    def key(self, step: Step) -> tuple[str, str | None, int]:
        """What is told of a step: cause, place, gap."""
        kept = self.kept[step.rows[0]]
        return kept.what, kept.location, step.gap

    def search(self) -> tuple[FoundSteps, ...]:
        """The steps that happened, in the order of their gaps."""
        steps: list[Step] = []
        while len(steps) < _MOST:
            best, happened = self._best(steps)
            if happened < _SURE or best in steps:
                break
            steps = self._again([*steps, best])
        found = [self._judged(step, [s for s in steps if s is not step]) for step in steps]
        strongest = max((each.signal for each in found), default=0.0)
        told = [each for each in found if each.signal > _LINEAR * strongest]
        return tuple(sorted(told, key=lambda each: each.step.gap))

    def _again(self, steps: list[Step]) -> list[Step]:
        """Each step sought anew beside the others; gone where they explain it."""
        for step in steps[:-1]:
            rest = [s for s in steps if s is not step]
            best, happened = self._best(rest)
            steps = rest if happened < _SURE or best in rest else [best, *rest]
        return steps

    def _best(self, beside: Sequence[Step]) -> tuple[Step, float]:
        posterior, none = self._posterior(beside)
        told = self._told(posterior)
        top = max(told, key=lambda key: told[key])
        rows = [i for i, step in enumerate(self.candidates) if self.key(step) == top]
        return self.candidates[max(rows, key=lambda i: posterior[i])], 1.0 - none

    def _told(self, posterior: Array) -> dict[tuple[str, str | None, int], float]:
        told: dict[tuple[str, str | None, int], float] = {}
        for step, p in zip(self.candidates, posterior.tolist(), strict=True):
            told[self.key(step)] = told.get(self.key(step), 0.0) + p
        return told

    def _judged(self, step: Step, beside: Sequence[Step]) -> FoundSteps:
        posterior, none = self._posterior(beside)
        told, own = self._told(posterior), self.key(step)
        rivals = sorted(((p, key) for key, p in told.items() if key != own and p > _LIKE), key=str)
        first = {self.key(s): s for s in reversed(self.candidates)}
        return FoundSteps(
            step,
            told[own],
            1.0 - none,
            tuple((first[key], p) for p, key in sorted(rivals, key=lambda r: -r[0])),
            self._signal(step, beside),
        )

    def _posterior(self, beside: Sequence[Step]) -> tuple[Array, float]:
        """Probability of each candidate beside steps that are known, and of none."""
        normal, right = self._normal(beside)
        factor = cho_factor(normal)
        m = cho_solve(factor, right)
        log_b = np.array([self._log_bayes(s, beside, factor, m) for s in self.candidates])
        every = np.append(log_b + self._log_prior, 0.0)
        p = np.exp(every - logsumexp(every))
        return p[:-1], float(p[-1])

    def _normal(
        self, steps: Sequence[Step], only: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array]:
        """Normal matrix and right side of x_0 and these steps.

        Args:
            steps: that are in the model.
            only: which of x_0 are not held at nothing, (q,); all where not given.
        """
        spread = np.array([k.spread for k in self.kept])
        if only is not None:
            spread = np.where(only, spread, 1e-6)
        blocks = [(tuple(range(len(spread))), 0), *((s.rows, s.gap + 1) for s in steps)]
        normal = np.block(
            [
                [self._behind[max(i, j)][np.ix_(rows, cols)] for cols, j in blocks]
                for rows, i in blocks
            ]
        )
        stepped = [_STEP] * sum(len(s.rows) for s in steps)
        right = np.concatenate([self._right[i][list(rows)] for rows, i in blocks])
        return normal + np.diag(np.concatenate([spread, stepped]) ** -2.0), right

    def _alone(
        self, step: Step, beside: Sequence[Step], factor: tuple[Array, bool], m: Array
    ) -> tuple[Array, Array]:
        """S and g of a further step."""
        rows, at = list(step.rows), step.gap + 1
        blocks = [self._behind[at][:, rows]]
        blocks += [self._behind[max(at, s.gap + 1)][np.ix_(s.rows, rows)] for s in beside]
        across = np.concatenate(blocks)
        own = self._behind[at][np.ix_(rows, rows)] - across.T @ cho_solve(factor, across)
        return own, self._right[at][rows] - across.T @ m

    def _log_bayes(
        self, step: Step, beside: Sequence[Step], factor: tuple[Array, bool], m: Array
    ) -> float:
        own, g = self._alone(step, beside, factor, m)
        values, axes = np.linalg.eigh(own)
        values, along = np.clip(values, 0.0, None)[:, None], (axes.T @ g)[:, None] ** 2
        each = along / (values + _SIZES**-2.0) - np.log1p(values * _SIZES**2)
        return float(logsumexp(each.sum(axis=0) / 2) - np.log(len(_SIZES)))

    def told(self, step: Step, beside: Sequence[Step]) -> Array:
        """S, information on a step beside steps that are known, (r, r)."""
        normal, right = self._normal(beside)
        factor = cho_factor(normal)
        return self._alone(step, beside, factor, cho_solve(factor, right))[0]

    def _signal(self, step: Step, beside: Sequence[Step]) -> float:
        normal, right = self._normal(beside)
        factor = cho_factor(normal)
        own, g = self._alone(step, beside, factor, cho_solve(factor, right))
        return float(g @ np.linalg.pinv(own, hermitian=True) @ g)

    def values(self, steps: Sequence[Step], only: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Most likely x_0 and steps, one behind the other, and their covariance.

        Args:
            steps: that are in the model.
            only: which of x_0 are not held at nothing, (q,).
        """
        normal, right = self._normal(steps, only)
        covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        return np.asarray(covariance @ right), np.asarray(covariance)
