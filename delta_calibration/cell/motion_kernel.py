"""Compiled tracking of the commanded joint motion, command by command, for `Surroundings`.

Determines for every joint the direction and the travel since its last reversal (data/motion.py),
and speed and acceleration from a parabola fitted over the last tenth of a second of stamps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled, record

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BEGUN, FIRST, NUMBER = range(3)  # whether a command came; row of the oldest one kept; number kept
KEPT = 200  # commands
_WINDOW = 0.1  # [s] over which speeds are fitted
_PAUSE = 0.25  # [s] between commands, after which the joints are assumed to stand
_FEWEST = 3  # commands needed for an acceleration
_SPREAD = 1e-14  # mean square of the quadratic term below which it is only rounding of the stamps


@record
class Motion(NamedTuple):
    """State of the motion from the commands so far."""

    turned: float  # [rad] way back from the farthest point that counts as a reversal
    farthest: Array  # (m,) [rad] farthest angle of the present stroke
    direction: Array  # (m,) -1, 0, 1
    turn: Array  # (m,) [rad] angle where the stroke began; NaN before the first reversal
    stamp: Index  # (KEPT,) [ns]
    angle: Array  # (KEPT, m) [rad]
    told: Index  # (3,) see BEGUN
    powers: Array  # (KEPT, 2) scratch


def motion(joints: int, turned: float) -> Motion:
    """Create the state of joints that have not moved yet."""
    return Motion(
        float(turned),
        np.zeros(joints),
        np.zeros(joints),
        np.full(joints, np.nan),
        np.zeros(KEPT, np.int64),
        np.zeros((KEPT, joints)),
        np.zeros(3, np.int64),
        np.zeros((KEPT, 2)),
    )


def apart(own: Motion) -> Motion:
    """Copy of the strokes, independent of the original and without a history of speeds."""
    other = motion(len(own.turn), own.turned)
    other.farthest[:], other.direction[:], other.turn[:] = own.farthest, own.direction, own.turn
    other.told[BEGUN] = own.told[BEGUN]
    return other


@compiled(borrows=True)
def moved(own: Motion, q: Array, stamp_ns: int) -> None:
    """Take a command (m,) [rad]; speeds restart if its stamp is not newer or after a pause."""
    for i in range(len(q)):
        _stroke(own, i, q[i])
    own.told[BEGUN] = 1
    told = own.told
    if told[NUMBER] > 0:
        last = own.stamp[(told[FIRST] + told[NUMBER] - 1) % KEPT]
        if not 0.0 < (stamp_ns - last) * 1e-9 <= _PAUSE:
            told[NUMBER] = 0
    if told[NUMBER] == KEPT:
        told[FIRST] = (told[FIRST] + 1) % KEPT
        told[NUMBER] -= 1
    row = (told[FIRST] + told[NUMBER]) % KEPT
    own.stamp[row] = stamp_ns
    for i in range(len(q)):
        own.angle[row, i] = q[i]
    told[NUMBER] += 1
    while told[NUMBER] > _FEWEST and (stamp_ns - own.stamp[told[FIRST]]) * 1e-9 > _WINDOW:
        told[FIRST] = (told[FIRST] + 1) % KEPT
        told[NUMBER] -= 1


@compiled(borrows=True)
def _stroke(own: Motion, i: int, angle: float) -> None:
    """Update the stroke of joint i with its new angle [rad]; see `data.motion.Stroke`."""
    if own.told[BEGUN] == 0:
        own.farthest[i], own.direction[i], own.turn[i] = angle, 0.0, np.nan
        return
    gone = angle - own.farthest[i]
    if own.direction[i] == 0.0:
        if abs(gone) > own.turned:
            own.direction[i] = 1.0 if gone > 0.0 else -1.0
            own.farthest[i] = angle
    elif own.direction[i] * gone >= 0.0:
        own.farthest[i] = angle
    elif -own.direction[i] * gone > own.turned:
        own.turn[i] = own.farthest[i]
        own.direction[i] = -own.direction[i]
        own.farthest[i] = angle


@compiled(borrows=True)
def travelled(own: Motion, q: Array, direction: Array, travel: Array) -> None:
    """Fill in direction and travel since the last reversal [rad] (inf before the first), (m,)."""
    for i in range(len(q)):
        begun = own.told[BEGUN] != 0
        direction[i] = own.direction[i] if begun else 0.0
        known = begun and np.isfinite(own.turn[i])
        travel[i] = abs(q[i] - own.turn[i]) if known else np.inf


@compiled(borrows=True)
def speeds(own: Motion, velocity: Array, acceleration: Array) -> None:
    """Fill in speed and acceleration at the last command, (m,); 0 if it repeats the one before.

    Least squares with polynomials orthogonal at the stamps: well conditioned at any rate.
    """
    first, number = own.told[FIRST], own.told[NUMBER]
    for j in range(len(velocity)):
        velocity[j] = acceleration[j] = 0.0
    if number < 2:
        return
    last, before = (first + number - 1) % KEPT, (first + number - 2) % KEPT
    same = True
    for j in range(len(velocity)):
        same = same and own.angle[last, j] == own.angle[before, j]
    if same:
        return
    # Time relative to the last command, in units of the whole span.
    span, powers = (own.stamp[last] - own.stamp[first]) * 1e-9, own.powers
    mean = 0.0
    for k in range(number):
        powers[k, 0] = (own.stamp[(first + k) % KEPT] - own.stamp[last]) * 1e-9 / span
        mean += powers[k, 0]
    mean /= number
    square, cross = 0.0, 0.0
    for k in range(number):
        powers[k, 0] -= mean
        square += powers[k, 0] ** 2
        cross += powers[k, 0] ** 3
    skew, spread = cross / square, square / number
    bend = 0.0
    for k in range(number):
        powers[k, 1] = powers[k, 0] ** 2 - skew * powers[k, 0] - spread
        bend += powers[k, 1] ** 2
    curved = number >= _FEWEST and bend > _SPREAD * number
    for j in range(len(velocity)):
        linear, curve = 0.0, 0.0
        for k in range(number):
            gone = own.angle[(first + k) % KEPT, j] - own.angle[last, j]
            linear += powers[k, 0] * gone
            curve += powers[k, 1] * gone
        slope, second = linear / square, curve / bend if curved else 0.0
        # d/dt at t = 0, where the shifted time is -mean
        velocity[j] = (slope + second * (-2.0 * mean - skew)) / span
        acceleration[j] = 2.0 * second / span**2


@compiled(alone=True)
def notice(own: Motion, q: Array, stamp_ns: int) -> None:
    """`moved` for callers that are not compiled."""
    moved(own, q, stamp_ns)


@compiled(alone=True)
def state(own: Motion, q: Array, found: Array) -> None:
    """Write velocity, acceleration, direction and travel at the last command into found (4, m)."""
    speeds(own, found[0], found[1])
    travelled(own, q, found[2], found[3])
