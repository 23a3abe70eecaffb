"""Causes hidden in the measurement: reflector, air, stand and clock of the tracker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from blind.cause import Cause, Draw
from blind.world import State, World

Array = NDArray[np.float64]

_OFFSET = 0.1  # [m]
_AIR = 20e-6
_STAND = 60e-6  # [m] in two hours
_YAW = 20e-6  # [rad] in two hours
_CLOCK = 3e-3  # [s]


def _any_way(rng: np.random.Generator) -> Array:
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


def smr_offset(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The reflector is at another place on the platform; visible where the platform tilts."""
    offset = strength * _OFFSET * _any_way(rng)

    def act(world: World, state: State) -> None:
        state.offset = offset

    return Cause("smr_offset", act, dict(zip("xyz", offset.tolist(), strict=True)))


def tracker_scale(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The wavelength in air of other density: every distance is too long, or too short."""
    scale = float(strength * _AIR * rng.choice([-1.0, 1.0]))

    def act(world: World, state: State) -> None:
        state.distortions += (lambda reading, time: reading / (1 - scale),)

    return Cause("tracker_scale", act, {"scale": scale})


def tracker_drift(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The stand of the tracker moves: steadily, or settling towards an end."""
    shift, turn = strength * _STAND * _any_way(rng), strength * _YAW * _any_way(rng)
    settles = bool(rng.random() < 0.5)
    constant = float(rng.uniform(1200, 3600)) if settles else np.inf

    def distort(reading: Array, time: Array) -> Array:
        share = 1 - np.exp(-time / constant) if settles else time / 7200
        stand = Rotation.from_rotvec(share[:, None] * turn)
        return stand.apply(reading - share[:, None] * shift)

    def act(world: World, state: State) -> None:
        state.distortions += (distort,)

    return Cause("tracker_drift", act, {"constant": constant, "shift": strength * _STAND})


def timestamp_latency(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The clock of the tracker is off: a reading belongs to a moment before or after its stamp."""
    late = float(strength * _CLOCK * rng.choice([-1.0, 1.0]))

    def act(world: World, state: State) -> None:
        state.late += late

    return Cause("timestamp_latency", act, {"latency": late})


MEASUREMENT: dict[str, Draw] = {
    "smr_offset": smr_offset,
    "tracker_scale": tracker_scale,
    "tracker_drift": tracker_drift,
    "timestamp_latency": timestamp_latency,
}
