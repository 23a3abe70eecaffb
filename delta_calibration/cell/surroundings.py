"""Under which conditions a command is given: how the joints move, what is carried, how warm it is.

The motion is that of the stream of commands: direction and travel since the last turn for every
joint, speed and acceleration by a parabola over the last tenth of a second.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.samples import Conditions, Stroke, at_rest

Array = NDArray[np.float64]

_WINDOW = 0.1  # [s] over which speeds are taken
_PAUSE = 0.25  # [s] after which the joints are taken to stand
_FEWEST = 3  # commands for an acceleration
_KEPT = 200


class Surroundings:
    """What is known beside the command itself.

    Args:
        joints: how many there are.
        temperature_timeout_s: age [s] beyond which a temperature is not known any more.
    """

    def __init__(self, joints: int, temperature_timeout_s: float = 300.0) -> None:
        self.temperature_timeout_s = temperature_timeout_s
        self._joints = joints
        self._mass, self._centre = np.nan, np.full(3, np.nan)
        self._warm: dict[str, tuple[float, float]] = {}  # part -> celsius, heard at [s]
        self.reset()

    def reset(self) -> None:
        """Forget how the joints moved, as after a pause of unknown length."""
        self._strokes: list[Stroke] | None = None
        self._past: deque[tuple[int, Array]] = deque(maxlen=_KEPT)

    def carries(self, mass: float, centre: Array) -> None:
        """Payload [kg] and its centre (3,) [m] in the platform's frame."""
        self._mass, self._centre = mass, centre

    def is_warm(self, part: str, celsius: float, now_s: float) -> None:
        """Temperature of a part."""
        self._warm[part] = celsius, now_s

    def moved(self, q: Array, stamp_ns: int) -> None:
        """Take notice of a command (m,) [rad]; one that is not newer than the last begins anew."""
        if self._strokes is None:
            self._strokes = [Stroke(float(angle)) for angle in q]
        pairs = zip(self._strokes, q.tolist(), strict=True)
        self._strokes = [stroke.moved(angle) for stroke, angle in pairs]
        if self._past:
            gap = (stamp_ns - self._past[-1][0]) * 1e-9
            if not 0 < gap <= _PAUSE:
                self._past.clear()
        self._past.append((stamp_ns, np.array(q)))
        while len(self._past) > _FEWEST and (stamp_ns - self._past[0][0]) * 1e-9 > _WINDOW:
            self._past.popleft()

    def at(self, q: Array, now_s: float) -> Conditions:
        """The conditions of a command (m,) [rad] given now, as one sample."""
        velocity, acceleration = self._speeds()
        strokes = self._strokes or [Stroke(float(angle)) for angle in q]
        parts = tuple(sorted(self._warm))
        warm = [self._temperature(part, now_s) for part in parts]
        return replace(
            at_rest(q[None]),
            velocity=velocity[None],
            acceleration=acceleration[None],
            direction=np.array([[stroke.direction for stroke in strokes]]),
            travel=np.array([[s.travel(a) for s, a in zip(strokes, q.tolist(), strict=True)]]),
            payload=np.array([self._mass]),
            payload_centre=self._centre[None],
            temperature_parts=parts,
            temperature=np.array([warm]).reshape(1, len(parts)),
        )

    def _temperature(self, part: str, now_s: float) -> float:
        celsius, heard = self._warm[part]
        return celsius if now_s - heard <= self.temperature_timeout_s else np.nan

    def _speeds(self) -> tuple[Array, Array]:
        """Speed and acceleration at the last command, each (m,)."""
        still = np.zeros(self._joints)
        if len(self._past) < 2:
            return still, still
        last = self._past[-1][0]
        time = np.array([(stamp - last) * 1e-9 for stamp, _ in self._past])
        angle = np.array([q for _, q in self._past])
        order = min(2, len(time) - 1)
        terms = np.linalg.lstsq(np.vander(time, order + 1, increasing=True), angle, rcond=None)[0]
        return terms[1], 2 * terms[2] if order == 2 else still
