"""Columns of effects whose values each move one number of their stage, as products.

    x_k = m_r f_k        m (n, d, size of the stage): derivative by the stage,    f_k (n,): the
    function,            r: number of the stage that value k moves

The many shapes that a search tries differ only in their functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects.base import Effect, law_for
from delta_calibration.effects.signals import Places, Signals
from delta_calibration.model.law import Law
from delta_calibration.model.terms import Term, slopes, table_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Apart:
    """Some values of an effect, and the terms that contain them."""

    effect: Effect
    values: tuple[int, ...]  # (k,) indices of the effect's parameters
    moves: tuple[int, ...]  # (k,) index in the stage of the number that each of them moves
    terms: tuple[Term, ...]

    @classmethod
    def of(cls, effect: Effect, values: Sequence[int], places: Places) -> Apart | None:
        """Collect these values; None if one of them moves several numbers of the stage."""
        moves: dict[int, int] = {}
        terms = []
        for term in effect.terms(places):
            own = set(term.values).intersection(values)
            if not own:
                continue
            if len(term.outputs) > 1 or min(term.outputs) < 0 or not own.isdisjoint(moves):
                return None
            moves.update(dict.fromkeys(own, term.outputs[0]))
            terms.append(term)
        if len(moves) < len(values):
            return None
        return cls(effect, tuple(values), tuple(moves[v] for v in values), tuple(terms))


def functions_of(shapes: Sequence[Apart], signals: Signals, place: Index) -> Array:
    """Functions f_k of the values of all shapes, in units of their priors, (rows, n).

    Args:
        shapes: L shapes of k values each.
        signals: signals of the samples.
        place: row of each value of each shape in the result, (L, k).
    """
    parts: list[tuple[Law, Sequence[Term], int]] = []
    about, where, size = [np.zeros(0)], [], []
    for shape, rows in zip(shapes, place, strict=True):
        effect, values = shape.effect, list(shape.values)
        law = law_for(effect, shape.terms[0])
        parts.append((law, shape.terms, sum(len(known) for known in about)))
        about.append(effect.about)
        where.append(np.full(len(about[-1]), -1))
        where[-1][values] = rows
        size.append(effect.parameters.prior[values])
    table, at = table_of(parts), np.concatenate(about)
    found = np.asarray(slopes(table, signals.rows, at, np.concatenate(where), place.size))
    found[place.ravel()] *= np.concatenate(size)[:, None]
    return found
