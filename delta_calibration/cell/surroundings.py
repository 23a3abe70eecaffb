"""Conditions under which a command is given: joint motion, payload and temperatures.

The motion is derived from the stream of commands: for every joint direction and travel since the
last reversal, in order of arrival; speed and acceleration from a parabola over the last tenth of a
second of stamps. If stamps do not rise, or after a pause, speed and acceleration are zero.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell import motion_kernel
from delta_calibration.cell.motion_kernel import motion
from delta_calibration.data import Conditions, at_rest
from delta_calibration.data.motion import TURNED
from delta_calibration.errors import InputError

Array = NDArray[np.float64]

TEMPERATURE_TIMEOUT_S = 300.0  # [s]
MOST_PARTS = 100  # parts with a temperature; limited because any peer can name new ones


@dataclass(frozen=True)
class Known:
    """Known conditions other than the motion; NaN if unknown."""

    payload: float  # [kg]
    payload_centre: Array  # (3,) [m] in the platform's frame
    parts: tuple[str, ...]
    temperature: Array  # (parts,) [deg C]
    until_s: float  # steady time [s] after which some value is too old


class Surroundings:
    """Collects the conditions of the commands: motion, payload and temperatures.

    Args:
        joints: number of joints.
        temperature_timeout_s: age [s] beyond which a temperature counts as unknown.
        payload_timeout_s: the same for the payload; 0 for no limit, because a payload is sent once
            and stays valid.
        joint_size: joint displacement equivalent to one radian on a Delta, in the joints' unit.
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
        """Forget the past motion, after a pause of unknown length."""
        self.motion = motion(self._joints, self._turned)

    def set_timeouts(self, temperature_s: float, payload_s: float) -> None:
        """Change the ages beyond which temperatures and the payload count as unknown [s]."""
        self._temperature_timeout_s = temperature_s
        self._payload_timeout_s = payload_s if payload_s > 0 else np.inf
        self._known: Known | None = None

    def carries(self, mass: float, centre: Array, now_s: float) -> None:
        """Take a payload [kg] and its centre of mass (3,) [m] in the platform's frame."""
        self._carried, self._known = (mass, centre, now_s), None

    def is_warm(self, part: str, celsius: float, now_s: float) -> None:
        """Take the temperature of a part [deg C].

        Raises:
            InputError: a new part, but `MOST_PARTS` others already have a temperature.
        """
        if part not in self._warm and len(self._warm) >= MOST_PARTS:
            raise InputError(
                f"temperature of {part!r}: ignored, because {MOST_PARTS} other parts have one, "
                "which is the limit"
            )
        self._warm[part], self._known = (celsius, now_s), None

    def moved(self, q: Array, stamp_ns: int) -> None:
        """Take a command (m,) [rad]; speeds restart if its stamp is not newer or after a pause."""
        motion_kernel.notice(self.motion, q, stamp_ns)

    def ahead(self) -> Surroundings:
        """Copy whose motion advances independently, for points commanded in advance."""
        other = copy(self)
        other.motion = motion_kernel.apart(self.motion)
        return other

    def at(self, q: Array, now_s: float) -> Conditions:
        """Conditions of the command (m,) [rad] taken last, as one sample."""
        state, known = np.empty((4, len(q))), self.known(now_s)
        motion_kernel.state(self.motion, q, state)
        velocity, acceleration, direction, travel = state[:, None]
        return replace(
            at_rest(q[None]),
            velocity=velocity,
            acceleration=acceleration,
            direction=direction,
            travel=travel,
            payload=np.array([known.payload]),
            payload_centre=known.payload_centre[None],
            temperature_parts=known.parts,
            temperature=known.temperature[None],
        )

    def known(self, now_s: float) -> Known:
        """Conditions other than the motion at a steady time; the same object while unchanged."""
        if self._known is None or now_s > self._known.until_s:
            self._known = self._known_at(now_s)
        return self._known

    def _known_at(self, now_s: float) -> Known:
        parts, until = tuple(sorted(self._warm)), [np.inf]
        temperature = np.full(len(parts), np.nan)
        for k, part in enumerate(parts):
            celsius, heard = self._warm[part]
            if now_s <= heard + self._temperature_timeout_s:
                temperature[k] = celsius
                until.append(heard + self._temperature_timeout_s)
        mass, centre = np.nan, np.full(3, np.nan)
        if self._carried and now_s <= self._carried[2] + self._payload_timeout_s:
            mass, centre = self._carried[:2]
            until.append(self._carried[2] + self._payload_timeout_s)
        return Known(mass, centre, parts, temperature, min(until))
