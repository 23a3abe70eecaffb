"""Serial arm: joints that turn one after the other, from the base to a tool."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.geometry import rotations
from delta_calibration.mechanisms.base import Mechanism
from delta_calibration.mechanisms.serial_dimensions import ArmDimensions, ArmTolerances, Link
from delta_calibration.parameters import Parameter, ParameterSet

Array = NDArray[np.float64]

X, Y, Z = range(3)
_FIXED = -1  # no parameter, or no joint
_STEPS = 200
_TOLERANCE = 1e-12  # [m, rad] largest miss of a solved inverse problem


@dataclass(frozen=True)
class _Motion:
    """A turn about, or a shift along, an axis of the frame reached so far."""

    turns: bool
    axis: int
    drawn: float = 0.0  # [rad, m] what is no parameter
    row: int = _FIXED
    joint: int = _FIXED


@dataclass(frozen=True)
class Walk:
    """Where each elementary motion of the arm happens, and where the arm ends, in the base."""

    axis: Array  # (n, K, 3)
    origin: Array  # (n, K, 3) [m]
    rotation: Array  # (n, 3, 3)
    position: Array  # (n, 3) [m]


class SerialArm(Mechanism):
    """Links in modified DH, with Hayati's angle where neighbouring axes are parallel.

        A_i = R_x(alpha_i) T_x(a_i) R_z(q_i + z_i) T_z(d_i)
        A_i = R_x(alpha_i) R_y(beta_i) T_x(a_i) R_z(q_i + z_i) T_z(d_i drawn)    parallel axes

    Closure: (p - p_F, 1/2 vee(M - M^T)), M = R(w) R_F^T, with p_F, R_F the product of all A_i and
    the tool: what is left of the pose in position [m] and turn (its sine), regular up to a turn of
    pi. Each elementary motion about or along an axis s through o moves the tool by the twist
    (s, s x (p - o)) or (0, s), which is all that derivatives need.

    Pose x (n, 6): tool centre point [m], rotation vector [rad]. Joints q (n, m) [rad]. Parameters
    of link i: twist alpha [rad], skew beta [rad] if parallel, length a [m], zero z [rad], offset d
    [m] if not; then of the tool: place (3) [m] in the last link, turn (3) [rad] about x, y, z
    after its mounting as drawn. An arm of m joints has 4 m + 6 of them; with a free frame of the
    measuring device 4 m + 6 combinations of 4 m + 12 show in the pose: the first link does four of
    the frame's six, the last zero and offset do as much as the tool.

    Two joints command x and y, six or more the pose, others the place. Of the postures that reach
    a task, two parallel axes keep the elbow of `home`, and with a guess any arm takes the one at
    the guess; without, damped steps from home decide. Leaves out links that bend and gears that
    give way.
    """

    name: ClassVar[str] = "serial_arm"
    home_is: ClassVar[str] = "geometry.home_deg"
    Dimensions = ArmDimensions
    Tolerances = ArmTolerances

    def __init__(self, dimensions: ArmDimensions, tolerances: ArmTolerances) -> None:
        """From the drawing and the expected errors of the parts."""
        self.dimensions = dimensions
        self.tolerances = tolerances
        self.joints = len(dimensions.links)
        self.pose_size = 6
        self.task_size = 2 if self.joints == 2 else 6 if self.joints >= 6 else 3
        each = (self._link(number, link) for number, link in enumerate(dimensions.links, 1))
        self.parameters = ParameterSet((*(p for link in each for p in link), *self._tool()))
        self._motions = tuple(self._chain())
        self._joint_motions = [
            k for k, motion in enumerate(self._motions) if motion.joint != _FIXED
        ]
        rows = {motion.row: k for k, motion in enumerate(self._motions)}
        self._parameter_motions = [rows[row] for row in range(len(self.parameters))]

    @property
    def home(self) -> Array:
        """Joints of the drawing's home, (m,) [rad]."""
        return np.array(self.dimensions.home)

    def task(self, position: Array, turn: Array) -> Array:
        """The tool at a place, turned from how it is held at home, (n, task_size)."""
        home = self.forward(self.home[None], self.parameters.nominal)
        held = rotations.log(rotations.exp(turn) @ self.rotation(home))
        return np.concatenate([position, held], axis=1)[:, : self.task_size]

    def turn(self, x: Array) -> Array:
        """How the tool is turned from how it is held at home, (n, 3) [rad]."""
        home = self.forward(self.home[None], self.parameters.nominal)
        return rotations.log(self.rotation(x) @ np.swapaxes(self.rotation(home), 1, 2))

    def closure(self, q: Array, x: Array, g: Array) -> Array:
        """Misfit of pose and arm, (n, 6) [m, 1]."""
        walk = self.walk(q, g)
        m = self._misturned(x, walk)
        turn = _vee(m - np.swapaxes(m, 1, 2)) / 2
        return np.concatenate([x[:, :3] - walk.position, turn], axis=1)

    def closure_by_pose(self, q: Array, x: Array, g: Array) -> Array:
        """[1, 0; 0, (tr M - M) J_l / 2], J_l of the rotation vector, (n, 6, 6)."""
        slope = np.zeros((len(x), 6, 6))
        slope[:, :3, :3] = np.eye(3)
        m = self._misturned(x, self.walk(q, g))
        slope[:, 3:, 3:] = _traced(m) @ rotations.left_jacobian(x[:, 3:]) / 2
        return slope

    def closure_by_joints(self, q: Array, x: Array, g: Array) -> Array:
        """Twists of the joints' axes, (n, 6, m)."""
        return self._closure_by(self._joint_motions, x, self.walk(q, g))

    def closure_by_geometry(self, q: Array, x: Array, g: Array) -> Array:
        """Twists of all that can be wrong, (n, 6, p)."""
        return self._closure_by(self._parameter_motions, x, self.walk(q, g))

    def forward(self, q: Array, g: Array, guess: Array | None = None) -> Array:
        """Pose of the tool, (n, 6) [m, rad]; the product itself.

        `guess` is not needed and not used.
        """
        walk = self.walk(q, g)
        return np.concatenate([walk.position, _rotation_vector(walk.rotation)], axis=1)

    def inverse(self, task: Array, g: Array, guess: Array | None = None) -> Array:
        """Joints in the posture of `guess`, or near home, (n, m) [rad]; NaN rows out of reach.

        Steps damped by the squared miss (Sugihara): they stay short far off and near a
        singularity, and become Newton's at the end. Rows that are there take no more of them.
        """
        q = self.start_joints(task, g) if guess is None else np.array(guess, dtype=float)
        left = np.arange(len(q))
        for _ in range(_STEPS):
            if not left.size:
                break
            own = g if g.ndim == 1 else g[left]
            miss, slope = self._task_miss(q[left], task[left], own)
            across = np.swapaxes(slope, 1, 2)
            damping = np.sum(miss**2, axis=1)[:, None, None] * np.eye(self.task_size)
            tiny = np.finfo(float).eps * np.eye(self.task_size)
            step = across @ np.linalg.solve(slope @ across + damping + tiny, miss[..., None])
            q[left] += step[..., 0]
            left = left[np.abs(miss).max(axis=1) >= _TOLERANCE]  # NaN is not: it never will be
        good = np.abs(self._task_miss(q, task, g)[0]).max(axis=1) < _TOLERANCE
        return np.where(good[:, None], q, np.nan)

    def start(self, q: Array, g: Array) -> Array:
        """The solution itself: the direct problem is closed."""
        return self.forward(q, g)

    def start_joints(self, task: Array, g: Array) -> Array:
        """Home; on two parallel axes the joints of a plane arm, its elbow as at home."""
        if not (self.joints == 2 and self.dimensions.links[1].parallel):
            return np.tile(self.home, (len(task), 1))
        names = ("length_2", "tool_x", "tool_y", "zero_1", "zero_2")
        rows = [self.parameters.row(name) for name in names]
        upper, along, across, zero, own = np.moveaxis(g[..., rows], -1, 0)
        fore = np.hypot(along, across)
        cosine = (np.sum(task**2, axis=1) - upper**2 - fore**2) / (2 * upper * fore)
        elbow = np.copysign(np.arccos(np.clip(cosine, -1.0, 1.0)), self.home[1])
        bend = np.arctan2(fore * np.sin(elbow), upper + fore * np.cos(elbow))
        shoulder = np.arctan2(task[:, 1], task[:, 0]) - bend
        return np.stack([shoulder - zero, elbow - own - np.arctan2(across, along)], axis=1)

    def walk(self, q: Array, g: Array) -> Walk:
        """Along the arm, motion by motion."""
        kind = np.result_type(q, g)
        axis = np.empty((len(q), len(self._motions), 3), dtype=kind)
        origin = np.empty_like(axis)
        rotation = np.tile(np.eye(3, dtype=kind), (len(q), 1, 1))
        position = np.zeros((len(q), 3), dtype=kind)
        for k, motion in enumerate(self._motions):
            axis[:, k], origin[:, k] = rotation[:, :, motion.axis], position
            size = motion.drawn + np.zeros(len(q), dtype=kind)
            if motion.row != _FIXED:
                size = size + g[..., motion.row]
            if motion.joint != _FIXED:
                size = size + q[:, motion.joint]
            if motion.turns:
                rotation = _turned(rotation, motion.axis, size)
            else:
                position = position + size[:, None] * axis[:, k]
        return Walk(axis, origin, rotation, position)

    def joint_axes(self, walk: Walk) -> tuple[Array, Array]:
        """Direction and a point of each joint's axis in the base, 2 (n, m, 3) [1], [m]."""
        return walk.axis[:, self._joint_motions], walk.origin[:, self._joint_motions]

    def _closure_by(self, motions: list[int], x: Array, walk: Walk) -> Array:
        turn, shift = self._twists(motions, walk)
        m = self._misturned(x, walk)
        by_turn = -_traced(np.swapaxes(m, 1, 2)) @ turn / 2
        return np.concatenate([-shift, by_turn], axis=1)

    def _twists(self, motions: list[int], walk: Walk) -> tuple[Array, Array]:
        """How the tool turns and shifts with some of the motions, 2 (n, 3, K)."""
        turns = np.array([self._motions[k].turns for k in motions])[:, None]
        axis = walk.axis[:, motions]
        lever = np.cross(axis, walk.position[:, None] - walk.origin[:, motions])
        turn, shift = np.where(turns, axis, 0.0), np.where(turns, lever, axis)
        return np.swapaxes(turn, 1, 2), np.swapaxes(shift, 1, 2)

    def _task_miss(self, q: Array, task: Array, g: Array) -> tuple[Array, Array]:
        """What the joints still miss of the task, (n, t), and how they move it, (n, t, m)."""
        walk = self.walk(q, g)
        turn, shift = self._twists(self._joint_motions, walk)
        miss = task[:, :3] - walk.position[:, : min(3, self.task_size)]
        if self.task_size < 6:
            return miss, shift[:, : self.task_size]
        wanted = rotations.exp(task[:, 3:6])
        miss_turn = _rotation_vector(wanted @ np.swapaxes(walk.rotation, 1, 2))
        return np.concatenate([miss, miss_turn], 1), np.concatenate([shift, turn], 1)

    def _misturned(self, x: Array, walk: Walk) -> Array:
        """M = R(w) R_F^T, (n, 3, 3)."""
        return rotations.exp(x[:, 3:]) @ np.swapaxes(walk.rotation, 1, 2)

    def _chain(self) -> Iterator[_Motion]:
        """The elementary motions from the base to the tool."""
        row = self.parameters.row
        for i, link in enumerate(self.dimensions.links, 1):
            yield _Motion(True, X, row=row(f"twist_{i}"))
            if link.parallel:
                yield _Motion(True, Y, row=row(f"skew_{i}"))
            yield _Motion(False, X, row=row(f"length_{i}"))
            yield _Motion(True, Z, row=row(f"zero_{i}"), joint=i - 1)
            if link.parallel:
                yield _Motion(False, Z, drawn=link.offset)
            else:
                yield _Motion(False, Z, row=row(f"offset_{i}"))
        for axis, letter in enumerate("xyz"):
            yield _Motion(False, axis, row=row(f"tool_{letter}"))
        for axis, drawn in zip((Z, Y, X), self.dimensions.mount, strict=True):
            yield _Motion(True, axis, drawn=float(drawn))
        for axis, letter in enumerate("xyz"):
            yield _Motion(True, axis, row=row(f"tool_turn_{letter}"))

    def _link(self, number: int, link: Link) -> Iterator[Parameter]:
        t, where = self.tolerances, f"joint_{number}"

        def parameter(name: str, unit: str, nominal: float, prior: float, cause: str) -> Parameter:
            return Parameter(f"{name}_{number}", unit, nominal, prior, cause, where)

        yield parameter("twist", "rad", link.twist, t.twist, "joint_axis_tilt")
        if link.parallel:
            yield parameter("skew", "rad", 0.0, t.twist, "joint_axis_tilt")
        yield parameter("length", "m", link.length, t.length, "link_length")
        yield parameter("zero", "rad", 0.0, t.zero, "joint_zero_offset")
        if not link.parallel:
            yield parameter("offset", "m", link.offset, t.length, "link_offset")

    def _tool(self) -> Iterator[Parameter]:
        """Of the tool; where the last axes are parallel its x is the last link's length."""
        t, where = self.tolerances, f"joint_{self.joints}"
        plane = self.dimensions.links[-1].parallel
        for letter, value in zip("xyz", self.dimensions.tool, strict=True):
            last = plane and letter == "x"
            prior, cause = (t.length, "link_length") if last else (t.tool, "tool_position")
            yield Parameter(f"tool_{letter}", "m", float(value), prior, cause, where)
        for letter in "xyz":
            yield Parameter(f"tool_turn_{letter}", "rad", 0.0, t.mount, "tool_turn", where)


def _turned(rotation: Array, axis: int, angle: Array) -> Array:
    """R R_axis(angle): two columns mixed.  (n, 3, 3), (n,) -> (n, 3, 3)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    one, two = (axis + 1) % 3, (axis + 2) % 3
    turned = rotation.copy()
    turned[:, :, one] = c * rotation[:, :, one] + s * rotation[:, :, two]
    turned[:, :, two] = c * rotation[:, :, two] - s * rotation[:, :, one]
    return turned


def _rotation_vector(rotation: Array) -> Array:
    """(n, 3, 3) -> (n, 3) [rad]; NaN where the matrix has NaN."""
    finite = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    turn = rotations.log(np.where(finite[:, None, None], rotation, np.eye(3)))
    return np.where(finite[:, None], turn, np.nan)


def _vee(skew: Array) -> Array:
    """The vector v of [v]x.  (n, 3, 3) -> (n, 3)."""
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


def _traced(m: Array) -> Array:
    """tr(M) - M: vee([v]x M + M^T [v]x) = (tr(M) - M) v.  (n, 3, 3) -> (n, 3, 3)."""
    return np.asarray(np.trace(m, axis1=1, axis2=2)[:, None, None] * np.eye(3) - m)
