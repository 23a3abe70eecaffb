"""A cable robot: eight drums let out cable, and the platform takes the pose that fits best.

Cables are measured from anchor to platform joint. With more cables than degrees of freedom real
lengths never fit all at once. The drives hold the tensions near a pretension, and the platform
settles where the sum of squared length errors is smallest. Tensions follow from virtual work: the
work of the cables in a small motion of the platform balances that of its weight, with tensions as
near to the pretension as possible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.kind import Index, Kind, Span, read
from blind.loops import slopes
from blind.machine import turned
from blind.weight import GRAVITY

Array = NDArray[np.float64]

_CLOSED, _MOST = 1e-12, 30


def _after(more: Array, gibbs: Array) -> Array:
    """Gibbs vectors of a rotation by `more` after one by `gibbs`."""
    over = more + gibbs + np.cross(more, gibbs)
    return np.asarray(over / (1 - np.sum(more * gibbs, axis=1, keepdims=True)))


@dataclass(frozen=True)
class Build:
    """Cables, one row each."""

    anchor: Array  # (8, 3) [m]
    joint: Array  # (8, 3) [m] in the platform
    gain: Array  # (8,) [m/rad]
    zero: Array  # (8,) [rad]


@dataclass(frozen=True)
class CableStand:
    """Position and Gibbs vector of the platform."""

    place: Array  # (n, 3) [m]
    gibbs: Array  # (n, 3)

    def point(self, local: Array) -> Array:
        return self.place + turned(self.gibbs, local[None])[:, 0]

    def take(self, rows: Index) -> CableStand:
        return CableStand(self.place[rows], self.gibbs[rows])


class CableRobot(Kind):
    """The robot cdpr8. Plans move a pose: position [m] and Gibbs vector."""

    robot = "cdpr8"
    heavy = 5.0
    centre = np.array([0.0, 0.0, -0.2])
    far: Span = (4.5, 5.2)
    circle: Span = (0.4, 1.25)
    others: tuple[Span, Span] = ((0.3, 1.4), (0.5, 1.1))

    def __init__(self) -> None:
        file = read(self.robot)
        geometry, tolerances = file["geometry"], file["tolerances"]
        self.joints = tuple(file["joints"]["names"])
        self.anchors, self.ends = (
            1e-3 * np.array(geometry[name]) for name in ("anchors_mm", "joints_mm")
        )
        radius, gear, tackle = (
            np.array(geometry[name]) for name in ("drum_radius_mm", "gear", "tackle")
        )
        self.gear, self.gain = gear, 1e-3 * radius / (gear * tackle)
        self.size = 0.3 / float(self.gain.mean())
        self.rest = 1e-6 * file["joints"]["repeatability_urad"]
        self.encoder = 1e-6 * file["joints"]["encoder_urad"]
        self.pretension, self.kilograms = geometry["pretension_n"], file["masses"]["platform_kg"]
        self.home = np.append(1e-3 * np.array(geometry["home_place_mm"]), np.zeros(3))
        self.expected = {
            "anchor": 1e-3 * tolerances["anchor_mm"],
            "joint": 1e-3 * tolerances["joint_mm"],
            "gain": 1e-2 * tolerances["gain_percent"] * self.gain,
            "zero": 0.0,
        }
        self.beside = np.array([0.012, 0.009, 0.016, 0.003, -0.002, 0.004])
        self.sweep = np.diag([0.5, 0.4, 0.3, 0.06, 0.06, 0.06])
        self.rise, self.constant, self.sensors = {"base": (3.5, 6.0)}, {"base": (3e3, 4.5e3)}, ()

    def drawing(self) -> Build:
        return Build(self.anchors.copy(), self.ends.copy(), self.gain.copy(), np.zeros(8))

    def away(self, x: Array, build: Build) -> Array:
        """Vectors from anchors to platform joints at poses (n, 6), (n, 8, 3) [m]."""
        return x[:, None, :3] + turned(x[:, 3:], build.joint) - build.anchor

    def command(self, u: Array) -> Array:
        d = self.drawing()
        here, home = (np.linalg.norm(self.away(x, d), axis=2) for x in (u, self.home[None]))
        return (here - home) / d.gain

    def assemble(
        self, q: Array, build: Build, changed: Any = None, near: CableStand | None = None
    ) -> CableStand:
        at_home = np.linalg.norm(self.away(self.home[None], build), axis=2)
        more, turned_by = (
            0.0 if changed is None else changed.of(part) for part in ("cable", "direction")
        )
        let_out = at_home + build.gain * (q + build.zero) + more

        place, gibbs = np.tile(self.home[:3], (len(q), 1)), np.zeros((len(q), 3))
        if near is not None:
            place, gibbs = near.place, near.gibbs
        for _ in range(_MOST):
            arms = turned(gibbs, build.joint)
            cable = place[:, None] + arms - build.anchor
            length = np.linalg.norm(cable, axis=2)
            unit = cable / length[..., None] + turned_by  # along which the cable pulls
            slope = np.concatenate([unit, 2 * np.cross(arms, unit)], axis=2)
            across = np.swapaxes(slope, 1, 2)
            short = across @ (let_out - length)[..., None]
            step = np.linalg.solve(across @ slope, short)[..., 0]
            place, gibbs = place + step[:, :3], _after(step[:, 3:], gibbs)
            if np.abs(step).max() < _CLOSED:
                return CableStand(place, gibbs)
        raise ArithmeticError(f"the cables do not fit: last step {np.abs(step).max():.1e}")

    def masses(
        self, stand: CableStand, build: Build, payload: Array, centre: Array
    ) -> tuple[Array, Array]:
        where = np.stack([stand.place, stand.point(centre)], axis=1)
        return np.stack([np.full(len(payload), self.kilograms), payload], axis=1), where

    def pulls(
        self, q: Array, build: Build, changed: Any, payload: Array, centre: Array, near: CableStand
    ) -> Array:
        """Tensions by virtual work at the pose `near`, (n, 8) [N]."""
        return self.tensions(np.append(near.place, near.gibbs, axis=1), build, payload, centre)

    def tensions(
        self, x: Array, build: Build, payload: Array, centre: Array, kept: Array | None = None
    ) -> Array:
        """Tensions at poses (n, 6) and a pretension (n, 8), (n, 8) [N]."""

        def works(at: Array) -> Array:
            stand = CableStand(at[:, :3], at[:, 3:])
            mass, where = self.masses(stand, build, payload, centre)
            lifted = GRAVITY * np.sum(mass * where[..., 2], axis=1, keepdims=True)
            return np.append(np.linalg.norm(self.away(at, build), axis=2), lifted, axis=1)

        slope = slopes(works, x)
        lengths, weight = slope[:, :8], slope[:, 8]
        # sum_i T_i dl_i = -dE for every direction of motion of the platform
        kept = np.full((len(x), 8), self.pretension) if kept is None else kept
        short = -weight - np.einsum("nck,nc->nk", lengths, kept)
        return kept + np.einsum("nck,nk->nc", np.linalg.pinv(np.swapaxes(lengths, 1, 2)), short)

    def places(self, rng: np.random.Generator, count: int) -> Array:
        box, turn = np.array([0.7, 0.5, 0.35]), np.tan(np.radians(8.0) / 2)
        where = self.home[:3] + rng.uniform(-box, box, (count, 3))
        return np.append(where, rng.uniform(-turn / 2, turn / 2, (count, 3)), axis=1)

    def at(self, points: Array) -> Array:
        return np.append(points, np.zeros_like(points), axis=1)

    def ring(self, angle: Array, radius: float, level: float) -> Array:
        flat = [radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, level)]
        return np.stack(flat, axis=1)

    def reflector(self, rng: np.random.Generator) -> Array:
        return rng.uniform(-0.04, 0.04, 3)


CDPR8 = CableRobot()
