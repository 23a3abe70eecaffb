"""All laws of a grammar about one fit: how well each explains what is left, and at what price.

The column of a law's value is what it moves times a function of the sample,

    x = m f        m (n, d): whitened d(reading) / d(what is moved),    f (n,): the function

and both factors are shared by many laws. With U = C^-1 A, Q the roots of the paths' shared errors
and g = m . m' the products under V of `linear_model.py` are sums over samples of small things,

    <x, x'> = sum g f f' - (Q^T x) . (Q^T x') - (A^T C^-1 x)^T (A^T C^-1 A + P)^-1 (A^T C^-1 x')

so that each m is multiplied out once, and a law costs as much as its functions.

A law is charged as a cause of the catalogue is (`scores.py`): its values share one size.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.constants import TYPICAL_SHIFT
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import PRECISION, log_bayes_of_each
from delta_calibration.effects.base import Stage, law_of
from delta_calibration.effects.found_law import FoundLaw
from delta_calibration.effects.signals import Signals
from delta_calibration.model.terms import Term, columns, table_of

Array = NDArray[np.float64]

_AT_A_TIME = 32  # laws, whose columns are in memory together
_KEPT = 100e6  # bytes of functions that are in memory together
_NO_COLUMN = 1e-12  # of a displacement, under which it is none

Taken = tuple[tuple[int, ...], tuple[float, ...]]  # signals and constants of a function
Moved = tuple[Stage, tuple[tuple[int, float], ...]]  # what is moved, and how much of each
Column = tuple[Moved, Taken]


@dataclass(frozen=True)
class Case:
    """How well some columns explain what is left."""

    log_bayes: float
    gain: float  # decrease of chi square
    value: Array  # (k,) most likely, in `size`
    size: Array  # (k,) units in which each column moves the reading by `TYPICAL_SHIFT`
    information: Array  # (k, k) in those units


@dataclass
class _Factor:
    """What a column's m makes of the nuisance, the shared errors and what is left."""

    moved: Array  # (n, d)
    nuisance: Array  # (n, A)
    shared: tuple[Array, ...]  # (samples, r) of each block
    left: Array  # (n,)


@dataclass
class Screen:
    """Products of the columns of laws about one evidence.

    Args:
        evidence: of what is left, with all that may always be in its nuisance.
        signals: of its samples.
    """

    evidence: LinearizedModel
    signals: Signals
    _factors: dict[Moved, _Factor] = field(default_factory=dict)
    _functions: dict[Taken, Array] = field(default_factory=dict)
    # of each column x: A^T C^-1 x, and what of it looks like errors that samples share
    _nuisance: dict[Column, Array] = field(default_factory=dict)
    _shared: dict[Column, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """What all laws share."""
        evidence, good = self.evidence, self.evidence.believed
        self._weighed = evidence.weigh(evidence.column)[:, 0].reshape(evidence.residual.shape)
        self._projected = evidence.projected
        self._noise = float(np.sqrt(np.nanmean(evidence.variance[good]) / evidence.axes))
        self._count = int(good.sum())

    def cases(self, laws: Sequence[FoundLaw]) -> list[Case]:
        """Each law's case by itself; those of one wording, whatever moves, one after the other."""
        pairs = [tuple(self.pairs(law)) for law in laws]
        worded: dict[Hashable, list[int]] = {}
        for i, law in enumerate(laws):
            worded.setdefault((law.of, law.function, law.by), []).append(i)
        found: dict[int, Case] = {}
        for rows in worded.values():
            self._evaluate([pair for i in rows for pair in pairs[i]])
            for some in _batches(rows, pairs):
                found.update(zip(some, self._cases([pairs[i] for i in some]), strict=True))
            self._forget()
        return [found[i] for i in range(len(laws))]

    def case(self, laws: Sequence[FoundLaw]) -> Case:
        """That of some laws together."""
        pairs = tuple(pair for law in laws for pair in self.pairs(law))
        self._evaluate(pairs)
        return self._cases([pairs])[0]

    def signal(self, laws: Sequence[FoundLaw], case: Case) -> Array:
        """What they make of the whitened readings at their most likely values, (d n,)."""
        pairs = [pair for law in laws for pair in self.pairs(law)]
        self._evaluate(pairs)
        made = (
            v * self._factor(moved).moved * self._functions[taken][:, None]
            for v, (moved, taken) in zip(case.value * case.size, pairs, strict=True)
        )
        return np.asarray(sum(made)).ravel()

    def pairs(self, law: FoundLaw) -> Iterator[Column]:
        """What each value moves, and its function."""
        for target in law.targets:
            for kind in law.kinds:
                taken = law.factor(self.signals.places, target, kind)
                yield (law.stage, target.rows), taken

    def _cases(self, laws: Sequence[Sequence[Column]]) -> list[Case]:
        """Of laws with as many columns each, (L,) of k."""
        count, k = len(laws), len(laws[0])
        f = np.array([[self._functions[taken] for _, taken in own] for own in laws])
        factors = [[self._factor(moved) for moved, _ in own] for own in laws]
        flat = np.array([[factor.moved for factor in own] for own in factors])
        flat *= f[..., None]
        flat = flat.reshape(count, k, -1)
        direct = flat @ flat.swapaxes(1, 2)
        along = np.array([[self._nuisance[pair] for pair in own] for own in laws])
        common = np.array([[self._shared[pair] for pair in own] for own in laws])
        solved = self.evidence.solved(along.reshape(count * k, -1).T).T.reshape(along.shape)
        information = direct - common @ common.swapaxes(1, 2) - along @ solved.swapaxes(1, 2)
        left = np.array([[factor.left for factor in own] for own in factors])
        left = np.einsum("lkn,lkn->lk", left, f)
        metres = self._noise * np.sqrt(np.diagonal(direct, axis1=1, axis2=2) / self._count)
        size = TYPICAL_SHIFT / np.maximum(metres, _NO_COLUMN)
        information, b = size[:, :, None] * information * size[:, None], size * left
        value = np.linalg.solve(information + PRECISION * np.eye(k), b[..., None])[..., 0]
        worth = log_bayes_of_each(information, b, value).tolist()
        gain = np.maximum(
            0.0, np.sum(value * (2 * b - (information @ value[..., None])[..., 0]), 1)
        )
        return list(map(Case, worth, gain.tolist(), value, size, information))

    def _shared_by(self, factor: _Factor, f: Array) -> Array:
        """(k, r) of functions (k, n)."""
        blocks = zip(self.evidence.rest.samples, factor.shared, strict=True)
        parts = [f[:, rows] @ own for rows, own in blocks]
        return np.concatenate([np.zeros((len(f), 0)), *parts], axis=1)

    def _factor(self, moved: Moved) -> _Factor:
        if moved not in self._factors:
            stage, rows = moved
            slope = self.evidence.by_stage(stage)
            m = np.sum([weight * slope[:, :, row] for row, weight in rows], axis=0)
            self._factors[moved] = _Factor(
                m,
                np.einsum("nc,nca->na", m, self._projected),
                self.evidence.rest.seen_by_sample(m),
                np.einsum("nc,nc->n", m, self._weighed),
            )
        return self._factors[moved]

    def _evaluate(self, pairs: Sequence[Column]) -> None:
        """What is not known yet of some columns: their functions, and these with the nuisance."""
        self._find([taken for _, taken in pairs])
        groups: dict[Moved, list[Taken]] = {}
        for moved, taken in dict.fromkeys(pairs):
            if (moved, taken) not in self._nuisance:
                groups.setdefault(moved, []).append(taken)
        for moved, some in groups.items():
            factor = self._factor(moved)
            f = np.stack([self._functions[taken] for taken in some])
            keys = [(moved, taken) for taken in some]
            self._nuisance.update(zip(keys, f @ factor.nuisance, strict=True))
            self._shared.update(zip(keys, self._shared_by(factor, f), strict=True))

    def _forget(self) -> None:
        """Drop the functions kept so far if they take more memory than `_KEPT`."""
        if len(self._functions) * 8 * len(self.evidence) > _KEPT:
            self._functions.clear()

    def _find(self, taken: Sequence[Taken]) -> None:
        """Functions at all samples, (n,) each, of what is not known yet."""
        new = [key for key in dict.fromkeys(taken) if key not in self._functions]
        if not new:
            return
        law = law_of(FoundLaw.law, f"effect_{FoundLaw.cause}", (3, 1, 8, 1))
        terms = [Term(at, (i,), (0,), (*c, 1.0)) for i, (at, c) in enumerate(new)]
        table, one = table_of([(law, terms, 0)]), np.eye(1)[None]
        values = columns(table, self.signals.rows, np.ones(len(new)), one)[:, 0]
        self._functions.update(zip(new, np.ascontiguousarray(values.T), strict=True))


def _batches(rows: Sequence[int], pairs: Sequence[Sequence[Column]]) -> Iterator[list[int]]:
    """Some of the laws at a time, each time with as many columns."""
    alike: dict[int, list[int]] = {}
    for i in rows:
        alike.setdefault(len(pairs[i]), []).append(i)
    for own in alike.values():
        for begin in range(0, len(own), _AT_A_TIME):
            yield own[begin : begin + _AT_A_TIME]
