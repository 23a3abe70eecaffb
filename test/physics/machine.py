"""Parts of a machine, and their faults: wear and compliance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Nominal SRBD [m], [kg].
RADIUS, PLATFORM, ARM, ROD, HALF = 0.2, 0.055, 0.32, 0.85, 0.04
PLATFORM_KG, ARM_KG, ROD_KG = 1.2, 1.6, 0.18
ARM_CENTRE = 0.45  # of its length, from the motor's axis
SIDES = (-1.0, 1.0)

PLATFORM_END, ELBOW_END = "platform", "elbow"


def _none() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Machine:
    """Lengths of the parts as manufactured, and their faults.

    Attributes:
        hinge: of each motor's axis off its place, outward, along and up, (3, 3) [m].
        ball: of the middle of each pair of ball joints on the platform, the same, (3, 3) [m].
        arm: of each arm, (3,) [m].
        rod: of each rod, (3, 2) [m].
        line: direction of each arm's pair of ball joints, rotated about the arm's length and about
            the normal of arm and motor's axis, (3, 2) [rad].
        zero: by which an arm is ahead of its motor, (3,) [rad].
        drive: stiffness of each drive [N m/rad]; infinite: rigid.
        gap: backlash of each drive, from flank to flank, (3,) [rad].
        friction: of each arm in its bearing, Coulomb, (3,) [N m].
        rod_spring: stiffness of each rod [N/m]; infinite: rigid.
        clearance: by which a ball may be off the middle of its socket [m].
        worn: end of the rods with the clearance, `PLATFORM_END` or `ELBOW_END`.
        mount: stiffness of the base's mount, in each direction [N/m]; infinite: rigid.
        feet: depth of the mount below the base [m].
    """

    hinge: Array
    ball: Array
    arm: Array
    rod: Array
    line: Array
    zero: Array
    drive: Array
    gap: Array
    friction: Array
    rod_spring: float = np.inf
    clearance: float = 0.0
    worn: str = PLATFORM_END
    mount: float = np.inf
    feet: float = 0.0

    def elbow(self, leg: int, side: int) -> Array:
        """Ball joint of a rod on its arm: along the arm, the motor's axis, normal, (3,) [m]."""
        about_length, about_normal = self.line[leg]
        line = np.array([-about_normal, 1.0, about_length])
        middle = np.array([self.arm[leg], 0.0, 0.0])
        return middle + SIDES[side] * HALF * line / np.linalg.norm(line)

    def with_(self, **faults: Array | float | str) -> Machine:
        """The same machine with faults; a value of each drive may be one number for all."""
        each = ("drive", "gap", "friction")
        return replace(
            self,
            **{
                name: np.broadcast_to(value, 3).astype(float) if name in each else value
                for name, value in faults.items()
            },
        )


def as_drawn() -> Machine:
    """A machine without any error or fault."""
    return Machine(
        hinge=np.zeros((3, 3)),
        ball=np.zeros((3, 3)),
        arm=np.full(3, ARM),
        rod=np.full((3, 2), ROD),
        line=np.zeros((3, 2)),
        zero=_none(),
        drive=np.full(3, np.inf),
        gap=_none(),
        friction=_none(),
    )


def from_the_workshop(rng: np.random.Generator) -> Machine:
    """A machine without faults whose parts deviate as the robot file expects."""
    drawn = as_drawn()
    apart = rng.normal(0, 0.05e-3, 3)
    rod = ROD + rng.normal(0, 0.2e-3, 3)
    return replace(
        drawn,
        hinge=rng.normal(0, 0.25e-3, (3, 3)),
        ball=rng.normal(0, 0.25e-3, (3, 3)),
        arm=ARM + rng.normal(0, 0.15e-3, 3),
        rod=rod[:, None] + np.array(SIDES) * apart[:, None] / 2,
        zero=rng.normal(0, 0.8e-3, 3),
        line=rng.normal(0, 0.5e-3, (3, 2)),
    )
