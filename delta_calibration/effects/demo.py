"""How `delta-cal demo` shows an effect."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Demo:
    """An effect hidden in the demonstration's machine, and the session that shows it.

    Of several that suit a machine the first in the catalogue is taken, one that is not `general`
    before one that is.
    """

    plan: str  # by name
    count: int  # of the plan's points
    strength: float = 3.0  # typical sizes
    general: bool = False  # whether machines of nearly every kind can have it
