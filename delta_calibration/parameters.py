"""Named parameters: what a model can be wrong about, in which unit, by how much one expects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """One scalar of a model.

    `prior` is the standard deviation one expects of (actual - nominal) before any measurement;
    `inf` where nothing is known. `cause` is the name under which an error of this parameter is
    reported, `location` the joint or chain that it belongs to. Beyond `lower` and `upper` no
    machine can be: no stiffness is negative, no metal grows by a hundredth.
    """

    name: str
    unit: str  # "m", "rad" or "1"
    nominal: float
    prior: float
    cause: str = "geometry"
    location: str | None = None
    lower: float = -inf
    upper: float = inf


@dataclass(frozen=True)
class ParameterSet:
    """Parameters in the order of the vector that holds their values."""

    items: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        """Refuse double names, which would make a value ambiguous."""
        if len(self._rows) != len(self.items):
            names = [item.name for item in self.items]
            doubles = sorted({name for name in names if names.count(name) > 1})
            raise InputError(f"parameter names must differ, found twice: {', '.join(doubles)}")

    @cached_property
    def _rows(self) -> dict[str, int]:
        """Row of each name."""
        return {item.name: row for row, item in enumerate(self.items)}

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.items)

    def __add__(self, other: ParameterSet) -> ParameterSet:
        return ParameterSet(self.items + other.items)

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in vector order."""
        return tuple(item.name for item in self.items)

    @property
    def units(self) -> tuple[str, ...]:
        """Units, in vector order."""
        return tuple(item.unit for item in self.items)

    @property
    def nominal(self) -> Array:
        """Values of the drawing, (p,)."""
        return np.array([item.nominal for item in self.items])

    @property
    def prior(self) -> Array:
        """Expected standard deviations about the nominal values, (p,)."""
        return self._priors.copy()

    @cached_property
    def _priors(self) -> Array:
        return np.array([item.prior for item in self.items])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Physical bounds in units of the priors, two (p,)."""
        lower = np.array([item.lower for item in self.items])
        upper = np.array([item.upper for item in self.items])
        return lower / self._priors, upper / self._priors

    def row(self, name: str) -> int:
        """Place of a parameter in the vector.

        Raises:
            InputError: no parameter of that name.
        """
        if name not in self._rows:
            raise InputError(f"no parameter {name!r}; there are: {', '.join(self.names)}")
        return self._rows[name]

    def values(self, vector: Array) -> dict[str, float]:
        """The vector as name -> value, for people and files."""
        return {item.name: float(value) for item, value in zip(self.items, vector, strict=True)}

    def vector(self, values: Iterable[tuple[str, float]]) -> Array:
        """Nominal values with the given ones in their places.

        Raises:
            InputError: a name that is not of this set.
        """
        vector = self.nominal
        for name, value in values:
            vector[self.row(name)] = value
        return vector
