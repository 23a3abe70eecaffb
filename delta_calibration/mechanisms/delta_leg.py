"""Common parts of the two models of a rotary Delta: legs, hinge, arm, drawing and masses.

Leg i stands at angle eta_i about z, by default 2 pi (i - 1) / 3. Its hinge frame has x radially
outward, y along the motor's axis and z up; a positive joint angle lowers the arm:
u(q) = (cos q, 0, -sin q). Paper 000 section 2 has z down and the same positive sense.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from itertools import chain
from math import pi
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.geometry import rotations
from delta_calibration.mechanisms.base import ROD_END, ROD_MIDDLE, Limb, Mechanism
from delta_calibration.mechanisms.stands import require_apart
from delta_calibration.model.symbols import Symbol, about_z, column, cos, little, sin, tilt
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.sections import (
    angle,
    as_written,
    length,
    mass,
    quantity,
    refused,
    tolerance,
)

Array = NDArray[np.float64]

LEGS = 3
_STANDS: Array = np.asarray(2 * np.pi / 3 * np.arange(LEGS), dtype=np.float64)  # [rad] about z


@dataclass(frozen=True)
class DeltaDimensions:
    """The drawing of a rotary Delta [m]: paper 000 table 1, and half widths of ball joints."""

    base_radius: float = length(about="R: distance of the motor axes from the centre of the base")
    platform_radius: float = length(
        about="r: distance of the middle of a leg's ball joints from the centre of the platform"
    )
    arm: float = length(about="L: length of the upper arm, motor axis to elbow")
    rod: float = length(about="l: length of the forearm, elbow to platform, between ball centres")
    half_width: float = length(
        about="e: half of the distance between the two ball joints of a pair"
    )
    azimuths: Array | None = angle(
        shape=(LEGS,),
        default=None,
        about="direction of each leg about z, counter-clockwise; left out: 0, 120, 240",
    )

    @property
    def stands(self) -> Array:
        """Direction of each leg about z, (3,) [rad]."""
        return _STANDS if self.azimuths is None else self.azimuths

    @property
    def frames(self) -> Array:
        """Rotation matrices of the legs about z, (3, 3, 3)."""
        return rotations.about_z(self.stands)

    def __post_init__(self) -> None:
        """Refuse rods too short to reach the platform from level arms, and coincident legs.

        Raises:
            ConfigError: names the entry, its value and what is allowed.
        """
        across = abs(self.base_radius + self.arm - self.platform_radius)
        if not self.rod > across:
            raise refused(
                self,
                "rod",
                f"more than {as_written(across, 'mm')} (base_radius_mm + arm_mm - "
                "platform_radius_mm), to reach the platform from level arms",
            )
        require_apart(self, "azimuths", self.stands, "legs")


@dataclass(frozen=True)
class DeltaTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    joint_position: float = tolerance(
        about="position of hinges and platform joints, each coordinate"
    )
    arm: float = tolerance(about="length of an arm")
    rod: float = tolerance(about="mean length of a pair of rods")
    rod_mismatch: float = tolerance(about="difference of the two rods of a pair")
    joint_zero: float = tolerance("mrad", about="zero of the encoder")
    hinge_tilt: float = tolerance("mrad", about="direction of the motor axis")
    half_width: float = tolerance(about="position of a ball joint along the line of its pair")
    line_tilt: float = tolerance(
        "mrad", about="direction of the line through a pair of ball joints"
    )


@dataclass(frozen=True)
class DeltaMasses:
    """Moving masses of a rotary Delta."""

    platform: float = mass(about="platform with everything permanently mounted on it")
    arm: float = mass(about="mass of one upper arm")
    arm_centre: float = quantity(
        least=0.0,
        most=1.0,
        about="centre of mass of an upper arm: fraction of its length from the motor axis",
    )
    rod: float = mass(about="mass of one rod")

    @property
    def on_platform(self) -> float:
        """Mass at the platform in a one-mass model: the platform and half of each rod [kg]."""
        return self.platform + LEGS * self.rod

    @property
    def turning(self) -> float:
        """Moment of inertia of an arm about its motor, over its mass times its length squared.

        That of a bar whose section changes linearly along it and gives it this centre of mass; at
        least that of a point mass there.
        """
        return max(self.arm_centre**2, self.arm_centre - 1 / 6)


class DeltaModel(Mechanism):
    """Base of the models of a rotary Delta: three motors command the platform's centre."""

    Dimensions = DeltaDimensions
    Tolerances = DeltaTolerances
    Masses = DeltaMasses
    commanded: ClassVar[str] = "rotary_delta"
    detailed: ClassVar[str] = "six_rod_delta"
    joints: int = LEGS
    task_size: int = 3

    def __init__(self, dimensions: DeltaDimensions, tolerances: DeltaTolerances) -> None:
        """From the drawing and the expected errors of the parts."""
        self.dimensions = dimensions
        self.tolerances = tolerances
        each = (self._leg_parameters(leg) for leg in range(1, LEGS + 1))
        self.parameters = ParameterSet(tuple(chain.from_iterable(each)))

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """The legs: motor, dimensions, closure rows, cosine and sine of the direction of each."""
        size, rows = len(self.parameters) // LEGS, self.pose_size // LEGS
        stands = self.dimensions.stands
        turns = tuple(zip(np.cos(stands).tolist(), np.sin(stands).tolist(), strict=True))
        return tuple(
            Limb(
                (leg,),
                tuple(range(leg * size, (leg + 1) * size)),
                tuple(range(leg * rows, (leg + 1) * rows)),
                turns[leg],
            )
            for leg in range(LEGS)
        )

    def weights(self, masses: DeltaMasses | None) -> Array:
        """Point masses at the platform, the elbows and the middles of the pairs of rods [kg].

        Each arm carries a pair of uniform rods, see `ROD_END`. The arm's own mass is divided
        between hinge and elbow so that its centre is kept.
        """
        if masses is None:
            return np.zeros(1 + 2 * LEGS)
        end, middle = (2 * share * masses.rod for share in (ROD_END, ROD_MIDDLE))
        elbow, platform = masses.arm * masses.arm_centre + end, masses.platform + LEGS * end
        return np.array([platform, *LEGS * (elbow,), *LEGS * (middle,)])

    def moving(self, masses: DeltaMasses | None) -> Array:
        """Share of each mass that acts as inertia; for an arm that of its moment of inertia."""
        share = np.ones(1 + 2 * LEGS)
        if masses is not None and (at_elbow := self.weights(masses)[1]):
            share[1 : 1 + LEGS] = (
                masses.arm * masses.turning + 2 * ROD_END * masses.rod
            ) / at_elbow
        return share

    @property
    def levers(self) -> Array:
        """Platform radius, outward, by which `masses` has each leg shifted in, (7, 3) [m]."""
        legs = self.dimensions.platform_radius * self._outwards
        return np.concatenate([np.zeros((1, 3)), legs, legs])

    @property
    def pivots(self) -> Array:
        """Motor positions for the arms' masses, zero for the others, (7, 3) [m]."""
        motors = self.dimensions.base_radius * self._outwards
        return np.concatenate([np.zeros((1, 3)), motors, np.zeros((LEGS, 3))])

    @property
    def base_lengths(self) -> Array:
        """Radius of the base in the dimension that places each leg radially, (p,) [m]."""
        names = self.parameters.names
        radial = [name.startswith(("base_radial", "joint_radial")) for name in names]
        return np.where(radial, self.dimensions.base_radius, 0.0)

    @property
    def _outwards(self) -> Array:
        """Unit vectors from the axis to the legs, (3, 3)."""
        stands = np.array(self.dimensions.stands)
        return np.stack([np.cos(stands), np.sin(stands), 0 * stands], axis=1)

    @abstractmethod
    def _leg_parameters(self, leg: int) -> list[Parameter]:
        """Parameters of leg 1, 2 or 3, in the order of the model's vector."""


def arm_end(angle: Symbol, hinge_tilt: Symbol, arm: Symbol) -> Symbol:
    """T u(angle) L: vector from the hinge to the middle of the elbow, in the leg's frame [m].

    Args:
        angle: angle of the arm, including the encoder's zero [rad].
        hinge_tilt: tilt of the motor's axis about x and z [rad], (2).
        arm: length of the arm [m].
    """
    direction = column(cos(angle), 0, -sin(angle))
    return arm * (hinge_frame(hinge_tilt) @ direction)


def elbow_of(c: Symbol, hinge: Symbol, *arm: Symbol) -> Symbol:
    """Middle of a leg's elbow in the base [m]; hinge (3) [m] in its frame, `arm` of `arm_end`."""
    return leg_frame(c) @ (hinge + arm_end(*arm))


def turned_on(d: Symbol, c: Symbol, hinge: Symbol, angle: Symbol, *arm: Symbol) -> Symbol:
    """Elbow after the arm has turned by d [rad], up to `symbols.LITTLE`, about the hinge [m]."""
    about, (cosine, sine) = leg_frame(c) @ hinge, little(d)
    ahead, across = (elbow_of(c, hinge, at, *arm) - about for at in (angle, angle + pi / 2))
    return about + cosine * ahead + sine * across


def hinge_frame(about: Symbol) -> Symbol:
    """Rotation matrix of a part that is tilted about x and z, (2) [rad], and not about y."""
    return tilt(column(about[0], 0, about[1]))


def leg_frame(c: Symbol) -> Symbol:
    """Rotation matrix about z to the direction of a leg, from its cosine and sine."""
    return about_z(c[0], c[1])
