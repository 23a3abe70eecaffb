"""What a mapping may have got wrong: other units, columns in one another's place, other signs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.recording.table_mapping import ANGLES, LENGTHS, Column, TableMapping
from delta_calibration.recording.table_placing import Way

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Slip:
    """Columns that are not what they are said to be."""

    columns: tuple[Column, ...]
    unit: str  # that they likely have; empty where the unit is not what is wrong
    said: str  # what they likely are
    meant: Callable[[Way], Way]  # what they say then


def unit_slips(mapping: TableMapping) -> Iterator[Slip]:
    """Other units of each column by itself, of all commands, of all of the position."""
    groups = [[c] for c in (*mapping.position, *mapping.commands)]
    groups += [
        list(columns)
        for columns in (mapping.position, mapping.commands)
        if len({c.unit for c in columns}) == 1
    ]
    for group in groups:
        for unit, factor in other_units(group):
            yield Slip(tuple(group), unit, unit, _times(group, mapping, factor))


def other_units(columns: Sequence[Column]) -> Iterator[tuple[str, float]]:
    """Units of the same kind, and what SI values would be by them, of those by the stated unit.

    None for microsteps and for what has an offset.
    """
    unit = columns[0].unit
    kind: Mapping[str, float] = next((u for u in (ANGLES, LENGTHS) if unit in u), {})
    if any(c.offset for c in columns):
        return
    for other in dict.fromkeys(("deg", "rad", "mm", "m", *kind)):
        if other in kind and other != unit:
            yield other, kind[other] / kind[unit]


def order_slips(mapping: TableMapping) -> Iterator[Slip]:
    """A left-handed frame, joints of the other sign, two joints in each other's place."""
    commands = mapping.commands
    yield Slip(
        mapping.position,
        "",
        f"{', '.join(c.name for c in mapping.position)} in a left-handed frame (two swapped, or "
        "one of the other sign)",
        lambda way: (way[0], way[1] * [-1.0, 1.0, 1.0]),
    )
    for k, column in enumerate(commands):
        said = f"{column.name} of the other sign (`scale: {-column.scale:g}`)"
        yield Slip((column,), "", said, _reversed([k], commands))
    if len(commands) > 1:
        every = range(len(commands))
        yield Slip(commands, "", "all joints of the other sign", _reversed(every, commands))
    for a, b in combinations(range(len(commands)), 2):
        one, other = commands[a], commands[b]
        if (one.factor, one.scale, one.offset) == (other.factor, other.scale, other.offset):
            said = f"{one.name} and {other.name} swapped"
            yield Slip((one, other), "", said, _swapped(a, b))


def _times(
    columns: Sequence[Column], mapping: TableMapping, factor: float
) -> Callable[[Way], Way]:
    joints, places = (
        np.array([factor if c in columns else 1.0 for c in some])
        for some in (mapping.commands, mapping.position)
    )
    return lambda way: (way[0] * joints, way[1] * places)


def _reversed(some: Sequence[int], commands: Sequence[Column]) -> Callable[[Way], Way]:
    """With the numbers of some joints negated; what is added to them stays."""
    sign, zero = np.ones(len(commands)), np.zeros(len(commands))
    for k in some:
        sign[k], zero[k] = -1.0, 2 * commands[k].offset * commands[k].factor
    return lambda way: (zero + sign * way[0], way[1])


def _swapped(a: int, b: int) -> Callable[[Way], Way]:
    def meant(way: Way) -> Way:
        joint = way[0].copy()
        joint[:, [a, b]] = joint[:, [b, a]]
        return joint, way[1]

    return meant
