"""Possible mistakes of a mapping: wrong units, swapped columns, wrong signs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from delta_calibration.recording.table_mapping import ANGLES, LENGTHS, Column, TableMapping
from delta_calibration.recording.table_placing import Way


@dataclass(frozen=True)
class Slip:
    """A possible mistake: columns that differ from what the mapping states."""

    columns: tuple[Column, ...]
    unit: str  # their likely unit; empty if the mistake is not the unit
    said: str  # description of what they likely are
    meant: Callable[[Way], Way]  # corrects joints and points read by the mapping


def unit_slips(mapping: TableMapping) -> Iterator[Slip]:
    """Wrong units: of each single column, of all commands, of all columns of the position."""
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
    """Other units of the same kind, each with its factor relative to the stated unit.

    None for microsteps and for columns with an offset.
    """
    unit = columns[0].unit
    kind: Mapping[str, float] = next((u for u in (ANGLES, LENGTHS) if unit in u), {})
    if any(c.offset for c in columns):
        return
    for other in dict.fromkeys(("deg", "rad", "mm", "m", *kind)):
        if other in kind and other != unit:
            yield other, kind[other] / kind[unit]


def order_slips(mapping: TableMapping) -> Iterator[Slip]:
    """Wrong signs and order: a left-handed frame, reversed joints, two swapped joints."""
    commands = mapping.commands
    yield Slip(
        mapping.position,
        "",
        f"{', '.join(c.name for c in mapping.position)} in a left-handed frame (two swapped, or "
        "one with the opposite sign)",
        lambda way: (way[0], way[1] * [-1.0, 1.0, 1.0]),
    )
    for k, column in enumerate(commands):
        said = f"{column.name} with the opposite sign (`scale: {-column.scale:g}`)"
        yield Slip((column,), "", said, _reversed([k], commands))
    if len(commands) > 1:
        every = range(len(commands))
        yield Slip(commands, "", "all joints with the opposite sign", _reversed(every, commands))
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
    """Negate the numbers of some joints; their offsets keep their sign."""
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
