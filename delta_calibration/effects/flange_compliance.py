"""Compliance of the tool flange: the tool shifts and turns under the payload.

    u = F / K + w x h z        w = (M - (z . M) z / 2) / k        M = (h z + c) x F

F and M are force and moment of the payload on the flange, by its weight and inertia
(model/loads.py), z is the tool's axis, the flange lies h behind the tool centre point along it,
and c is the vector from that point to the payload's centre. A circle of evenly spaced screws is
half as compliant in rotation about the axis as about a diameter. K and k include a force sensor, a
tool changer or an adapter between flange and tool.

Where the payload's centre is the tool centre point, the observed displacement is proportional to
h^2 / k, and a session hardly determines h: its interval and that of the turn are then wide. The
shift is added to the tool's position in the last link and the turn to its mounting there, so that
commands can be corrected for both.

Leaves out the weight of the tool itself, whose centre is not stated: its constant part is part of
the tool's position, and the part that turns with the tool is not known. Platforms that never turn
are left out as well: at rest the flange of such a platform adds a constant vector per kilogram,
which cannot be distinguished from a reflector that sits differently after a change of payload.

Sizes, from general knowledge of data sheets: tilting stiffness 4e4 to 1e6 N m/rad for bearings of
a small wrist (crossed rollers of harmonic drives, CSF-2UH); 1e4 to 1e5 N m/rad and 1e7 to 1e8 N/m
for six-axis force sensors; a hundredth of it for printed adapters and compensators of misalignment
for assembly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from scipy.spatial.transform import Rotation

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Interval, Limits, Stage
from delta_calibration.effects.regressor import LOAD, Groups, Regressor, by_payload
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import CARRIED, POSE, Places
from delta_calibration.mechanisms import SerialArm
from delta_calibration.model import symbols as sy
from delta_calibration.model.symbols import Symbol
from delta_calibration.model.terms import Term
from delta_calibration.parameters import Parameter, ParameterSet

_SHIFT, _SOFTEST_SHIFT = 1e-7, 1e-5  # [m/N]
_TURN, _SOFTEST_TURN = 5e-5, 2e-3  # [rad/(N m)]
_USUAL = 0.15  # [m] from the tool centre point back to the flange: a gripper's length
_ROWS = ("tool_x", "tool_y", "tool_z", "tool_turn_x", "tool_turn_y", "tool_turn_z")


@dataclass(frozen=True)
class FlangeCompliance(Effect):
    """Elastic compliance between the last link and the tool, under the payload."""

    cause: ClassVar[str] = "flange_compliance"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "tool flange",
        "tighten the tool and all parts between it and the flange, or compensate with the payload",
        "hold a dial gauge from the last link to the tool and hang the payload on it",
    )
    kind: ClassVar[str] = "structure"
    stage: ClassVar[Stage] = Stage.STRUCTURE
    gentle: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("payload",)
    called: ClassVar[str] = "compliance of the tool flange"
    takes: ClassVar[tuple[str, ...]] = (CARRIED, POSE)
    limits: ClassVar[Limits] = {"behind": (0.0, 2.0)}
    told: ClassVar[Mapping[str, tuple[str, str]]] = {"behind": ("behind_m", "m")}

    behind: float = _USUAL  # [m] from the tool centre point back to the flange

    @property
    def suits(self) -> bool:
        """Whether the mechanism is a serial arm, which carries its tool on a flange."""
        return isinstance(self.mechanism, SerialArm)

    @property
    def parameters(self) -> ParameterSet:
        """1 / K [m/N] and 1 / k [rad/(N m)]."""
        sizes = (
            ("shift", "m/N", _SHIFT, _SOFTEST_SHIFT),
            ("turn", "rad/(N m)", _TURN, _SOFTEST_TURN),
        )
        return ParameterSet(
            tuple(
                Parameter(name, unit, 0.0, prior, self.cause, None, 0.0, most)
                for name, unit, prior, most in sizes
            )
        )

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """Shift of the tool in the last link [m], and its turn in its own axes [rad]."""
        force, moment, at, own = s[0:3], s[3:6], s[6:9], sy.rotation(s[9:12])
        arm = c[0] * own[:, 2]  # from the flange to the tool centre point
        about = moment - sy.cross(at - arm, force)
        twist = sy.dot(own[:, 2], about) / 2
        turn = v[1] * (about - twist * own[:, 2])
        shift = own.T @ (v[0] * force + sy.cross(turn, arm))
        return sy.column(sy.matrix(c[1:10], 3) @ shift, own.T @ turn)

    def terms(self, places: Places) -> Iterator[Term]:
        """A single term, for position and mounting of the tool."""
        carried, pose = places.begin(CARRIED), places.begin(POSE)
        signals = (*range(carried, carried + 6), *range(pose, pose + 6))
        rows = tuple(self.mechanism.parameters.row(name) for name in _ROWS)
        yield Term(signals, (0, 1), rows, self.constants(0))

    def constants(self, joint: int) -> tuple[float, ...]:
        """Distance of the flange behind the tool, and mounting of the tool in the last link."""
        del joint
        arm = self.mechanism
        assert isinstance(arm, SerialArm)
        mount = Rotation.from_euler("ZYX", arm.dimensions.mount).as_matrix()
        return (self.behind, *mount.ravel().tolist())

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """A flange at the usual distance, at half of it and at twice."""
        del at
        for share in (1.0, 0.5, 2.0):
            yield replace(self, behind=share * _USUAL)

    def intervals(self) -> tuple[Interval, ...]:
        """Half of the distance to either side, so that it stays where no reading decides."""
        return (("behind", self.behind / 2, 1.5 * self.behind),)

    def regressor(self, at: Conditions) -> Regressor:
        """Payload."""
        del at
        return LOAD

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups by payload."""
        del joint
        return by_payload(at)
