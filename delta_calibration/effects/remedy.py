"""What to do about a cause, and the one test that would confirm it."""

from __future__ import annotations

from dataclasses import dataclass

ADJUST, REPAIR, COMPENSATE, MEASURE = "adjust", "repair", "compensate", "measure"


@dataclass(frozen=True)
class Remedy:
    """What cures a cause.

    Attributes:
        do: `adjust`, `repair`, `compensate` (by the extended calibration) or `measure` (what is
            wrong is the measurement, not the machine).
        part: of the machine or the cell, in words.
        how: in words, an order to somebody at the machine.
        confirm: the one test that would confirm the cause, in words.
    """

    do: str
    part: str
    how: str
    confirm: str


AS_FOUND = Remedy(
    COMPENSATE,
    "machine",
    "compensate it as it was found",
    "repeat the session: what belongs to the machine comes back",
)
