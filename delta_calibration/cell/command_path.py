"""From a joint command to what is sent to the drives, and back from what the encoders say.

    sent = q + dq + gap

dq is the compensator's correction on its ramp (`ramp.py`), or on its way to zero where there is
none. gap is zero but after a hold: then it is the way from where the drives were held to where the
commands are by then. The drives never see a jump that is not in the commands themselves.
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
ECHO = "what was sent, unmarked, commanded again: passed unchanged"
BLENDED = "correction blended out towards the edge of the region"
LIMITED = "correction held to its rate"
LIMIT = "correction held at a joint's limit"
BEYOND = "commanded beyond a joint's limit: refused"
CLAMPED = "commanded beyond a joint's limit: brought to it"
STALE = "older than the timeout"
AHEAD = "stamped farther ahead of the node's clock than the timeout"
AGELESS = "its age is not known: use_sim_time without a /clock"
REFUSED = "refused: malformed"
HELD = "held: the last good command was sent instead"
DROPPED = "dropped: nothing was sent"
BACKWARD = "time went backwards"
WAITING = "waiting for joint_states: deactivated in a hold, and not known where the drives stand"

STATES_S = 0.5  # [s] age beyond which joint_states no longer say where the drives stand

_NOTHING = np.zeros(0)
_ROUNDING = 1e-9  # [rad, m] of a limit that was given in degrees or millimetres


class Corrects(Protocol):
    """What the path asks of a compensator: same command and conditions, same answer."""

    def compensate(self, q: Array, at: Conditions | None = None) -> Compensated:
        """Correct commands, (n, m) [rad], given under these conditions, (n)."""
        ...


@dataclass(frozen=True)
class Sent:
    """What goes to the drives."""

    joint: Array  # (m,) [rad]
    compensated: bool  # to be marked, so that nobody compensates it again
    # (k,) axes that the model passes through, as the command has them
    carried: Array = field(default_factory=lambda: _NOTHING)

    @property
    def whole(self) -> Array:
        """All that is sent, (m + k,): the robot's joints, then what is passed through."""
        return np.concatenate([self.joint, self.carried]) if self.carried.size else self.joint


class CommandPath:
    """State of the way from command to drives: pass-through or compensating.

    What fails a guard of the compensator goes out as it came (`pass_through`) or not at all, the
    last good command in its place (`hold`; nothing, before there is one). After a hold the output
    goes back on a ramp to where the commands are by then. A command that is not finite, older than
    the timeout, or beyond a joint's limit goes out in neither case, compensation on or off; one
    beyond a limit goes out at the limit where that is asked for.

    Axes that the model passes through go out as commanded, neither judged nor corrected; they are
    held, and go back from where they were held, as the joints do.

    The first output after a reset starts where the drives stand by `joint_states`, and goes to
    the commands as after a hold. Where the reset was in a hold, it waits until they say so.

    Attributes:
        ramp: the correction that the drives have, and how fast it changes.
        compensator: None before there is a calibration.
        counts: what was done, and how often.
        trouble: what was wrong with the last command, in words.
        echo: the last outputs.
        last_stamp: of the last command [ns]; None before the first.

    Args:
        on_failure: `pass_through` or `hold`.
        ramp_s: time over which a correction comes and goes [s].
        rate: fastest change of a joint's correction [rad/s or m/s]. A play is corrected by a step
            where the motion turns round; the drives shall not be asked for it at once.
        timeout_s: age [s] beyond which a command is not sent any more, nor one stamped as far
            ahead; 0 for none.
        speed: fastest motion of a joint on its way back from a hold [rad/s or m/s].
        unit: of the joints, for what is told.
        limits: lowest and highest angle of each joint, each (m,) [rad]. Neither a command nor its
            correction brings a joint beyond one.
        beyond_limits: `refuse` or `clamp`, of a command that is beyond one.
        at_once_s: time [s] of a ramp, or of a correction at its rate, that one output makes up
            for: where commands are far apart a correction comes in steps that are bounded.
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
        self._measured: tuple[Sent, float] | None = None  # where the drives stand, and when [s]
        self._carried = _NOTHING  # with the command that is followed
        self._held: Sent | None = None
        self._holding = False  # whether the last output was the one before it again
        self._back: WayBack | None = None
        self._astray = False  # whether the drives were left elsewhere than the commands
        self.reset()

    def reset(self) -> None:
        """Forget what was sent, as after a pause of unknown length; compensation is off.

        The correction that the drives have been left with goes out over a ramp.
        """
        self.enabled = False
        self.ramp.restart()
        self._astray = self._astray or self._holding or self._back is not None
        self._held, self._holding, self._back = None, False, None
        self._begins = True  # whether nothing was sent since
        self._interrupted = False  # whether time was lost since the last output
        self._anothers = False  # whether the last output was corrected by another, and not here
        self.echo = Echo()
        self.last_stamp: int | None = None

    def shadow(self) -> CommandPath:
        """The same path at this moment, for work on another thread; nothing is counted yet."""
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
        """Change what happens on failure, the length of ramps from the next one on, and bounds.

        Raises:
            InputError: no such choice, a negative time, or a rate that is not above zero.
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
        """Whether there is a calibration to compensate by."""
        return self.compensator is not None

    def load(self, compensator: Corrects | None) -> None:
        """Take another compensator; where compensation is on, its correction is ramped in."""
        self.compensator, self._cached = compensator, None
        self.enabled = self.enabled and compensator is not None

    def enable(self, on: bool) -> None:
        """Switch compensation; its correction comes or goes over the ramp.

        Raises:
            DataError: nothing loaded to compensate by.
        """
        if on and self.compensator is None:
            raise DataError("there is no calibration to compensate by: fit or load one first")
        self.enabled = on

    def stand(self, measured: Array, now_s: float, carried: Array = _NOTHING) -> None:
        """Take notice of where the drives stand, (m,) [rad], by `joint_states`.

        And where what is passed through stands, (k,), if they tell.
        """
        self._measured = Sent(measured, False, carried), now_s

    def interrupt(self) -> None:
        """The next command comes after lost time: no jump to it, as fast as the joints may."""
        self._interrupted = self._held is not None

    def in_time(self, age_s: float) -> bool:
        """Whether a command of this age [s] may be sent, as far as that goes."""
        return self.timeout_s == 0.0 or abs(age_s) <= self.timeout_s

    def takes(self, q: Array, age_s: float) -> bool:
        """Whether a command (m,) [rad] of this age [s] may be sent at all."""
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
        """What to send for a command.

        Args:
            q: nominal joint angles, (m,) [rad].
            stamp_ns: of the command.
            now_s: steady time, for the ramp.
            already: whether the command carries the mark of a compensated one.
            at: what the compensator may need to know beside the command, one sample.
            age_s: of the command when it came [s], by a clock that it was stamped by as well; not
                a number where there is no such clock.
            carried: with it, of axes that are passed through, (k,).

        Returns:
            What goes out; None if nothing does.
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
        # One that is blended out to nothing at the edge ends there without a ramp of its own.
        faded = verdict is CommandStatus.OUTSIDE_REGION and found.share is not None
        source = self.compensator if faded else None
        return self._ramped(q, np.zeros_like(q), source, now_s)

    @property
    def steady(self) -> bool:
        """Whether nothing is to be done for the next command but to correct it."""
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
        """Take notice of what a shorter way has sent while `steady`: a command, corrected.

        Args:
            dq: its correction, (m,) [rad].
            joint: what was sent, (m,) [rad]; `echo.kept` has it already.
            stamp_ns: of the command.
            now_s: steady time.
            blended: whether only a part of the correction was applied.
            carried: what was passed through with it, (k,).
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
        """What to send in the place of a command that could not be understood."""
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
        """What is within limits of `joint`, asked for commands q, (..., m) [rad]; None if all."""
        if self._limits is None:
            return None
        lower, upper = self._limits
        if ((joint >= lower) & (joint <= upper)).all():
            return None
        inside = np.clip(joint, np.minimum(lower, q), np.maximum(upper, q))
        return None if np.array_equal(inside, joint) else inside

    def inside(self, q: Array) -> Array | None:
        """Commands (..., m) as far as the joints' limits let them go; None where that is refused.

        What is beyond is counted where it is brought to the limit.
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
        """Why a command (m,) [rad] of this age [s] is not sent at all; empty where it may be."""
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
        """Something was wrong with the last command."""
        self.counts[trouble] += 1
        self.trouble = trouble

    def _compensated(self, compensator: Corrects, q: Array, at: Conditions | None) -> Compensated:
        """The compensator's answer, remembered while command and conditions stand still."""
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
        """Send what has been through here, or through another compensator, as it came."""
        if again is None:  # neither the end of a ramp of ours nor a place to begin from
            self._anothers = True
            return self._go(q, np.zeros_like(q), True, now_s)
        self.ramp.resume(again.stage, now_s)
        held = self._held
        if self._holding and held is not None and (again.astray or again.is_at(held.joint)):
            return held  # the commands are not back yet
        if again.astray:
            self._held = Sent(q, True, self._carried)
            return self._held
        return self._go(q, np.zeros_like(q), True, now_s)

    def _go(self, q: Array, dq: Array, compensated: bool, now_s: float) -> Sent:
        """Send q + dq, or what lies between that and where the drives were held."""
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
        """Where the drives stand; None where nothing recent says it."""
        if self._measured is None or now_s - self._measured[1] > STATES_S:
            return None
        return self._measured[0]

    def _instead(self) -> Sent | None:
        """The last good output when holding; nothing otherwise."""
        if self.on_failure == HOLD and self._held is not None:
            self.counts[HELD] += 1
            self._holding = True
            return self._held
        self.counts[DROPPED] += 1
        return None


def _gap(stood: Sent, joint: Array, carried: Array) -> Array:
    """From where the drives are wanted to where they stood, (m + k,).

    Without the axes that are passed through where either does not tell of them, (m,).
    """
    beside = stood.carried - carried if stood.carried.shape == carried.shape else _NOTHING
    return np.concatenate([stood.joint - joint, beside])


def _between(lower: float, value: float, upper: float) -> bool:
    return lower - _ROUNDING <= value <= upper + _ROUNDING


def _finite(q: Array) -> bool:
    return all(map(isfinite, q.tolist()))  # of three numbers, a third of what numpy takes
