"""Compiled call that turns the bytes of a usual command into the bytes to send.

A command is usual if it only has to be corrected: its layout is known, it is finite, not earlier
than the last one, no echo of an output, passes every guard, and its correction is within the rate
limit. All other commands are left to `CommandPath.send`, which counts and reports them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell.echo_kernel import LEAST, Outputs, remember, row_of
from delta_calibration.cell.motion_kernel import Motion, moved, speeds, travelled
from delta_calibration.cell.wire_kernel import (
    Wire,
    nanoseconds,
    positions,
    same,
    seconds,
    write_all,
)
from delta_calibration.compensation.command_kernel import Single, commanded
from delta_calibration.compensation.command_status import PASSED, SHARE
from delta_calibration.model.jit import compiled, record
from delta_calibration.model.kernels import copy_into

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Octets = NDArray[np.uint8]

# Result for a command. For one that is not usual: whether its motion was recorded.
UNSEEN, SEEN, CORRECTED, BLENDED = range(4)
COMMAND, RATE, ACCELERATION, DIRECTION = range(4)  # signals of the command and its motion
DQ, JOINT = range(2)  # rows of the answer
_NANOSECONDS = 1_000_000_000


@record
class Usual(NamedTuple):
    """Inputs, state and results of the compiled call."""

    wire: Wire
    single: Single
    motion: Motion
    outputs: Outputs
    by_conditions: bool  # whether the correction depends on more than the command
    known: Array  # (S,) signals of the conditions other than the motion
    signals: Array  # (S,)
    at: Index  # (4,) where the signals of the command and its motion begin
    carried: Array  # (4,) payload [kg] and its centre [m]; NaN where it is not known
    travel: Array  # (m,) scratch
    q: Array  # (m + k,) [rad] the command: joints, then pass-through axes
    target: Array  # (a,)
    told: Array  # (4,)
    answer: Array  # (2, m + k) [rad] correction and output
    stamp: Index  # (2,) seconds, nanoseconds
    out: Octets  # the message to send
    out_at: int  # byte offset of its positions


@compiled(borrows=True)
def _follow(
    own: Usual,
    message: bytes,
    last_ns: int,
    now_s: float,
    last_s: float,
    fastest: float,
    at_once_s: float,
    applied: Array,
) -> int:
    """See `follow`."""
    told, m = own.q, len(own.travel)
    if not same(own.wire, message) or not positions(own.wire, message, told):
        return UNSEEN
    q = told[:m]
    own.stamp[0], own.stamp[1] = seconds(own.wire, message), nanoseconds(own.wire, message)
    stamp_ns = own.stamp[0] * _NANOSECONDS + own.stamp[1]
    moved(own.motion, q, stamp_ns)
    if stamp_ns < last_ns or row_of(own.outputs, q, False) >= 0:
        return SEEN
    signals, dq, joint = own.signals, own.answer[DQ, :m], own.answer[JOINT]
    copy_into(signals, own.known)
    copy_into(signals[own.at[COMMAND] : own.at[COMMAND] + m], q)
    if own.by_conditions:
        rate, acceleration = own.at[RATE], own.at[ACCELERATION]
        speeds(own.motion, signals[rate : rate + m], signals[acceleration : acceleration + m])
        direction = own.at[DIRECTION]
        travelled(own.motion, q, signals[direction : direction + m], own.travel)
    single = own.single
    code = commanded(
        single.drawn,
        single.machine,
        single.guards,
        single.search,
        q,
        signals,
        own.carried[0],
        own.carried[1:],
        True,
        own.target,
        dq,
        own.told,
        single.room,
    )
    if code != PASSED:
        return SEEN
    step = fastest * min(max(now_s - last_s, 0.0), at_once_s)
    odd = False
    for j in range(m):
        if abs(dq[j] - applied[j]) > step:
            return SEEN
        joint[j] = q[j] + dq[j]
        odd = odd or abs(dq[j]) > LEAST
    for j in range(m, len(told)):
        joint[j] = told[j]
    remember(own.outputs, joint[:m], odd)
    write_all(own.stamp[0], own.stamp[1], joint, own.out, own.out_at)
    return BLENDED if 0.0 < own.told[SHARE] < 1.0 else CORRECTED


@compiled(alone=True)
def follow(
    own: Usual,
    message: bytes,
    last_ns: int,
    now_s: float,
    last_s: float,
    fastest: float,
    at_once_s: float,
    applied: Array,
) -> int:
    """Correct a usual command, and write the output message and its details to `own`.

    Args:
        own: see `Usual`.
        message: the command.
        last_ns: stamp of the command before [ns].
        now_s: steady time [s].
        last_s: steady time of the output before [s].
        fastest: largest rate of a correction [rad/s].
        at_once_s: longest time [s] that counts for this rate in one output.
        applied: correction in the output before, (m,) [rad].
    """
    return _follow(own, message, last_ns, now_s, last_s, fastest, at_once_s, applied)
