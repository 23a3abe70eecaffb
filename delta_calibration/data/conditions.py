"""Conditions of each sample: all quantities that an effect may depend on."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError

Array = NDArray[np.float64]

SAME_PAYLOAD = 1e-3  # [kg] a smaller change of the payload is none


@dataclass(frozen=True)
class Conditions:
    """Joint angles of n samples and the conditions under which they were taken.

    `direction` is the sign of each joint's last motion, 0 if unknown; `travel` is the joint's
    distance from its last reversal, infinite if unknown. Quantities that were not recorded are
    NaN. `reading` with its velocity and acceleration is the tracker's: as measured, or as the
    chain predicts it before its last stage.
    """

    joint: Array  # (n, m) [rad] by the encoders
    time: Array  # (n,) [s]
    velocity: Array  # (n, m) [rad/s]
    acceleration: Array  # (n, m) [rad/s^2]
    direction: Array  # (n, m) -1, 0, 1
    travel: Array  # (n, m) [rad]
    payload: Array  # (n,) [kg]
    payload_centre: Array  # (n, 3) [m] in the platform's frame
    temperature_parts: tuple[str, ...]
    temperature: Array  # (n, parts) [deg C]
    reading: Array  # (n, 3) [m] in the tracker's frame
    reading_velocity: Array  # (n, 3) [m/s]
    reading_acceleration: Array  # (n, 3) [m/s^2]

    def __len__(self) -> int:
        return len(self.joint)

    def take(self, rows: NDArray[Any] | slice) -> Conditions:
        """Some of the samples."""
        return replace(self, **{name: getattr(self, name)[rows] for name in _ARRAYS})

    def fingerprint(self) -> bytes:
        """Key of the conditions that is equal if all but the times are equal."""
        rest = [getattr(self, name).tobytes() for name in _ARRAYS if name != "time"]
        return b"".join([*rest, *(part.encode() for part in self.temperature_parts)])

    def of_part(self, part: str) -> Array:
        """Temperature of a part, (n,) [deg C].

        Raises:
            InputError: no sensor of that name was recorded.
        """
        if part not in self.temperature_parts:
            known = ", ".join(self.temperature_parts) or "none"
            raise InputError(f"no temperature of part {part!r}; recorded: {known}")
        return np.asarray(self.temperature[:, self.temperature_parts.index(part)])


def at_rest(joint: Array) -> Conditions:
    """Return the conditions of joints (n, m) [rad] at rest, all else being unknown."""
    n, m = joint.shape
    still, unknown = np.zeros((n, m)), np.full(n, np.nan)
    return Conditions(
        joint=joint,
        time=np.zeros(n),
        velocity=still,
        acceleration=still,
        direction=still,
        travel=np.full((n, m), np.inf),
        payload=unknown,
        payload_centre=np.full((n, 3), np.nan),
        temperature_parts=(),
        temperature=np.zeros((n, 0)),
        reading=np.full((n, 3), np.nan),
        reading_velocity=np.zeros((n, 3)),
        reading_acceleration=np.zeros((n, 3)),
    )


def joined(first: Conditions, *others: Conditions) -> Conditions:
    """Concatenate the samples of all, which must have the same sensors."""
    parts = (first, *others)
    together: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS
    }
    return replace(first, **together)


_ARRAYS = tuple(f.name for f in fields(Conditions) if f.name != "temperature_parts")
