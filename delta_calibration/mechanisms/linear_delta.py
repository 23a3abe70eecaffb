"""Linear Delta: three vertical carriages, three arms, a platform that only translates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms.base import Mechanism
from delta_calibration.mechanisms.rotary_delta import lower_meeting_point
from delta_calibration.parameters import Parameter, ParameterSet

Array = NDArray[np.float64]

TOWERS = 3
_SIZE = 4  # parameters a tower
RADIUS, ANGLE, ENDSTOP, ARM = range(_SIZE)


@dataclass(frozen=True)
class LinearDeltaDimensions:
    """The drawing of a linear Delta."""

    radius: float  # [m] tower joints from the axis, less those of the platform
    angles: Array  # (3,) [rad] where the towers stand about z, counter-clockwise
    arm: float  # [m]
    height: float  # [m] of the platform over the bed, in the middle, carriages at their endstops


@dataclass(frozen=True)
class LinearDeltaTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    radius: float  # [m]
    angle: float  # [rad]
    endstop: float  # [m]
    arm: float  # [m]


class LinearDelta(Mechanism):
    """Carriages on vertical towers, each with an arm (a parallelogram) to the platform.

    Closure of tower i: |x - c_i|^2 = L_i^2, c_i = (R_i cos phi_i, R_i sin phi_i, h_i - q_i), the
    carriage's joint moved in by the platform's radius.

    Joints q (n, 3) [m]: how far each carriage stands down from its endstop. Pose x (n, 3) [m]: the
    platform's centre; z = 0 is the bed. Parameters of a tower, shape (12,) in all: radius R [m],
    angle phi [rad], height h [m] of the joint at its endstop, arm L [m]. All 12 show in the
    positions. Turning the base about z or shifting it along the bed changes no height over the bed
    and no distance: of these observations alone 9 combinations show. A tower that leans, a carriage
    that tilts, and unequal arms of a pair are left out: the platform then tilts.
    """

    name: ClassVar[str] = "linear_delta"
    joints: int = TOWERS
    pose_size: int = 3
    task_size: int = 3

    def __init__(
        self, dimensions: LinearDeltaDimensions, tolerances: LinearDeltaTolerances
    ) -> None:
        """From the drawing and the expected errors of the parts."""
        self.dimensions = dimensions
        self.tolerances = tolerances
        self.parameters = ParameterSet(
            tuple(p for tower in range(TOWERS) for p in self._tower(tower))
        )

    @property
    def home(self) -> Array:
        """Carriages of the platform in the middle, half way up, (3,) [m]."""
        return np.full(TOWERS, self.dimensions.height / 2)

    def closure(self, q: Array, x: Array, g: Array) -> Array:
        """|x - c_i|^2 - L_i^2, (n, 3) [m^2]."""
        arm = _towers(g)[..., ARM]
        return np.asarray(np.sum(self._arms(q, x, g) ** 2, axis=-1) - arm**2)

    def closure_by_pose(self, q: Array, x: Array, g: Array) -> Array:
        """2 (x - c_i), (n, 3, 3)."""
        return 2 * self._arms(q, x, g)

    def closure_by_joints(self, q: Array, x: Array, g: Array) -> Array:
        """Each carriage in its own closure only, (n, 3, 3)."""
        return np.asarray(2 * self._arms(q, x, g)[..., 2, None] * np.eye(TOWERS))

    def closure_by_geometry(self, q: Array, x: Array, g: Array) -> Array:
        """Blocks of four columns on the diagonal, (n, 3, 12)."""
        tower, s = _towers(g), self._arms(q, x, g)
        c, sine = np.cos(tower[..., ANGLE]), np.sin(tower[..., ANGLE])
        block = np.empty((*q.shape, _SIZE))
        block[..., RADIUS] = -2 * (s[..., 0] * c + s[..., 1] * sine)
        block[..., ANGLE] = 2 * tower[..., RADIUS] * (s[..., 0] * sine - s[..., 1] * c)
        block[..., ENDSTOP] = -2 * s[..., 2]
        block[..., ARM] = -2 * tower[..., ARM]
        own = np.eye(TOWERS)[..., None] * block[:, :, None, :]
        return np.asarray(own.reshape(len(q), TOWERS, TOWERS * _SIZE))

    def forward(self, q: Array, g: Array, guess: Array | None = None) -> Array:
        """Platform's centre under the carriages, (n, 3) [m]; closed form, NaN out of reach.

        `guess` is not needed and not used.
        """
        arm = np.broadcast_to(_towers(g)[..., ARM], q.shape)
        return lower_meeting_point(_carriages(q, g), arm)

    def inverse(self, task: Array, g: Array, guess: Array | None = None) -> Array:
        """Carriages above the platform, (n, 3) [m]; closed form, NaN out of reach.

        `guess` is not needed and not used.
        """
        tower = _towers(g)
        s = self._arms(np.zeros_like(task), task, g)
        with np.errstate(invalid="ignore"):
            rise = np.sqrt(tower[..., ARM] ** 2 - s[..., 0] ** 2 - s[..., 1] ** 2)
        return np.asarray(-s[..., 2] - rise)

    def start(self, q: Array, g: Array) -> Array:
        """The solution itself: the direct problem is closed."""
        return self.forward(q, g)

    def start_joints(self, task: Array, g: Array) -> Array:
        """The solution itself: the inverse problem is closed."""
        return self.inverse(task, g)

    def _tower(self, tower: int) -> list[Parameter]:
        d, t = self.dimensions, self.tolerances
        number, where = tower + 1, f"joint_{tower + 1}"
        endstop = d.height + float(np.sqrt(d.arm**2 - d.radius**2))
        angle, place = float(d.angles[tower]), "base_joint_position"
        return [
            Parameter(f"tower_radius_{number}", "m", d.radius, t.radius, place, where),
            Parameter(f"tower_angle_{number}", "rad", angle, t.angle, place, where),
            Parameter(
                f"endstop_height_{number}", "m", endstop, t.endstop, "joint_zero_offset", where
            ),
            Parameter(f"arm_{number}", "m", d.arm, t.arm, "arm_length", where),
        ]

    def _arms(self, q: Array, x: Array, g: Array) -> Array:
        """From carriage to platform, (n, 3 towers, 3) [m]."""
        return x[:, None, :] - _carriages(q, g)


def _towers(g: Array) -> Array:
    """Geometry by tower.  (12,) or (n, 12) -> (3, 4) or (n, 3, 4)."""
    return g.reshape((*g.shape[:-1], TOWERS, _SIZE))


def _carriages(q: Array, g: Array) -> Array:
    """Joints of the carriages, moved in by the platform's radius, (n, 3 towers, 3) [m]."""
    tower = _towers(g)
    radius, angle = tower[..., RADIUS], tower[..., ANGLE]
    around = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    height = tower[..., ENDSTOP] - q
    flat = np.broadcast_to(around, (*height.shape, 2))
    return np.concatenate([flat, height[..., None]], axis=-1)
