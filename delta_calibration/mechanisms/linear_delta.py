"""Linear Delta: three vertical carriages, three arms, a platform that only translates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms.base import Mechanism
from delta_calibration.mechanisms.rotary_delta import lower_meeting_point
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.sections import angle, as_written, length, refused, tolerance

Array = NDArray[np.float64]

TOWERS = 3
RADIUS = 0  # columns of the parameters
_APART = np.pi / 180  # [rad] of two towers about the axis, at least
ANGLE, ENDSTOP, ARM = slice(1, 4), slice(4, 7), slice(7, 10)


@dataclass(frozen=True)
class LinearDeltaDimensions:
    """The drawing of a linear Delta."""

    radius: float = length()  # [m] tower joints from the axis, less those of the platform
    # (3,) [rad] where the towers stand about z, counter-clockwise
    angles: Array = angle(shape=(TOWERS,))
    arm: float = length()  # [m]
    # [m] of the platform over the bed, in the middle, carriages at their endstops
    height: float = length()

    def __post_init__(self) -> None:
        """Refuse arms that do not reach the middle, and towers in one place.

        Raises:
            ConfigError: names the entry, its value and what is allowed.
        """
        if not self.arm > self.radius:
            radius = as_written(self.radius, "mm")
            raise refused(self, "arm", f"more than radius_mm, {radius}, to reach the middle")
        apart = np.abs(np.exp(1j * self.angles[:, None]) - np.exp(1j * self.angles))
        if apart[np.triu_indices(TOWERS, 1)].min() < _APART:
            raise refused(
                self,
                "angles",
                f"{TOWERS} towers at least {as_written(_APART, 'deg')} deg apart: by two in one "
                "place the platform is not held",
            )


@dataclass(frozen=True)
class LinearDeltaTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    radius: float = tolerance()  # [m]
    angle: float = tolerance("mrad")  # [rad]
    endstop: float = tolerance()  # [m]
    arm: float = tolerance()  # [m]


class LinearDelta(Mechanism):
    """Carriages on vertical towers, each with an arm (a parallelogram) to the platform.

    Closure of tower i: |x - c_i|^2 = L_i^2, c_i = (R cos phi_i, R sin phi_i, h_i - q_i), the
    carriage's joint moved in by the platform's radius. Three joints always stand on a circle: the
    base's z axis is its middle, so one radius is no less than three.

    Joints q (n, 3) [m]: how far each carriage stands down from its endstop. Pose x (n, 3) [m]: the
    platform's centre; z = 0 is the bed. Parameters, shape (10,): radius R [m]; of the towers angle
    phi (3) [rad], height h (3) [m] of the joint at its endstop, arm L (3) [m]. All show in the
    positions. A turn of the base about z changes no height over the bed and no distance: of these
    observations alone 9 combinations show. Leaves out a tower that leans, a carriage that tilts,
    and unequal arms of a pair: the platform then tilts.
    """

    name: ClassVar[str] = "linear_delta"
    Dimensions = LinearDeltaDimensions
    Tolerances = LinearDeltaTolerances
    joint_unit: ClassVar[str] = "m"
    home_is: ClassVar[str] = "half of geometry.height_mm"
    joint_size: float = 0.3
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
        """Carriages of the platform in the middle, half way up, (3,) [m]."""
        return np.full(TOWERS, self.dimensions.height / 2)

    def closure(self, q: Array, x: Array, g: Array) -> Array:
        """|x - c_i|^2 - L_i^2, (n, 3) [m^2]."""
        return np.asarray(np.sum(self._arms(q, x, g) ** 2, axis=-1) - g[..., ARM] ** 2)

    def closure_by_pose(self, q: Array, x: Array, g: Array) -> Array:
        """2 (x - c_i), (n, 3, 3)."""
        return 2 * self._arms(q, x, g)

    def closure_by_joints(self, q: Array, x: Array, g: Array) -> Array:
        """Each carriage in its own closure only, (n, 3, 3)."""
        return np.asarray(2 * self._arms(q, x, g)[..., 2, None] * np.eye(TOWERS))

    def closure_by_geometry(self, q: Array, x: Array, g: Array) -> Array:
        """The radius in every closure, the rest each in its own, (n, 3, 10)."""
        s = self._arms(q, x, g)
        along, across = _radial(g), _tangential(g)
        own = np.eye(TOWERS)
        f = np.empty((*q.shape, len(self.parameters)))
        f[..., RADIUS] = -2 * np.sum(s[..., :2] * along, axis=-1)
        by_angle = -2 * g[..., RADIUS, None] * np.sum(s[..., :2] * across, axis=-1)
        f[..., ANGLE] = by_angle[..., None] * own
        f[..., ENDSTOP] = -2 * s[..., 2, None] * own
        f[..., ARM] = -2 * g[..., None, ARM] * own
        return f

    def forward(self, q: Array, g: Array, guess: Array | None = None) -> Array:
        """Platform's centre under the carriages, (n, 3) [m]; closed form, NaN out of reach.

        `guess` is not needed and not used.
        """
        arm = np.broadcast_to(g[..., ARM], q.shape)
        return lower_meeting_point(_carriages(q, g), arm)

    def inverse(self, task: Array, g: Array, guess: Array | None = None) -> Array:
        """Carriages above the platform, (n, 3) [m]; closed form, NaN out of reach.

        `guess` is not needed and not used.
        """
        s = self._arms(np.zeros_like(task), task, g)
        with np.errstate(invalid="ignore"):
            rise = np.sqrt(g[..., ARM] ** 2 - s[..., 0] ** 2 - s[..., 1] ** 2)
        return np.asarray(-s[..., 2] - rise)

    def start(self, q: Array, g: Array) -> Array:
        """The solution itself: the direct problem is closed."""
        return self.forward(q, g)

    def start_joints(self, task: Array, g: Array) -> Array:
        """The solution itself: the inverse problem is closed."""
        return self.inverse(task, g)

    def _radius(self) -> Parameter:
        d, t = self.dimensions, self.tolerances
        return Parameter("tower_radius", "m", d.radius, t.radius, "base_joint_position")

    def _towers(self) -> Iterator[Parameter]:
        d, t = self.dimensions, self.tolerances
        endstop = d.height + float(np.sqrt(d.arm**2 - d.radius**2))
        for i, about_z in enumerate(d.angles.tolist(), 1):
            where = f"joint_{i}"
            cause = "base_joint_position"
            yield Parameter(f"tower_angle_{i}", "rad", about_z, t.angle, cause, where)
        for i in range(1, TOWERS + 1):
            name, cause = f"endstop_height_{i}", "joint_zero_offset"
            yield Parameter(name, "m", endstop, t.endstop, cause, f"joint_{i}")
        for i in range(1, TOWERS + 1):
            yield Parameter(f"arm_{i}", "m", d.arm, t.arm, "arm_length", f"joint_{i}")

    def _arms(self, q: Array, x: Array, g: Array) -> Array:
        """From carriage to platform, (n, 3 towers, 3) [m]."""
        return x[:, None, :] - _carriages(q, g)


def _radial(g: Array) -> Array:
    """From the axis towards each tower.  (10,) or (n, 10) -> (3, 2) or (n, 3, 2)."""
    return np.stack([np.cos(g[..., ANGLE]), np.sin(g[..., ANGLE])], axis=-1)


def _tangential(g: Array) -> Array:
    """Its derivative by the tower's angle."""
    return np.stack([-np.sin(g[..., ANGLE]), np.cos(g[..., ANGLE])], axis=-1)


def _carriages(q: Array, g: Array) -> Array:
    """Joints of the carriages, moved in by the platform's radius, (n, 3 towers, 3) [m]."""
    height = g[..., ENDSTOP] - q
    around = np.broadcast_to(g[..., RADIUS, None, None] * _radial(g), (*height.shape, 2))
    return np.concatenate([around, height[..., None]], axis=-1)
