"""Named parameters of a model, with unit, nominal value, prior and bounds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """One scalar parameter of a model.

    `prior` is the standard deviation of (actual - nominal) before any measurement; `inf` if
    nothing is known. `cause` is the name under which an error of this parameter is reported,
    `location` the joint or chain that it belongs to. `lower` and `upper` are physical bounds: no
    stiffness is negative, no metal expands by a hundredth. `drawn` is false for an error that
    simulated machines do not have, so that a seed keeps the machine that it gave before a model
    learned of that error.
    """

    name: str
    unit: str  # SI: "m", "rad", "1", of an effect also others, such as "s" or "rad/(N m)"
    nominal: float
    prior: float
    cause: str = "geometry"
    location: str | None = None
    lower: float = -inf
    upper: float = inf
    drawn: bool = field(default=True, kw_only=True)


@dataclass(frozen=True)
class ParameterSet:
    """Ordered parameters, in the order of the vector of their values."""

    items: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        """Refuse duplicate names, which would make a value ambiguous."""
        if len(self._rows) != len(self.items):
            names = [item.name for item in self.items]
            doubles = sorted({name for name in names if names.count(name) > 1})
            raise InputError(f"parameter names must differ, found twice: {', '.join(doubles)}")

    @cached_property
    def _rows(self) -> dict[str, int]:
        """Index in the vector of each name."""
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
        """Nominal values, (p,)."""
        return np.array([item.nominal for item in self.items])

    @property
    def prior(self) -> Array:
        """Prior standard deviations about the nominal values, (p,)."""
        return self._priors.copy()

    @cached_property
    def _priors(self) -> Array:
        return np.array([item.prior for item in self.items])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Physical bounds, lower and upper, in units of the priors, (p,) each."""
        lower = np.array([item.lower for item in self.items])
        upper = np.array([item.upper for item in self.items])
        return lower / self._priors, upper / self._priors

    def row(self, name: str) -> int:
        """Index of a parameter in the vector.

        Raises:
            InputError: no parameter of that name.
        """
        if name not in self._rows:
            raise InputError(f"no parameter {name!r}; there are: {', '.join(self.names)}")
        return self._rows[name]
