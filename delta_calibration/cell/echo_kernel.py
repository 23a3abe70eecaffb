"""Compiled search for a command among the last outputs, for `Echo`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled, record

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAST = 1e-7  # [rad] a correction below this may be applied twice without harm
KEPT = 256  # outputs: a quarter of a second at 1 kHz, longer than a loop through a controller
SAME = 1e-9  # [rad] a command this near an output is taken for that output


@record
class Outputs(NamedTuple):
    """Ring buffer of the last outputs; output number n is in row n % KEPT."""

    first: Array  # (KEPT,) [rad] angle of the first joint
    joint: Array  # (KEPT, m) [rad]
    odd: NDArray[np.bool_]  # (KEPT,) whether it differs from its command; see `Output.odd`
    told: Index  # (1,) number of outputs stored so far


def outputs(joints: int) -> Outputs:
    """Create an empty buffer for outputs of that many joints."""
    return Outputs(
        np.full(KEPT, np.nan),
        np.zeros((KEPT, joints)),
        np.zeros(KEPT, np.bool_),
        np.zeros(1, np.int64),
    )


@compiled(borrows=True)
def remember(own: Outputs, joint: Array, odd: bool) -> int:
    """Store an output (m,) [rad] and return its row."""
    row = int(own.told[0] % KEPT)
    own.first[row] = joint[0]
    for j in range(len(joint)):
        own.joint[row, j] = joint[j]
    own.odd[row] = odd
    own.told[0] += 1
    return row


@compiled(borrows=True)
def row_of(own: Outputs, q: Array, marked: bool) -> int:
    """Row of the newest output equal to a command (m,) [rad]; -1 if there is none.

    A marked command may match any output, an unmarked one only an output that is `odd`.
    """
    found = -1
    for row in range(KEPT):
        if abs(own.first[row] - q[0]) <= SAME and (marked or own.odd[row]):
            same = True
            for j in range(1, len(q)):
                same = same and abs(own.joint[row, j] - q[j]) <= SAME
            if same and (found < 0 or _age(own, row) < _age(own, found)):
                found = row
    return found


@compiled(borrows=True)
def _age(own: Outputs, row: int) -> int:
    """Number of outputs stored after that of a row."""
    return int((own.told[0] - 1 - row) % KEPT)


@compiled(alone=True)
def keep(own: Outputs, joint: Array, odd: bool) -> int:
    """`remember` for callers that are not compiled."""
    return remember(own, joint, odd)


@compiled(alone=True)
def find(own: Outputs, q: Array, marked: bool) -> int:
    """`row_of` for callers that are not compiled."""
    return row_of(own, q, marked)
