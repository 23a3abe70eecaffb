"""Candidate causes of the residuals: effects with their shapes, dimensions and smooth maps."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.columns import Columns, Plain, joined
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.effects import Effect
from delta_calibration.effects.signals import KINDS, PLACE, kinds_of
from delta_calibration.effects.unexplained import (
    SIZES,
    UNEXPLAINED,
    Unexplained,
    families,
    reaches,
)

Array = NDArray[np.float64]

_STEP = 1e-3  # step of finite differences, as a share of a searched field's interval


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate cause: an effect in one shape, or a dimension that is out of its tolerance.

    `rows` are the indices of the free parameters: those of the effect or, if there is no effect,
    those of the mechanism's geometry. `again` is the number of the occasion if a machine has the
    cause more than once (`Effect.apart`): 1 for the second bump of a tracker's stand.
    """

    cause: str
    kind: str
    location: str | None
    effect: Effect | None
    rows: tuple[int, ...]
    again: int = 0

    @property
    def unexplained(self) -> bool:
        """Whether it is a smooth map, which names no cause."""
        return self.cause == UNEXPLAINED

    @property
    def sized(self) -> bool:
        """Whether its size is unknown; dimensions have their tolerance, maps a given size."""
        return self.effect is not None and not self.unexplained

    @property
    def plain(self) -> bool:
        """Whether no field of its shape is searched; such shapes may still be several.

        Growth has one for each thermometer.
        """
        return self.effect is None or not self.effect.bounded_intervals()

    @property
    def sought(self) -> bool:
        """Whether a search may find it: not all places at once of an effect that acts at one."""
        if self.effect is None or self.location:
            return True
        return not (self.effect.at_one_place or (self.again and self.effect.again_at_one_place))

    @property
    def choices(self) -> float:
        """Factor by which its choice among alternatives is paid, beyond the tries of a search.

        For a map the number of sizes and widths of which the likeliest is taken; for a cause how
        rare the shape is.
        """
        if self.effect is None:
            return 1.0
        family = self.effect.moves_with if self.unexplained else None
        return self.effect.rarity if family is None else len(SIZES) * len(reaches(family))

    @property
    def depends_on(self) -> frozenset[str]:
        """Kinds of quantity that it varies with; a map may vary with any."""
        if self.effect is None:
            return frozenset({PLACE})
        return KINDS if self.unexplained else kinds_of(self.effect.takes)

    @property
    def with_all_values(self) -> Candidate:
        """The effect with all its values free."""
        if self.effect is None:
            return self
        return replace(self, location=None, rows=tuple(range(len(self.effect.parameters))))

    @property
    def label(self) -> str:
        """Readable name: the cause and its location."""
        family = self.effect.moves_with if self.effect is not None else None
        if family is not None:
            return f"{self.cause} ({family})"
        name = f"{self.cause} ({self.again + 1})" if self.again else self.cause
        return name if self.location is None else f"{name} at {self.location}"

    @property
    def key(self) -> str:
        """Key of the cause and its location, independent of the searched shape."""
        effect, rows = self.effect, self.rows
        located = self.location is not None
        whole = effect is not None and (located or len(rows) == len(effect.parameters))
        return self.label if whole else f"{self.label} {rows}"

    @property
    def shape(self) -> Hashable:
        """Unique key of the candidate: its label, parameter indices and settings."""
        own = () if self.effect is None else tuple(self.effect.settings.items())
        return self.label, self.rows, own

    def same_name(self, other: Candidate) -> bool:
        """Whether both would be reported under the same name."""
        return self.cause == other.cause and (not self.unexplained or self.label == other.label)

    def same_cause(self, other: Candidate) -> bool:
        """Whether they cannot stand beside each other: the same name, for the same occasion."""
        if not self.same_name(other) or self.effect is None or other.effect is None:
            return self.same_name(other)
        return self.again == other.again or not self.effect.apart(other.effect)

    def beside(self, used: Sequence[Candidate]) -> Candidate:
        """The candidate with the number of its occasion beside the terms in use.

        That of a term whose occasion it shares; else the first that none of them has.
        """
        if self.effect is None or not self.effect.repeats:
            return self
        same = [(m.again, m.effect) for m in used if m.cause == self.cause and m.effect]
        shared = (k for k, effect in same if not effect.apart(self.effect))
        free = set(range(len(same) + 1)) - {k for k, _ in same}
        return replace(self, again=next(shared, min(free)))

    def contains(self, other: Candidate) -> bool:
        """Whether all that another of the same cause and occasion moves is moved by this one too.

        Parameters are compared by name; those of curves of unlike resolution, and of other effects
        whose shapes have unlike parameters, by the joints that they move: a shared one moves all.
        """
        if self.effect is None or other.effect is None:
            return self.effect is other.effect and self.rows == other.rows
        if not self.same_cause(other):
            return False
        own, its = self.effect.parameters, other.effect.parameters
        if own.names == its.names:
            return set(other.rows) <= set(self.rows)
        here = {own.items[row].location for row in self.rows}
        if None in here or len(self.rows) == len(own):
            return True
        return {its.items[row].location for row in other.rows} <= here


def columns_of(candidate: Candidate, evidence: LinearizedModel) -> Array:
    """Whitened columns of the candidate's free parameters in units of their priors, (d n, k)."""
    rows = list(candidate.rows)
    if candidate.effect is None:
        return np.asarray(evidence.geometry[:, rows])
    return np.asarray(evidence.columns(candidate.effect)[:, rows])


def all_columns(candidates: Sequence[Candidate], evidence: LinearizedModel) -> Columns:
    """Concatenated whitened columns of some candidates, (d n, k); see `products_of`."""
    return joined([products_of(candidate, evidence) for candidate in candidates])


def moved_by(candidate: Candidate, evidence: LinearizedModel, scaled: Array) -> Array:
    """Whitened shift of the readings, (d n,), by values (k,) in units of the priors."""
    return products_of(candidate, evidence).times(scaled[:, None])[:, 0]


def products_of(candidate: Candidate, evidence: LinearizedModel) -> Columns:
    """Whitened columns of the candidate's free parameters, (d n, k).

    Those of a map are products; those of an error curve are a sparse matrix.
    """
    effect, sparse = candidate.effect, None
    if effect is not None and effect.by_functions:
        if len(candidate.rows) == len(effect.parameters):
            return evidence.product(effect)
    elif effect is not None and effect.free_form:
        sparse = evidence.sparse(effect, candidate.rows)
    return Plain(columns_of(candidate, evidence)) if sparse is None else sparse


def shape_columns(candidate: Candidate, evidence: LinearizedModel, scaled: Array) -> Array:
    """Derivatives of a candidate's whitened signal by its searched fields, (d n, fields).

    The unit of a field is its standard deviation if it is uniformly distributed in its interval.

    Args:
        candidate: the cause in the shape that was found.
        evidence: the linearized model of the session.
        scaled: its parameter values in units of their priors, (k,).
    """
    effect, columns = candidate.effect, [np.zeros((evidence.size, 0))]
    if effect is None:
        return columns[0]
    for name, low, high in effect.bounded_intervals():
        at, step = getattr(effect, name), _STEP * (high - low)
        ends = np.clip([at - step, at + step], low, high)
        fields: list[dict[str, Any]] = [{name: float(end)} for end in ends]
        shapes = (replace(candidate, effect=replace(effect, **field)) for field in fields)
        before, after = (moved_by(shape, evidence, scaled) for shape in shapes)
        spread = (high - low) / np.sqrt(12)  # of a uniform distribution
        columns.append(((after - before) * spread / np.ptp(ends))[:, None])
    return np.concatenate(columns, axis=1)


def typical_of(candidate: Candidate) -> Array:
    """Typical sizes of the free parameters, (k,); 1 for a dimension, which is its tolerance."""
    if candidate.effect is None:
        return np.ones(len(candidate.rows))
    return np.asarray(candidate.effect.parameters.prior[list(candidate.rows)])


def bounds_of(candidate: Candidate) -> tuple[Array, Array]:
    """Physical bounds of the free parameters in units of their priors, two (k,)."""
    if candidate.effect is None:
        return np.full(len(candidate.rows), -np.inf), np.full(len(candidate.rows), np.inf)
    lower, upper = candidate.effect.parameters.bounds
    rows = list(candidate.rows)
    return lower[rows], upper[rows]


def subsets(effect: Effect) -> Iterator[Candidate]:
    """Candidates of an effect: all its parameters, its `alone` sets and each single location."""
    items, names = effect.parameters.items, effect.parameters.names
    places = list(dict.fromkeys(p.location for p in items))
    yield Candidate(effect.cause, effect.kind, None, effect, tuple(range(len(items))))
    for some in effect.alone:
        rows = tuple(names.index(name) for name in some)
        yield Candidate(effect.cause, effect.kind, None, effect, rows)
    if len(places) > 1:
        for place in places:
            rows = tuple(i for i, p in enumerate(items) if p.location == place)
            yield Candidate(effect.cause, effect.kind, place, effect, rows)


def dimensions(evidence: LinearizedModel) -> Iterator[Candidate]:
    """Each dimension of the machine as a candidate of its own."""
    for row, p in enumerate(evidence.chain.mechanism.parameters):
        yield Candidate(p.cause, "geometry", p.location, None, (row,))


def maps(evidence: LinearizedModel, any_effect: Effect) -> Iterator[list[Candidate]]:
    """Smooth maps over each variable that errors may depend on, each from small to large."""
    joint = evidence.at.joint[: evidence.poses]
    for family in families(evidence.at):
        for reach in reaches(family):
            widest = Unexplained.over(
                any_effect, family, joint, reach=reach, seen=evidence.at.joint
            )
            rows = tuple(range(len(widest.parameters)))
            own = widest.mechanism.joint_size
            effects = [replace(widest, size=size * own) for size in SIZES]
            yield [Candidate(UNEXPLAINED, "unknown", None, effect, rows) for effect in effects]
