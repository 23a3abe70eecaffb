"""What to do about a cause, and the one test that would confirm it."""

from __future__ import annotations

from dataclasses import dataclass

ADJUST, REPAIR, COMPENSATE, MEASURE = "adjust", "repair", "compensate", "measure"


@dataclass(frozen=True)
class Remedy:
    """Action against a cause, and the test that confirms it.

    Attributes:
        do: `adjust`, `repair`, `compensate` (by the extended calibration) or `measure` (the
            measurement is wrong, not the machine).
        part: part of the machine or the cell, in words.
        how: instruction to the person at the machine, in words.
        confirm: the one test that would confirm the cause, in words.
    """

    do: str
    part: str
    how: str
    confirm: str


AS_FOUND = Remedy(
    COMPENSATE,
    "machine",
    "compensate with the identified values",
    "repeat the session: an error of the machine appears again",
)
