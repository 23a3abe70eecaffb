"""What can be measured of a mechanism: each kind says what it misses and how that moves.

A kind is asked about a machine theta under the conditions of its samples, and answers with what
was measured less what the chain predicts, and with how the prediction goes with every entry of
theta and with the joints. All places come from the one chain of measurement (`chain.py`), with the
effects that are in it; a kind adds how it looks at them. Metres, radians or pixels. Cameras are in
`image.py`, closures of a redundant mechanism in `closures.py` and `encoder_closures.py`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain, Predictor, read_at
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import Stage
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism
from delta_calibration.theta import Layout

if TYPE_CHECKING:
    from delta_calibration.model.view import Seen

Array = NDArray[np.float64]
Own = TypeVar("Own", bound="Observation")


@dataclass(frozen=True)
class PlacedMachine:
    """A mechanism as built, and as placed before the device that measures it."""

    chain: Chain
    theta: Array  # (P,)

    @classmethod
    def of(cls, mechanism: Mechanism, geometry: Array, frame: Frame) -> PlacedMachine:
        """With dimensions (p,) and `T_device_base`, and no reflector on its platform."""
        chain = bare_chain(mechanism)
        return cls(chain, chain.join(geometry, np.zeros(3), frame))

    @property
    def geometry(self) -> Array:
        """Dimensions, (p,)."""
        return self.chain.split(self.theta)[0]

    @property
    def frame(self) -> Frame:
        """`T_device_base`."""
        return self.chain.split(self.theta)[2]

    def poses(self, joint: Array) -> Array:
        """Of the platform in the base at joints (n, m), (n, k); NaN rows out of reach."""
        return self.chain.pose(at_rest(joint), self.theta)


@dataclass(frozen=True)
class Linear:
    """Measurements about one machine."""

    pose: Array  # (n, k) of the platform; NaN rows out of reach
    missed: Array  # (n, d) measured less predicted [m, rad, px]
    by_theta: Array  # (n, d, P) d(predicted)/d(theta)
    by_joints: Array  # (n, d, m) by the joints behind the drives
    at: Conditions  # with readings as the chain has them before its last stage
    # (n, m) joints behind the drives and (n, p) dimensions under the conditions, where it is known
    stood: tuple[Array, Array] | None = None


class Observation(ABC):
    """Base of all kinds: n measurements of d numbers each."""

    kind: ClassVar[str]
    each: ClassVar[tuple[str, ...]] = ("joint",)  # fields with a row a measurement

    joint: Array  # (n, m)

    @property
    def device(self) -> str:
        """What measures, where it matters how that stands before the base; else nothing."""
        return ""

    @property
    def turns(self) -> bool:
        """Whether it matters, too, how that is turned."""
        return True

    @property
    @abstractmethod
    def sigma(self) -> Array:
        """Standard deviation of each of the d numbers, (d,) [m, rad, px]."""

    @abstractmethod
    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """What is missed of a machine, and how that goes with it.

        Args:
            at: the chain under the conditions of the n measurements.
            theta: (P,) of the chain, with a probe's mount where the fit has one.
            guess: the platform's poses, nearly, (n, k).
        """

    def joints(self) -> tuple[Array, ...]:
        """Every set of joints that it was taken at, each (n, m)."""
        return (self.joint,)

    def missed(self, machine: PlacedMachine) -> Array:
        """Measured less predicted of a machine at rest, (n, d); NaN rows out of reach."""
        return self._about(machine).missed

    def slopes(self, machine: PlacedMachine) -> Array:
        """d(predicted)/d(theta) of a machine at rest, (n, d, P)."""
        return self._about(machine).by_theta

    def _about(self, machine: PlacedMachine) -> Linear:
        return self.linearized(machine.chain.predictor(at_rest(self.joint)), machine.theta)

    def take(self: Own, rows: NDArray[Any]) -> Own:
        """Some of the measurements."""
        own: dict[str, Any] = {name: getattr(self, name)[rows] for name in self.each}
        taken: Own = replace(self, **own)  # type: ignore[type-var]
        return taken


@dataclass(frozen=True)
class Measured:
    """Observations of one kind, what held while each was taken, and how much each counts."""

    observation: Observation
    at: Conditions  # (n) joints are the observation's
    timed: bool = True  # whether the times are a clock's, or stand for an order
    given: Array | None = None  # (n, d, d) whitening, where it is not the observation's own
    # (n,) number of the motion that each was taken in, where none was at rest, and the standard
    # deviation of where the joints came to rest before it [rad or m]: an error that a motion keeps
    path: NDArray[np.int64] | None = None
    repeatability: float = 0.0

    def __post_init__(self) -> None:
        """Refuse conditions of other samples.

        Raises:
            InputError: names the kind.
        """
        if not np.array_equal(self.at.joint, self.observation.joint):
            kind = self.observation.kind
            raise InputError(f"{kind}: conditions are of other joints than the observations")

    @cached_property
    def whiten(self) -> Array:
        """(n, d, d) [1/m, 1/rad, 1/px]."""
        if self.given is not None:
            return self.given
        root = np.diag(1 / self.observation.sigma)
        return np.broadcast_to(root, (len(self.at), *root.shape)).copy()

    def take(self, rows: NDArray[Any]) -> Measured:
        """Some of them."""
        given = None if self.given is None else self.given[rows]
        path = None if self.path is None else self.path[rows]
        at, observation = self.at.take(rows), self.observation.take(rows)
        return Measured(observation, at, self.timed, given, path, self.repeatability)


@dataclass(frozen=True)
class PointMeasured(Observation):
    """A reflector's position by a tracker."""

    kind: ClassVar[str] = "position"
    each: ClassVar[tuple[str, ...]] = ("joint", "point")

    joint: Array
    point: Array  # (n, 3) [m] in the device's frame
    offset: Array | None  # (3,) [m] of the reflector in the platform; None: theta's
    noise: float  # [m] each coordinate

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        offset = {} if self.offset is None else {"offset": (3,)}
        require_shapes(self, point=(len(self.joint), 3), **offset)

    @property
    def device(self) -> str:
        """A tracker."""
        return "tracker"

    @property
    def sigma(self) -> Array:
        """(3,) [m]."""
        return np.full(3, self.noise)

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """(n, 3) [m]."""
        seen = point_seen(at, theta, self.offset, None, guess, read=True)
        by_theta = _mounted(seen.jacobian, _layout(at.chain, theta))
        read = read_at(at.at, seen)
        geometry = np.broadcast_to(seen.geometry, (len(seen.x), seen.geometry.shape[1]))
        missed, stood = self.point - seen.reading, (seen.joint, geometry)
        return Linear(seen.x, missed, by_theta, seen.by_joints, read, stood)


@dataclass(frozen=True)
class PoseMeasured(PointMeasured):
    """A probe's position and turn by a tracker of six degrees of freedom.

        R_measured = exp([e]x) R_T R(x) R(m)

    R_T: the tracker's frame; R(x): the platform's turn; m: how the probe is mounted on the
    platform, three more unknowns, or none, where theta is of the chain alone.
    e is what is missed, in axes of the tracker.
    """

    kind: ClassVar[str] = "pose"
    each: ClassVar[tuple[str, ...]] = ("joint", "point", "rotation")

    rotation: Array  # (n, 3, 3) of the probe in the device's frame
    turn_noise: float  # [rad] each axis

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        super().__post_init__()
        require_shapes(self, rotation=(len(self.joint), 3, 3))

    @property
    def sigma(self) -> Array:
        """(6,) [m, rad]."""
        return np.append(super().sigma, np.full(3, self.turn_noise))

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """(n, 6) [m, rad]; derivatives of the turn to first order in what is missed of it."""
        point = super().linearized(at, theta, guess)
        chain, layout, x = at.chain, _layout(at.chain, theta), point.pose
        turned = at.see(theta[layout.chain], x, "poses")
        frame = rotations.exp(theta[layout.turn])
        platform = chain.rotation(at.at, theta[layout.chain], x)
        by_pose = frame @ chain.mechanism.turn_by_pose(x)
        slope = _mounted(by_pose @ turned.jacobian, layout)
        slope[..., layout.turn] = rotations.left_jacobian(theta[layout.turn])
        _add_turns_of_base(slope, at, theta, layout, x)
        predicted = platform
        if layout.has_mount:
            predicted = platform @ rotations.exp(theta[layout.mount])
            slope[..., layout.mount] = platform @ rotations.left_jacobian(theta[layout.mount])
        missed = rotations.log(self.rotation @ np.swapaxes(predicted, 1, 2))
        return replace(
            point,
            missed=np.concatenate([point.missed, missed], axis=1),
            by_theta=np.concatenate([point.by_theta, slope], axis=1),
            by_joints=np.concatenate([point.by_joints, by_pose @ turned.by_joints], axis=1),
        )


@dataclass(frozen=True)
class HeightAtContact(Observation):
    """How high over the bed, the base's plane z = 0, the platform stands when its probe touches.

    Heights alone say nothing of a turn about z or a shift along the bed.
    """

    kind: ClassVar[str] = "height"
    each: ClassVar[tuple[str, ...]] = ("joint", "height")

    joint: Array
    height: Array  # (n,) [m]
    noise: float  # [m]

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        require_shapes(self, height=(len(self.joint),))

    @property
    def sigma(self) -> Array:
        """(1,) [m]."""
        return np.array([self.noise])

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """(n, 1) [m]."""
        seen = centre_seen(at, theta, guess)
        missed = np.asarray(self.height - seen.reading[:, 2])[:, None]
        slope = _mounted(seen.jacobian[:, 2:], _layout(at.chain, theta))
        return Linear(seen.x, missed, slope, seen.by_joints[:, 2:], at.at)


@dataclass(frozen=True)
class RadiusMeasured(Observation):
    """How long a telescoping ballbar is, between a ball on the platform and one on the table.

    Where the ball on the table stands is not known: it is the origin of the device's frame, whose
    turn does not show.
    """

    kind: ClassVar[str] = "radius"
    each: ClassVar[tuple[str, ...]] = ("joint", "radius")

    joint: Array
    radius: Array  # (n,) [m]
    offset: Array  # (3,) [m] of the ball in the platform
    noise: float  # [m]

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        require_shapes(self, radius=(len(self.joint),), offset=(3,))

    @property
    def device(self) -> str:
        """A ballbar."""
        return "ballbar"

    @property
    def turns(self) -> bool:
        """A length is the same from everywhere."""
        return False

    @property
    def sigma(self) -> Array:
        """(1,) [m]."""
        return np.array([self.noise])

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """(n, 1) [m]."""
        seen = point_seen(at, theta, self.offset, None, guess)
        length = np.linalg.norm(seen.reading, axis=1)
        along = (seen.reading / length[:, None])[:, None, :]
        layout = _layout(at.chain, theta)
        slope = _mounted(along @ seen.jacobian, layout)
        slope[..., layout.turn] = 0.0
        missed = np.asarray(self.radius - length)[:, None]
        return Linear(seen.x, missed, slope, along @ seen.by_joints, at.at)


@dataclass(frozen=True)
class DistanceBetween(Observation):
    """Distance of two places of the platform's centre, by a caliper or a scale bar."""

    kind: ClassVar[str] = "distance"
    each: ClassVar[tuple[str, ...]] = ("joint", "other", "distance")

    joint: Array  # (n, m) at the one place
    other: Array  # (n, m) at the other
    distance: Array  # (n,) [m]
    noise: float  # [m]

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        require_shapes(self, other=self.joint.shape, distance=(len(self.joint),))

    @property
    def sigma(self) -> Array:
        """(1,) [m]."""
        return np.array([self.noise])

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """(n, 1) [m]; the poses and the joints' slopes are those of the one place."""
        seen = centre_seen(at, theta, guess)
        there = centre_seen(at.chain.predictor(replace(at.at, joint=self.other)), theta)
        between = there.reading - seen.reading
        apart = np.linalg.norm(between, axis=1)
        along = (between / apart[:, None])[:, None, :]
        slope = _mounted(along @ (there.jacobian - seen.jacobian), _layout(at.chain, theta))
        missed = np.asarray(self.distance - apart)[:, None]
        return Linear(seen.x, missed, slope, -along @ seen.by_joints, at.at)

    def joints(self) -> tuple[Array, ...]:
        """Both places'."""
        return self.joint, self.other


def bare_chain(mechanism: Mechanism) -> Chain:
    """The chain of a mechanism without a reflector of its own and without effects."""
    return Chain(mechanism, np.zeros(3), 1.0)


def centre_seen(at: Predictor, theta: Array, guess: Array | None = None) -> Seen:
    """The platform's centre in the base, see `point_seen`."""
    return point_seen(at, theta, np.zeros(3), Frame.identity(), guess)


def point_seen(
    at: Predictor,
    theta: Array,
    offset: Array | None,
    place: Frame | None,
    guess: Array | None = None,
    read: bool = False,
) -> Seen:
    """A point fixed to the platform as the chain has it, in the frame of a device.

    Args:
        at: the chain under the conditions of n samples.
        theta: (P,) of the chain, a probe's mount in it or not.
        offset: (3,) [m] of the point in the platform; theta's where not given.
        place: `T_device_base`; theta's where not given.
        guess: the platform's poses, nearly, (n, k).
        read: whether a tracker reads it, on which the effects of the measurement act.

    Returns:
        Derivatives by what was given are zero.
    """
    layout = at.chain.layout
    machine = theta[_layout(at.chain, theta).chain]
    given: list[tuple[slice, Array | float]] = []
    given += [] if read else [(part, 0.0) for part in _of_readings(at.chain)]
    if offset is not None:
        given.append((layout.offset, offset))
    if place is not None:
        given.append((layout.frame, place.vector()))
    if given:
        for part, values in given:
            machine[part] = values
    seen = at.see(machine, guess)
    for part, _ in given:
        seen.jacobian[..., part] = 0.0
    return seen


def standing(at: Predictor, theta: Array, guess: Array | None = None) -> tuple[Seen, Array]:
    """How the machine stands under the conditions, and its dimensions there, (p,) or (n, p)."""
    seen = at.see(theta[_layout(at.chain, theta).chain], guess, "nothing")
    shared = len(seen.geometry) == 1 != len(seen.x)
    return seen, seen.geometry[0] if shared else seen.geometry


def through_closures(at: Predictor, theta: Array, by_joints: Array, by_geometry: Array) -> Array:
    """d(closures)/d(theta), (n, d, P), of what goes by joints and dimensions, at a given pose.

    Args:
        at: the chain under the conditions of n samples.
        theta: (P,).
        by_joints: (n, d, m) by the joints behind the drives.
        by_geometry: (n, d, p) by the dimensions under the samples' conditions.
    """
    layout, chain = _layout(at.chain, theta), at.chain
    slope = np.zeros((*by_geometry.shape[:-1], len(theta)))
    slope[..., layout.geometry] = by_geometry
    by_stage = {Stage.DRIVE: by_joints, Stage.STRUCTURE: by_geometry}
    acting = [(e, own) for e, own in zip(chain.effects, layout.each, strict=True)]
    signals = chain.signals(at.at, theta[layout.chain]) if acting else None
    for effect, own in acting:
        if signals is not None and effect.stage in by_stage:
            slope[..., own] = effect.columns_of(signals, theta[own], by_stage[effect.stage])
    return slope


def require_shapes(observation: Observation, **shapes: tuple[int, ...]) -> None:
    """Refuse arrays of another shape, and numbers that are none.

    Raises:
        InputError: names kind, array, shape found and shape needed.
    """
    for name, shape in {"joint": observation.joint.shape, **shapes}.items():
        value = getattr(observation, name)
        if value.shape != shape or not np.isfinite(value).all():
            raise InputError(
                f"{observation.kind}: {name} {value.shape} is not allowed; {shape}, finite"
            )
    if not (observation.sigma > 0).all():
        raise InputError(f"{observation.kind}: noise {observation.sigma} is not allowed; over 0")


def _of_readings(chain: Chain) -> list[slice]:
    """Entries of the effects that act between the pose in the base and a tracker's readings."""
    parts = zip(chain.effects, chain.layout.each, strict=True)
    return [own for effect, own in parts if effect.on_readings]


def _add_turns_of_base(
    slope: Array, at: Predictor, theta: Array, layout: Layout, x: Array
) -> None:
    """Add the base's turn by its effects' values to d(turn)/d(theta), (n, 3, P)."""
    chain, machine = at.chain, theta[layout.chain]
    if not chain.of_base:
        return
    signals = chain.signals(at.at, machine, x)
    by_base = np.concatenate([np.zeros((3, 3)), rotations.exp(theta[layout.turn])], axis=1)[None]
    for effect, own in zip(chain.effects, layout.each, strict=True):
        if effect.stage is Stage.BASE:
            slope[..., own] += effect.columns_of(signals, theta[own], by_base)


def _layout(chain: Chain, theta: Array) -> Layout:
    return chain.layout if len(theta) == chain.layout.size else chain.layout.mounted


def _mounted(by_chain: Array, layout: Layout) -> Array:
    """With columns of zeros for the probe's mount, where theta has one."""
    if not layout.has_mount:
        return by_chain
    every = np.zeros((*by_chain.shape[:-1], layout.size))
    every[..., layout.chain] = by_chain
    return every
