"""From a joint command to what is sent to the drives, and back from what the encoders say.

    sent = q + dq,    dq(t) = (1 - s) dq_0 + s dq*(q),    s = (t - t_0) / ramp, within [0, 1]

dq* is the compensator's correction, or zero where there is none. Whenever that changes (switched
on or off, another calibration, the edge of the region) a new ramp begins at t_0 from dq_0, the
correction that was applied last: the drives never see a jump of it. Where dq* itself steps, as
that of a play does when the motion turns round, |d(dq)/dt| has a bound.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation import Compensated, Verdict
from delta_calibration.errors import DataError, InputError
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]

PASS_THROUGH, HOLD = "pass_through", "hold"
ON_FAILURE = (PASS_THROUGH, HOLD)

PASSED = "passed through"
ALREADY = "already compensated, passed unchanged"
REFUSED = "refused: malformed"
HELD = "held: the last good command was sent instead"
DROPPED = "dropped: nothing was sent"
BACKWARD = "time went backwards"


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


class CommandPath:
    """State of the way from command to drives: pass-through or compensating.

    What fails a guard of the compensator goes out as it came (`pass_through`) or not at all, the
    last good command in its place (`hold`; nothing, before there is one). After a hold the path
    goes on from wherever the commands are by then. A command that is not finite goes out in
    neither case.

    Args:
        on_failure: `pass_through` or `hold`.
        ramp_s: time over which a correction comes and goes [s].
        rate: fastest change of a joint's correction [rad/s]. A play is corrected by a step where
            the motion turns round; the drives shall not be asked for it at once.
    """

    def __init__(
        self, on_failure: str = PASS_THROUGH, ramp_s: float = 1.0, rate: float = np.inf
    ) -> None:
        self.set_options(on_failure, ramp_s, rate)
        self.counts: Counter[str] = Counter()
        self.trouble: str | None = None  # what was wrong with the last command, in words
        self._compensator: Corrects | None = None
        self._cached: tuple[bytes, Compensated] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget what was sent, as after a pause of unknown length; compensation is off."""
        self.enabled = False
        self._held: Sent | None = None
        self._applied: Array | float = 0.0  # (m,) [rad] correction in the last output
        self._source: object = None  # what the correction comes from, None for none
        self._from: Array | float = 0.0
        self._since_s, self._ramp = -np.inf, 0.0  # [s]
        self._last_stamp: int | None = None
        self._last_s = -np.inf  # [s] of the last output

    def set_options(self, on_failure: str, ramp_s: float, rate: float = np.inf) -> None:
        """Change what happens on failure, the length of ramps from the next one on, and the rate.

        Raises:
            InputError: no such choice, a negative time, or a rate that is not above zero.
        """
        if on_failure not in ON_FAILURE:
            raise InputError(f"on_failure {on_failure!r}; choose from: {', '.join(ON_FAILURE)}")
        if not (np.isfinite(ramp_s) and ramp_s >= 0.0):
            raise InputError(f"ramp_s is {ramp_s}; it has to be finite and not negative")
        if not rate > 0.0:
            raise InputError(f"max_correction_rate is {rate} rad/s; it has to be above 0")
        self.on_failure, self.ramp_s, self.rate = on_failure, ramp_s, rate

    @property
    def loaded(self) -> bool:
        """Whether there is a calibration to compensate by."""
        return self._compensator is not None

    def load(self, compensator: Corrects | None) -> None:
        """Take another compensator; where compensation is on, its correction is ramped in."""
        self._compensator, self._cached = compensator, None
        self.enabled = self.enabled and compensator is not None

    def enable(self, on: bool) -> None:
        """Switch compensation; its correction comes or goes over the ramp.

        Raises:
            DataError: nothing loaded to compensate by.
        """
        if on and self._compensator is None:
            raise DataError("there is no calibration to compensate by: fit or load one first")
        self.enabled = on

    def send(
        self,
        q: Array,
        stamp_ns: int,
        now_s: float,
        already: bool = False,
        at: Conditions | None = None,
    ) -> Sent | None:
        """What to send for a command.

        Args:
            q: nominal joint angles, (m,) [rad].
            stamp_ns: of the command.
            now_s: steady time, for the ramp.
            already: whether the command carries the mark of a compensated one.
            at: what the compensator may need to know beside the command, one sample.

        Returns:
            What goes out; None if nothing does.
        """
        self.trouble = None
        self._watch_time(stamp_ns)
        if not np.isfinite(q).all():
            self._count(Verdict.NOT_FINITE.value)
            return self._instead()
        if already:
            self._count(ALREADY)
            return self._remember(Sent(q, True), 0.0, None)
        if not self.enabled or self._compensator is None:
            self.counts[PASSED] += 1
            return self._ramped(q, np.zeros_like(q), None, now_s)
        found = self._compensated(self._compensator, q, at)
        verdict = found.verdicts[0]
        if verdict is Verdict.CORRECTED:
            self.counts[verdict.value] += 1
            return self._ramped(q, found.correction[0], self._compensator, now_s)
        self._count(verdict.value)
        if verdict is Verdict.MISSING_CONDITION:
            self.trouble = f"{verdict.value}: {found.missing}"
        if self.on_failure == HOLD:
            return self._instead()
        return self._ramped(q, np.zeros_like(q), None, now_s)

    def refuse(self, why: str) -> Sent | None:
        """What to send in the place of a command that could not be understood."""
        self.counts[REFUSED] += 1
        self.trouble = why
        return self._instead()

    def nominal(self, measured: Array) -> Array:
        """Joint angles as upstream should see them: measured (m,) less the applied correction."""
        return measured - self._applied

    @property
    def applied(self) -> float:
        """Largest correction of a joint in the last output [rad]."""
        return float(np.abs(self._applied).max())

    def _watch_time(self, stamp_ns: int) -> None:
        if self._last_stamp is not None and stamp_ns < self._last_stamp:
            self._count(BACKWARD)
        self._last_stamp = stamp_ns

    def _count(self, trouble: str) -> None:
        self.counts[trouble] += 1
        self.trouble = trouble

    def _compensated(self, compensator: Corrects, q: Array, at: Conditions | None) -> Compensated:
        """The compensator's answer, remembered while command and conditions stand still."""
        key = q.tobytes() + (b"" if at is None else at.fingerprint())
        if self._cached is None or self._cached[0] != key:
            self._cached = (key, compensator.compensate(q[None], at))
        return self._cached[1]

    def _ramped(self, q: Array, goal: Array, source: object, now_s: float) -> Sent:
        if source is not self._source:
            self._from, self._since_s = self._applied, now_s
            self._ramp = self.ramp_s
        share = 1.0
        if now_s < self._since_s + self._ramp:
            share = max(now_s - self._since_s, 0.0) / self._ramp
        dq = (1.0 - share) * self._from + share * goal
        if np.isfinite(self.rate):
            step = self.rate * max(now_s - self._last_s, 0.0)
            dq = np.clip(dq, self._applied - step, self._applied + step)
        self._last_s = now_s
        return self._remember(Sent(q + dq, self.enabled or bool(np.any(dq))), dq, source)

    def _remember(self, sent: Sent, correction: Array | float, source: object) -> Sent:
        self._held, self._applied, self._source = sent, correction, source
        return sent

    def _instead(self) -> Sent | None:
        """The last good output when holding; nothing otherwise."""
        if self.on_failure == HOLD and self._held is not None:
            self.counts[HELD] += 1
            return self._held
        self.counts[DROPPED] += 1
        return None
