"""Search for steps of parameters between sessions, by Bayes factors.

A step of parameters R in a gap, with all else integrated out, has a vector g and an information S
(`walk.py`). With its size s anywhere within three decades, its Bayes factor against no step is

    ln B = g^T (S + 1/s^2)^-1 g / 2 - ln det(1 + s^2 S) / 2         averaged over s

Constant errors of the machine, known or unknown, do not influence a step: only differences
between sessions count. The prior of a step accounts for the number of causes, locations and gaps
it was chosen from. The search is greedy forward; each step is checked again given the others.

The first search assumes no drift. Then the speed of the drift is learnt given those steps, and
steps that the drift explains as well are removed; then the search is repeated with this drift. If
the drift were learnt first, it would explain a step as drift when there are few sessions.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from delta_calibration.history.walk import Kept, Part, Step, Walk
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_CHANGES = 0.05  # probability of a change in a gap before anything was measured
_SURE = 0.99  # least probability of a step for it to be reported
_SIZES = 5.0 * np.logspace(-3, 0, 7)  # s, in typical sizes
_MOST = 8  # most steps that are searched for
# Least lambda of a reported step, as a share of the strongest one's: the model is linearised about
# a fit, and the linearisation error of a strong step looks like weaker steps.
_LINEAR = 1e-3
_NOTHING = 1e-6  # information at or below this identifies nothing
_KNOWN = 10.0  # factor on the prior of a change of a cause that the machine is known to have
_LIKE = 0.02  # least probability of a rival that is reported


@dataclass(frozen=True)
class FoundSteps:
    """A step in the history, with its probability and its rivals."""

    step: Step
    confidence: float  # probability of cause, location and gap
    happened: float  # probability of any step, against none
    rivals: tuple[tuple[Step, float], ...]  # other causes or gaps, with their probability
    signal: float  # lambda, decrease of chi square


@dataclass(frozen=True)
class Steps:
    """Search for drift and steps that explain a history of sessions."""

    kept: tuple[Kept, ...]
    parts: tuple[Part, ...]
    known: tuple[frozenset[str], ...] = ()  # causes found by diagnoses before each gap; () if none
    days: tuple[float, ...] | None = None  # between sessions; None: no drift is assumed

    @cached_property
    def still(self) -> Walk:
        """Model of a machine that neither drifts nor changes."""
        gaps = len(self.parts) - 1
        days = np.zeros(gaps) if self.days is None else np.array(self.days)
        return Walk(self.kept, self.parts, days)

    @cached_property
    def candidates(self) -> tuple[Step, ...]:
        """All candidate steps: each identifiable group of parameters in each gap."""
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
        """Log prior of each candidate: equal per cause and location, shared by its groups."""
        names = [self.key(step)[:2] for step in self.candidates]
        places = len(set(names))
        gaps = len(self.parts) - 1
        share = np.array([names.count(name) / gaps for name in names])
        known = np.array([self._is_known(step) for step in self.candidates])
        return np.log(_CHANGES / places / share) + np.where(known, np.log(_KNOWN), 0.0)

    def _is_known(self, step: Step) -> bool:
        """Whether a diagnosis of a session before the step's gap found its cause."""
        return bool(self.known) and self.key(step)[0] in self.known[step.gap]

    def key(self, step: Step) -> tuple[str, str | None, int]:
        """Cause, location and gap of a step."""
        kept = self.kept[step.rows[0]]
        return kept.what, kept.location, step.gap

    def search(self) -> tuple[tuple[FoundSteps, ...], Walk]:
        """Find the steps, in the order of their gaps; also returns the model with the drift."""
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
        """Add steps to a model, one by one, as long as they are probable enough."""
        while len(walk.steps) < _MOST:
            best, happened = self._best(walk)
            if happened < _SURE or best in walk.steps:
                break
            walk = self._again(walk.stepped([*walk.steps, best]))
        return walk

    def _again(self, walk: Walk) -> Walk:
        """Search each step but the last again given the others; drop it if they explain it."""
        for step in walk.steps[:-1]:
            rest = _less(walk, step)
            best, happened = self._best(rest)
            gone = happened < _SURE or best in rest.steps
            walk = rest if gone else rest.stepped([best, *rest.steps])
        return walk

    def _weeded(self, walk: Walk) -> Walk:
        """Remove steps that the drift explains as well, the least likely first."""
        while walk.steps:
            odds = [self._odds(_less(walk, step), step.gap) for step in walk.steps]
            weakest = int(np.argmin(odds))
            if odds[weakest] > np.log(_SURE / (1 - _SURE)):
                break
            walk = _less(walk, walk.steps[weakest]).learnt()
        return walk

    def _odds(self, walk: Walk, gap: int) -> float:
        """Log odds of any step in a gap against none."""
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
        """Probability of each further candidate given a model, and of no further step."""
        every = np.append(self._log_bayes(walk) + self._log_prior, 0.0)
        p = np.exp(every - logsumexp(every))
        return p[:-1], float(p[-1])

    def _log_bayes(self, walk: Walk) -> Array:
        """ln B of each candidate given the steps and the drift of a model."""
        r, n = (np.array(each) for each in zip(*walk.back, strict=True))
        found = np.empty(len(self.candidates))
        for numbers, rows, gaps in self._sizes:
            information = n[gaps[:, None, None], rows[:, :, None], rows[:, None, :]]
            found[numbers] = log_bayes(r[gaps[:, None], rows], information)
        return found

    @cached_property
    def _sizes(self) -> list[tuple[Index, Index, Index]]:
        """Candidates by number of parameters: their indices, rows, and first sessions after."""
        found = []
        for numbers, rows in by_size([step.rows for step in self.candidates]):
            found.append((numbers, rows, np.array([self.candidates[i].gap + 1 for i in numbers])))
        return found


def known_before(found: Sequence[Iterable[str]]) -> tuple[frozenset[str], ...]:
    """Causes that the machine is known to have before each gap, (sessions - 1,).

    Diagnoses of the sessions after a gap do not count: they use the same readings as the search
    for its step, so that a prior from them would count these readings twice.

    Args:
        found: causes that the diagnosis of each session found, in order of time.
    """
    known: list[frozenset[str]] = []
    for causes in found[:-1]:
        known.append(frozenset(causes) | (known[-1] if known else frozenset()))
    return tuple(known)


def by_size(groups: Sequence[Sequence[int]]) -> list[tuple[Index, Index]]:
    """Sort groups by size; of each size the indices of its groups (n,) and members (n, size)."""
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
