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

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.effects import SPREAD, Effect, Stage
from delta_calibration.effects.base import asked_of_stages, stages_of, table_of_stage, terms_of
from delta_calibration.effects.signals import Places, Signals, all_asked, recorded, standing
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.chain_constants import NOTHING, POSES, READINGS, STRAY
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import Robot
from delta_calibration.theta import Layout, Parts, frame_names, vector_names

if TYPE_CHECKING:
    from delta_calibration.model.view import Seen

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Asked = Literal["nothing", "readings", "poses"]

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

    def predictor(self, at: Conditions) -> Predictor:
        """The chain made ready to predict samples for one machine after the other."""
        return Predictor(self, at, recorded(self.mechanism, at))

    def see(
        self, at: Conditions, theta: Array, guess: Array | None = None, asked: Asked = "readings"
    ) -> Seen:
        """What a machine shows under these conditions, see `Predictor.see`."""
        return self.predictor(at).see(theta, guess, asked)

    def pose(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """Platform's pose in the base, (n, k); NaN rows out of reach."""
        return self.see(at, theta, guess, "nothing").x

    def predict(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """What the tracker will say under these conditions, (n, 3) [m]; NaN rows out of reach."""
        return self.see(at, theta, guess, "nothing").reading

    def jacobian(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """d(reading)/d(theta), (n, 3, P), at constant encoder angles."""
        return self.see(at, theta, guess).jacobian

    def signals(
        self, at: Conditions, theta: Array, x: Array | None = None, robot: Robot | None = None
    ) -> Signals:
        """All that effects may take of samples of a machine at poses x, (n, k).

        Args:
            at: the conditions.
            theta: the machine.
            x: its poses, nearly; sought where not given.
            robot: whose masses are carried, where all loads are wanted; else only those that the
                chain's own effects take are known.
        """
        of = self.predictor(at)
        if robot is None and not self.effects:
            return of.signals
        seen = of.see(theta, x, "nothing")
        asked = all_asked(self.mechanism)
        if robot is None:
            robot, asked = self.effects[0].robot, asked_of_stages(self.effects)
        return standing(
            of.signals, robot, self.mechanism, seen.x, seen.geometry, asked, seen.joint
        )

    def base_moved(self, at: Conditions, theta: Array, x: Array) -> Array:
        """Shift [m] and turn [rad] of the base by its effects, in its own axes, (n, 6)."""
        moved = np.zeros((len(at), 6))
        parts = self.of_base
        signals = self.signals(at, theta, x) if parts else None
        for effect, own in parts:
            assert signals is not None
            moved += terms_of((effect,), signals.places).shifts(signals, theta[own])
        return moved

    @property
    def of_base(self) -> tuple[tuple[Effect, slice], ...]:
        """Effects of the base, and which entries of theta are theirs."""
        every = zip(self.effects, self.layout.each, strict=True)
        return tuple((effect, own) for effect, own in every if effect.stage is Stage.BASE)

    def rotation(self, at: Conditions, theta: Array, x: Array) -> Array:
        """How the platform is turned in the tracker's frame, (n, 3, 3).

        Args:
            at: the conditions.
            theta: the machine.
            x: its poses under them, (n, k).
        """
        base = rotations.exp(self.base_moved(at, theta, x)[:, 3:])
        return np.asarray(self.split(theta)[2].rotation @ base @ self.mechanism.rotation(x))

    @cached_property
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

    def point(self, x: Array, offset: Array) -> Array:
        """A point fixed to the platform, in the base, (n, 3) [m]."""
        return self.mechanism.points(x, offset)


def read_at(at: Conditions, seen: Seen) -> Conditions:
    """The conditions with the readings before the last stage, and how fast they move there."""
    return replace(at, reading=seen.before, reading_velocity=seen.rate)


@dataclass(frozen=True)
class Predictor:
    """A chain made ready for some samples: what is the same for every theta."""

    chain: Chain
    at: Conditions
    signals: Signals  # recorded

    @cached_property
    def stages(self) -> Any:
        """Effects of drives and structure, see `Chain.stages`."""
        return self.chain.stages(self.signals.places.parts)

    @cached_property
    def _last(self) -> Any:
        """Effects of the measurement."""
        return table_of_stage(
            Stage.MEASUREMENT, self.chain.effects, self.chain.layout.each, self.signals.places
        )

    @cached_property
    def _begins(self) -> Index:
        """Where offset, turn and place begin in theta."""
        layout = self.chain.layout
        return np.array([layout.offset.start, layout.turn.start, layout.place.start])

    def see(self, theta: Array, guess: Array | None = None, asked: Asked = "readings") -> Seen:
        """What a machine shows at every sample: see `model/view.py`.

        Args:
            theta: the machine, (P,).
            guess: its poses, nearly, (n, k); sought from the beginning where not given.
            asked: of what derivatives by theta are wanted: the tracker's "readings", the
                platform's "poses" or "nothing".

        Returns:
            Poses, readings and derivatives; NaN rows where it cannot stand.
        """
        chain, known = self.chain, self.signals
        near = guess is not None and not chain.mechanism.exact
        x = np.zeros((len(known), chain.mechanism.pose_size))
        if near:
            x[:] = guess
        theta = np.ascontiguousarray(theta, dtype=float)
        seen = _view().see(
            chain.body,
            self.stages,
            self._last,
            self._device(theta),
            known.rows,
            theta[chain.layout.geometry],
            theta,
            near,
            STRAY,
            _ASKED[asked],
            x,
        )
        return cast("Seen", seen)

    def _device(self, theta: Array) -> tuple[Array, Array, Array, Array, Index]:
        """Reflector and frame as the compiled chain takes them: fields of `view.Device`."""
        layout = self.chain.layout
        rotation, turning = rotations.exp_with_derivative(theta[layout.turn])
        return theta[layout.offset], rotation, theta[layout.place], turning, self._begins


_ASKED: Mapping[Asked, int] = {"nothing": NOTHING, "readings": READINGS, "poses": POSES}


def _view() -> Any:
    """The compiled view."""
    from delta_calibration.model import view

    return view
