"""Rod forces and rod lengths of a Delta, whichever model of it: pairs as one, or six of their own.

A pair has a mean length l and, where rods are told apart, a mismatch m: l_a = l - m/2 and
l_b = l + m/2. With U the potential of the masses, tensions follow from

    dU/dl = -(N_a + N_b)        dU/dm = -(N_b - N_a) / 2
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects.loads import load_on
from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]


def tensions(robot: Robot, mechanism: Mechanism, at: Conditions) -> tuple[Array, Array]:
    """Pull in rods a and b of each pair, two of (n, legs) [N]; equal where they are not parted."""
    owners = robot, mechanism
    a, b = at.kept("tensions", owners, lambda: np.stack(_tensions(robot, mechanism, at)))
    return a, b


def _tensions(robot: Robot, mechanism: Mechanism, at: Conditions) -> tuple[Array, Array]:
    both = -load_on(robot, mechanism, at, _rows(mechanism, "rod_"))
    apart = np.zeros_like(both)
    rows = _rows(mechanism, "rod_mismatch_")
    if rows:
        apart = -2 * load_on(robot, mechanism, at, rows)
    return (both - apart) / 2, (both + apart) / 2


def lengthened(mechanism: Mechanism, a: Array, b: Array) -> Array:
    """Change of the geometry when rods a and b grow by so much, (n, legs) [m] -> (n, p)."""
    change = np.zeros((len(a), len(mechanism.parameters)))
    change[:, _rows(mechanism, "rod_")] = (a + b) / 2
    rows = _rows(mechanism, "rod_mismatch_")
    if rows:
        change[:, rows] = b - a
    return change


def _rows(mechanism: Mechanism, start: str) -> list[int]:
    """Parameters called `start` and a number, in the order of the legs."""
    names = enumerate(mechanism.parameters.names)
    return [i for i, name in names if name.removeprefix(start).isdigit()]
