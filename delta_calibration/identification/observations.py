"""What can be measured of a mechanism: each kind says what it misses and how that moves.

Unknowns, in this order: the geometry g (p,), and where the machine's base stands in the frame of
the device that measures, F = `T_device_base`, as turn and place (6,). A kind that needs no device
(a probe that touches the bed, a caliper) has columns of zeros there. Measured less predicted, in
metres, radians or pixels; any mechanism takes part by its poses and its Jacobians. Cameras are in
`image.py`, the closure of a redundant mechanism is in `closing.py`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import Mechanism
from delta_calibration.theta import Layout

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Machine:
    """A mechanism as built, and as placed before the device that measures it."""

    mechanism: Mechanism
    geometry: Array  # (p,)
    frame: Frame  # T_device_base

    @property
    def layout(self) -> Layout:
        """Which of the unknowns are which: no reflector's offset is among them."""
        return unknowns(len(self.mechanism.parameters))

    def poses(self, joint: Array) -> Array:
        """Of the platform in the base, (n, k); NaN rows out of reach."""
        return self.mechanism.forward(joint, self.geometry)

    def points(self, joint: Array, offset: Array) -> Array:
        """A point fixed to the platform, in the base, (n, 3) [m]."""
        x = self.poses(joint)
        return self.mechanism.position(x) + self.mechanism.rotation(x) @ offset

    def seen_by_unknowns(self, joint: Array, offset: Array) -> Array:
        """Derivative of a platform's point in the device, by all unknowns, (n, 3, p + 6)."""
        point = self.points(joint, offset)
        turn = np.broadcast_to(rotations.log(self.frame.rotation), point.shape)
        return self.layout.columns(
            self.frame.rotation @ self.points_by_geometry(joint, offset),
            turn=rotations.exp_times_derivative(turn, point),
            place=np.broadcast_to(np.eye(3), (len(point), 3, 3)),
        )

    def points_by_geometry(self, joint: Array, offset: Array) -> Array:
        """Their derivative, (n, 3, p)."""
        x = self.poses(joint)
        return self.mechanism.point_by_pose(x, offset) @ self._poses_by_geometry(joint, x)

    def turns_by_geometry(self, joint: Array) -> Array:
        """Small turn of the platform, in axes of the base, (n, 3, p) [rad]."""
        x = self.poses(joint)
        return self.mechanism.turn_by_pose(x) @ self._poses_by_geometry(joint, x)

    def _poses_by_geometry(self, joint: Array, x: Array) -> Array:
        return self.mechanism.identification_jacobian(joint, x, self.geometry)


class Observation(ABC):
    """Base of all kinds: n measurements of d numbers each."""

    kind: ClassVar[str]

    joint: Array  # (n, m)

    @property
    def device(self) -> str:
        """What measures, where it matters how that stands before the base; else nothing."""
        return ""

    @property
    @abstractmethod
    def sigma(self) -> Array:
        """Standard deviation of each of the d numbers, (d,) [m, rad, px]."""

    @abstractmethod
    def missed(self, machine: Machine) -> Array:
        """Measured less predicted, (n, d) [m, rad, px]; NaN rows out of reach."""

    @abstractmethod
    def slopes(self, machine: Machine) -> Array:
        """d(predicted)/d(unknowns), (n, d, p + 6)."""

    def joints(self) -> tuple[Array, ...]:
        """Every set of joints that it was taken at, each (n, m)."""
        return (self.joint,)


@dataclass(frozen=True)
class PointMeasured(Observation):
    """A reflector's position by a tracker."""

    kind: ClassVar[str] = "position"

    joint: Array
    point: Array  # (n, 3) [m] in the device's frame
    offset: Array  # (3,) [m] of the reflector in the platform
    noise: float  # [m] each coordinate

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        require_shapes(self, point=(len(self.joint), 3), offset=(3,))

    @property
    def device(self) -> str:
        """A tracker."""
        return "tracker"

    @property
    def sigma(self) -> Array:
        """(3,) [m]."""
        return np.full(3, self.noise)

    def missed(self, machine: Machine) -> Array:
        """(n, 3) [m]."""
        return self.point - machine.frame.apply(machine.points(self.joint, self.offset))

    def slopes(self, machine: Machine) -> Array:
        """(n, 3, p + 6)."""
        return machine.seen_by_unknowns(self.joint, self.offset)


@dataclass(frozen=True)
class PoseMeasured(PointMeasured):
    """A probe's position and turn by a tracker of six degrees of freedom."""

    kind: ClassVar[str] = "pose"

    rotation: Array  # (n, 3, 3) of the platform in the device's frame
    turn_noise: float  # [rad] each axis

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together."""
        super().__post_init__()
        require_shapes(self, rotation=(len(self.joint), 3, 3))

    @property
    def sigma(self) -> Array:
        """(6,) [m, rad]."""
        return np.append(super().sigma, np.full(3, self.turn_noise))

    def missed(self, machine: Machine) -> Array:
        """(n, 6) [m, rad]; the turn is the one that is left, in axes of the device."""
        x = machine.poses(self.joint)
        predicted = machine.frame.rotation @ machine.mechanism.rotation(x)
        turn = rotations.log(self.rotation @ np.swapaxes(predicted, 1, 2))
        return np.concatenate([super().missed(machine), turn], axis=1)

    def slopes(self, machine: Machine) -> Array:
        """(n, 6, p + 6); of the turn to first order in what is left."""
        by_turn = rotations.left_jacobian(rotations.log(machine.frame.rotation))
        turn = machine.layout.columns(
            machine.frame.rotation @ machine.turns_by_geometry(self.joint),
            turn=np.broadcast_to(by_turn, (len(self.joint), 3, 3)),
        )
        return np.concatenate([super().slopes(machine), turn], axis=1)


@dataclass(frozen=True)
class HeightAtContact(Observation):
    """How high over the bed, the base's plane z = 0, the platform stands when its probe touches.

    Heights alone say nothing of a turn about z or a shift along the bed.
    """

    kind: ClassVar[str] = "height"

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

    def missed(self, machine: Machine) -> Array:
        """(n, 1) [m]."""
        return np.asarray(self.height - machine.points(self.joint, np.zeros(3))[:, 2])[:, None]

    def slopes(self, machine: Machine) -> Array:
        """(n, 1, p + 6)."""
        slope = machine.points_by_geometry(self.joint, np.zeros(3))[:, 2:]
        return without_frame(slope)


@dataclass(frozen=True)
class DistanceBetween(Observation):
    """Distance of two places of the platform's centre, by a caliper or a scale bar."""

    kind: ClassVar[str] = "distance"

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

    def missed(self, machine: Machine) -> Array:
        """(n, 1) [m]."""
        apart = np.linalg.norm(self._between(machine), axis=1)
        return np.asarray(self.distance - apart)[:, None]

    def slopes(self, machine: Machine) -> Array:
        """(n, 1, p + 6): along the line between the two."""
        between = self._between(machine)
        along = between / np.linalg.norm(between, axis=1)[:, None]
        moved = machine.points_by_geometry(self.other, np.zeros(3))
        moved = moved - machine.points_by_geometry(self.joint, np.zeros(3))
        return without_frame(along[:, None, :] @ moved)

    def joints(self) -> tuple[Array, ...]:
        """Both places'."""
        return self.joint, self.other

    def _between(self, machine: Machine) -> Array:
        zero = np.zeros(3)
        return machine.points(self.other, zero) - machine.points(self.joint, zero)


def unknowns(geometry_size: int) -> Layout:
    """Layout of the unknowns of a fit of observations: geometry (p,) and frame (6,)."""
    return Layout(geometry_size, has_offset=False)


def without_frame(slope: Array) -> Array:
    """Columns of zeros for the device's frame.  (n, d, p) -> (n, d, p + 6)."""
    return unknowns(slope.shape[-1]).columns(slope)


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
