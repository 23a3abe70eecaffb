"""Scores of candidate explanations: decrease of chi square, F test and Bayes factor.

Two questions need two answers. Whether there is an effect at all: the F test of the candidate's
parameters, corrected for everything that was tried. Which effect it is: the Bayes factor against
no effect, in which an explanation pays for every parameter by the range of data that it could
have explained.

    D = 2 b v - v G v                   decrease of chi square at v, G = <X, X>, b = <X, r>
    D / a ~ chi^2 of d degrees          by chance; a d = sum u, a^2 d = sum u^2 (Satterthwaite),
                                        u = 1 - L^2 / (g + L)^2, g the eigenvalues of G
    ln B = b' (G + L)^-1 b / 2 - ln det(1 + G / L) / 2        v ~ N(0, 1/L)

A cause has an unknown size that its parameters share: L = 1/s^2 with ln s uniform over three
decades, integrated by Laplace's method about the s of the largest likelihood. If three joints lag
by similar amounts, the cause pays for one size, not for three independent values.

A candidate whose shape was searched pays for the search as well: a parametric bootstrap of the
largest D over all shapes gives the number of independent tries, and both p and ln B are corrected
by it. A map pays in ln B for all sizes and widths that it could have had; in the F test these are
counted one by one. If a cause is some factor likelier than the average cause, according to
machines of the same type, its number of tries is divided by that factor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import log, pi

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf

from delta_calibration.diagnosis.candidates import (
    Candidate,
    all_columns,
    bounds_of,
    typical_of,
)
from delta_calibration.diagnosis.constants import DECADES, EULER, PLAINLY
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.shapes import Shapes
from delta_calibration.diagnosis.tails import log_chi2, log_f
from delta_calibration.effects import SPREAD
from delta_calibration.estimation.positive import solved
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]

PRECISION = 1 / SPREAD**2  # of a parameter in units of its typical size

Weights = tuple[tuple[str, float], ...]  # causes, and how much likelier each is than the average
_RANK = 1e-9  # share of the largest eigenvalue under which a direction counts as zero


@dataclass(frozen=True)
class Chance:
    """Distribution of D by chance: `unit` times a chi square of `degrees`."""

    unit: float
    degrees: float

    @classmethod
    def of(cls, information: Array) -> Chance:
        """Distribution for columns with this information, (k, k), and priors on their values."""
        held = PRECISION / (np.clip(np.linalg.eigvalsh(information), 0.0, None) + PRECISION)
        free = 1 - held**2
        total, square = float(free.sum()), float(np.sum(free**2))
        return cls(square / total, total**2 / square) if total > 0 else cls(1.0, 1.0)

    @property
    def mean(self) -> float:
        """Decrease of chi square by chance, on average."""
        return self.unit * self.degrees

    def log_p(self, gain: float, noise_degrees: float) -> float:
        """ln p of a decrease of chi square at least this large."""
        return log_p_of(gain / self.unit, self.degrees, noise_degrees)


@dataclass(frozen=True)
class Score:
    """Score of a candidate: its most likely values, D, ln B and price of the search."""

    candidate: Candidate
    value: Array  # (k,) most likely, in units of the priors
    information: Array  # (k, k) in `units`; all sizes of a map share it
    units: Array  # (k,) of the priors
    gain: float  # D
    log_bayes: float  # ln B, less the price of the search
    tries_of: tuple[float, float]  # of the search for a plain shape, and for one with fields
    noise_degrees: float  # degrees of freedom of the noise estimate

    @property
    def tries(self) -> float:
        """Independent tries of the search for a shape of this kind; 1 if nothing was searched."""
        return self.tries_of[not self.candidate.plain]

    @cached_property
    def log_p(self) -> float:
        """ln of the F test's p value times the tries of the search, at most 0.

        It is computed on demand: most candidates do not need it, and for a map it is slow.
        """
        information = _scaled(self.information, self.units)
        log_p = Chance.of(information).log_p(self.gain, self.noise_degrees)
        return min(0.0, log_p + float(np.log(self.tries)))

    @property
    def degrees(self) -> int:
        """Number of the candidate's parameters."""
        return len(self.value)


@dataclass(frozen=True)
class _Best:
    """The best shape so far, and the largest D of any shape in each draw of noise."""

    gain: float
    candidate: Candidate
    value: Array  # (k,)
    information: Array  # (k, k) in `units`
    units: Array  # (k,) of the priors
    b: Array  # (k,)
    chance: Array  # (draws,)
    shapes: int

    def or_better(self, other: _Best) -> _Best:
        """The better of both, with the draws and the number of shapes of both."""
        better = other if other.gain > self.gain else self
        chance = np.maximum(self.chance, other.chance)
        return replace(better, chance=chance, shapes=self.shapes + other.shapes)


@dataclass(frozen=True)
class Weighed:
    """The residuals of an evidence and draws of noise, ready to score many candidates."""

    evidence: LinearizedModel
    weighed: Array  # (d n, 1 + draws): V^-1 of the residuals, then of each draw
    noise_degrees: float  # degrees of freedom of the noise estimate
    every: Shapes  # the same, for explanations of several shapes
    weights: Weights = ()

    @classmethod
    def of(
        cls, evidence: LinearizedModel, noise_degrees: float, draws: int, rng: np.random.Generator
    ) -> Weighed:
        """Draw noise, and multiply residuals and draws by V^-1."""
        both = np.concatenate([evidence.column, evidence.draw(draws, rng)], axis=1)
        weighed = evidence.weigh(both)
        return cls(evidence, weighed, noise_degrees, Shapes(evidence, weighed))

    def explore(self, shapes: Sequence[Sequence[Candidate]]) -> list[Score]:
        """The best shape of each explanation, charged for the search.

        Args:
            shapes: for each shape the candidates that share its columns except for units: the
                whole effect first, then parts of it.
        """
        best: dict[tuple[int, bool], _Best] = {}
        for groups, information, b in self._products(shapes):
            whole = groups[0][0]
            for i, same in enumerate(zip(*groups, strict=True)):
                rows = np.searchsorted(whole.rows, same[0].rows)
                own, along = information, b
                if len(rows) < len(whole.rows):
                    own, along = information[:, rows[:, None], rows], b[:, rows]
                units = np.ones(len(rows))
                if same[0].effect is not whole.effect:
                    units = typical_of(same[0]) / typical_of(whole)[rows]
                for kind, of_kind in _by_kind(same):
                    some = [same[k] for k in np.arange(len(same))[of_kind]]
                    here = _best_of(some, own[of_kind], along[of_kind], units)
                    known = best.get((i, kind))
                    best[i, kind] = here if known is None else known.or_better(here)
        kinds = ([best.get((i, kind)) for kind in (True, False)] for i in {i: 0 for i, _ in best})
        return [self._charged(*both) for both in kinds]

    def _products(
        self, shapes: Sequence[Sequence[Candidate]]
    ) -> Iterator[tuple[Sequence[Sequence[Candidate]], Array, Array]]:
        """Batches of groups of k columns with their products, (L, k, k) and (L, k, 1 + draws).

        Batches are small because the nuisance is large. Products with the draws are needed only
        if there are several shapes.
        """
        asked = self.weighed.shape[1] if len(shapes) > 1 else 1
        for _, alike in groupby(shapes, lambda group: len(group[0].rows)):
            groups = list(alike)
            if groups[0][0].unexplained:  # a map is the only group with its number of columns
                one = all_columns([groups[0][0]], self.evidence)
                b = one.along(self.weighed[:, :asked])
                yield groups, self.evidence.information_of(one)[None], b[None]
                continue
            begin = 0
            for some, information, b in self.every.each([group[0] for group in groups]):
                yield groups[begin : begin + len(some)], information, b[..., :asked]
                begin += len(some)

    def _charged(self, plain: _Best | None, searched: _Best | None) -> Score:
        """Score of the likelier of the best plain and the best searched shape."""
        known = [each for each in (plain, searched) if each is not None]
        tries = [
            1.0 if each is None or each.shapes == 1 else _tries(each.chance, len(each.value))
            for each in (plain, searched)
        ]
        if len(known) == 1:
            tries = 2 * [max(tries)]
        else:
            tries = [tries[0] * (1 + 1 / PLAINLY), tries[1] * (1 + PLAINLY)]
        candidate = known[0].candidate
        weight = 1.0 if candidate.effect is None else dict(self.weights).get(candidate.cause, 1.0)
        of_kind = tries[0] / weight, tries[1] / weight
        return max((self._score(each, of_kind) for each in known), key=lambda s: s.log_bayes)

    def _score(self, best: _Best, tries_of: tuple[float, float]) -> Score:
        """The score of a candidate at its most likely values."""
        candidate, value, b = best.candidate, best.value, best.b
        information = _scaled(best.information, best.units)
        spans = [slice(0, len(value))] if candidate.sized else []
        choices = tries_of[not candidate.plain] * candidate.choices
        return Score(
            candidate=candidate,
            value=value,
            information=best.information,
            units=best.units,
            gain=decrease(information, b, value),
            log_bayes=log_bayes(information, b, value, spans) - log(choices),
            tries_of=tries_of,
            noise_degrees=self.noise_degrees,
        )


def _by_kind(shapes: Sequence[Candidate]) -> Iterator[tuple[bool, slice | NDArray[np.intp]]]:
    """Whether shapes are plain, and the indices of these, for each kind that there is."""
    plain = np.array([shape.plain for shape in shapes])
    if plain.all() or not plain.any():
        yield bool(plain[0]), slice(None)
    else:
        yield True, np.flatnonzero(plain)
        yield False, np.flatnonzero(~plain)


def tries_of(term: Candidate, tried: Sequence[Score]) -> tuple[float, float]:
    """Tries that the search for a term's cause made (`Score.tries_of`); 1 if there was none."""
    own = [s.tries_of for s in tried if s.candidate.same_name(term)]
    return max((a for a, _ in own), default=1.0), max((b for _, b in own), default=1.0)


def _best_of(shapes: Sequence[Candidate], products: Array, b: Array, units: Array) -> _Best:
    """The best of some shapes of an explanation, and the largest D of any in each draw.

    Args:
        shapes: of k parameters each, (L,).
        products: information of their parameters in some units, (L, k, k).
        b: products of their columns with the residuals and with each draw, (L, k, 1 + draws).
        units: those units, (k,).
    """
    information, b = _scaled(products, units), units[:, None] * b
    own, drawn = b[..., 0], b[..., 1:]
    value, gain = most_likely_of_each(shapes, information, own)
    top = int(np.argmax(gain))
    chance = free_decrease(information, drawn).max(axis=0) if drawn.size else np.zeros(0)
    best = max(0.0, float(gain[top]))
    found = products[top], units, own[top], chance, len(shapes)
    return _Best(best, shapes[top], value[top], *found)


def _scaled(information: Array, units: Array) -> Array:
    """Information (..., k, k) in units of the priors; unchanged if all units are 1."""
    return information if (units == 1).all() else units[:, None] * information * units


def most_likely_of_each(
    shapes: Sequence[Candidate], information: Array, b: Array
) -> tuple[Array, Array]:
    """Most likely values of each shape within its bounds, (L, k), and their D, (L,).

    Args:
        shapes: of k parameters each, (L,).
        information: of their parameters, (L, k, k).
        b: products of their columns with the residuals, (L, k).
    """
    every = zip(information, b, map(bounds_of, shapes), strict=True)
    value = np.array([most_likely(g, along, *bounds) for g, along, bounds in every])
    return value, np.sum(value * (2 * b - (information @ value[..., None])[..., 0]), axis=-1)


def most_likely(
    information: Array, b: Array, lower: Array, upper: Array, precision: Array | float = PRECISION
) -> Array:
    """Values v of largest posterior within bounds, (k,); active bounds are fixed one by one.

    Args:
        information: of the values, (k, k).
        b: products of their columns with the residuals, (k,).
        lower: bounds, (k,).
        upper: bounds, (k,).
        precision: of the prior of each value, (k,) or of all.
    """
    normal = information + np.diag(np.broadcast_to(precision, len(b)))
    held = np.zeros(len(b), dtype=bool)
    value = solved(normal, b)
    for _ in range(len(b)):
        beyond = np.maximum(lower - value, value - upper)
        beyond[held] = 0.0
        if not (beyond > 0).any():
            break
        worst = int(np.argmax(beyond))
        held[worst] = True
        value[worst] = np.clip(value[worst], lower[worst], upper[worst])
        free = ~held
        if free.any():
            right = b[free] - normal[free][:, held] @ value[held]
            value[free] = solved(normal[free][:, free], right)
    return value


def log_p_of(gain: float, k: float, noise_degrees: float) -> float:
    """ln p of the F test of k parameters that lower chi square by `gain`.

    `noise_degrees` are the degrees of freedom of the noise estimate in the unit of chi square;
    infinite if the noise is known.
    """
    if not np.isfinite(noise_degrees):
        return float(log_chi2(gain, k))
    return log_f(gain / k, k, noise_degrees)


def decrease(information: Array, b: Array, value: Array) -> float:
    """D at v; 0 if chi square grows."""
    return max(0.0, change(information, b, value))


def change(information: Array, b: Array, value: Array) -> float:
    """D at v; negative if chi square grows."""
    return float(2 * b @ value - value @ information @ value)


def free_decrease(information: Array, b: Array) -> Array:
    """D at the best v without prior and bounds, (..., j), for each column of b (..., k, j)."""
    values, axes = np.linalg.eigh(information)
    shown = values > _RANK * np.maximum(values[..., -1:], 1e-300)
    square = (axes.swapaxes(-1, -2) @ b) ** 2
    each = np.zeros_like(square)
    np.divide(square, values[..., None], out=each, where=shown[..., None])
    return np.asarray(each.sum(axis=-2))


def log_bayes(information: Array, b: Array, value: Array, spans: Sequence[slice] = ()) -> float:
    """ln B at v: half the decrease of chi square, less the price of the parameters."""
    explained = float(b @ value - value @ information @ value / 2)
    return explained - price_of(information, value, spans)


def log_bayes_of_each(information: Array, b: Array, value: Array) -> Array:
    """ln B of each of L explanations alone, (L,); the values of each share one unknown size.

    Args:
        information: of their parameters, (L, k, k).
        b: products of their columns with the residuals, (L, k).
        value: their most likely values, (L, k).
    """
    explained = np.sum(value * (b - (information @ value[..., None])[..., 0] / 2), axis=-1)
    size, price = _of_one_size(value)
    return np.asarray(explained - price - _cost(information, value, size))


def price_of(information: Array, value: Array, spans: Sequence[slice] = ()) -> float:
    """Price of parameters in ln B, for the range of values that they could have had.

    Args:
        information: of the parameters, (k, k).
        value: of the parameters, (k,).
        spans: parameters of each explanation whose size is not known; each has one size.
    """
    size, price = np.full(len(value), SPREAD), 0.0
    for span in spans:
        own, paid = _of_one_size(value[span])
        size[span], price = own, price + paid
    return price + float(_cost(information, value, size))


def precision_of(candidate: Candidate, value: Array) -> float:
    """Precision of the prior of values that share the size of these (k,); a map's has its own."""
    return float(_of_one_size(value)[0][0] ** -2) if candidate.sized else PRECISION


def _of_one_size(value: Array) -> tuple[Array, float]:
    """The most likely size that values (..., k) of an explanation share, and its price."""
    rms = np.sqrt(np.mean(value**2, axis=-1, keepdims=True))
    size = np.clip(rms, SPREAD * np.exp(-log(DECADES)), SPREAD)
    return size, log(log(DECADES) / np.sqrt(pi / value.shape[-1]))


def _cost(information: Array, value: Array, size: Array) -> Array:
    """Price (...) of values (..., k) expected within `size`; information is (..., k, k)."""
    size = np.broadcast_to(size, value.shape)
    unlike = np.sum((value / size) ** 2, axis=-1) / 2
    could = np.eye(value.shape[-1]) + size[..., :, None] * information * size[..., None, :]
    return np.asarray(unlike + _log_determinant(could) / 2)


def _log_determinant(matrix: Array) -> Array:
    """ln determinant of matrices positive definite up to rounding, (..., k, k) -> (...)."""
    if matrix.ndim == 2:
        factor, failed = dpotrf(matrix)
        if not failed:
            return np.asarray(2 * np.log(np.diag(factor)).sum())
    return np.asarray(np.linalg.slogdet(matrix)[1])


def _tries(largest: Array, k: int) -> float:
    """Number M of independent tries of a search: the least p has E ln(1/p) = ln M + gamma.

    Args:
        largest: largest D over all shapes in each draw of noise, (draws,).
        k: number of parameters of a shape.
    """
    return float(max(1.0, np.exp(np.mean(-log_chi2(largest, k)) - EULER)))
