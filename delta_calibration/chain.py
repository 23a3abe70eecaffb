"""The chain of measurement: from joint angles to a reading of the tracker, and its derivatives.

    encoder angle --drive effects--> joint angle --closure of the mechanism, its geometry changed
    by structure effects--> pose --probe offset--> point in the base --frame--> point before the
    tracker --measurement effects--> reading

Simulator, fit, verdict and compensator all use this one chain. Its parameters are one vector
theta: the mechanism's geometry g, the reflector's offset o in the platform, the tracker's frame
(where the base stands in it), and those of the effects, v:

    q' = q + D(c) v        g' = g + S(c) v
    y  = R(w_T) (p(q', g') + R(x) o) + t_T        y' = y + M(c, y) v

with c the conditions of a sample, its encoders' angles q among them. Without effects q' is q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects import SPREAD, Effect, Stage
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]

FRAME_NAMES = tuple(f"tracker_{kind}_{axis}" for kind in ("turn", "place") for axis in "xyz")
OFFSET_NAMES = tuple(f"reflector_{axis}" for axis in "xyz")


_FRAME = 6  # parameters of the tracker's frame


@dataclass(frozen=True)
class Chain:
    """A mechanism, a reflector on its platform, a tracker that looks at it, effects on the way.

    `offset` (3,) [m] is the reflector's nominal place in the platform's frame, `offset_prior` [m]
    what it is expected to deviate by.
    """

    mechanism: Mechanism
    offset: Array
    offset_prior: float
    effects: tuple[Effect, ...] = ()

    @property
    def parameters(self) -> ParameterSet:
        """Geometry, reflector offset, tracker frame, effects, in the order of theta."""
        offset = tuple(
            Parameter(name, "m", float(value), self.offset_prior, "smr_offset")
            for name, value in zip(OFFSET_NAMES, self.offset, strict=True)
        )
        frame = tuple(
            Parameter(name, "rad" if "turn" in name else "m", 0.0, float("inf"), "tracker_frame")
            for name in FRAME_NAMES
        )
        own = tuple(
            replace(p, name=f"{effect.cause}.{p.name}", prior=SPREAD * p.prior)
            for effect in self.effects
            for p in effect.parameters
        )
        return self.mechanism.parameters + ParameterSet(offset + frame + own)

    @property
    def geometry_size(self) -> int:
        """How many of theta's first entries are the mechanism's geometry."""
        return len(self.mechanism.parameters)

    @property
    def base_size(self) -> int:
        """How many of theta's first entries are not the effects'."""
        return self.geometry_size + 3 + _FRAME

    def with_effects(self, effects: tuple[Effect, ...]) -> Chain:
        """The same cell with these effects on the way."""
        return replace(self, effects=effects)

    def split(self, theta: Array) -> tuple[Array, Array, Frame]:
        """Geometry (p,), reflector offset (3,) [m], frame `T_tracker_base`."""
        p = self.geometry_size
        return theta[:p], theta[p : p + 3], Frame.from_vector(theta[p + 3 : p + 9])

    def join(self, geometry: Array, offset: Array, frame: Frame) -> Array:
        """The vector theta of the three parts, every effect at nothing."""
        effects = np.zeros(sum(len(effect.parameters) for effect in self.effects))
        return np.concatenate([geometry, offset, frame.vector(), effects])

    def effect_values(self, theta: Array) -> tuple[Array, ...]:
        """Of each effect its part of theta, (k,)."""
        ends = np.cumsum([self.base_size, *(len(e.parameters) for e in self.effects)])
        return tuple(theta[begin:end] for begin, end in pairwise(ends.tolist()))

    def joints(self, at: Conditions, theta: Array) -> Array:
        """Joint angles behind the drives, q', (n, m) [rad]."""
        return at.joint + self._shift(Stage.DRIVE, at, theta, at.joint.shape)

    def geometry(self, at: Conditions, theta: Array) -> Array:
        """Dimensions under these conditions, (n, p), or (p,) where all samples share them."""
        g = theta[: self.geometry_size]
        if not self._at_stage(Stage.STRUCTURE):
            return g
        return g + self._shift(Stage.STRUCTURE, at, theta, (len(at), len(g)))

    def pose(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """Platform's pose in the base, (n, k); NaN rows out of reach."""
        return self.mechanism.forward(self.joints(at, theta), self.geometry(at, theta), guess)

    def reading(self, at: Conditions, x: Array, theta: Array) -> Array:
        """What the tracker says of a platform at x, (n, 3) [m] in the tracker's frame."""
        _, offset, frame = self.split(theta)
        if not self._at_stage(Stage.MEASUREMENT):
            return frame.apply(self.point(x, offset))
        before = self.seen(at, x, theta)
        return before.reading + self._shift(
            Stage.MEASUREMENT, before, theta, before.reading.shape
        )

    def predict(self, at: Conditions, theta: Array) -> Array:
        """What the tracker will say under these conditions, (n, 3) [m]; NaN rows out of reach."""
        return self.reading(at, self.pose(at, theta), theta)

    def point(self, x: Array, offset: Array) -> Array:
        """A point fixed to the platform, in the base, (n, 3) [m]."""
        return self.mechanism.position(x) + self.mechanism.rotation(x) @ offset

    def point_by_pose(self, x: Array, offset: Array) -> Array:
        """d(point)/dx, (n, 3, k)."""
        return self.mechanism.point_by_pose(x, offset)

    def point_by_joints(self, at: Conditions, x: Array, theta: Array) -> Array:
        """d(reflector in the base)/dq', (n, 3, m) [m/rad]."""
        _, offset, _ = self.split(theta)
        slope = self.mechanism.velocity_jacobian(
            self.joints(at, theta), x, self.geometry(at, theta)
        )
        return self.point_by_pose(x, offset) @ slope

    def jacobian(self, at: Conditions, x: Array, theta: Array) -> Array:
        """d(reading)/d(theta), (n, 3, P), at constant encoder angles."""
        return self.columns(at, x, theta, *self.slopes(at, x, theta))

    def columns(
        self, at: Conditions, x: Array, theta: Array, by_joints: Array, by_geometry: Array
    ) -> Array:
        """The same with d(reading) by joints and geometry known, as `slopes` gives them."""
        _, offset, frame = self.split(theta)
        point = self.point(x, offset)
        first = self.geometry_size + 3
        turn = np.broadcast_to(theta[first : first + 3], point.shape)
        parts = [
            by_geometry,
            frame.rotation @ self.mechanism.rotation(x),
            rotations.exp_times_derivative(turn, point),
            np.broadcast_to(np.eye(3), (len(at), 3, 3)),
        ]
        for effect in self.effects:
            if effect.stage is Stage.MEASUREMENT:
                parts.append(effect.columns(self.seen(at, x, theta, by_joints)))
            elif effect.stage is Stage.STRUCTURE:
                parts.append(by_geometry @ effect.columns_kept(at))
            else:
                parts.append(by_joints @ effect.columns_kept(at))
        return np.concatenate(parts, axis=-1)

    def slopes(self, at: Conditions, x: Array, theta: Array) -> tuple[Array, Array]:
        """d(reading) by joint angles behind the drives, (n, 3, m), and by geometry, (n, 3, p)."""
        _, offset, frame = self.split(theta)
        joints, geometry = self.joints(at, theta), self.geometry(at, theta)
        by_pose = frame.rotation @ self.point_by_pose(x, offset)
        return self.mechanism.moved_by(joints, x, geometry, by_pose)

    def seen(
        self, at: Conditions, x: Array, theta: Array, by_joints: Array | None = None
    ) -> Conditions:
        """The conditions with the reading before the last stage, and how fast it moves."""
        _, offset, frame = self.split(theta)
        velocity = np.zeros((len(at), 3))
        moving = np.flatnonzero((at.velocity != 0).any(axis=1))
        if moving.size:
            slope = (
                frame.rotation @ self.point_by_joints(at.take(moving), x[moving], theta)
                if by_joints is None
                else by_joints[moving]
            )
            velocity[moving] = (slope @ at.velocity[moving, :, None])[..., 0]
        return replace(at, reading=frame.apply(self.point(x, offset)), reading_velocity=velocity)

    def _at_stage(self, stage: Stage) -> list[tuple[int, Effect]]:
        return [(i, effect) for i, effect in enumerate(self.effects) if effect.stage is stage]

    def _shift(self, stage: Stage, at: Conditions, theta: Array, shape: tuple[int, ...]) -> Array:
        """What the effects of a stage add together, (n, size of the stage)."""
        values = self.effect_values(theta)
        shift = np.zeros(shape)
        for i, effect in self._at_stage(stage):
            shift += effect.columns_kept(at) @ values[i]
        return shift
