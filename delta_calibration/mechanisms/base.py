"""A mechanism is its closure equation f(q, x, g) = 0; everything else follows from it.

q: joint coordinates (n, m); x: pose (n, k); g: geometry, (p,) for all samples or (n, p) where it
changes from sample to sample (temperature, load). A mechanism writes f and its three derivatives;
this base class makes of them, for all samples at once, the direct and the inverse problem and, by
the implicit function theorem,

    dx/dq = -f_x^-1 f_q   (velocity Jacobian)        dx/dg = -f_x^-1 f_g   (identification
    Jacobian)

in the least-squares sense where f has more rows than x has coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ReachError, SingularityError
from delta_calibration.geometry import rotations
from delta_calibration.parameters import ParameterSet

Array = NDArray[np.float64]

_NEWTON_STEPS = 25
_NEWTON_TOLERANCE = 1e-13  # largest last step, in coordinates of the order of one
_STRAY = 1e-9  # a closure larger than this [m^2] after the last step is no solution


class Mechanism(ABC):
    """Base of all mechanisms.

    The pose x is the platform centre's position [m], with a rotation vector [rad] behind it where
    the platform turns. A mechanism of other coordinates says by `position`, `rotation` and
    `point_by_pose` what they mean; nothing else in the package asks.
    """

    name: ClassVar[str]
    # sections of the robot file that describe it, see sections.py
    Dimensions: ClassVar[type[Any]]
    Tolerances: ClassVar[type[Any]]
    Masses: ClassVar[type[Any] | None] = None
    joint_unit: ClassVar[str] = "rad"  # or "m" where the joints slide
    limb: ClassVar[str] = "joint"  # what a location is called, with its number behind
    commanded: ClassVar[str] = ""  # simpler model that a controller of it uses, if not this one
    detailed: ClassVar[str] = ""  # model of the same drawing that leaves out least, if another
    pulls: ClassVar[bool] = False  # whether its limbs can pull only: see `borne`

    home_is: ClassVar[str] = "zero of every joint"  # what of the robot file says where it is

    joint_size: float = 1.0  # of its joints' unit, that move it as far as 1 rad does a Delta
    joints: int  # m
    pose_size: int  # k: 3, or 6 with a rotation vector behind the position
    task_size: int  # the first so many pose coordinates are what the joints command

    parameters: ParameterSet

    @abstractmethod
    def __init__(self, dimensions: Any, tolerances: Any) -> None:
        """From the drawing and the expected errors of the parts."""

    # --- what a mechanism writes
    # -------------------------------------------------------------------------

    @abstractmethod
    def closure(self, q: Array, x: Array, g: Array) -> Array:
        """Closure f, (n, r); zero where joints, pose and geometry fit together."""

    @abstractmethod
    def closure_by_pose(self, q: Array, x: Array, g: Array) -> Array:
        """df/dx, (n, r, k)."""

    @abstractmethod
    def closure_by_joints(self, q: Array, x: Array, g: Array) -> Array:
        """df/dq, (n, r, m)."""

    @abstractmethod
    def closure_by_geometry(self, q: Array, x: Array, g: Array) -> Array:
        """df/dg, (n, r, p)."""

    @abstractmethod
    def start(self, q: Array, g: Array) -> Array:
        """A pose near the wanted assembly mode, (n, k): where the direct problem starts."""

    @abstractmethod
    def start_joints(self, task: Array, g: Array) -> Array:
        """Joints near the wanted working mode, (n, m): where the inverse problem starts."""

    @property
    def home(self) -> Array:
        """Joints of a pose in the middle of the workspace, (m,)."""
        return np.zeros(self.joints)

    # --- what follows
    # ------------------------------------------------------------------------------------

    def forward(self, q: Array, g: Array, guess: Array | None = None) -> Array:
        """Pose of the platform at joints q, (n, k); NaN rows where it cannot be assembled."""
        x = self.start(q, g) if guess is None else np.array(guess, dtype=float)
        for _ in range(_NEWTON_STEPS):
            f, slope = self.linearised(q, x, g)
            step = solve(slope, f[..., None])[..., 0]
            x = x - step
            if _settled(step):
                break
        return _without_strays(x, self.missed(q, x, g))

    def linearised(self, q: Array, x: Array, g: Array) -> tuple[Array, Array]:
        """Closure (n, r) and its derivative by the pose (n, r, k), by what they have in common."""
        return self.closure(q, x, g), self.closure_by_pose(q, x, g)

    def missed(self, q: Array, x: Array, g: Array) -> Array:
        """What of the closure another pose could take away, (n, r); zero at a solution.

        All of it where there are as many rows as coordinates; a redundant mechanism keeps the
        rest, and x is then the pose of least squares.
        """
        f = self.closure(q, x, g)
        if f.shape[1] == self.pose_size:
            return f
        slope = self.closure_by_pose(q, x, g)
        return np.asarray((slope @ solve(slope, f[..., None]))[..., 0])

    def inverse(self, task: Array, g: Array, guess: Array | None = None) -> Array:
        """Joints that bring the commanded coordinates to `task`, (n, m); NaN rows out of reach."""
        q = self.start_joints(task, g) if guess is None else np.array(guess, dtype=float)
        missed = np.zeros_like(task)
        for _ in range(_NEWTON_STEPS):
            x = self.forward(q, g)
            missed = x[:, : self.task_size] - task
            slope = self.velocity_jacobian(q, x, g)[:, : self.task_size]
            step = solve(slope, missed[..., None])[..., 0]
            q = q - step
            if _settled(step):
                break
        return _without_strays(q, missed)

    def velocity_jacobian(self, q: Array, x: Array, g: Array) -> Array:
        """dx/dq, (n, k, m) [m/rad, rad/rad]."""
        return -solve(self.closure_by_pose(q, x, g), self.closure_by_joints(q, x, g))

    def identification_jacobian(self, q: Array, x: Array, g: Array) -> Array:
        """dx/dg, (n, k, p), at constant joints."""
        return -solve(self.closure_by_pose(q, x, g), self.closure_by_geometry(q, x, g))

    def moved_by(self, q: Array, x: Array, g: Array, by_pose: Array) -> tuple[Array, Array]:
        """Derivatives by joints, (n, c, m), and geometry, (n, c, p), of what follows the pose.

        `by_pose` (n, c, k) is its derivative by the pose. The same as the products with the two
        Jacobians, but with c systems to solve for each sample instead of m + p.
        """
        back = -divide(by_pose, self.closure_by_pose(q, x, g))
        return back @ self.closure_by_joints(q, x, g), back @ self.closure_by_geometry(q, x, g)

    def condition(self, q: Array, x: Array, g: Array) -> Array:
        """How far a pose is from being regular, (n,): 1 is as good as home, infinite is singular.

        The largest singular value of the commanded part of the velocity Jacobian over the
        smallest, each compared with the mean gain at home as well. So it grows where the platform
        gains a freedom (f_x singular), where it loses one (f_q singular), and also where it loses
        all at once, which the plain condition number does not see.
        """
        typical = self._typical_gain
        gains = self._singular_values(self.velocity_jacobian(q, x, g))
        most, least = np.fmax(gains[:, 0], typical), np.fmin(gains[:, -1], typical)
        return np.divide(most, least, out=np.full_like(most, np.inf), where=least > 0)

    @cached_property
    def _typical_gain(self) -> float:
        """Mean gain of the nominal machine at home [m/rad]."""
        home, nominal = self.home[None], self.parameters.nominal
        slope = self.velocity_jacobian(home, self.forward(home, nominal), nominal)
        gains = self._singular_values(slope)
        return float(np.exp(np.log(gains).mean())) if gains.all() else 0.0

    def _singular_values(self, slope: Array) -> Array:
        """Of the commanded part, (n, min(m, task)), largest first; 0 where no Jacobian exists."""
        task = slope[:, : self.task_size]
        finite = np.isfinite(task).all(axis=(1, 2))
        values = np.zeros((len(task), min(task.shape[1:])))
        values[finite] = np.linalg.svd(task[finite], compute_uv=False)
        return values

    def position(self, x: Array) -> Array:
        """Platform's centre in the base, (n, 3) [m]."""
        return x[:, :3]

    def rotation(self, x: Array) -> Array:
        """Platform's orientation in the base, (n, 3, 3)."""
        if self.pose_size == 3:
            return np.broadcast_to(np.eye(3), (len(x), 3, 3))
        return rotations.exp(x[:, 3:6])

    def task(self, position: Array, turn: Array) -> Array:
        """What the joints command of a place (n, 3) [m] and a turn (n, 3) [rad], (n, task_size).

        The turn is a rotation vector, or what the mechanism turns by about x, y and z.
        """
        return np.concatenate([position, turn], axis=1)[:, : self.task_size]

    def point_by_pose(self, x: Array, offset: Array) -> Array:
        """d(point)/dx of a point fixed to the platform at `offset`, (3,) or (n, 3), (n, 3, k)."""
        slope = np.zeros((len(x), 3, self.pose_size))
        slope[:, :, :3] = np.eye(3)
        if self.pose_size == 6:
            each = np.broadcast_to(offset, (len(x), 3))
            slope[:, :, 3:] = rotations.exp_times_derivative(x[:, 3:], each)
        return slope

    def turn(self, x: Array) -> Array:
        """The turn (n, 3) [rad] that `task` takes for the orientation at poses x, (n, k)."""
        none = np.zeros((len(x), 3))
        none[:, : self.pose_size - 3] = x[:, 3:6]
        return none

    @property
    def freedoms(self) -> tuple[int, ...]:
        """Which of x, y, z of a place and of a turn about x, y, z the joints command, 0 to 5."""
        return tuple(range(self.task_size))

    def borne(self, x: Array, g: Array, load: Array) -> NDArray[np.bool_]:
        """Whether the limbs bear a load at poses x, (n,); those that can push as well always do.

        Args:
            x: poses, (n, k).
            g: geometry.
            load: dU/dx of all weights on the platform, (n, k) [N, N m]; z is up.
        """
        del g, load
        return np.ones(len(x), dtype=np.bool_)

    def require_borne(self, x: Array, g: Array, load: Array, what: str) -> None:
        """Refuse a batch that holds a pose at which a load is not borne; `what` names a pose.

        Raises:
            ReachError: names the first such pose and what gives way.
        """
        del x, g, load, what

    def turn_by_pose(self, x: Array) -> Array:
        """Small turn of the platform, in axes of the base, by the pose, (n, 3, k).

        2 dphi = sum_k r_k x dr_k over the columns of the platform's rotation.
        """
        rotation, still = self.rotation(x), self.point_by_pose(x, np.zeros(3))
        turn = np.zeros_like(still)
        for k, axis in enumerate(np.eye(3)):
            moved = self.point_by_pose(x, axis) - still
            turn += rotations.skew(rotation[:, :, k]) @ moved / 2
        return turn

    def require_reach(
        self, solution: Array, wanted: Array, what: str, unit: str | None = None
    ) -> None:
        """Refuse a batch that holds a row out of reach.

        Args:
            solution: NaN where there is none, (n, ...).
            wanted: what it was sought for, (n, ...).
            what: how a row of that is called.
            unit: of it; that of the joints where not given.

        Raises:
            ReachError: names the first such row and its value.
        """
        bad = np.flatnonzero(~np.isfinite(solution).all(axis=1))
        if bad.size:
            unit = self.joint_unit if unit is None else unit
            value = ", ".join(f"{v:.6g}" for v in wanted[bad[0]])
            more = f" (and {bad.size - 1} more)" if bad.size > 1 else ""
            named = f"{what} {bad[0] + 1} ({value} {unit})"
            raise ReachError(f"{named} is out of the robot's reach{more}")

    def require_regular(self, q: Array, x: Array, g: Array, limit: float) -> None:
        """Refuse a batch that holds a pose too near a singularity.

        Raises:
            SingularityError: names the first pose whose condition number exceeds `limit`.
        """
        condition = self.condition(q, x, g)
        bad = np.flatnonzero(~(condition <= limit))
        if bad.size:
            value = condition[bad[0]]
            raise SingularityError(
                f"pose {bad[0] + 1} is near a singularity: "
                f"condition {value:.3g}, allowed {limit:g}"
            )


def solve(matrix: Array, right: Array) -> Array:
    """Solve matrix @ y = right for each sample, by least squares where rows outnumber columns.

    Singular samples give NaN instead of an exception, so that one bad pose does not stop a batch.
    (n, r, k), (n, r, c) -> (n, k, c).
    """
    if matrix.shape[-2] != matrix.shape[-1]:
        transposed = np.swapaxes(matrix, -1, -2)
        matrix, right = transposed @ matrix, transposed @ right
    known = np.isfinite(matrix).all(axis=(-1, -2)) & np.isfinite(right).all(axis=(-1, -2))
    finite = np.asarray(known)
    size = matrix.shape[-1]
    usable = np.where(finite[..., None, None], matrix, np.eye(size))
    try:
        result = np.linalg.solve(usable, np.where(finite[..., None, None], right, 0.0))
    except np.linalg.LinAlgError:
        regular = np.asarray(np.linalg.matrix_rank(usable) == size)
        finite = finite & regular
        usable = np.where(regular[..., None, None], usable, np.eye(size))
        result = np.linalg.solve(usable, np.where(finite[..., None, None], right, 0.0))
    return np.where(finite[..., None, None], result, np.nan)


def divide(left: Array, matrix: Array) -> Array:
    """left @ (pseudo)inverse of matrix for each sample; NaN where that is singular.

    (n, c, k), (n, r, k) -> (n, c, r).
    """
    turned = np.swapaxes(matrix, -1, -2)
    if matrix.shape[-2] == matrix.shape[-1]:
        return np.swapaxes(solve(turned, np.swapaxes(left, -1, -2)), -1, -2)
    return np.swapaxes(matrix @ solve(turned @ matrix, np.swapaxes(left, -1, -2)), -1, -2)


def _settled(step: Array) -> bool:
    """Whether no sample moves any more; unsolvable ones (NaN) do not hold up the others."""
    return bool(np.max(np.nan_to_num(np.abs(step)), initial=0.0) <= _NEWTON_TOLERANCE)


def _without_strays(solution: Array, missed: Array) -> Array:
    """The solution with NaN in the rows where the equation is not met."""
    good = np.isfinite(solution).all(axis=1) & (np.abs(missed).max(axis=1) < _STRAY)
    return np.where(good[:, None], solution, np.nan)
