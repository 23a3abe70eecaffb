"""Five-axis parallel machine: four vertical sliders, four struts, a platform in a plane.

Dang, Fang, *A step identification method of mechanism parameters of a 5-DOF parallel machine tool*
(2015), paper 004. The table's feed, the fifth axis, carries the work piece and is not modelled.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms.base import ROD_END, ROD_MIDDLE, Limb, Mechanism
from delta_calibration.model.symbols import Symbol, column, cos, rows, sin, sqrt, square
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.sections import as_written, length, mass, place, refused, tolerance

Array = NDArray[np.float64]

STRUTS = 4
_JOINTS = 6  # coordinates of both joints of a strut
PLATFORM, SLIDER, LENGTH = slice(0, 3), slice(3, 6), 6  # joints: each x, y, z
_BENCH = 2e-6  # [m] standard deviation of a length measured on the bench
TURNS_ABOUT_Y = (1.0, 1.0, 0.0, 0.0)  # struts 3, 4 hold the part that only turns about x
SIDE = (-1.0, 1.0, -1.0, 1.0)  # sign of y
ABOVE = (1.0, 1.0, -1.0, -1.0)  # 1: slider above its platform joint, -1: below it
_TURNS, _ABOVE = range(2)  # constants of a strut


@dataclass(frozen=True)
class StrutPair:
    """Dimensions of two struts, one on either side of the plane y = 0 [m]."""

    platform_x: float = place(about="x of the platform joint, in the platform's frame")
    platform_y: float = place(about="distance of the platform joint from the plane y = 0")
    platform_z: float = place(about="z of the platform joint, in the platform's frame")
    column_x: float = place(about="x of the column that the slider runs on, in the base frame")
    column_y: float = place(about="distance of the column from the plane y = 0")
    strut: float = length(about="length of the strut between joint centres, measured on the bench")

    def __post_init__(self) -> None:
        """Refuse struts too short to reach from column to platform.

        Raises:
            ConfigError: names the entry, its value and what is allowed.
        """
        x, y = self.column_x - self.platform_x, self.column_y - self.platform_y
        across = float(np.hypot(x, y))
        if not self.strut > across:
            raise refused(
                self,
                "strut",
                f"more than {as_written(across, 'mm')}, from column to platform joint in x and y",
            )


@dataclass(frozen=True)
class FiveAxisDimensions:
    """The drawing of a five-axis machine, [m]."""

    turning: StrutPair  # struts 1, 2: on the platform, R = R_X R_Y
    hinged: StrutPair  # struts 3, 4: on the part that turns about x only, R_X
    tool: float = length(about="distance of the tool tip from the platform's centre, along its z")
    height: float = length(about="height of the platform's centre in the middle of the workspace")


@dataclass(frozen=True)
class FiveAxisTolerances:
    """Standard deviations of a machine's parts about the drawing."""

    joint_position: float = tolerance(about="position of each joint centre, each coordinate")
    strut: float | None = tolerance(
        default=None,
        about="length of a strut; left out: as measured on the bench, to 2 um",
    )


@dataclass(frozen=True)
class FiveAxisMasses:
    """Moving masses of a five-axis machine."""

    platform: float = mass(about="platform with everything mounted on it, at its centre")
    slider: float = mass(about="one slider")
    strut: float = mass(about="one strut")


class FiveAxis(Mechanism):
    """Struts on sliders carry a platform that moves in the plane x = 0 and turns about x and y.

    Closure of strut v: |o + T_v t_v - s_v - q_v e_z|^2 = L_v^2, o = (0, y, z), paper (3), (4),
    with T = R_X(A) R_Y(B) for struts 1, 2 and R_X(A) for struts 3, 4.

    Joints q (n, 4) [m]: heights of the sliders. Pose x (n, 4): the platform centre's y, z [m] and
    the angles A, B [rad]; all four are commanded. The base frame is that of the plane's guides:
    the platform's centre has x = 0. Parameters, shape (28,): of each strut its platform joint t
    (x, y, z) in the platform and slider joint s (x, y, z) in the base at q = 0 [m], then the four
    lengths L [m]; an error of s_z is an error of the slider's zero.

    The paper's are the first 24: it measures the lengths before assembly. So they are known to
    2 um here if the file gives no tolerance, but may grow with temperature. 20 of the 24 are
    identifiable from poses: t_x and s_x of struts 3, 4, which stay in planes across x, have no
    effect at first order about the drawing. Leaves out errors of the plane's guides, tilt of the
    columns, and play.
    """

    name: ClassVar[str] = "five_axis"
    Dimensions = FiveAxisDimensions
    Tolerances = FiveAxisTolerances
    Masses = FiveAxisMasses
    masses_needed: ClassVar[bool] = False
    joint_unit: ClassVar[str] = "m"
    home_is: ClassVar[str] = "the level platform at geometry.height_mm"
    joint_size: float = 0.3
    joints: int = STRUTS
    pose_size: int = 4
    task_size: int = 4

    def __init__(self, dimensions: FiveAxisDimensions, tolerances: FiveAxisTolerances) -> None:
        """From the drawing and the expected errors of the parts."""
        self.dimensions = dimensions
        self.tolerances = tolerances
        pairs = (dimensions.turning, dimensions.turning, dimensions.hinged, dimensions.hinged)
        joints = (p for strut, pair in enumerate(pairs) for p in self._joints(strut, pair))
        self.parameters = ParameterSet((*joints, *map(self._length, range(STRUTS), pairs)))

    @property
    def home(self) -> Array:
        """Slider positions of the level platform in the middle of the workspace, (4,) [m]."""
        return np.array(self.inverse(self.home_pose[None], self.parameters.nominal)[0])

    @property
    def tool(self) -> Array:
        """Position of the tool's tip in the platform's frame, (3,) [m]."""
        return np.array([0.0, 0.0, self.dimensions.tool])

    @staticmethod
    def point(x: Symbol, o: Symbol) -> Symbol:
        """Position in the base [m] of a point fixed to the platform at o."""
        return column(0, x[0], x[1]) + _turn(x[2], x[3]) @ o

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """The struts."""
        return tuple(
            Limb(
                (i,),
                (*range(_JOINTS * i, _JOINTS * (i + 1)), _JOINTS * STRUTS + i),
                (i,),
                (TURNS_ABOUT_Y[i], ABOVE[i]),
            )
            for i in range(STRUTS)
        )

    @property
    def home_pose(self) -> Array:
        """Pose of the level platform in the middle of the workspace, (4,)."""
        return np.array([0.0, self.dimensions.height, 0.0, 0.0])

    @staticmethod
    def equation(q: Symbol, x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Squared length of one strut minus that of its parameter [m^2]."""
        return square(_strut(q, x, g, c)) - g[LENGTH] ** 2

    @staticmethod
    def masses(x: Symbol, q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Positions of the platform's centre, the sliders, and ends and middles of struts [m]."""
        sliders = [g[i][SLIDER] + column(0, 0, q[i]) for i in range(STRUTS)]
        vectors = [_strut(q[i], x, g[i], c[i]) for i in range(STRUTS)]
        pairs = list(zip(sliders, vectors, strict=True))
        ends, middles = ([at + share * v for at, v in pairs] for share in (1.0, 0.5))
        return column(0, x[0], x[1], *sliders, *ends, *middles)

    def weights(self, masses: FiveAxisMasses | None) -> Array:
        """Point masses of the platform, the sliders, and at ends and middles of struts [kg].

        Each strut is a uniform rod, see `ROD_END`.
        """
        if masses is None:
            return np.zeros(1 + 3 * STRUTS)
        end, middle = (share * masses.strut for share in (ROD_END, ROD_MIDDLE))
        each = masses.slider + end, end, middle
        return np.array([masses.platform, *np.repeat(each, STRUTS)])

    @staticmethod
    def reaching(x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Slider position above or below its platform joint [m]; closed form."""
        s = _strut(0.0, x, g, c)
        return s[2] + c[_ABOVE] * sqrt(g[LENGTH] ** 2 - s[0] ** 2 - s[1] ** 2)

    def task(self, position: Array, turn: Array) -> Array:
        """Commanded coordinates y, z, A, B, (n, 4); x is always 0."""
        return np.stack([position[:, 1], position[:, 2], turn[:, 0], turn[:, 1]], axis=1)

    def turn(self, x: Array) -> Array:
        """Turn A, B, 0, (n, 3) [rad]."""
        return np.concatenate([x[:, 2:4], np.zeros_like(x[:, :1])], axis=1)

    @property
    def freedoms(self) -> tuple[int, ...]:
        """Commanded freedoms: y, z, and turns about x and y."""
        return (1, 2, 3, 4)

    def _length(self, strut: int, pair: StrutPair) -> Parameter:
        known, where = self.tolerances.strut, f"joint_{strut + 1}"
        prior = _BENCH if known is None else known
        name, drawn = f"strut_{strut + 1}", known is not None
        return Parameter(name, "m", pair.strut, prior, "arm_length", where, drawn=drawn)

    def _joints(self, strut: int, pair: StrutPair) -> list[Parameter]:
        where, side = f"joint_{strut + 1}", float(SIDE[strut])
        ends = {
            "platform": (pair.platform_x, side * pair.platform_y, pair.platform_z),
            "slider": (pair.column_x, side * pair.column_y, 0.0),
        }
        causes = {"platform": "platform_joint_position", "slider": "base_joint_position"}

        def cause(end: str, axis: str) -> str:
            return "joint_zero_offset" if (end, axis) == ("slider", "z") else causes[end]

        prior = self.tolerances.joint_position
        return [
            Parameter(f"{end}_{axis}_{strut + 1}", "m", value, prior, cause(end, axis), where)
            for end, place in ends.items()
            for axis, value in zip("xyz", place, strict=True)
        ]


def by_strut(g: Array) -> tuple[Array, Array]:
    """Joints of each strut (4, 6) and its length (4,), of parameters (28,) [m]."""
    joints = _JOINTS * STRUTS
    return g[:joints].reshape(STRUTS, _JOINTS), g[joints:]


def _strut(q: Symbol, x: Symbol, g: Symbol, c: Symbol) -> Symbol:
    """Vector from slider joint to platform joint, in the base [m]."""
    turned = _turn(x[2], c[_TURNS] * x[3]) @ g[PLATFORM]
    return turned + column(0, x[0], x[1] - q) - g[SLIDER]


def _turn(a: Symbol, b: Symbol) -> Symbol:
    """Rotation matrix R_X(a) R_Y(b)."""
    about_x = rows(column(1, 0, 0), column(0, cos(a), -sin(a)), column(0, sin(a), cos(a)))
    about_y = rows(column(cos(b), 0, sin(b)), column(0, 1, 0), column(-sin(b), 0, cos(b)))
    return about_x @ about_y
