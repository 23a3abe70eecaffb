"""Conversion of joint commands to outputs for the drives, and of encoder readings back.

    sent = q + dq + gap

dq is the compensator's correction on its ramp (`ramp.py`); without a correction it ramps to zero.
gap is zero except after a hold: then it starts as the position at which the drives were held less
the wanted one, and ramps to zero. The drives never see a jump that the commands do not contain.
"""

from __future__ import annotations

from collections import Counter
from copy import copy
from dataclasses import dataclass, field
from math import isfinite
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell.echo_filter import Echo, Output
from delta_calibration.cell.ramp import Ramp, WayBack
from delta_calibration.compensation import CommandStatus, Compensated
from delta_calibration.data import Conditions
from delta_calibration.errors import DataError, InputError

Array = NDArray[np.float64]

PASS_THROUGH, HOLD = "pass_through", "hold"
ON_FAILURE = (PASS_THROUGH, HOLD)
REFUSE, CLAMP = "refuse", "clamp"
BEYOND_LIMITS = (REFUSE, CLAMP)

PASSED = "passed through"
ALREADY = "already compensated, passed unchanged"
ECHO = "own output received as a command: passed unchanged"
BLENDED = "correction faded out towards the edge of the region"
LIMITED = "correction limited by its rate"
LIMIT = "correction limited by a joint limit"
BEYOND = "commanded beyond a joint limit: refused"
CLAMPED = "commanded beyond a joint limit: set to the limit"
STALE = "older than the timeout"
AHEAD = "stamped ahead of the node's clock by more than the timeout"
AGELESS = "age unknown: use_sim_time is set and there is no /clock"
REFUSED = "refused: malformed"
HELD = "held: the last good command was sent instead"
DROPPED = "dropped: nothing was sent"
BACKWARD = "time went backwards"
WAITING = (
    "waiting for joint_states: deactivated during a hold, so the position of the drives "
    "is not known"
)

STATES_S = 0.5  # [s] largest age of joint_states that are used as the position of the drives

_NOTHING = np.zeros(0)
_ROUNDING = 1e-9  # [rad, m] rounding error of a limit given in degrees or millimetres


class Corrects(Protocol):
    """Interface of a compensator; equal commands and conditions must give equal results."""

    def compensate(self, q: Array, at: Conditions | None = None) -> Compensated:
        """Correct commands, (n, m) [rad], for n samples of the conditions."""
        ...


@dataclass(frozen=True)
class Sent:
    """Output to the drives."""

    joint: Array  # (m,) [rad]
    compensated: bool  # whether to mark it, so that no other node compensates it again
    # (k,) positions of the pass-through axes, as commanded
    carried: Array = field(default_factory=lambda: _NOTHING)

    @property
    def whole(self) -> Array:
        """Complete output, (m + k,): the robot's joints, then the pass-through axes."""
        return np.concatenate([self.joint, self.carried]) if self.carried.size else self.joint


class CommandPath:
    """Processes the commands to the drives: passes them through or compensates them.

    A command that fails a guard of the compensator is sent uncorrected (`pass_through`), or the
    last good output is sent instead (`hold`; nothing if there is none yet). After a hold, the
    output ramps back to the current commands. A command that is not finite, older than the
    timeout, or beyond a joint limit is never sent, whether compensation is on or off; with
    `clamp`, a command beyond a limit is sent at the limit.

    Pass-through axes are sent as commanded, neither checked nor corrected; after a hold they ramp
    back as the joints do.

    The first output after a reset starts at the position of the drives from `joint_states`, and
    ramps to the commands as after a hold. If the reset came during a hold, nothing is sent until
    this position is known.

    Attributes:
        ramp: the correction applied to the drives, and its rate of change.
        compensator: None before there is a calibration.
        counts: number of commands by the way they were handled.
        trouble: problem with the last command as text; None if it had none.
        echo: the last outputs.
        last_stamp: stamp of the last command [ns]; None before the first.

    Args:
        on_failure: `pass_through` or `hold`.
        ramp_s: time over which a correction fades in or out [s].
        rate: largest rate of a joint's correction [rad/s or m/s]. The correction of backlash steps
            where the motion reverses; the limit keeps this step from the drives.
        timeout_s: largest age [s] of a command that is sent, and largest time by which its stamp
            may lie in the future; 0 for no limit.
        speed: largest speed of a joint on its way back from a hold [rad/s or m/s].
        unit: unit of the joints, for messages.
        limits: lowest and highest angle of each joint, each (m,) [rad]. Neither a command nor its
            correction brings a joint beyond one.
        beyond_limits: treatment of a command beyond a limit, `refuse` or `clamp`.
        at_once_s: longest part [s] of a ramp, or of a rate-limited change, that one output may
            advance: if commands are far apart, each step of the correction is still bounded.
    """

    def __init__(
        self,
        on_failure: str = PASS_THROUGH,
        ramp_s: float = 1.0,
        rate: float = np.inf,
        timeout_s: float = 0.0,
        speed: float = np.inf,
        unit: str = "rad",
        limits: tuple[Array, Array] | None = None,
        beyond_limits: str = REFUSE,
        at_once_s: float = np.inf,
    ) -> None:
        self.ramp, self._unit = Ramp(ramp_s, rate), unit
        self.set_options(on_failure, ramp_s, rate, timeout_s, beyond_limits)
        self._speed, self._limits, self.at_once_s = speed, limits, at_once_s
        self.counts: Counter[str] = Counter()
        self.trouble: str | None = None
        self.compensator: Corrects | None = None
        self._cached: tuple[bytes, Compensated] | None = None
        self._measured: tuple[Sent, float] | None = None  # drives' position, time [s]
        self._carried = _NOTHING  # pass-through axes of the current command
        self._held: Sent | None = None
        self._holding = False  # whether the last output repeated the one before
        self._back: WayBack | None = None
        self._astray = False  # whether the drives were left away from the commands
        self.reset()

    def reset(self) -> None:
        """Forget the past outputs, after a pause of unknown length, and switch compensation off.

        The correction that the drives still have fades out over a ramp.
        """
        self.enabled = False
        self.ramp.restart()
        self._astray = self._astray or self._holding or self._back is not None
        self._held, self._holding, self._back = None, False, None
        self._begins = True  # whether nothing was sent since the reset
        self._interrupted = False  # whether the stream was interrupted since the last output
        self._anothers = False  # whether the last output was corrected by another node
        self.echo = Echo()
        self.last_stamp: int | None = None

    def shadow(self) -> CommandPath:
        """Copy of the path in its present state, for another thread, with all counts at zero."""
        shadow = copy(self)
        shadow.ramp, shadow.counts, shadow.trouble = copy(self.ramp), Counter(), None
        return shadow

    def set_options(
        self,
        on_failure: str,
        ramp_s: float,
        rate: float = np.inf,
        timeout_s: float = 0.0,
        beyond_limits: str = REFUSE,
    ) -> None:
        """Change the failure policy, the limits, and the length of ramps from the next one on.

        Raises:
            InputError: an unknown choice, a negative time, or a rate that is not above zero.
        """
        if on_failure not in ON_FAILURE:
            raise InputError(f"on_failure {on_failure!r}; choose from: {', '.join(ON_FAILURE)}")
        for name, value in (("ramp_s", ramp_s), ("command_timeout_s", timeout_s)):
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} is {value}; it has to be finite and not negative")
        if not rate > 0.0:
            raise InputError(f"max_correction_rate is {rate} {self._unit}/s; it has to be above 0")
        if beyond_limits not in BEYOND_LIMITS:
            allowed = ", ".join(BEYOND_LIMITS)
            raise InputError(f"beyond_limits {beyond_limits!r}; choose from: {allowed}")
        self.on_failure, self.timeout_s = on_failure, timeout_s
        self.beyond_limits = beyond_limits
        self.ramp.seconds, self.ramp.rate = ramp_s, rate

    @property
    def ramp_s(self) -> float:
        """Length of the next ramp [s]."""
        return self.ramp.seconds

    @property
    def loaded(self) -> bool:
        """Whether a calibration is loaded."""
        return self.compensator is not None

    def load(self, compensator: Corrects | None) -> None:
        """Replace the compensator; if compensation is on, its correction is ramped in."""
        self.compensator, self._cached = compensator, None
        self.enabled = self.enabled and compensator is not None

    def enable(self, on: bool) -> None:
        """Switch compensation on or off; its correction fades in or out over the ramp.

        Raises:
            DataError: no calibration is loaded.
        """
        if on and self.compensator is None:
            raise DataError("there is no calibration for compensation: fit or load one first")
        self.enabled = on

    def stand(self, measured: Array, now_s: float, carried: Array = _NOTHING) -> None:
        """Update the position of the drives, (m,) [rad], from `joint_states`.

        `carried` is the position of the pass-through axes, (k,), or empty if not reported.
        """
        self._measured = Sent(measured, False, carried), now_s

    def interrupt(self) -> None:
        """Note an interruption: the output moves to the next command at the joints' speed."""
        self._interrupted = self._held is not None

    def in_time(self, age_s: float) -> bool:
        """Whether the age [s] of a command is within the timeout."""
        return self.timeout_s == 0.0 or abs(age_s) <= self.timeout_s

    def takes(self, q: Array, age_s: float) -> bool:
        """Whether a command (m,) [rad] is finite and its age [s] is within the timeout."""
        return not self._against(q, age_s)

    def send(
        self,
        q: Array,
        stamp_ns: int,
        now_s: float,
        already: bool = False,
        at: Conditions | None = None,
        age_s: float = 0.0,
        carried: Array = _NOTHING,
    ) -> Sent | None:
        """Process a command and return the output to send for it.

        Args:
            q: nominal joint angles, (m,) [rad].
            stamp_ns: stamp of the command [ns].
            now_s: steady time [s], for the ramp.
            already: whether the command is marked as compensated.
            at: conditions of the command, one sample, if the compensator needs them.
            age_s: age of the command at its arrival [s], by the clock of its stamp; NaN if that
                clock is not available.
            carried: positions of the pass-through axes, (k,).

        Returns:
            The output; None if nothing is sent.
        """
        self.trouble, self._carried = None, carried
        self._watch_time(stamp_ns)
        against = self._against(q, age_s)
        if against:
            self.count(against)
            return self._instead()
        inside = self.inside(q)
        if inside is None:
            self.count(BEYOND)
            return self._instead()
        q = inside
        if self._begins and self._astray and self._start(now_s) is None:
            self.count(WAITING)
            return None
        again, self._anothers = self.echo.of(q, already), False
        if already or again is not None:
            self.count(ALREADY if already else ECHO)
            return self._unchanged(q, again, now_s)
        if not self.enabled or self.compensator is None:
            self.counts[PASSED] += 1
            return self._ramped(q, np.zeros_like(q), None, now_s)
        found = self._compensated(self.compensator, q, at)
        verdict = found.verdicts[0]
        if verdict is CommandStatus.CORRECTED:
            self.counts[verdict.value] += 1
            if found.blended(0):
                self.counts[BLENDED] += 1
            return self._ramped(q, found.correction[0], self.compensator, now_s)
        self.count(verdict.value)
        if verdict is CommandStatus.MISSING_CONDITION:
            self.trouble = f"{verdict.value}: {found.missing}"
        if self.on_failure == HOLD:
            return self._instead()
        # A correction blended out to zero at the edge of the region needs no ramp of its own.
        faded = verdict is CommandStatus.OUTSIDE_REGION and found.share is not None
        source = self.compensator if faded else None
        return self._ramped(q, np.zeros_like(q), source, now_s)

    @property
    def steady(self) -> bool:
        """Whether the next command only has to be corrected: no ramp, hold or return is active."""
        back = self._begins or self._holding or self._interrupted or self._back is not None
        return self.enabled and not back and self.ramp.is_over(self.compensator)

    def went(
        self,
        dq: Array,
        joint: Array,
        stamp_ns: int,
        now_s: float,
        blended: bool = False,
        carried: Array = _NOTHING,
    ) -> Sent:
        """Update the state after the fast path (`usual.py`) has sent a command while `steady`.

        Args:
            dq: correction of the command, (m,) [rad].
            joint: output, (m,) [rad]; `echo.kept` has it already.
            stamp_ns: stamp of the command [ns].
            now_s: steady time [s].
            blended: whether only a part of the correction was applied.
            carried: positions of the pass-through axes, (k,).
        """
        self.trouble, self._anothers = None, False
        self.last_stamp = stamp_ns
        self.counts[CommandStatus.CORRECTED.value] += 1
        if blended:
            self.counts[BLENDED] += 1
        self.ramp.stands(dq, now_s)
        self.echo.kept_already(self.ramp.stage)
        self._held = Sent(joint, True, carried)
        return self._held

    def refuse(self, why: str) -> Sent | None:
        """Count a malformed command, and return the output to send instead."""
        self.counts[REFUSED] += 1
        self.trouble = why
        return self._instead()

    def nominal(self, measured: Array) -> Array:
        """Joint angles as upstream should see them: measured (m,) less the applied correction."""
        return measured if self._anothers else measured - self.ramp.applied

    @property
    def applied(self) -> float:
        """Largest correction of a joint in the last output [rad]."""
        return 0.0 if self._anothers else float(np.abs(self.ramp.applied).max())

    def within(self, q: Array, joint: Array) -> Array | None:
        """Clip outputs `joint` of commands q, (..., m) [rad], to the limits; None if unchanged."""
        if self._limits is None:
            return None
        lower, upper = self._limits
        if ((joint >= lower) & (joint <= upper)).all():
            return None
        inside = np.clip(joint, np.minimum(lower, q), np.maximum(upper, q))
        return None if np.array_equal(inside, joint) else inside

    def inside(self, q: Array) -> Array | None:
        """Commands (..., m) within the joint limits; None if one is beyond and policy is `refuse`.

        With `clamp`, commands beyond a limit are set to it and counted.
        """
        if self._limits is None:
            return q
        lower, upper = self._limits
        low, high = lower.tolist(), upper.tolist()
        if all(all(map(_between, low, one, high)) for one in np.atleast_2d(q).tolist()):
            return q
        if self.beyond_limits == REFUSE:
            return None
        self.count(CLAMPED)
        return np.clip(q, lower, upper)

    def _against(self, q: Array, age_s: float) -> str:
        """Reason not to send a command (m,) [rad] of this age [s]; empty if it may be sent."""
        if not _finite(q):
            return CommandStatus.NOT_FINITE.value
        if self.in_time(age_s):
            return ""
        if isfinite(age_s):
            return STALE if age_s > 0.0 else AHEAD
        return AGELESS

    def _watch_time(self, stamp_ns: int) -> None:
        if self.last_stamp is not None and stamp_ns < self.last_stamp:
            self.count(BACKWARD)
        self.last_stamp = stamp_ns

    def count(self, trouble: str) -> None:
        """Count and record a problem with the last command."""
        self.counts[trouble] += 1
        self.trouble = trouble

    def _compensated(self, compensator: Corrects, q: Array, at: Conditions | None) -> Compensated:
        """The compensator's result, cached while command and conditions do not change."""
        key = q.tobytes() + (b"" if at is None else at.fingerprint())
        if self._cached is None or self._cached[0] != key:
            self._cached = (key, compensator.compensate(q[None], at))
        return self._cached[1]

    def _ramped(self, q: Array, goal: Array, source: object, now_s: float) -> Sent:
        before = self.ramp.limited
        dq = self.ramp.toward(goal, source, now_s, self.at_once_s)
        if self.ramp.limited > before:
            self.counts[LIMITED] += 1
        inside = self.within(q, q + dq)
        if inside is not None:
            self.counts[LIMIT] += 1
            dq = self.ramp.applied = inside - q
        return self._go(q, dq, self.enabled or bool(np.any(dq)), now_s)

    def _unchanged(self, q: Array, again: Output | None, now_s: float) -> Sent:
        """Send a command unchanged that this or another compensator has already corrected."""
        if again is None:  # another node's: neither ends a ramp here nor is a start for one
            self._anothers = True
            return self._go(q, np.zeros_like(q), True, now_s)
        self.ramp.resume(again.stage, now_s)
        held = self._held
        if self._holding and held is not None and (again.astray or again.is_at(held.joint)):
            return held  # the commands have not returned yet
        if again.astray:
            self._held = Sent(q, True, self._carried)
            return self._held
        return self._go(q, np.zeros_like(q), True, now_s)

    def _go(self, q: Array, dq: Array, compensated: bool, now_s: float) -> Sent:
        """Send q + dq, or a point on the way back to it from where the drives were held."""
        joint, carried = q + dq, self._carried
        stopped = self._holding or self._interrupted
        stood = self._held if stopped else None
        seconds = self.ramp.seconds if self._holding else 0.0
        if self._begins:
            stood, seconds = self._start(now_s), self.ramp.seconds
            self._begins = self._astray = False
        self._interrupted = False
        if stood is not None:
            self._back = WayBack.over(_gap(stood, joint, carried), now_s, seconds, self._speed)
        if self._back is not None:
            self._back = self._back.by(now_s, self.at_once_s)
            left, m = self._back.left, len(joint)
            joint = joint + left[:m]
            carried = carried + left[m:] if left[m:].shape == carried.shape else carried
            inside = self.within(q, joint)
            joint = joint if inside is None else inside
            self._back = self._back if left.any() else None
        astray = self._back is not None
        if compensated or astray:
            self.echo.sent(Output(joint, self.ramp.stage, astray))
        self._held, self._holding = Sent(joint, compensated, carried), False
        return self._held

    def _start(self, now_s: float) -> Sent | None:
        """Measured position of the drives; None if not known or too old."""
        if self._measured is None or now_s - self._measured[1] > STATES_S:
            return None
        return self._measured[0]

    def _instead(self) -> Sent | None:
        """The last good output if the policy is `hold`; None otherwise."""
        if self.on_failure == HOLD and self._held is not None:
            self.counts[HELD] += 1
            self._holding = True
            return self._held
        self.counts[DROPPED] += 1
        return None


def _gap(stood: Sent, joint: Array, carried: Array) -> Array:
    """Position at which the drives stood less the wanted one, (m + k,).

    Only the joints, (m,), if one of the two does not contain the pass-through axes.
    """
    beside = stood.carried - carried if stood.carried.shape == carried.shape else _NOTHING
    return np.concatenate([stood.joint - joint, beside])


def _between(lower: float, value: float, upper: float) -> bool:
    return lower - _ROUNDING <= value <= upper + _ROUNDING


def _finite(q: Array) -> bool:
    return all(map(isfinite, q.tolist()))  # for three numbers, a third of numpy's time
