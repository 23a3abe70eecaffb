"""Settings with which `delta-cal demo` shows an effect."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Demo:
    """Session that shows an effect hidden in the demonstration's machine.

    If several effects suit a machine, the first in the catalogue is taken, with those that are
    not `general` before those that are.
    """

    plan: str  # name of the plan
    count: int  # number of the plan's points
    strength: float = 3.0  # in typical sizes
    general: bool = False  # whether machines of nearly every kind can have it
