"""Linear Delta: three carriages on towers, three arms, a platform that only translates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms.base import ROD_END, ROD_MIDDLE, Limb, Mechanism
from delta_calibration.mechanisms.spheres import lower_meeting_point, way_round
from delta_calibration.mechanisms.stands import require_apart
from delta_calibration.model.symbols import Symbol, column, cos, dot, sin, sqrt, square
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.sections import angle, as_written, length, mass, refused, tolerance

Array = NDArray[np.float64]

TOWERS = 3
RADIUS, ANGLE, ENDSTOP, ARM, OUT, ASIDE = range(6)  # indices of a tower's dimensions


@dataclass(frozen=True)
class LinearDeltaDimensions:
    """The drawing of a linear Delta."""

    radius: float = length(
        about="distance of the carriage joints from the axis, minus that of the platform joints"
    )
    angles: Array = angle(
        shape=(TOWERS,), about="direction of each tower about z, counter-clockwise"
    )
    arm: float = length(about="length of a rod, carriage to platform, between ball centres")
    height: float = length(
        about="height of the platform over the centre of the bed with all carriages at their "
        "endstops"
    )

    def __post_init__(self) -> None:
        """Refuse arms too short to reach the middle, and coincident towers.

        Raises:
            ConfigError: names the entry, its value and what is allowed.
        """
        if not self.arm > self.radius:
            radius = as_written(self.radius, "mm")
            raise refused(self, "arm", f"more than radius_mm, {radius}, to reach the middle")
        require_apart(self, "angles", self.angles, "towers")


@dataclass(frozen=True)
class LinearDeltaTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    radius: float = tolerance(about="radius of a tower")
    angle: float = tolerance(
        "mrad", about="direction of a tower about z, without the part that its radius causes"
    )
    endstop: float = tolerance(about="height of an endstop")
    arm: float = tolerance(about="length of a rod")
    lean: float | None = tolerance(
        "mrad",
        default=None,
        about="lean of a tower, outward and aside; left out: the towers are vertical",
    )


@dataclass(frozen=True)
class LinearDeltaMasses:
    """Moving masses of a linear Delta."""

    platform: float = mass(about="platform with everything permanently mounted on it")
    carriage: float = mass(about="one carriage")
    rod: float = mass(about="one rod; each arm is a pair of rods")


class LinearDelta(Mechanism):
    """Carriages on towers, each with an arm (a parallelogram) to the platform.

    Closure of tower i: |x - c_i|^2 = L_i^2, c_i = (R cos phi_i, R sin phi_i, h_i) - q_i u_i, the
    carriage's joint shifted inward by the platform's radius, u_i the direction of the tower: up,
    leaning by o_i outward and by a_i aside, counter-clockwise. Three joints always lie on a
    circle: its centre defines the base's z axis, so one radius describes the towers without loss.

    Joints q (n, 3) [m]: distance of each carriage below its endstop. Pose x (n, 3) [m]: the
    platform's centre; z = 0 is the bed. Parameters, shape (10,): radius R [m]; of the towers angle
    phi (3) [rad], height h (3) [m] of the joint at its endstop, arm L (3) [m]; with a tolerance of
    the towers' lean shape (16,): also o (3) and a (3) [rad]. All are identifiable from positions
    in the base; where the tracker's frame is fitted too, two of the leans are its inclination.
    Unequal radii of the towers appear as changed directions from the
    circle's centre, so the prior of a direction combines both tolerances. A turn of the base about
    z changes no height above the bed and no distance: from such observations alone 9 combinations
    are identifiable. Leaves out towers that are not straight, tilting carriages, and unequal arms
    of a pair, which tilt the platform.
    """

    name: ClassVar[str] = "linear_delta"
    Dimensions = LinearDeltaDimensions
    Tolerances = LinearDeltaTolerances
    Masses = LinearDeltaMasses
    masses_needed: ClassVar[bool] = False
    joint_unit: ClassVar[str] = "m"
    home_is: ClassVar[str] = "half of geometry.height_mm"
    joint_size: float = 0.3
    exact: ClassVar[bool] = True
    joints: int = TOWERS
    pose_size: int = 3
    task_size: int = 3

    def __init__(
        self, dimensions: LinearDeltaDimensions, tolerances: LinearDeltaTolerances
    ) -> None:
        """From the drawing and the expected errors of the parts."""
        self.dimensions = dimensions
        self.tolerances = tolerances
        self.parameters = ParameterSet((self._radius(), *self._towers()))

    @property
    def home(self) -> Array:
        """Carriage positions with the platform in the middle, half way up, (3,) [m]."""
        return self.drives.read(np.full(TOWERS, self.dimensions.height / 2))

    @property
    def fixed(self) -> Array:
        """Lean of a tower outward and aside, 0, used if the leans are no parameters [rad]."""
        return np.zeros(2)

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """The towers; they share the radius."""
        free = self.tolerances.lean is not None
        leans = [(10 + i, 13 + i) if free else (10, 11) for i in range(TOWERS)]
        return tuple(Limb((i,), (0, 1 + i, 4 + i, 7 + i, *leans[i]), (i,)) for i in range(TOWERS))

    @staticmethod
    def equation(q: Symbol, x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """|x - c_i|^2 - L_i^2 of one tower [m^2]."""
        del c
        return square(x - _carriage(q, g)) - g[ARM] ** 2

    @staticmethod
    def masses(x: Symbol, q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Positions of the platform, the carriages and the middles of the arms [m].

        Carriages are shifted inward by the platform's radius, as in the closure.
        """
        del c
        carriages = [_carriage(q[tower], g[tower]) for tower in range(TOWERS)]
        return column(x, *carriages, *((carriage + x) / 2 for carriage in carriages))

    def weights(self, masses: LinearDeltaMasses | None) -> Array:
        """Point masses at the platform, the carriages and the middles of the arms [kg].

        Each arm is a pair of uniform rods, see `ROD_END`.
        """
        if masses is None:
            return np.zeros(1 + 2 * TOWERS)
        end, middle = (2 * share * masses.rod for share in (ROD_END, ROD_MIDDLE))
        carriage, platform = masses.carriage + end, masses.platform + TOWERS * end
        return np.array([platform, *TOWERS * (carriage,), *TOWERS * (middle,)])

    @staticmethod
    def opening(q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Position of the platform's centre, below the carriages [m]; closed form."""
        del c
        carriages = tuple(_carriage(q[tower], g[tower]) for tower in range(TOWERS))
        turned = way_round(tuple((cos(tower[ANGLE]), sin(tower[ANGLE])) for tower in g))
        return lower_meeting_point(carriages, tuple(tower[ARM] for tower in g), turned)

    @staticmethod
    def reaching(x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Position of a carriage above the platform [m]; closed form."""
        del c
        away = x - _carriage(0.0, g)
        along = dot(away, _tower(g))
        return -along - sqrt(along**2 - square(away) + g[ARM] ** 2)

    def _radius(self) -> Parameter:
        d, t = self.dimensions, self.tolerances
        return Parameter("tower_radius", "m", d.radius, t.radius, "base_joint_position")

    def _towers(self) -> Iterator[Parameter]:
        d, t = self.dimensions, self.tolerances
        endstop = d.height + float(np.sqrt(d.arm**2 - d.radius**2))
        # With towers all round, unequal radii move the circle's centre by (2/3) sum of r_i e_i,
        # and two of the three combinations of directions by as much over the radius: their
        # variances add. The shared radius, a mean of three, keeps the tolerance of a single one.
        aside = float(np.hypot(t.angle, t.radius / d.radius))
        for i, about_z in enumerate(d.angles.tolist(), 1):
            where = f"joint_{i}"
            cause = "base_joint_position"
            yield Parameter(f"tower_angle_{i}", "rad", about_z, aside, cause, where)
        for i in range(1, TOWERS + 1):
            name, cause = f"endstop_height_{i}", "joint_zero_offset"
            yield Parameter(name, "m", endstop, t.endstop, cause, f"joint_{i}")
        for i in range(1, TOWERS + 1):
            yield Parameter(f"arm_{i}", "m", d.arm, t.arm, "arm_length", f"joint_{i}")
        if t.lean is None:
            return
        for way in ("outward", "aside"):
            for i in range(1, TOWERS + 1):
                name, cause = f"tower_lean_{way}_{i}", "base_joint_tilt"
                yield Parameter(name, "rad", 0.0, t.lean, cause, f"joint_{i}")


def _carriage(q: Symbol, g: Symbol) -> Symbol:
    """Position of a carriage's joint, shifted inward by the platform's radius [m]."""
    foot = column(g[RADIUS] * cos(g[ANGLE]), g[RADIUS] * sin(g[ANGLE]), g[ENDSTOP])
    return foot - q * _tower(g)


def _tower(g: Symbol) -> Symbol:
    """Direction of a tower, upward; length 1."""
    out, aside, c, s = g[OUT], g[ASIDE], cos(g[ANGLE]), sin(g[ANGLE])
    return column(c * out - s * aside, s * out + c * aside, 1) / sqrt(1 + out**2 + aside**2)
