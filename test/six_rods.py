"""A rotary Delta of six separate rods and a tracker, sharing no code with the package.

Ball joints are points in space, a rod is a distance between two of them, and the platform is where
six distances agree: Newton's method with rotations applied from the left. Only the names of the
errors of a machine are those of the package, so that errors can be set by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.data import Poses, Rejected

Array = NDArray[np.float64]

BASE, PLATFORM, ARM, ROD, HALF = 0.2, 0.055, 0.32, 0.85, 0.04  # [m] SRBD
TURN = Rotation.from_rotvec([0.01, -0.02, 2.2])  # of the tracker against the base
LEGS, SIDES = (1, 2, 3), {"a": -1.0, "b": 1.0}
REPEATABILITY = 12e-6  # [rad]
RADIAL, TRANSVERSE, PER_METRE = 3e-6, 2e-6, 2e-6  # [m], [m], [m/m]


class SixRods:
    """A machine with `errors` added to its nominal dimensions, by name; [m] and [rad]."""

    def __init__(self, errors: Mapping[str, float] | None = None) -> None:
        self.errors = dict(errors or {})
        unused = set(self.errors)

        def wrong(name: str) -> float:
            unused.discard(name)
            return self.errors.get(name, 0.0)

        def tilted(part: str, leg: int) -> Rotation:
            return Rotation.from_rotvec(
                [wrong(f"{part}_tilt_x_{leg}"), 0, wrong(f"{part}_tilt_z_{leg}")]
            )

        def place(part: str, leg: int, radius: float) -> Array:
            errors = [wrong(f"{part}_{axis}_{leg}") for axis in ("radial", "tangential", "height")]
            return np.array([radius, 0.0, 0.0]) + errors

        self.turn, self.hinge, self.tilt, self.zero, self.arm = [], [], [], [], []
        self.elbow, platform, length = [], [], []
        for leg in LEGS:
            turn = Rotation.from_euler("z", 120.0 * (leg - 1), degrees=True)
            self.turn.append(turn)
            self.hinge.append(place("base", leg, BASE))
            self.tilt.append(tilted("hinge", leg))
            self.zero.append(wrong(f"joint_zero_{leg}"))
            self.arm.append(ARM + wrong(f"arm_{leg}"))
            kept = tilted("elbow_line", leg)
            on_arm = tilted("elbow_line_on_arm", leg).apply([0.0, 1.0, 0.0])
            line = tilted("platform_line", leg).apply([0.0, 1.0, 0.0])
            middle = place("platform", leg, PLATFORM)
            for name, side in SIDES.items():
                half = HALF + wrong(f"elbow_half_width_{leg}{name}")
                self.elbow.append((kept, side * half * on_arm))
                half = HALF + wrong(f"platform_half_width_{leg}{name}")
                platform.append(turn.apply(middle + side * half * line))
                length.append(ROD + wrong(f"rod_{leg}") + side * wrong(f"rod_mismatch_{leg}") / 2)
        self.platform, self.length = np.array(platform), np.array(length)
        assert not unused, f"no such error: {unused}"

    def elbows(self, q: Array) -> Array:
        """Ball joints at the elbows, (n, 6, 3)."""
        balls = []
        for row in range(6):
            leg = row // 2
            angle = q[:, leg] + self.zero[leg]
            arm = self.arm[leg] * np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
            kept, ball = self.elbow[row]
            aside = kept.apply(Rotation.from_rotvec(np.outer(angle, [0, 1, 0])).apply(ball))
            in_leg = self.hinge[leg] + self.tilt[leg].apply(arm + aside)
            balls.append(self.turn[leg].apply(in_leg))
        return np.stack(balls, axis=1)

    def pose(self, q: Array) -> tuple[Array, Rotation]:
        """Centre (n, 3) and orientation of the platform."""
        elbows, n = self.elbows(q), len(q)
        centre, turn = np.tile([0.0, 0.0, -0.9], (n, 1)), Rotation.identity(n)
        for _ in range(40):
            balls = np.stack([turn.apply(ball) for ball in self.platform], axis=1)
            rods = centre[:, None] + balls - elbows
            gap = np.sum(rods**2, axis=2) - self.length**2
            slope = 2 * np.concatenate([rods, np.cross(balls, rods)], axis=2)
            step = np.linalg.solve(slope, -gap[..., None])[..., 0]
            centre = centre + step[:, :3]
            turn = Rotation.from_rotvec(step[:, 3:]) * turn
            if np.abs(step).max() < 1e-14:
                break
        assert np.abs(gap).max() < 1e-12
        assert (centre[:, 2] < -0.3).all()
        return centre, turn

    def point(self, q: Array, offset: Array | tuple[float, float, float] = (0, 0, 0)) -> Array:
        """A point of the platform in the base, (n, 3)."""
        centre, turn = self.pose(q)
        return centre + turn.apply(np.asarray(offset, dtype=float))


@dataclass(frozen=True)
class Cell:
    """A machine, the reflector on it, and a tracker."""

    machine: SixRods
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: Rotation = TURN
    place: tuple[float, float, float] = (-2.4, 1.7, 0.4)

    def reading(self, q: Array) -> Array:
        """Noise-free tracker reading of the reflector, (n, 3)."""
        return self.turn.apply(self.machine.point(q, self.offset)) + self.place

    def measure(
        self,
        q: Array,
        rng: np.random.Generator,
        *,
        count: int = 21,
        repeatability: float = REPEATABILITY,
        noise: float = 1.0,
        direction: Array | None = None,
    ) -> Poses:
        """Poses at commands q, as from a session; `noise` is a factor on the known noise."""
        true = self.reading(q + repeatability * rng.standard_normal(q.shape))
        distance = np.linalg.norm(true, axis=1)[:, None, None]
        beam = true[:, None] / distance
        raw = rng.standard_normal((len(q), count, 3))
        along = np.sum(raw * beam, axis=2, keepdims=True) * beam
        errors = noise * (RADIAL * along + (TRANSVERSE + PER_METRE * distance) * (raw - along))
        deviation = errors - errors.mean(axis=1, keepdims=True)
        scatter = np.full((len(q), 3, 3), np.nan)
        if count > 1:
            scatter = np.einsum("nci,ncj->nij", deviation, deviation) / (count - 1)
        return poses_of(q, true + errors.mean(axis=1), scatter, count, direction)


def poses_of(
    q: Array, point: Array, scatter: Array, count: int, direction: Array | None = None
) -> Poses:
    """The package's form of poses, with exact encoders; equal commands are one place."""
    n = len(q)
    direction = np.ones((n, 3)) if direction is None else direction
    _, place = np.unique(q, axis=0, return_inverse=True)
    _, repeat = np.unique(np.column_stack([q, direction]), axis=0, return_inverse=True)
    return Poses(
        source="made",
        start_ns=0,
        time=np.arange(n) * 2.0,
        joint=q.copy(),
        command=q.copy(),
        point=point,
        quaternion=None,
        count=np.full(n, count),
        scatter=scatter,
        direction=direction,
        travel=np.full_like(direction, np.inf),
        payload=np.zeros(n),
        payload_centre=np.zeros((n, 3)),
        temperature_parts=(),
        temperature=np.zeros((n, 0)),
        place=place.reshape(-1),
        repeat=repeat.reshape(-1),
        readings=n * count,
        duration=2.0 * n,
        rejected=Rejected(),
        notes=(),
    )


def workspace(n: int, rng: np.random.Generator) -> Array:
    """Joints of points spread over the paper's disc, 200 mm high, (n, 3) [rad]."""
    r, angle = 0.5 * np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
    height = rng.uniform(-0.83, -0.63, n)
    return drawing_joints(np.stack([r * np.cos(angle), r * np.sin(angle), height], axis=1))


def drawing_joints(points: Array) -> Array:
    """Joints of the nominal machine at platform positions, arms outward, by the cosine rule."""
    joints = []
    for leg in LEGS:
        back = Rotation.from_euler("z", -120.0 * (leg - 1), degrees=True)
        radial, across, up = back.apply(points).T
        radial = radial + PLATFORM - BASE
        reach, rod2 = np.hypot(radial, up), ROD**2 - across**2
        corner = np.arccos((reach**2 + ARM**2 - rod2) / (2 * reach * ARM))
        joints.append(-(np.arctan2(up, radial) + corner))
    return np.stack(joints, axis=1)
