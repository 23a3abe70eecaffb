"""What stepped between which sessions, by evidence.

A step of parameters R in a gap, with all else integrated out, has a vector g and an information S
(`walk.py`) and, its size s anywhere in three decades, the Bayes factor

    ln B = g^T (S + 1/s^2)^-1 g / 2 - ln det(1 + s^2 S) / 2         averaged over s

against none. What the machine constantly is, whether in the drawing, found by a diagnosis or
neither, costs a step nothing: differences count. A step pays for the choice among all causes,
places and gaps by its prior. Greedy forward, each step looked at again by the others.

First as if nothing drifted; then it is learnt how fast the machine drifts beside those steps, and
what the drift does as well is no step; then beside the drift. A drift that was learnt first would
take a step for its own where there are few sessions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from delta_calibration.history.walk import Kept, Part, Step, Walk

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_CHANGES = 0.05  # probability of a change in a gap before anything was measured
_SURE = 0.99  # that there was one, for it to be told
_SIZES = 5.0 * np.logspace(-3, 0, 7)  # s, in typical sizes
_MOST = 8  # steps that are looked for
# Share of the strongest step's lambda from which on another is told: about a fit all is taken for
# linear, and what a step leaves of that looks like weaker ones.
_LINEAR = 1e-3
_NOTHING = 1e-6  # information that tells nothing
_KNOWN = 10.0  # times as likely is a change of what the machine is known to have
_LIKE = 0.02  # probability from which on a rival is told


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
    """A history of sessions, to be explained by drift and steps."""

    kept: tuple[Kept, ...]
    parts: tuple[Part, ...]
    known: frozenset[str] = frozenset()  # causes that a diagnosis found in the machine
    days: tuple[float, ...] | None = None  # between sessions; None: nothing is taken to drift

    @cached_property
    def still(self) -> Walk:
        """The sessions of a machine that neither drifts nor changes."""
        gaps = len(self.parts) - 1
        days = np.zeros(gaps) if self.days is None else np.array(self.days)
        return Walk(self.kept, self.parts, days)

    @cached_property
    def candidates(self) -> tuple[Step, ...]:
        """All that could have stepped."""
        groups: dict[tuple[str | None, ...], list[int]] = {}
        for row, kept in enumerate(self.kept):
            groups.setdefault(kept.group, []).append(row)
        told = np.sum([np.diag(part.information) for part in self.parts], axis=0) > _NOTHING
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

    def search(self) -> tuple[tuple[FoundSteps, ...], Walk]:
        """The steps that happened, in the order of their gaps, and the drift beside them."""
        if not self.candidates:
            return (), self.still if self.days is None else self.still.learnt()
        walk = self._forward(self.still)
        if self.days is not None:
            walk = self._weeded(walk.learnt())
            walk = self._weeded(self._forward(walk).learnt())
        found = [self._judged(step, _less(walk, step)) for step in walk.steps]
        strongest = max((each.signal for each in found), default=0.0)
        told = [each for each in found if each.signal > _LINEAR * strongest]
        return tuple(sorted(told, key=lambda each: each.step.gap)), walk

    def _forward(self, walk: Walk) -> Walk:
        """With all steps that are sure beside the others."""
        while len(walk.steps) < _MOST:
            best, happened = self._best(walk)
            if happened < _SURE or best in walk.steps:
                break
            walk = self._again(walk.stepped([*walk.steps, best]))
        return walk

    def _again(self, walk: Walk) -> Walk:
        """Each step but the last sought anew beside the others; gone where they explain it."""
        for step in walk.steps[:-1]:
            rest = _less(walk, step)
            best, happened = self._best(rest)
            gone = happened < _SURE or best in rest.steps
            walk = rest if gone else rest.stepped([best, *rest.steps])
        return walk

    def _weeded(self, walk: Walk) -> Walk:
        """Without steps that the drift does as well, the least likely first."""
        while walk.steps:
            odds = [self._odds(_less(walk, step), step.gap) for step in walk.steps]
            weakest = int(np.argmin(odds))
            if odds[weakest] > np.log(_SURE / (1 - _SURE)):
                break
            walk = _less(walk, walk.steps[weakest]).learnt()
        return walk

    def _odds(self, walk: Walk, gap: int) -> float:
        """ln of how much likelier a step in a gap is than none."""
        here = np.array([step.gap == gap for step in self.candidates])
        return float(logsumexp((self._log_bayes(walk) + self._log_prior)[here]))

    def _best(self, walk: Walk) -> tuple[Step, float]:
        posterior, none = self._posterior(walk)
        told = self._told(posterior)
        top = max(told, key=lambda key: told[key])
        rows = [i for i, step in enumerate(self.candidates) if self.key(step) == top]
        return self.candidates[max(rows, key=lambda i: posterior[i])], 1.0 - none

    def _told(self, posterior: Array) -> dict[tuple[str, str | None, int], float]:
        told: dict[tuple[str, str | None, int], float] = {}
        for step, p in zip(self.candidates, posterior.tolist(), strict=True):
            told[self.key(step)] = told.get(self.key(step), 0.0) + p
        return told

    def _judged(self, step: Step, walk: Walk) -> FoundSteps:
        posterior, none = self._posterior(walk)
        told, own = self._told(posterior), self.key(step)
        rivals = sorted(((p, key) for key, p in told.items() if key != own and p > _LIKE), key=str)
        first = {self.key(s): s for s in reversed(self.candidates)}
        g, information = walk.shift(step)
        return FoundSteps(
            step,
            told[own],
            1.0 - none,
            tuple((first[key], p) for p, key in sorted(rivals, key=lambda r: -r[0])),
            float(g @ np.linalg.pinv(information, hermitian=True) @ g),
        )

    def _posterior(self, walk: Walk) -> tuple[Array, float]:
        """Probability of each candidate beside steps and drift that are known, and of none."""
        every = np.append(self._log_bayes(walk) + self._log_prior, 0.0)
        p = np.exp(every - logsumexp(every))
        return p[:-1], float(p[-1])

    def _log_bayes(self, walk: Walk) -> Array:
        """ln B of each candidate beside what is known."""
        r, n = (np.array(each) for each in zip(*walk.back, strict=True))
        found = np.empty(len(self.candidates))
        for numbers, rows, gaps in self._sizes:
            information = n[gaps[:, None, None], rows[:, :, None], rows[:, None, :]]
            found[numbers] = log_bayes(r[gaps[:, None], rows], information)
        return found

    @cached_property
    def _sizes(self) -> list[tuple[Index, Index, Index]]:
        """Candidates that step by as many numbers: which, their rows and sessions behind them."""
        found = []
        for numbers, rows in by_size([step.rows for step in self.candidates]):
            found.append((numbers, rows, np.array([self.candidates[i].gap + 1 for i in numbers])))
        return found


def by_size(groups: Sequence[Sequence[int]]) -> list[tuple[Index, Index]]:
    """Groups of numbers by how many they are: which groups, and their numbers (n, size)."""
    sizes = np.array([len(group) for group in groups])
    found = []
    for size in np.unique(sizes):
        here = np.flatnonzero(sizes == size)
        found.append((here, np.array([groups[int(i)] for i in here])))
    return found


def _less(walk: Walk, step: Step) -> Walk:
    return walk.stepped(other for other in walk.steps if other is not step)


def log_bayes(g: Array, information: Array) -> Array:
    """ln B of steps with vectors g (n, r) and information (n, r, r), (n,)."""
    values, axes = np.linalg.eigh(information)
    values = np.clip(values, 0.0, None)[..., None]
    along = (np.swapaxes(axes, 1, 2) @ g[..., None]) ** 2
    each = along / (values + _SIZES**-2.0) - np.log1p(values * _SIZES**2)
    return np.asarray(logsumexp(each.sum(axis=1) / 2, axis=1) - np.log(len(_SIZES)))
