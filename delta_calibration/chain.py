"""The chain of measurement: from joint angles to a reading of the tracker, and its derivatives.

    encoder angle --drive effects--> joint angle --closure of the mechanism, its geometry changed
    by structure effects--> pose --probe offset--> point in the base --frame--> point before the
    tracker --measurement effects--> reading

Simulator, fit, verdict and compensator all use this one chain. Its parameters are one vector
theta: the mechanism's geometry g, the reflector's offset o in the platform, the tracker's frame
(where the base stands in it), and those of the effects, v:

    q' = q + D(c, x, v)        g' = g + S(c, x, v)
    y  = R(w_T) (p(q', g') + R(x) o) + t_T        y' = y + M(c, y, v)

with c the conditions of a sample, its encoders' angles q among them, and x the pose, at which the
loads are that some effects take. Without effects q' is q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.effects import SPREAD, Effect, Stage
from delta_calibration.effects.base import stages_of, stand, terms_of
from delta_calibration.effects.signals import Places, Signals, all_asked, recorded, standing
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions
from delta_calibration.theta import Layout, Parts, frame_names, vector_names

Array = NDArray[np.float64]

FRAME_NAMES = frame_names("tracker")
OFFSET_NAMES = vector_names("reflector")


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

    @cached_property
    def layout(self) -> Layout:
        """Which entries of theta are which."""
        effects = tuple((effect.cause, len(effect.parameters)) for effect in self.effects)
        return Layout(len(self.mechanism.parameters), effects)

    def with_effects(self, effects: tuple[Effect, ...]) -> Chain:
        """The same cell with these effects on the way."""
        return replace(self, effects=effects)

    def split(self, theta: Array) -> tuple[Array, Array, Frame]:
        """Geometry (p,), reflector offset (3,) [m], frame `T_tracker_base`."""
        layout = self.layout
        frame = Frame.from_vector(theta[layout.frame])
        return theta[layout.geometry], theta[layout.offset], frame

    def join(self, geometry: Array, offset: Array, frame: Frame) -> Array:
        """The vector theta of the three parts, every effect at nothing."""
        effects = tuple(np.zeros(size) for _, size in self.layout.effect_sizes)
        return self.layout.join(Parts(geometry, offset, frame.vector(), effects, np.zeros(0)))

    def effect_values(self, theta: Array) -> tuple[Array, ...]:
        """Of each effect its part of theta, (k,)."""
        return tuple(theta[part] for part in self.layout.each)

    def joints(self, at: Conditions, theta: Array, x: Array | None = None) -> Array:
        """Joint angles behind the drives, q', (n, m) [rad], of a machine at poses x, (n, k)."""
        if not self._drive:
            return at.joint
        return at.joint + self._shift(Stage.DRIVE, self.signals(at, theta, x), theta)

    def geometry(self, at: Conditions, theta: Array, x: Array | None = None) -> Array:
        """Dimensions under these conditions, (n, p), or (p,) where all samples share them."""
        g = theta[self.layout.geometry]
        if not self._structure:
            return g
        return g + self._shift(Stage.STRUCTURE, self.signals(at, theta, x), theta)

    def pose(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """Platform's pose in the base, (n, k); NaN rows out of reach."""
        if not (self._drive or self._structure):
            return self.mechanism.forward(at.joint, theta[self.layout.geometry], guess)
        return self._stand(at, theta, guess)[1]

    def signals(
        self, at: Conditions, theta: Array, x: Array | None = None, robot: Robot | None = None
    ) -> Signals:
        """All that effects may take of samples of a machine at poses x, (n, k).

        Args:
            at: the conditions.
            theta: the machine.
            x: its poses; sought where not given.
            robot: whose masses are carried, where all loads are wanted; else only those that the
                chain's own effects take are known.
        """
        if x is None and (self._drive or self._structure):
            known, x = self._stand(at, theta, None)
        known, g = recorded(self.mechanism, at), theta[self.layout.geometry]
        if robot is None and not self.effects:
            return known
        asked = all_asked(self.mechanism)
        if robot is None:
            robot, asked = self.effects[0].robot, self.stages(at.temperature_parts).asked
        x = self.mechanism.forward(at.joint, g) if x is None else x
        here = standing(known, robot, self.mechanism, x, g, asked)
        if not (self._drive or self._structure):
            return here
        joint = at.joint + self._shift(Stage.DRIVE, here, theta)
        own = g if not self._structure else g + self._shift(Stage.STRUCTURE, here, theta)
        return standing(known, robot, self.mechanism, x, own, asked, joint)

    def body(self) -> Any:
        """The mechanism as the compiled chain takes it, with what it carries."""
        masses = self.effects[0].robot.masses if self.effects else None
        return self.mechanism.body(masses)

    def stages(self, parts: tuple[str, ...]) -> Any:
        """Effects of drives and structure as the compiled chain takes them (model/stand.py).

        Args:
            parts: of which temperatures are recorded.
        """
        places = Places.of(self.mechanism, parts)
        return stages_of(self.effects, tuple(self.layout.each), places)

    def _stand(
        self, at: Conditions, theta: Array, guess: Array | None
    ) -> tuple[Signals, Array]:
        """Signals and poses (n, k) of the machine."""
        known = recorded(self.mechanism, at)
        x = np.zeros((len(at), self.mechanism.pose_size))
        near = guess is not None and not self.mechanism.exact
        if near:
            x[:] = guess
        g = np.ascontiguousarray(theta[self.layout.geometry])
        stand(self.body(), self.stages(at.temperature_parts), known.rows, g, theta, near, x)
        return known, x

    @property
    def _drive(self) -> bool:
        return any(effect.stage is Stage.DRIVE for effect in self.effects)

    @property
    def _structure(self) -> bool:
        return any(effect.stage is Stage.STRUCTURE for effect in self.effects)

    def reading(self, at: Conditions, x: Array, theta: Array) -> Array:
        """What the tracker says of a platform at x, (n, 3) [m] in the tracker's frame."""
        _, offset, frame = self.split(theta)
        if not self._at_stage(Stage.MEASUREMENT):
            return frame.apply(self.point(x, offset))
        before = self.seen(at, x, theta)
        signals = recorded(self.mechanism, before)
        return before.reading + self._shift(Stage.MEASUREMENT, signals, theta)

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
        joints, geometry = self._here(at, x, theta)
        by_pose = self.point_by_pose(x, offset)
        return self.mechanism.moved_by(joints, x, geometry, by_pose)[0]

    def jacobian(self, at: Conditions, x: Array, theta: Array) -> Array:
        """d(reading)/d(theta), (n, 3, P), at constant encoder angles."""
        return self.columns(at, x, theta, *self.slopes(at, x, theta))

    def columns(
        self, at: Conditions, x: Array, theta: Array, by_joints: Array, by_geometry: Array
    ) -> Array:
        """The same with d(reading) by joints and geometry known, as `slopes` gives them."""
        _, offset, frame = self.split(theta)
        point = self.point(x, offset)
        turn = np.broadcast_to(theta[self.layout.turn], point.shape)
        by_effects = self.by_effects(at, x, theta, by_joints, by_geometry)
        return self.layout.columns(
            by_geometry,
            frame.rotation @ self.mechanism.rotation(x),
            rotations.exp_times_derivative(turn, point),
            np.broadcast_to(np.eye(3), (len(at), 3, 3)),
            by_effects,
        )

    def by_effects(
        self, at: Conditions, x: Array, theta: Array, by_joints: Array, by_geometry: Array
    ) -> list[Array]:
        """d(reading) by the parameters of each effect, (n, 3, k) each, at their values."""
        if not self.effects:
            return []
        signals, found = self.signals(at, theta, x), []
        values = self.effect_values(theta)
        for effect, value in zip(self.effects, values, strict=True):
            if effect.stage is Stage.MEASUREMENT:
                seen = recorded(self.mechanism, self.seen(at, x, theta, by_joints))
                found.append(effect.columns_of(seen, value))
            else:
                slope = by_geometry if effect.stage is Stage.STRUCTURE else by_joints
                found.append(slope @ effect.columns_of(signals, value))
        return found

    def slopes(self, at: Conditions, x: Array, theta: Array) -> tuple[Array, Array]:
        """d(reading) by joint angles behind the drives, (n, 3, m), and by geometry, (n, 3, p)."""
        _, offset, frame = self.split(theta)
        joints, geometry = self._here(at, x, theta)
        by_pose = frame.rotation @ self.point_by_pose(x, offset)
        return self.mechanism.moved_by(joints, x, geometry, by_pose)

    def _here(self, at: Conditions, x: Array, theta: Array) -> tuple[Array, Array]:
        """Joints behind the drives and dimensions of a machine at poses x."""
        if not (self._drive or self._structure):
            return at.joint, theta[self.layout.geometry]
        signals, geometry = self.signals(at, theta, x), theta[self.layout.geometry]
        joints = at.joint + self._shift(Stage.DRIVE, signals, theta)
        if self._structure:
            geometry = geometry + self._shift(Stage.STRUCTURE, signals, theta)
        return joints, geometry

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

    def _shift(self, stage: Stage, signals: Signals, theta: Array) -> Array:
        """What the effects of a stage add together, (n, size of the stage); 0 without any."""
        own = [(e, theta[part]) for e, part in zip(self.effects, self.layout.each, strict=True)]
        here = [(effect, values) for effect, values in own if effect.stage is stage]
        if not here:
            return np.zeros((len(signals), 1))
        terms = terms_of([effect for effect, _ in here], signals.places)
        return terms.shifts(signals, np.concatenate([values for _, values in here]))
