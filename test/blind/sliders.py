"""Machines with sliders on columns and struts to a platform: linear Delta, five-axis machine.

A strut is a distance between its joint on the slider and its joint on the platform.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.kind import Index, Kind, More, Span, read
from blind.loops import closed

Array = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class SliderStand:
    """Pose of the platform; joints of the sliders."""

    place: Array  # (n, 3) [m]
    turn: Array  # (n, 3, 3)
    sliders: Array  # (n, m, 3) [m]
    unknown: Array  # (n, k) solution of the closure

    def point(self, local: Array) -> Array:
        return self.place + self.turn @ local

    def take(self, rows: Index) -> SliderStand:
        return SliderStand(
            self.place[rows], self.turn[rows], self.sliders[rows], self.unknown[rows]
        )


@dataclass(frozen=True)
class Build:
    """Struts of a machine, one row each [m]."""

    foot: Array  # (m, 3) joint of the slider at q = 0
    joint: Array  # (m, 3) of the platform, in its frame
    strut: Array  # (m,)
    zero: Array  # (m,)


class Sliders(Kind):
    """Common parts of both machines."""

    way: float  # +1 if a slider goes up with its joint, -1 if down
    kilograms: tuple[float, float] = (0.5, 0.3)  # platform, slider
    heavy = 0.5
    size = 0.3
    rest: float
    gears: Span

    def __init__(self) -> None:
        file = read(self.robot)
        self.joints = tuple(file["joints"]["names"])
        self.rest = 1e-6 * file["joints"]["repeatability_um"]
        self.encoder = 1e-6 * file["joints"]["encoder_um"]
        turns = 2 * np.pi * file["joints"]["gear_ratio_turns_per_m"]
        self.gears = (turns, turns)  # of the screw itself, once or twice a turn
        self.beside = np.full(len(self.joints), 0.015)
        self._draw(file["geometry"], file["tolerances"])

    def _draw(self, geometry: Any, tolerances: Any) -> None:
        raise NotImplementedError

    def _sliders(self, q: Array, build: Build) -> Array:
        return build.foot + self.way * (q + build.zero)[..., None] * _UP

    def masses(
        self, stand: SliderStand, build: Build, payload: Array, centre: Array
    ) -> tuple[Array, Array]:
        where = np.concatenate(
            [stand.place[:, None], stand.point(centre)[:, None], stand.sliders], axis=1
        )
        mass = np.empty(where.shape[:2])
        mass[:, 0], mass[:, 1], mass[:, 2:] = self.kilograms[0], payload, self.kilograms[1]
        return mass, where


class LinearDelta(Sliders):
    """Three carriages and three pairs of equal rods: the platform does not rotate.

    Its joints lie in the platform's centre, because its radius is subtracted from that of the
    columns.
    """

    robot = "linear_delta"
    way = -1.0
    circle: Span = (0.06, 0.10)
    others: tuple[Span, Span] = ((0.05, 0.14), (0.07, 0.06))

    def _draw(self, geometry: Any, tolerances: Any) -> None:
        radius, arm = 1e-3 * geometry["radius_mm"], 1e-3 * geometry["arm_mm"]
        about = np.radians(geometry["angles_deg"])
        top = 1e-3 * geometry["height_mm"] + np.sqrt(arm**2 - radius**2)
        self.feet = np.stack([radius * np.cos(about), radius * np.sin(about), 0 * about + top], 1)
        self.arm = arm
        aside = radius * 1e-3 * tolerances["angle_mrad"]
        flat = max(1e-3 * tolerances["radius_mm"] * 0.7, aside)
        self.expected = {
            "foot": np.array([flat, flat, 1e-3 * tolerances["endstop_mm"]]),
            "joint": 0.0,
            "strut": 1e-3 * tolerances["arm_mm"],
            "zero": 0.0,
        }
        self.rise, self.constant = {"arm": (9.0, 14.0)}, {"arm": (2000.0, 3000.0)}
        self.sensors = ("arm",)
        self.home = self.at(np.array([[0.0, 0.0, 0.1]]))[0]
        self.sweep = 0.06 * np.eye(3)

    def drawing(self) -> Build:
        return Build(self.feet.copy(), np.zeros((3, 3)), np.full(3, self.arm), np.zeros(3))

    def assemble(
        self,
        q: Array,
        build: Build,
        changed: More | None = None,
        near: SliderStand | None = None,
    ) -> SliderStand:
        sliders = self._sliders(q, build)
        strut = build.strut + (0.0 if changed is None else changed.of("strut"))

        def gaps(x: Array) -> Array:
            rods = x[:, None] + build.joint - sliders
            return np.linalg.norm(rods, axis=2) - strut

        start = sliders.mean(axis=1) - 0.9 * self.arm * _UP if near is None else near.unknown
        place = closed(gaps, start)
        upright = np.broadcast_to(np.eye(3), (len(q), 3, 3))
        return SliderStand(place, upright, sliders, place)

    def at(self, points: Array) -> Array:
        """Carriage positions for points, by Pythagoras."""
        flat = points[:, None, :2] - self.feet[:, :2]
        over = np.sqrt(self.arm**2 - np.sum(flat**2, axis=2))
        return self.feet[:, 2] - points[:, 2:] - over

    def places(self, rng: np.random.Generator, count: int) -> Array:
        low, high = [-0.08, -0.08, 0.0], [0.08, 0.08, 0.2]
        return self.at(rng.uniform(low, high, (count, 3)))

    def ring(self, angle: Array, radius: float, level: float) -> Array:
        flat = [radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, level)]
        return np.stack(flat, axis=1)

    def reflector(self, rng: np.random.Generator) -> Array:
        return rng.uniform([-0.03, -0.03, -0.06], [0.03, 0.03, -0.02])


class FiveAxis(Sliders):
    """Four sliders; the platform stays in the plane x = 0 and rotates about x and then about y."""

    robot = "five_axis"
    way = 1.0
    kilograms = (30.0, 8.0)
    heavy = 10.0
    circle: Span = (0.08, 0.0)
    others: tuple[Span, Span] = ((0.06, 0.02), (0.1, -0.02))

    def _draw(self, geometry: Any, tolerances: Any) -> None:
        joints, feet, struts, height = [], [], [], 1e-3 * geometry["height_mm"]
        for pair in ("turning", "hinged"):
            d = {name: 1e-3 * value for name, value in geometry[pair].items()}
            for side in (-1.0, 1.0):
                x, y = d["platform_x_mm"], side * d["platform_y_mm"]
                joints.append([x, y, d["platform_z_mm"]])
                feet.append([d["column_x_mm"], side * d["column_y_mm"], 0.0])
                struts.append(d["strut_mm"])
        self.platform, self.feet, self.struts = map(np.array, (joints, feet, struts))
        self.tip, self.middle = 1e-3 * geometry["tool_mm"], np.array([0.0, height, 0.0, 0.0])
        off = 1e-3 * tolerances["joint_position_mm"]
        self.expected = {"foot": off, "joint": off, "strut": 0.0, "zero": 0.0}
        self.rise = {"base": (3.5, 6.0), "arm": (5.0, 8.0)}
        self.constant = {"base": (3e3, 4.5e3), "arm": (2000.0, 3000.0)}
        self.sensors = ()
        self.home = self._over(self.middle[None])[0]
        self.sweep = 0.05 * np.eye(4)

    def drawing(self) -> Build:
        return Build(self.feet.copy(), self.platform.copy(), self.struts.copy(), np.zeros(4))

    @staticmethod
    def _turns(x: Array) -> tuple[Array, Array]:
        """Rotations of the part that only turns about x, and of the platform, (n, 3, 3) each."""
        (a, b), (c, d) = np.cos(x[:, 2:].T), np.sin(x[:, 2:].T)
        no, one = np.zeros_like(a), np.ones_like(a)
        about_x = np.stack([one, no, no, no, a, -c, no, c, a], axis=1).reshape(-1, 3, 3)
        about_y = np.stack([b, no, d, no, one, no, -d, no, b], axis=1).reshape(-1, 3, 3)
        return about_x, about_x @ about_y

    def _ends(self, x: Array, build: Build) -> Array:
        """Platform joints in the base, (n, 4, 3) [m]."""
        hinged, turning = self._turns(x)
        first = np.einsum("nij,lj->nli", turning, build.joint[:2])
        second = np.einsum("nij,lj->nli", hinged, build.joint[2:])
        centre = np.stack([0.0 * x[:, 0], x[:, 0], x[:, 1]], axis=1)
        return centre[:, None] + np.concatenate([first, second], axis=1)

    def assemble(
        self,
        q: Array,
        build: Build,
        changed: More | None = None,
        near: SliderStand | None = None,
    ) -> SliderStand:
        sliders = self._sliders(q, build)
        strut = build.strut + (0.0 if changed is None else changed.of("strut"))

        def gaps(x: Array) -> Array:
            return np.linalg.norm(self._ends(x, build) - sliders, axis=2) - strut

        start = np.tile(self.middle, (len(q), 1)) if near is None else near.unknown
        x = closed(gaps, start)
        place = np.stack([0.0 * x[:, 0], x[:, 0], x[:, 1]], axis=1)
        return SliderStand(place, self._turns(x)[1], sliders, x)

    def _over(self, x: Array) -> Array:
        """Nominal slider positions for poses y, z, A, B: the first pair above the platform."""
        apart = self._ends(x, self.drawing()) - self.feet
        across2 = np.sum(apart[..., :2] ** 2, axis=2)
        return apart[..., 2] + np.array([1.0, 1.0, -1.0, -1.0]) * np.sqrt(self.struts**2 - across2)

    def places(self, rng: np.random.Generator, count: int) -> Array:
        low = [-0.15, self.middle[1] - 0.1, -0.21, -0.21]
        high = [0.15, self.middle[1] + 0.1, 0.21, 0.21]
        return self._over(rng.uniform(low, high, (count, 4)))

    def at(self, points: Array) -> Array:
        level = np.zeros((len(points), 2))
        return self._over(np.append(points[:, 1:], level, axis=1))

    def ring(self, angle: Array, radius: float, level: float) -> Array:
        """Circle in the plane of the platform's centre."""
        y, z = radius * np.cos(angle), self.middle[1] + level + radius * np.sin(angle)
        return np.stack([np.zeros_like(angle), y, z], axis=1)

    def reflector(self, rng: np.random.Generator) -> Array:
        return np.array([0.0, 0.0, self.tip]) + rng.uniform(-0.03, 0.03, 3)


LINEAR_DELTA, FIVE_AXIS = LinearDelta(), FiveAxis()
