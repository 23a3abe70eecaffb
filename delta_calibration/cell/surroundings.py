"""Under which conditions a command is given: how the joints move, what is carried, how warm it is.

The motion is that of the stream of commands: direction and travel since the last turn for every
joint, in the order in which they come; speed and acceleration by a parabola over the last tenth of
a second, by their stamps. Where stamps do not rise, and across a pause, there is no speed.
"""

from __future__ import annotations

from collections import deque
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.samples import Conditions, Stroke, at_rest
from delta_calibration.samples.motion import TURNED

Array = NDArray[np.float64]

TEMPERATURE_TIMEOUT_S = 300.0  # [s]
_WINDOW = 0.1  # [s] over which speeds are taken
_PAUSE = 0.25  # [s] after which the joints are taken to stand
_FEWEST = 3  # commands for an acceleration
_KEPT = 200


class Surroundings:
    """What is known beside the command itself.

    Args:
        joints: how many there are.
        temperature_timeout_s: age [s] beyond which a temperature is not known any more.
        payload_timeout_s: the same for the payload; 0 for none, as what is on the platform is
            said once and holds.
        joint_size: of the joints' unit, that does what one radian does on a Delta.
    """

    def __init__(
        self,
        joints: int,
        temperature_timeout_s: float = TEMPERATURE_TIMEOUT_S,
        payload_timeout_s: float = 0.0,
        joint_size: float = 1.0,
    ) -> None:
        self.set_timeouts(temperature_timeout_s, payload_timeout_s)
        self._joints, self._turned = joints, TURNED * joint_size
        self._carried: tuple[float, Array, float] | None = None  # [kg], [m], heard at [s]
        self._warm: dict[str, tuple[float, float]] = {}  # part -> celsius, heard at [s]
        self.reset()

    def reset(self) -> None:
        """Forget how the joints moved, as after a pause of unknown length."""
        self._strokes: list[Stroke] = []
        self._past: deque[tuple[int, Array]] = deque(maxlen=_KEPT)

    def set_timeouts(self, temperature_s: float, payload_s: float) -> None:
        """Change how long what was heard is believed [s]."""
        self._temperature_timeout_s = temperature_s
        self._payload_timeout_s = payload_s if payload_s > 0 else np.inf

    def carries(self, mass: float, centre: Array, now_s: float) -> None:
        """Payload [kg] and its centre (3,) [m] in the platform's frame, heard now."""
        self._carried = mass, centre, now_s

    def is_warm(self, part: str, celsius: float, now_s: float) -> None:
        """Temperature of a part, heard now."""
        self._warm[part] = celsius, now_s

    def moved(self, q: Array, stamp_ns: int) -> None:
        """Take notice of a command (m,) [rad]; one that is not newer than the last begins anew."""
        strokes = self._strokes or self._standing(q)
        pairs = zip(strokes, q.tolist(), strict=True)
        self._strokes = [stroke.moved(angle) for stroke, angle in pairs]
        if self._past and not 0 < (stamp_ns - self._past[-1][0]) * 1e-9 <= _PAUSE:
            self._past.clear()
        self._past.append((stamp_ns, q.copy()))
        while len(self._past) > _FEWEST and (stamp_ns - self._past[0][0]) * 1e-9 > _WINDOW:
            self._past.popleft()

    def ahead(self) -> Surroundings:
        """The same, to be moved on without a trace here: for what is commanded in advance."""
        other = copy(self)
        other._past = deque(maxlen=_KEPT)
        return other

    def at(self, q: Array, now_s: float) -> Conditions:
        """The conditions of the command (m,) [rad] that was noticed last, as one sample."""
        velocity, acceleration = self._speeds()
        strokes = self._strokes or self._standing(q)
        parts = tuple(sorted(self._warm))
        mass, centre = self._payload(now_s)
        return replace(
            at_rest(q[None]),
            velocity=velocity[None],
            acceleration=acceleration[None],
            direction=np.array([[stroke.direction for stroke in strokes]]),
            travel=np.array([[s.travel(a) for s, a in zip(strokes, q.tolist(), strict=True)]]),
            payload=np.array([mass]),
            payload_centre=centre[None],
            temperature_parts=parts,
            temperature=np.array([[self._temperature(part, now_s) for part in parts]]),
        )

    def _standing(self, q: Array) -> list[Stroke]:
        """Strokes of joints (m,) [rad] that have not moved yet."""
        return [Stroke(angle, least=self._turned) for angle in q.tolist()]

    def _payload(self, now_s: float) -> tuple[float, Array]:
        if self._carried is None or now_s - self._carried[2] > self._payload_timeout_s:
            return np.nan, np.full(3, np.nan)
        return self._carried[:2]

    def _temperature(self, part: str, now_s: float) -> float:
        celsius, heard = self._warm[part]
        return celsius if now_s - heard <= self._temperature_timeout_s else np.nan

    def _speeds(self) -> tuple[Array, Array]:
        """Speed and acceleration at the last command, each (m,); none where it repeats one."""
        still = np.zeros(self._joints)
        if len(self._past) < 2 or np.array_equal(self._past[-1][1], self._past[-2][1]):
            return still, still
        time = np.array([stamp - self._past[-1][0] for stamp, _ in self._past]) * 1e-9
        angle = np.array([q for _, q in self._past]) - self._past[-1][1]
        # About the last command, and in units of the whole time: well conditioned at any rate.
        span, order = -time[0], min(2, len(time) - 1)
        powers = np.vander(time / span, order + 1, increasing=True)
        terms = np.linalg.lstsq(powers, angle, rcond=None)[0]
        return terms[1] / span, 2 * terms[2] / span**2 if order == 2 else still
