"""Last places in the workspace where a guard acted, thinned out to a grid."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell.command_path import (
    ALREADY,
    BACKWARD,
    BLENDED,
    ECHO,
    HOLD,
    CommandPath,
)
from delta_calibration.cell.scene import Drawing, Kind
from delta_calibration.description.tree import ORANGE, PURPLE, VERMILION
from delta_calibration.plans import tool_points
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

FADED, PASSED, HELD = "blended out", "passed uncompensated", "held"
SEEN = {  # colour, and the dot's diameter [m], so that they differ in size as well
    FADED: (ORANGE, 0.006),
    PASSED: (VERMILION, 0.010),
    HELD: (PURPLE, 0.014),
}
_NO_GUARD = (ALREADY, ECHO, BACKWARD)  # notes on commands that were sent all the same
_WAITING = 200  # commands whose places are not computed yet; older ones are dropped
_CELL = 0.005  # [m] edge of a grid cell; places in one cell count as one
_KEPT = 500  # places kept


class GuardTrail:
    """Collects commands on which a guard acted; computes their places later, on any thread."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[str, Array]] = deque(maxlen=_WAITING)
        self._places: dict[tuple[str, int, int, int], Array] = {}
        self._blended = 0

    def see(self, q: Array, path: CommandPath) -> None:
        """Remember a command (m,) [rad] if a guard acted on it; fast, as on the command path."""
        blended, trouble = path.counts.get(BLENDED, 0), path.trouble
        if trouble is None and blended == self._blended:
            return
        if blended != self._blended:
            self._blended = blended
            self._waiting.append((FADED, q))
        elif trouble not in _NO_GUARD:
            self._waiting.append((HELD if path.on_failure == HOLD else PASSED, q))

    @property
    def waiting(self) -> bool:
        """Whether there are commands whose places are not computed yet."""
        return bool(self._waiting)

    def clear(self) -> None:
        """Forget the places, for example when another calibration is loaded."""
        self._waiting.clear()
        self._places.clear()

    def placed(self, robot: Robot) -> bool:
        """Compute places of waiting commands by the nominal model; return whether any is new."""
        waiting = [self._waiting.popleft() for _ in range(len(self._waiting))]
        before = len(self._places), next(iter(self._places), None)
        for what in SEEN:
            q = np.array([q for kind, q in waiting if kind == what])
            for point in tool_points(robot, q) if len(q) else ():
                if np.isfinite(point).all():
                    x, y, z = np.floor(point / _CELL).astype(int).tolist()
                    self._places.setdefault((what, x, y, z), point)
        while len(self._places) > _KEPT:
            del self._places[next(iter(self._places))]
        return before != (len(self._places), next(iter(self._places), None))

    def drawings(self) -> tuple[Drawing, ...]:
        """Dots where the guards acted, one drawing for each kind of action."""
        found = []
        for what, (colour, size) in SEEN.items():
            points = [point for (kind, *_), point in self._places.items() if kind == what]
            if points:
                name = f"guard: {what}"
                found.append(Drawing(name, Kind.DOTS, np.array(points), colour, size))
        return tuple(found)
