"""Definition of a hidden cause: its name, its action, and its true values for the judge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.truth import Truth
from blind.world import Act, State, World

Array = NDArray[np.float64]


def nothing(world: World, state: State) -> None:
    """Action of a cause that is already in the build."""


def as_built(build: Any) -> Any:
    """Rebuild of a cause that leaves the build unchanged."""
    return build


@dataclass(frozen=True)
class Cause:
    """A cause with its sizes drawn; it can act on any session of the machine."""

    name: str
    act: Act = nothing
    values: Mapping[str, float | str] = field(default_factory=dict)  # SI
    location: str | None = None  # joint_1, ... if it is in one joint only
    rebuild: Callable[[Any], Any] = as_built
    truth: Truth | None = None  # of what is in no catalogue; for the others see `truths`


# (rng, strength, legs that have it (m,) of 0 and 1) -> cause
Draw = Callable[[np.random.Generator, float, Array], Cause]


def of_legs(name: str, values: Array) -> dict[str, float]:
    """Non-zero values by name, with the number of the leg appended."""
    return {f"{name}_{leg + 1}": float(v) for leg, v in enumerate(values) if v}
