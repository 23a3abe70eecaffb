"""Gravity sag of a serial arm's joints under links of unknown mass.

    dq_j = -s_j sum_{k >= j} mu_jk . R_k^T (z x a_j) - tau_j / k_j

with a_j the axis of joint j, z up, and s_j the sense of the joint's reading, 1 or -1.

R_k mu_jk is the first moment of link k and all it carries, times the weight of a kilogram, over
the stiffness of joint j: an arm's gravity torques depend on no more than these vectors (base
parameters, Gautier and Khalil 1990), one free vector for each joint and link. The payload is known
better: tau_j is its torque on joint j, and one number, the compliance 1 / k_j, gives its effect.
That number is a free parameter if the payload changes; otherwise it is a part of the moments. If
the robot file states masses and the payload is recorded, `reducer_compliance` identifies the
stiffness itself, with far fewer values. The axes are nominal: their errors are of the order of
thousandths, and the sag is small.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Stage, payload_known
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import GRAVITY, JOINT, Places
from delta_calibration.effects.springs import GIVE, MOST_GIVE
from delta_calibration.mechanisms import SerialArm
from delta_calibration.model import symbols as sy
from delta_calibration.model.symbols import Symbol
from delta_calibration.model.terms import Term
from delta_calibration.parameters import Parameter, ParameterSet

_SIZE, _MOST = 0.2e-3, 0.02  # [rad] expected of a vector's component, and its bound
_UPRIGHT = 1e-6  # sine of the twist between successive axes below which they are parallel


UNKNOWN, KNOWN = "unknown", "known"


@dataclass(frozen=True)
class GravitySag(Effect):
    """Turn of each joint by the weight of its own link, every link beyond it and the payload."""

    cause: ClassVar[str] = "gravity_sag"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "drives",
        "compensate the compliance of the drives, or make them stiffer",
        "hang a known weight on the arm with the motor held and read a dial gauge at its end",
    )
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    gentle: ClassVar[bool] = True
    yields: ClassVar[bool] = True

    payload: str = UNKNOWN  # or KNOWN: the payload's part then has its own parameters

    @property
    def suits(self) -> bool:
        """Whether it is an arm with an axis that is not upright."""
        arm = self.mechanism
        return isinstance(arm, SerialArm) and any(
            abs(np.sin(link.twist)) > _UPRIGHT for link in arm.dimensions.links
        )

    @property
    def unsuited(self) -> str:
        """Reason: no arm, or only upright axes, free of weight."""
        if not isinstance(self.mechanism, SerialArm):
            return super().unsuited
        return "all its axes are vertical and carry no weight"

    @property
    def parameters(self) -> ParameterSet:
        """Components of every vector [rad], none of link j along axis j; 1 / k_j if known."""
        moments = _components(self.cause, self.mechanism.joints, self.mechanism.joint_size)
        if self.payload == UNKNOWN:
            return moments
        gives = self.each_joint("compliance", "rad/(N m)", GIVE, 0.0, MOST_GIVE)
        return ParameterSet((*moments.items, *gives.items))

    @property
    def alone(self) -> tuple[tuple[str, ...], ...]:
        """The payload's compliances: the joints' zeros absorb much of the arm's own weight."""
        gives = tuple(self.parameters.names[-self.mechanism.joints :])
        return (gives,) if self.payload == KNOWN else ()

    @property
    def takes(self) -> tuple[str, ...]:
        """Joint angles; also each joint's torque by the payload if it has its own parameters."""
        return (JOINT, GRAVITY) if self.payload == KNOWN else (JOINT,)

    @property
    def needs(self) -> tuple[str, ...]:
        """The payload, if it has its own parameters."""
        return ("payload",) if self.payload == KNOWN else ()

    def shapes(self, at: Conditions) -> Iterator[GravitySag]:
        """The payload has its own parameters if it changes."""
        changes = payload_known(at) and np.ptp(at.payload) > 0.0
        yield replace(self, payload=KNOWN if changes else UNKNOWN)

    def forms(self) -> Iterator[GravitySag]:
        """With and without parameters of the payload's own."""
        yield from (replace(self, payload=told) for told in (UNKNOWN, KNOWN))

    def wrong(self) -> str:
        """Check that `payload` is one of the two words."""
        if self.payload in (UNKNOWN, KNOWN):
            return super().wrong()
        return f"payload: {self.payload!r} is not allowed; {UNKNOWN} or {KNOWN}"

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """-sum mu_jk . R_k^T (z x a_j) - tau_j / k_j of all joints."""
        joints = int(c.shape[0]) // 3
        angles = [c[joints + i] * s[i] + c[2 * joints + i] for i in range(joints)]
        frames = list(_frames([c[i] for i in range(joints)], angles))
        sag, value = [], 0
        for j, (_, _, axis) in enumerate(frames):
            across = sy.column(-axis[1], axis[0], 0)
            turned: Symbol = 0
            for k in range(j, joints):
                for along in frames[k][: 2 if k == j else 3]:
                    turned = turned - v[value] * sy.dot(along, across)
                    value += 1
            sag.append(c[joints + j] * turned)
        for j in range(int(s.shape[0]) - joints):
            sag[j] = sag[j] - v[value + j] * s[joints + j]
        return sy.column(*sag)

    def terms(self, places: Places) -> Iterator[Term]:
        """A single term, for all joints."""
        m = self.mechanism.joints
        signals = (places.begin(name) + j for name in self.takes for j in range(m))
        yield Term(
            tuple(signals),
            tuple(range(len(self.parameters))),
            tuple(range(m)),
            self.constants(0),
        )

    def constants(self, joint: int) -> tuple[float, ...]:
        """Twist of each link; sense and zero of each joint's reading."""
        del joint
        arm = self.mechanism
        assert isinstance(arm, SerialArm)
        links, drives = arm.dimensions.links, arm.drives
        zero = np.array([link.zero for link in links]) - drives.sense * drives.zero
        return (*(link.twist for link in links), *drives.sense.tolist(), *zero.tolist())

    @property
    def variant(self) -> str:
        """Number of joints, and whether the payload has its own parameters."""
        return f"_{self.mechanism.joints}{'_carried' if self.payload == KNOWN else ''}"


def _frames(twists: list[Symbol], angles: list[Symbol]) -> Iterator[tuple[Symbol, Symbol, Symbol]]:
    """Axes x, y, z of each link's frame in the base, modified DH."""
    x, y, z = sy.column(1, 0, 0), sy.column(0, 1, 0), sy.column(0, 0, 1)
    for twist, angle in zip(twists, angles, strict=True):
        c, s = sy.cos(twist), sy.sin(twist)
        y, z = c * y + s * z, c * z - s * y
        c, s = sy.cos(angle), sy.sin(angle)
        x, y = c * x + s * y, c * y - s * x
        yield x, y, z


@lru_cache
def _components(cause: str, joints: int, size: float) -> ParameterSet:
    """Components of each joint's vectors, one vector per link from the joint on."""
    return ParameterSet(
        tuple(
            Parameter(
                f"sag_{j}_{k}{letter}",
                "rad",
                0.0,
                size * _SIZE,
                cause,
                f"joint_{j}",
                -size * _MOST,
                size * _MOST,
            )
            for j in range(1, joints + 1)
            for k in range(j, joints + 1)
            for letter in ("xy" if k == j else "xyz")
        )
    )
