"""The chain of measurement: from joint angles to a reading of the tracker, and its derivatives.

    encoder angle --drive effects--> joint angle --closure of the mechanism, its geometry changed
    by structure effects--> pose --probe offset--> point in the base, moved by base effects
    --frame--> point in the tracker's frame --measurement effects--> reading

Simulator, fit, verdict and compensator all use this one chain. Its parameters are one vector
theta: the mechanism's geometry g, the reflector's offset o in the platform, the pose of the base
in the tracker's frame (w_T, t_T), and the parameters of the effects, v:

    q' = q + D(c, x, v)        g' = g + S(c, x, v)        z = p(q', g') + R(x) o
    (s, r) = B(c, x, v)        y = R(w_T) (z + s + r x z) + t_T        y' = y + M(c, y, v)

with c the conditions of a sample, among them its encoder angles q, and x the pose, which decides
the loads that some effects depend on. Without effects q' = q, g' = g and y' = y.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.effects import SPREAD, Effect, Stage
from delta_calibration.effects.base import asked_of_stages, stages_of, table_of_stage, terms_of
from delta_calibration.effects.signals import Places, Signals, all_asked, recorded, standing
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.lazy import cached_property
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
    """Model of the measurement: mechanism, reflector on its platform, tracker, and effects.

    `offset` (3,) [m] is the reflector's nominal position in the platform's frame, `offset_prior`
    [m] the standard deviation of each of its coordinates before a fit. Effects by the clock are
    those of `moment` [s] since the start of their session; None: of each sample's own time.
    """

    mechanism: Mechanism
    offset: Array
    offset_prior: float
    effects: tuple[Effect, ...] = ()
    moment: float | None = None

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
            replace(p, name=f"{name}.{p.name}", prior=SPREAD * p.prior)
            for name, effect in zip(_named(self.effects), self.effects, strict=True)
            for p in effect.parameters
        )
        return self.mechanism.parameters + ParameterSet(offset + frame + own)

    @cached_property
    def layout(self) -> Layout:
        """Layout of theta: the slice of each part."""
        effects = tuple((effect.cause, len(effect.parameters)) for effect in self.effects)
        return Layout(len(self.mechanism.parameters), effects)

    def with_effects(self, effects: tuple[Effect, ...]) -> Chain:
        """The same chain with these effects instead of its own."""
        return replace(self, effects=effects)

    def held(self, moment: float | None) -> Chain:
        """The same chain, with the effects that depend on time as they were at one moment [s]."""
        return replace(self, moment=moment)

    def recorded(self, at: Conditions) -> Signals:
        """Recorded signals of samples, at the chain's moment if it is held at one."""
        if self.moment is not None:
            at = replace(at, time=np.full(len(at), self.moment))
        return recorded(self.mechanism, at)

    def split(self, theta: Array) -> tuple[Array, Array, Frame]:
        """Geometry (p,), reflector offset (3,) [m], frame `T_tracker_base`."""
        layout = self.layout
        frame = Frame.from_vector(theta[layout.frame])
        return theta[layout.geometry], theta[layout.offset], frame

    def join(self, geometry: Array, offset: Array, frame: Frame) -> Array:
        """Join the three parts into a vector theta; all parameters of effects are zero."""
        effects = tuple(np.zeros(size) for _, size in self.layout.effect_sizes)
        return self.layout.join(Parts(geometry, offset, frame.vector(), effects, np.zeros(0)))

    def effect_values(self, theta: Array) -> tuple[Array, ...]:
        """Parameters of each effect, cut out of theta, (k,) each."""
        return tuple(theta[part] for part in self.layout.each)

    def predictor(self, at: Conditions) -> Predictor:
        """Prepare to predict these samples for several vectors theta."""
        return Predictor(self, at, self.recorded(at))

    def see(
        self, at: Conditions, theta: Array, guess: Array | None = None, asked: Asked = "readings"
    ) -> Seen:
        """Poses, readings and derivatives under these conditions, see `Predictor.see`."""
        return self.predictor(at).see(theta, guess, asked)

    def pose(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """Pose of the platform in the base frame, (n, k); NaN rows out of reach."""
        return self.see(at, theta, guess, "nothing").x

    def predict(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """Predicted readings of the tracker, (n, 3) [m]; NaN rows out of reach."""
        return self.see(at, theta, guess, "nothing").reading

    def jacobian(self, at: Conditions, theta: Array, guess: Array | None = None) -> Array:
        """d(reading)/d(theta), (n, 3, P), at constant encoder angles."""
        return self.see(at, theta, guess).jacobian

    def signals(
        self, at: Conditions, theta: Array, x: Array | None = None, robot: Robot | None = None
    ) -> Signals:
        """Signals (angles, rates, loads, temperatures, ...) that effects may depend on.

        Args:
            at: the conditions.
            theta: the machine.
            x: start values of its poses, (n, k); found without them where not given.
            robot: its masses give the loads, all of which are computed; without it only the loads
                that the chain's own effects depend on.
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
        """Effects of the base, each with the slice of its parameters in theta."""
        every = zip(self.effects, self.layout.each, strict=True)
        return tuple((effect, own) for effect, own in every if effect.stage is Stage.BASE)

    def rotation(self, at: Conditions, theta: Array, x: Array) -> Array:
        """Orientation of the platform in the tracker's frame, (n, 3, 3).

        Args:
            at: the conditions.
            theta: the machine.
            x: its poses under them, (n, k).
        """
        base = rotations.exp(self.base_moved(at, theta, x)[:, 3:])
        return np.asarray(self.split(theta)[2].rotation @ base @ self.mechanism.rotation(x))

    @cached_property
    def body(self) -> Any:
        """The mechanism with its masses, in the form that the compiled chain takes."""
        masses = self.effects[0].robot.masses if self.effects else None
        return self.mechanism.body(masses)

    def compiled(self, places: Places) -> tuple[Any, Any]:
        """Compile the effects once for each layout of signals; the result must not be changed.

        Args:
            places: layout of the signals that the effects take.

        Returns:
            Those of all stages before the reading (model/stand.py), and those of the reading.
        """
        if places not in self._compiled:
            each = tuple(self.layout.each)
            last = table_of_stage(Stage.MEASUREMENT, self.effects, each, places)
            self._compiled[places] = stages_of(self.effects, each, places), last
        return self._compiled[places]

    @cached_property
    def _compiled(self) -> dict[Places, tuple[Any, Any]]:
        """Results of `compiled`: the samples of a fit and of its held-out parts share them."""
        return {}

    def point(self, x: Array, offset: Array) -> Array:
        """Position in the base frame of a point fixed to the platform, (n, 3) [m]."""
        return self.mechanism.points(x, offset)


def _named(effects: Sequence[Effect]) -> Iterator[str]:
    """Name each effect by its cause: tracker_drift, and tracker_drift_2 for a second one."""
    count: Counter[str] = Counter()
    for effect in effects:
        count[effect.cause] += 1
        again = effect.repeats and count[effect.cause] > 1
        yield f"{effect.cause}_{count[effect.cause]}" if again else effect.cause


def read_at(at: Conditions, seen: Seen) -> Conditions:
    """The conditions with the reading that the chain predicts before measurement effects."""
    return replace(
        at,
        reading=seen.before,
        reading_velocity=seen.rate,
        reading_acceleration=seen.acceleration,
    )


@dataclass(frozen=True)
class Predictor:
    """A chain prepared for some samples: it holds everything that does not depend on theta."""

    chain: Chain
    at: Conditions
    signals: Signals  # recorded

    def take(self, rows: NDArray[Any] | slice) -> Predictor:
        """The chain prepared for some of the samples."""
        return Predictor(self.chain, self.at.take(rows), self.signals.take(rows))

    @cached_property
    def _begins(self) -> Index:
        """First entries of offset, turn and place in theta."""
        layout = self.chain.layout
        return np.array([layout.offset.start, layout.turn.start, layout.place.start])

    def see(self, theta: Array, guess: Array | None = None, asked: Asked = "readings") -> Seen:
        """Compute pose, reading and derivatives at every sample: see `model/view.py`.

        Args:
            theta: the machine, (P,).
            guess: start values of its poses, (n, k); the mechanism's own where not given.
            asked: quantity whose derivatives by theta are computed: the tracker's "readings", the
                platform's "poses" or "nothing".

        Returns:
            Poses, readings and derivatives; NaN rows out of reach.

        Raises:
            InputError: theta of another length.
        """
        chain, known = self.chain, self.signals
        if theta.shape != (chain.layout.size,):
            raise InputError(f"theta has shape {theta.shape}; it has to be ({chain.layout.size},)")
        stages, last = chain.compiled(known.places)
        near = guess is not None and not chain.mechanism.exact
        x = np.zeros((len(known), chain.mechanism.pose_size))
        if near:
            x[:] = guess
        theta = np.ascontiguousarray(theta, dtype=float)
        seen = _view().see(
            chain.body,
            stages,
            last,
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
        """Reflector and frame in compiled form: the fields of `view.Device`."""
        layout = self.chain.layout
        rotation, turning = rotations.exp_with_derivative(theta[layout.turn])
        return theta[layout.offset], rotation, theta[layout.place], turning, self._begins


_ASKED: Mapping[Asked, int] = {"nothing": NOTHING, "readings": READINGS, "poses": POSES}


def _view() -> Any:
    """Import the module of the compiled chain when it is first needed."""
    from delta_calibration.model import view

    return view
