"""Kinds of measurement of a mechanism: each gives its residuals and their Jacobian.

For a machine theta under the conditions of its samples, a kind returns the residuals (measured
less predicted) and the derivatives of the prediction by every entry of theta and by the joints.
All positions come from the same measurement chain (`chain.py`) with its effects; a kind only adds
its measurement equation. Metres, radians or pixels. Cameras are in `image.py`, closures of a
redundant mechanism in `closures.py` and `encoder_closures.py`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Asked, Chain, Predictor, read_at
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import Stage
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.lazy import cached_property
from delta_calibration.mechanisms import Mechanism
from delta_calibration.theta import Layout

if TYPE_CHECKING:
    from delta_calibration.model.view import Seen

Array = NDArray[np.float64]
Own = TypeVar("Own", bound="Observation")


@dataclass(frozen=True)
class PlacedMachine:
    """A mechanism with its actual geometry, and its frame relative to the measuring device."""

    chain: Chain
    theta: Array  # (P,)

    @classmethod
    def of(cls, mechanism: Mechanism, geometry: Array, frame: Frame) -> PlacedMachine:
        """Build it from dimensions (p,) and `T_device_base`, with no reflector on the platform."""
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


@dataclass(frozen=True)
class Linear:
    """Measurements linearized about one machine."""

    pose: Array  # (n, k) of the platform; NaN rows out of reach
    missed: Array  # (n, d) measured less predicted [m, rad, px]
    by_theta: Array  # (n, d, P) d(predicted)/d(theta)
    by_joints: Array  # (n, d, m) d(predicted)/d(joints behind the drives)
    at: Conditions  # with the readings that the chain predicts before its last stage
    # (n, m) joints behind the drives and (n, p) dimensions under the conditions, if known
    stood: tuple[Array, Array] | None = None


class Observation(ABC):
    """Base of all kinds: n measurements of d numbers each."""

    kind: ClassVar[str]
    each: ClassVar[tuple[str, ...]] = ("joint",)  # fields with one row for each measurement

    joint: Array  # (n, m)

    @property
    def device(self) -> str:
        """Name of the measuring device if its pose in the base is an unknown; else empty."""
        return ""

    @property
    def turns(self) -> bool:
        """Whether the measurements depend on the device's orientation, too."""
        return True

    @property
    @abstractmethod
    def sigma(self) -> Array:
        """Standard deviation of each of the d numbers, (d,) [m, rad, px]."""

    @abstractmethod
    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Return the residuals about a machine and their derivatives.

        Args:
            at: the chain under the conditions of the n measurements.
            theta: (P,) of the chain, with a probe's mount if the fit has one.
            guess: approximate poses of the platform, (n, k).
        """

    def left(self, at: Predictor, theta: Array, guess: Array | None = None) -> tuple[Array, Array]:
        """Poses (n, k) and residuals (n, d) of `linearized`, if possible without derivatives."""
        linear = self.linearized(at, theta, guess)
        return linear.pose, linear.missed

    def joints(self) -> tuple[Array, ...]:
        """All sets of joints of the measurements, each (n, m)."""
        return (self.joint,)

    def missed(self, machine: PlacedMachine) -> Array:
        """Measured less predicted of a machine at rest, (n, d); NaN rows out of reach."""
        return self._about(machine).missed

    def slopes(self, machine: PlacedMachine) -> Array:
        """d(predicted)/d(theta) of a machine at rest, (n, d, P)."""
        return self._about(machine).by_theta

    def _about(self, machine: PlacedMachine) -> Linear:
        return self.linearized(machine.chain.predictor(at_rest(self.joint)), machine.theta)

    def take(self: Own, rows: NDArray[Any] | slice) -> Own:
        """Some of the measurements."""
        own: dict[str, Any] = {name: getattr(self, name)[rows] for name in self.each}
        taken: Own = replace(self, **own)  # type: ignore[type-var]
        return taken


@dataclass(frozen=True)
class Measured:
    """Observations of one kind, with the conditions and the whitening of each."""

    observation: Observation
    at: Conditions  # (n) with the joints of the observation
    timed: bool = True  # whether the times are clock times, not only an order
    given: Array | None = None  # (n, d, d) whitening that replaces the observation's
    # (n,) number of the motion in which each was taken, if none was at rest, and the standard
    # deviation of the joints' rest error before it [rad or m], which is constant in one motion
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
        """Whitening matrices, (n, d, d) [1/m, 1/rad, 1/px]."""
        if self.given is not None:
            return self.given
        root = np.diag(1 / self.observation.sigma)
        return np.broadcast_to(root, (len(self.at), *root.shape)).copy()

    def take(self, rows: NDArray[Any]) -> Measured:
        """Some of the observations."""
        given = None if self.given is None else self.given[rows]
        path = None if self.path is None else self.path[rows]
        at, observation = self.at.take(rows), self.observation.take(rows)
        return Measured(observation, at, self.timed, given, path, self.repeatability)


@dataclass(frozen=True)
class PointMeasured(Observation):
    """Position of a reflector, measured by a tracker."""

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
        """Standard deviation of each coordinate, (3,) [m]."""
        return np.full(3, self.noise)

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals (n, 3) [m] and their derivatives."""
        seen = point_seen(at, theta, self.offset, None, guess, read=True)
        by_theta = _mounted(seen.jacobian, _layout(at.chain, theta))
        read = read_at(at.at, seen)
        geometry = np.broadcast_to(seen.geometry, (len(seen.x), seen.geometry.shape[1]))
        missed, stood = self.point - seen.reading, (seen.joint, geometry)
        return Linear(seen.x, missed, by_theta, seen.by_joints, read, stood)

    def left(self, at: Predictor, theta: Array, guess: Array | None = None) -> tuple[Array, Array]:
        """Poses (n, k) and residuals (n, 3) [m]."""
        seen = point_seen(at, theta, self.offset, None, guess, read=True, asked="nothing")
        return seen.x, self.point - seen.reading


@dataclass(frozen=True)
class PoseMeasured(PointMeasured):
    """Position and orientation of a probe, measured by a tracker with six degrees of freedom.

        R_measured = exp([e]x) R_T R(x) R(m)

    R_T: the tracker's frame; R(x): the platform's rotation; m: the probe's mounting rotation on
    the platform, three more unknowns, or zero if theta is that of the chain alone.
    e is the residual, in the axes of the tracker.
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
        """Standard deviation of each number, (6,) [m, rad]."""
        return np.append(super().sigma, np.full(3, self.turn_noise))

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals (n, 6) [m, rad]; the rotation's derivatives are those at zero residual."""
        point = super().linearized(at, theta, guess)
        chain, layout, x = at.chain, _layout(at.chain, theta), point.pose
        turned = at.see(theta[layout.chain], x, "poses")
        frame = rotations.exp(theta[layout.turn])
        platform, missed = self._turned(at, theta, x)
        by_pose = frame @ chain.mechanism.turn_by_pose(x)
        slope = _mounted(by_pose @ turned.jacobian, layout)
        slope[..., layout.turn] = rotations.left_jacobian(theta[layout.turn])
        _add_turns_of_base(slope, at, theta, layout, x)
        if layout.has_mount:
            slope[..., layout.mount] = platform @ rotations.left_jacobian(theta[layout.mount])
        return replace(
            point,
            missed=np.concatenate([point.missed, missed], axis=1),
            by_theta=np.concatenate([point.by_theta, slope], axis=1),
            by_joints=np.concatenate([point.by_joints, by_pose @ turned.by_joints], axis=1),
        )

    def left(self, at: Predictor, theta: Array, guess: Array | None = None) -> tuple[Array, Array]:
        """Poses (n, k) and residuals (n, 6) [m, rad]."""
        pose, missed = super().left(at, theta, guess)
        _, turned = self._turned(at, theta, pose)
        return pose, np.concatenate([missed, turned], axis=1)

    def _turned(self, at: Predictor, theta: Array, x: Array) -> tuple[Array, Array]:
        """Predicted rotation of the platform (n, 3, 3), and the probe's residual (n, 3) [rad]."""
        layout = _layout(at.chain, theta)
        platform = predicted = at.chain.rotation(at.at, theta[layout.chain], x)
        if layout.has_mount:
            predicted = platform @ rotations.exp(theta[layout.mount])
        return platform, rotations.log(self.rotation @ np.swapaxes(predicted, 1, 2))


@dataclass(frozen=True)
class HeightAtContact(Observation):
    """Height of the platform over the bed (the base's plane z = 0) when its probe touches.

    Heights alone do not determine a rotation about z or a shift along the bed.
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
        """Standard deviation, (1,) [m]."""
        return np.array([self.noise])

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals (n, 1) [m] and their derivatives."""
        seen = centre_seen(at, theta, guess)
        missed = np.asarray(self.height - seen.reading[:, 2])[:, None]
        slope = _mounted(seen.jacobian[:, 2:], _layout(at.chain, theta))
        return Linear(seen.x, missed, slope, seen.by_joints[:, 2:], at.at)


@dataclass(frozen=True)
class RadiusMeasured(Observation):
    """Length of a telescoping ballbar between a ball on the platform and one on the table.

    The position of the ball on the table is unknown: it is the origin of the device's frame, whose
    orientation has no effect.
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
        """False: a length does not depend on the device's orientation."""
        return False

    @property
    def sigma(self) -> Array:
        """Standard deviation, (1,) [m]."""
        return np.array([self.noise])

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals (n, 1) [m] and their derivatives."""
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
    """Distance between two positions of the platform's centre, by a caliper or a scale bar."""

    kind: ClassVar[str] = "distance"
    each: ClassVar[tuple[str, ...]] = ("joint", "other", "distance")

    joint: Array  # (n, m) at the first position
    other: Array  # (n, m) at the second position
    distance: Array  # (n,) [m]
    noise: float  # [m]

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together, and distances of a position from itself."""
        require_shapes(self, other=self.joint.shape, distance=(len(self.joint),))
        same = np.flatnonzero((self.joint == self.other).all(axis=1))
        if same.size:
            raise InputError(
                f"distance {same[0] + 1}: both positions have the same joints; two positions "
                "that differ are needed"
            )

    @property
    def sigma(self) -> Array:
        """Standard deviation, (1,) [m]."""
        return np.array([self.noise])

    def linearized(self, at: Predictor, theta: Array, guess: Array | None = None) -> Linear:
        """Residuals (n, 1) [m]; poses and joint derivatives are those of the first position."""
        seen = centre_seen(at, theta, guess)
        there = centre_seen(at.chain.predictor(replace(at.at, joint=self.other)), theta)
        between = there.reading - seen.reading
        apart = np.linalg.norm(between, axis=1)
        along = (between / apart[:, None])[:, None, :]
        slope = _mounted(along @ (there.jacobian - seen.jacobian), _layout(at.chain, theta))
        missed = np.asarray(self.distance - apart)[:, None]
        return Linear(seen.x, missed, slope, -along @ seen.by_joints, at.at)

    def joints(self) -> tuple[Array, ...]:
        """Joints of both positions."""
        return self.joint, self.other


def bare_chain(mechanism: Mechanism) -> Chain:
    """Return the chain of a mechanism with no reflector offset and no effects."""
    return Chain(mechanism, np.zeros(3), 1.0)


def centre_seen(at: Predictor, theta: Array, guess: Array | None = None) -> Seen:
    """Predict the platform's centre in the base, see `point_seen`."""
    return point_seen(at, theta, np.zeros(3), Frame.identity(), guess)


def point_seen(
    at: Predictor,
    theta: Array,
    offset: Array | None,
    place: Frame | None,
    guess: Array | None = None,
    read: bool = False,
    asked: Asked = "readings",
) -> Seen:
    """Predict a point fixed to the platform, in the frame of a device.

    Args:
        at: the chain under the conditions of n samples.
        theta: (P,) of the chain, with or without a probe's mount.
        offset: (3,) [m] of the point in the platform; that of theta if not given.
        place: `T_device_base`; that of theta if not given.
        guess: approximate poses of the platform, (n, k).
        read: whether a tracker reads it, so that effects of base and measurement act on it.
        asked: whose derivatives are computed, see `Predictor.see`.

    Returns:
        The prediction; derivatives by `offset` and `place` are zero if these are given.
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
    seen = at.see(machine, guess, asked)
    for part, _ in given:
        seen.jacobian[..., part] = 0.0
    return seen


def standing(at: Predictor, theta: Array, guess: Array | None = None) -> tuple[Seen, Array]:
    """Poses and joints under the conditions, and the dimensions there, (p,) or (n, p)."""
    seen = at.see(theta[_layout(at.chain, theta).chain], guess, "nothing")
    shared = len(seen.geometry) == 1 != len(seen.x)
    return seen, seen.geometry[0] if shared else seen.geometry


def through_closures(at: Predictor, theta: Array, by_joints: Array, by_geometry: Array) -> Array:
    """d(closures)/d(theta) at given poses, (n, d, P), through joints and dimensions.

    Args:
        at: the chain under the conditions of n samples.
        theta: (P,).
        by_joints: (n, d, m) derivatives by the joints behind the drives.
        by_geometry: (n, d, p) derivatives by the dimensions under the samples' conditions.
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
    """Refuse arrays of another shape, and numbers that are not finite.

    Raises:
        InputError: names kind, array, shape found and shape needed, or the noise.
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
    """Slices of theta for effects between the pose in the base and a tracker's readings."""
    parts = zip(chain.effects, chain.layout.each, strict=True)
    return [own for effect, own in parts if effect.on_readings]


def _add_turns_of_base(
    slope: Array, at: Predictor, theta: Array, layout: Layout, x: Array
) -> None:
    """Add the base's rotation by its effects to d(rotation)/d(theta), (n, 3, P), in place."""
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
    """Insert zero columns for the probe's mount, if theta has one."""
    if not layout.has_mount:
        return by_chain
    every = np.zeros((*by_chain.shape[:-1], layout.size))
    every[..., layout.chain] = by_chain
    return every
