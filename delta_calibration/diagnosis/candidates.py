"""What is tried as an explanation: effects with their shapes, single dimensions, smooth maps."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.columns import Columns, Plain, joined
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.effects import Effect
from delta_calibration.effects.unexplained import (
    SIZES,
    UNEXPLAINED,
    Unexplained,
    families,
    reaches,
)

Array = NDArray[np.float64]

_STEP = 1e-3  # of a searched field's interval, for differences


@dataclass(frozen=True, eq=False)
class Candidate:
    """An explanation: an effect in one shape, or a dimension that is out of its tolerance.

    `rows` are the parameters that are free: of the effect, or of the mechanism's geometry where
    there is no effect.
    """

    cause: str
    kind: str
    location: str | None
    effect: Effect | None
    rows: tuple[int, ...]

    @property
    def unexplained(self) -> bool:
        """Whether it is a smooth map, which explains nothing."""
        return self.cause == UNEXPLAINED

    @property
    def sized(self) -> bool:
        """Whether nobody knows its size: a dimension has its tolerance, a map its own."""
        return self.effect is not None and not self.unexplained

    @property
    def forms(self) -> int:
        """Sizes and widths of a map, among which the likeliest is taken; 1 of all else."""
        family = self.effect.moves_with if self.unexplained and self.effect is not None else None
        return 1 if family is None else len(SIZES) * len(reaches(family))

    @property
    def label(self) -> str:
        """For people: cause, and where."""
        family = self.effect.moves_with if self.effect is not None else None
        if family is not None:
            return f"{self.cause} ({family})"
        return self.cause if self.location is None else f"{self.cause} at {self.location}"

    @property
    def key(self) -> str:
        """What tells it from others, whatever its shape."""
        effect, rows = self.effect, self.rows
        located = self.location is not None
        whole = effect is not None and (located or len(rows) == len(effect.parameters))
        return self.label if whole else f"{self.label} {rows}"

    @property
    def shape(self) -> Hashable:
        """Label, parameters and settings, by which it differs from every other candidate."""
        own = () if self.effect is None else tuple(self.effect.settings.items())
        return self.label, self.rows, own

    def same_cause(self, other: Candidate) -> bool:
        """Whether both would be reported under one name."""
        return self.cause == other.cause and (not self.unexplained or self.label == other.label)


def columns_of(candidate: Candidate, evidence: LinearizedModel) -> Array:
    """Whitened columns of the candidate's free parameters in units of their priors, (d n, k)."""
    rows = list(candidate.rows)
    if candidate.effect is None:
        return np.asarray(evidence.geometry[:, rows])
    return np.asarray(evidence.columns(candidate.effect)[:, rows])


def all_columns(candidates: Sequence[Candidate], evidence: LinearizedModel) -> Columns:
    """Those of some candidates one after the other, a map's as products, (d n, k)."""
    return joined([products_of(candidate, evidence) for candidate in candidates])


def moved_by(candidate: Candidate, evidence: LinearizedModel, scaled: Array) -> Array:
    """What it makes of the readings with values (k,) in units of its priors, (d n,)."""
    return products_of(candidate, evidence).times(scaled[:, None])[:, 0]


def products_of(candidate: Candidate, evidence: LinearizedModel) -> Columns:
    """Whitened columns of the candidate's free parameters, a map's as products, (d n, k)."""
    effect = candidate.effect
    whole = effect is not None and len(candidate.rows) == len(effect.parameters)
    if effect is not None and effect.by_functions and whole:
        return evidence.product(effect)
    return Plain(columns_of(candidate, evidence))


def shape_columns(candidate: Candidate, evidence: LinearizedModel, scaled: Array) -> Array:
    """How a candidate's signal goes with its searched fields, whitened, (d n, fields).

    In units of the spread of a field that lies anywhere in its interval.

    Args:
        candidate: in the shape that was found.
        evidence: of the session.
        scaled: its values in units of their priors, (k,).
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
    """Typical sizes of the free parameters, (k,); of a dimension 1: its tolerance."""
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
    """An effect at all joints, in its parts and, where each has its own parameters, at one."""
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
    """Each dimension of the machine by itself."""
    for row, p in enumerate(evidence.chain.mechanism.parameters):
        yield Candidate(p.cause, "geometry", p.location, None, (row,))


def maps(evidence: LinearizedModel, any_effect: Effect) -> Iterator[list[Candidate]]:
    """Smooth maps of everything that structure could move with, each from slight to large."""
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
