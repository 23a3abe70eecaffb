"""The truth for judging the equation of a law: where it acts, on what it depends, and its form.

Variables are those of the glossary, with joints relative to the wrong one: `q_j` is its own angle,
`q_j+1` that of the next joint (1 after 3), `q_j+2` that of the previous one. `force_j` is the
tension of the wrong rod, or of a rod of the wrong chain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Inputs by their names in the glossary, (n,) each, SI -> displacements (n,) each, by name: `dq_2`
# of a drive [rad], `darm_1`, `dhinge_1`, `drod_1a` of a dimension, `dx` of the platform [m].
Law = Callable[[Mapping[str, Array]], dict[str, Array]]

JOINTS, ARMS, RODS = "joints", "arms", "rods"  # all of them
PLATFORM, BASE, TRACKER = "platform", "base", "tracker"
DRIVE, STRUCTURE, MEASUREMENT = "drive", "structure", "measurement"


@dataclass(frozen=True)
class Truth:
    """One fair description of a hidden cause.

    If several are fair, `why` gives the reason: any of `stages` with any of `parts` is right, or
    the whole of one of `instead`.
    """

    stages: frozenset[str]
    parts: frozenset[str]  # joint_2, arm_1, or all of a kind: joints, arms, rods; base, platform
    variables: frozenset[str]
    form: str | None  # None if no equation of few terms exists
    law: Law | None  # None if its form is not judged
    why: str = ""
    instead: tuple[Truth, ...] = ()

    @property
    def fair(self) -> tuple[Truth, ...]:
        """All descriptions."""
        return (self, *self.instead)


def true(
    stage: str,
    part: str,
    variables: str,
    form: str | None,
    law: Law | None,
    why: str = "",
    instead: tuple[Truth, ...] = (),
) -> Truth:
    """The same from words separated by blanks."""
    return Truth(
        frozenset(stage.split()),
        frozenset(part.split()),
        frozenset(variables.split()),
        form,
        law,
        why,
        instead,
    )


def numbers(legs: Array) -> list[int]:
    """Numbers, from 1, of the legs that have it."""
    return [int(leg) + 1 for leg in np.flatnonzero(legs)]


def after(joint: int) -> int:
    """The next joint, 1 after 3."""
    return joint % 3 + 1


def of_each(left: str, joints: list[int], one: Callable[[Mapping[str, Array], int], Array]) -> Law:
    """A law that is the same in several joints or chains."""
    return lambda seen: {f"d{left}_{joint}": one(seen, joint) for joint in joints}


def of_rods(one: Callable[[Array], Array]) -> Law:
    """A law of the tension that is the same in all six rods."""
    rods = [f"{leg}{side}" for leg in (1, 2, 3) for side in "ab"]
    return lambda seen: {f"drod_{rod}": one(seen[f"force_{rod}"]) for rod in rods}


def of_shift(one: Callable[[Mapping[str, Array]], Array]) -> Law:
    """A law of a shift, (n, 3) [m]."""

    def law(seen: Mapping[str, Array]) -> dict[str, Array]:
        return dict(zip(("dx", "dy", "dz"), one(seen).T, strict=True))

    return law


def place(seen: Mapping[str, Array]) -> Array:
    """Position of the platform, (n, 3) [m]."""
    return np.stack([seen[name] for name in "xyz"], axis=1)
