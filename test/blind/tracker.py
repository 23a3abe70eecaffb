"""A tracker three metres away, a reflector on the platform, and the errors of the measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from blind.delta import DELTA
from blind.kind import Kind
from blind.world import State, World

Array = NDArray[np.float64]

_RADIAL, _ACROSS, _PER_METRE = 3e-6, 2e-6, 2e-6  # [m], [m], [m/m]
_GROSS, _CLIPPED = 0.0008, 1.5e-3  # share of gross errors, and their size per axis [m]


@dataclass(frozen=True)
class Tracker:
    """Position of the tracker relative to the base, and of the reflector on the platform."""

    turn: Rotation  # base to tracker
    place: Array  # (3,) [m] of the base in the tracker's frame
    reflector: Array  # (3,) [m] in the platform's frame

    @classmethod
    def drawn(cls, rng: np.random.Generator, kind: Kind = DELTA) -> Tracker:
        """Draw a station around the cell, level to about a degree, and a reflector off-centre."""
        bearing, far = rng.uniform(0, 2 * np.pi), rng.uniform(*kind.far)
        turn = Rotation.from_euler("zyx", [rng.uniform(0, 2 * np.pi), *rng.normal(0, 0.02, 2)])
        where = np.array([far * np.cos(bearing), far * np.sin(bearing), rng.uniform(-0.3, 0.5)])
        return cls(turn, -turn.apply(where), kind.reflector(rng))

    def sees(self, world: World, state: State) -> Array:
        """Readings without noise, (n, 3) [m]."""
        stand = world.kind.assemble(state.joint, world.build, state.changed, world.stand)
        local = self.reflector if state.offset is None else self.reflector + state.offset
        reading = self.turn.apply(stand.point(local) + state.shift) + self.place
        if state.late:
            reading = _older(world, reading, state.late)
        for distortion in state.distortions:
            reading = distortion(reading, world.time)
        return reading

    def noise(self, reading: Array, rng: np.random.Generator) -> Array:
        """Noise: small along the beam, growing with distance across it; a few gross errors."""
        distance = np.linalg.norm(reading, axis=1, keepdims=True)
        beam = reading / distance
        raw = rng.standard_normal(reading.shape)
        along = np.sum(raw * beam, axis=1, keepdims=True) * beam
        noise = _RADIAL * along + (_ACROSS + _PER_METRE * distance) * (raw - along)
        gross = rng.random(len(reading)) < _GROSS
        return noise + gross[:, None] * _CLIPPED * rng.standard_normal(reading.shape)


def _older(world: World, reading: Array, late: float) -> Array:
    """Readings from a time `late` before each stamp, motion by motion."""
    result = reading.copy()
    for number in range(len(world.items)):
        rows = np.flatnonzero(world.item == number)
        time = world.time[rows]
        course = CubicSpline(time, reading[rows], bc_type="clamped")  # from rest to rest
        result[rows] = course(np.clip(time - late, time[0], time[-1]))
    return result
