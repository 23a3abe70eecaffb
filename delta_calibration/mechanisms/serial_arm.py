"""Serial arm: joints that turn one after the other, from the base to a tool."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.geometry import rotations
from delta_calibration.mechanisms.base import ROD_END, ROD_MIDDLE, Limb, Mechanism
from delta_calibration.mechanisms.serial_dimensions import ArmDimensions, ArmTolerances, Link
from delta_calibration.model import symbols as sy
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import Parameter, ParameterSet

Array = NDArray[np.float64]

X, Y, Z = range(3)
_LINK = 5  # dimensions of a link: twist, skew, length, zero, offset


class SerialArm(Mechanism):
    """Serial arm of two (SCARA) to seven revolute joints, described by a DH table.

    Links are in modified DH, even if drawn in standard DH, with Hayati's angle between parallel
    axes.

        A_i = R_x(alpha_i) T_x(a_i) R_z(q_i + z_i) T_z(d_i)
        A_i = R_x(alpha_i) R_y(beta_i) T_x(a_i) R_z(q_i + z_i) T_z(d_i drawn)    parallel axes

    Closure: (p - p_F, log(R(w) R_F^T)), the difference of the pose from forward kinematics in
    position [m] and orientation [rad], regular up to a turn of pi. p_F and R_F are position and
    orientation after all A_i and the tool.

    Pose x (n, 6): tool centre point [m], rotation vector [rad]. Joints q (n, m) [rad]. Parameters
    of link i: twist alpha [rad], skew beta [rad] if parallel, length a [m], zero z [rad], offset d
    [m] if not; then of the tool: position (3) [m] in the last link, turn (3) [rad] about x, y, z
    after its mounting as drawn. An arm of m joints has 4 m + 6 parameters. With an unknown frame
    of the measuring device, 4 m + 6 combinations of the 4 m + 12 are identifiable from poses: the
    first link is redundant with four of the frame's six, the last zero and offset with the tool.

    Two joints command x and y, and so do more joints if all axes are parallel. Otherwise six or
    more joints command the pose, others the position. Of the postures that reach a task, two
    parallel axes keep the elbow of `home`, and with a guess any arm takes the posture of the
    guess; without one, damped steps from home decide. Leaves out compliance of links and gears.
    """

    name: ClassVar[str] = "serial_arm"
    home_is: ClassVar[str] = "geometry.home_deg"
    exact: ClassVar[bool] = True
    damped: ClassVar[bool] = True
    Dimensions = ArmDimensions
    Tolerances = ArmTolerances

    def __init__(self, dimensions: ArmDimensions, tolerances: ArmTolerances) -> None:
        """From the drawing and the expected errors of the parts."""
        self.drawn, self.dimensions = dimensions, dimensions.modified
        self.tolerances = tolerances
        self.joints = len(dimensions.links)
        self.pose_size = 6
        plane = self.joints == 2 or dimensions.planar
        self.task_size = 2 if plane else 6 if self.joints >= 6 else 3
        each = (self._link(number, link) for number, link in enumerate(self.dimensions.links, 1))
        self.parameters = ParameterSet((*(p for link in each for p in link), *self._tool()))
        self.variant = f"_{self.joints}"

    @property
    def home(self) -> Array:
        """Drive readings at the home of the drawing, (m,) [rad]."""
        return np.array(self.dimensions.home)

    def task(self, position: Array, turn: Array) -> Array:
        """Tool at a position, turned from its orientation at home, (n, task_size)."""
        home = self.forward(self.home[None], self.parameters.nominal)
        held = rotations.log(rotations.exp(turn) @ self.rotation(home))
        return np.concatenate([position, held], axis=1)[:, : self.task_size]

    def turn(self, x: Array) -> Array:
        """Turn of the tool from its orientation at home, a rotation vector, (n, 3) [rad]."""
        home = self.forward(self.home[None], self.parameters.nominal)
        return rotations.log(self.rotation(x) @ np.swapaxes(self.rotation(home), 1, 2))

    @property
    def fixed(self) -> Array:
        """Skew or offset of each link, the one that is no parameter; mounting of the tool."""
        each = [link.offset if link.parallel else 0.0 for link in self.dimensions.links]
        return np.array([*each, *self.dimensions.mount.tolist()])

    @property
    def drawn_along(self) -> Array:
        """Lengths and offsets of the drawing, each at the parameter that it changes, (p,) [m].

        An offset along an axis that is parallel to the previous axis is no parameter: it has the
        same effect as one along the previous axis, and is counted there.
        """
        found, own, along = self.parameters.nominal.copy(), -1, 1.0
        found[[p.cause not in ("link_length", "link_offset") for p in self.parameters]] = 0.0
        for number, link in enumerate(self.dimensions.links, 1):
            if link.parallel:
                along *= float(np.sign(np.cos(link.twist)))
                found[own] += along * link.offset
            else:
                own, along = self.parameters.row(f"offset_{number}"), 1.0
        return found

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """A single limb with all links and the tool."""
        row, first = self.parameters.row, len(self.parameters)
        numbers: list[int] = []
        for i, link in enumerate(self.dimensions.links, 1):
            drawn = first + i - 1
            skew = row(f"skew_{i}") if link.parallel else drawn
            offset = drawn if link.parallel else row(f"offset_{i}")
            numbers += [row(f"twist_{i}"), skew, row(f"length_{i}"), row(f"zero_{i}"), offset]
        numbers += [row(f"tool_{axis}") for axis in "xyz"]
        numbers += range(first + self.joints, first + self.joints + 3)
        numbers += [row(f"tool_turn_{axis}") for axis in "xyz"]
        return (Limb(tuple(range(self.joints)), tuple(numbers), tuple(range(6))),)

    @staticmethod
    def equation(q: Symbol, x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Difference between the pose and the arm's forward kinematics, (6) [m, rad]."""
        del c
        position, turn = _walked(q, g)
        back = sy.column(turn[0], -turn[1:4])
        left = sy.quaternion_product(sy.quaternion(x[3:6]), back)
        return sy.column(x[0:3] - position, sy.rotation_vector(left))

    @staticmethod
    def masses(x: Symbol, q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Start, middle and end of each link, a uniform rod from its joint to the next."""
        del c
        origins = [*_joint_places(q[0], g[0]), x[0:3]]
        return sy.column(
            *(
                place
                for start, end in pairwise(origins)
                for place in (start, (start + end) / 2, end)
            )
        )

    def weights(self, masses: Any) -> Array:
        """Point masses of each link [kg], a uniform rod: start, middle and end, see `ROD_END`."""
        del masses
        each = [link.mass for link in self.dimensions.links]
        return np.outer(each, [ROD_END, ROD_MIDDLE, ROD_END]).ravel()

    @staticmethod
    def opening(q: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Pose of the tool by forward kinematics, in closed form."""
        del c
        position, turn = _walked(q[0], g[0])
        return sy.column(position, sy.rotation_vector(turn))

    def start_joints(self, task: Array, g: Array) -> Array:
        """Home; for two parallel axes the joints of a planar arm, its elbow as at home."""
        if not (self.joints == 2 and self.dimensions.links[1].parallel):
            return np.tile(self.home, (len(task), 1))
        names = ("length_2", "tool_x", "tool_y", "zero_1", "zero_2")
        rows = [self.parameters.row(name) for name in names]
        upper, along, across, zero, own = np.moveaxis(g[..., rows], -1, 0)
        fore = np.hypot(along, across)
        cosine = (np.sum(task**2, axis=1) - upper**2 - fore**2) / (2 * upper * fore)
        held = self.drives.own(self.home)[1]
        elbow = np.copysign(np.arccos(np.clip(cosine, -1.0, 1.0)), held)
        bend = np.arctan2(fore * np.sin(elbow), upper + fore * np.cos(elbow))
        shoulder = np.arctan2(task[:, 1], task[:, 0]) - bend
        joints = np.stack([shoulder - zero, elbow - own - np.arctan2(across, along)], axis=1)
        return self.drives.read(joints)

    def _link(self, number: int, link: Link) -> Iterator[Parameter]:
        t, where = self.tolerances, f"joint_{number}"

        def parameter(name: str, unit: str, nominal: float, prior: float, cause: str) -> Parameter:
            return Parameter(f"{name}_{number}", unit, nominal, prior, cause, where)

        yield parameter("twist", "rad", link.twist, t.twist, "joint_axis_tilt")
        if link.parallel:
            yield parameter("skew", "rad", 0.0, t.twist, "joint_axis_tilt")
        yield parameter("length", "m", link.length, t.length, "link_length")
        yield parameter("zero", "rad", link.zero, t.zero, "joint_zero_offset")
        if not link.parallel:
            yield parameter("offset", "m", link.offset, t.length, "link_offset")

    def _tool(self) -> Iterator[Parameter]:
        """Parameters of the tool; if the last axes are parallel, x is the last link's length."""
        t, where = self.tolerances, f"joint_{self.joints}"
        plane = self.dimensions.links[-1].parallel
        for letter, value in zip("xyz", self.dimensions.tool, strict=True):
            last = plane and letter == "x"
            prior, cause = (t.length, "link_length") if last else (t.tool, "tool_position")
            yield Parameter(f"tool_{letter}", "m", float(value), prior, cause, where)
        for letter in "xyz":
            yield Parameter(f"tool_turn_{letter}", "rad", 0.0, t.mount, "tool_turn", where)


def _walked(q: Symbol, g: Symbol) -> tuple[Symbol, Symbol]:
    """Position of the tool in the base [m], and its unit quaternion, scalar first."""
    *_, (_, state) = _steps(q, g)
    tool = g[_LINK * _links(g) :]
    for axis in (X, Y, Z):
        state = _shifted(state, axis, tool[axis])
    for n, axis in enumerate((Z, Y, X)):
        state = _turned_by(state, axis, tool[3 + n])
    for axis in (X, Y, Z):
        state = _turned_by(state, axis, tool[6 + axis])
    return state[0], state[1]


def _joint_places(q: Symbol, g: Symbol) -> list[Symbol]:
    """One point on each joint's axis, in the base [m]."""
    return [before[0] for before, _ in _steps(q, g)]


def _links(g: Symbol) -> int:
    return int(g.shape[0] - 9) // _LINK


def _steps(q: Symbol, g: Symbol) -> Iterator[tuple[Any, Any]]:
    """Frame before and after each joint: position, unit quaternion and axes."""
    axes = sy.column(1, 0, 0), sy.column(0, 1, 0), sy.column(0, 0, 1)
    state: Any = sy.column(0, 0, 0), sy.column(1, 0, 0, 0), axes
    for i in range(_links(g)):
        twist, skew, length, zero, offset = (g[_LINK * i + n] for n in range(_LINK))
        before = _shifted(_turned_by(_turned_by(state, X, twist), Y, skew), X, length)
        state = _shifted(_turned_by(before, Z, q[i] + zero), Z, offset)
        yield before, state


def _shifted(state: Any, axis: int, size: Symbol) -> Any:
    """Shift the frame reached so far along one of its axes, by a length [m]."""
    position, turn, axes = state
    return position + size * axes[axis], turn, axes


def _turned_by(state: Any, axis: int, angle: Symbol) -> Any:
    """Turn the frame reached so far about one of its axes, by an angle [rad]."""
    position, turn, axes = state
    c, s = sy.cos(angle), sy.sin(angle)
    one, two = (axis + 1) % 3, (axis + 2) % 3
    mixed = list(axes)
    mixed[one] = c * axes[one] + s * axes[two]
    mixed[two] = c * axes[two] - s * axes[one]
    half = [0, 0, 0]
    half[axis] = sy.sin(angle / 2)
    return position, sy.quaternion_product(turn, sy.column(sy.cos(angle / 2), *half)), mixed
