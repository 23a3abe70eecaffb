"""Cable robot: a platform on m cables, each let out by its own drum."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ReachError
from delta_calibration.mechanisms.base import Limb, Mechanism
from delta_calibration.mechanisms.cable_dimensions import (
    CableDimensions,
    CableMasses,
    CableTolerances,
)
from delta_calibration.model.symbols import Symbol, norm, rotation
from delta_calibration.parameters import Parameter, ParameterSet

Array = NDArray[np.float64]

_LEVER = 0.3  # [m/rad] typical motion of a Delta's platform per joint angle
_TORN = 0.03  # strain that steel and aramid cables do not reach without breaking
_BORNE = 1e-6  # share of a load that may remain unbalanced when the cables bear it
_AXES = "xyz"


class CableRobot(Mechanism):
    """Point (3 degrees of freedom) or body (6) on m cables, at least one per degree of freedom.

    Closure of cable i (paper 002 (1), (2)): |a_i - P - R(w) b_i| = l_0i + k_i theta_i, a length.
    The counters are zero at the home pose (P_0, w_0), which is known: it defines the robot's
    frame, and l_0i = |a_i - P_0 - R(w_0) b_i| is no parameter but follows from the others. So the
    paper counts 7 m parameters. If the tolerances state one for the zeros, each counter has a zero
    offset z_i [m], one more parameter per cable. Then nothing fixes the robot's frame: six
    combinations of a_i, z_i and an unknown frame of the measuring device are not identifiable.

    Pose x (n, 6): P [m], rotation vector w [rad]; or (n, 3), P alone. Joints theta (n, m): motor
    angles [rad], positive where they let out. Parameters of a cable, in this order: a (3) [m], b
    (3) [m] for a body, k [m/rad], z [m] if free.

    With more cables than freedoms no pose fits all lengths of a real machine: forward kinematics
    give the pose of least squared closure. Their derivatives are those at zero closure.
    Leaves out mass and stretch of the cables, pulleys, errors of drums: see the effects.
    """

    name: ClassVar[str] = "cable_robot"
    limb: ClassVar[str] = "cable"
    pulls: ClassVar[bool] = True
    Dimensions = CableDimensions
    Tolerances = CableTolerances
    Masses = CableMasses

    def __init__(self, dimensions: CableDimensions, tolerances: CableTolerances) -> None:
        """From the drawing and the expected errors of the parts."""
        self.dimensions = dimensions
        self.tolerances = tolerances
        self.free_zeros = tolerances.zero is not None
        self.joints = len(dimensions.anchors)
        self.pose_size = self.task_size = len(dimensions.home)
        self.joint_size = _LEVER / float(dimensions.gain.mean())
        self._is_body = self.pose_size == 6
        self.variant = "_body" if self._is_body else "_point"
        self._gain = 6 if self._is_body else 3  # column of k among a cable's parameters
        self._size = self._gain + 1 + self.free_zeros
        each = (self._cable_parameters(i) for i in range(self.joints))
        self.parameters = ParameterSet(tuple(p for cable in each for p in cable))

    @property
    def fixed(self) -> Array:
        """Zero offset of a counter, 0, used if the zeros are no parameters."""
        return np.zeros(1)

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """The cables: dimensions a, b of a body, k and z; the home pose as constants."""
        p = self.joints * self._size
        home = tuple(self.dimensions.home.tolist())
        return tuple(
            Limb(
                (i,),
                (*range(self._size * i, self._size * (i + 1)), *(() if self.free_zeros else (p,))),
                (i,),
                home,
            )
            for i in range(self.joints)
        )

    @property
    def home_pose(self) -> Array:
        """Home pose, (k,), whose assembly mode all other poses share."""
        return np.array(self.dimensions.home)

    @property
    def most_misfit(self) -> Array:
        """Length error at which each cable tears, from its length at home, (m,) [m]."""
        home = self.dimensions.home[None]
        return np.asarray(_TORN * self.lengths(home, self.parameters.nominal)[0])

    @staticmethod
    def equation(q: Symbol, x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Distance between anchor and platform joint, minus the free cable length [m]."""
        gain, zero = g[-2], g[-1]
        return _distance(x, g) - _distance(c, g) - zero - gain * q

    @staticmethod
    def reaching(x: Symbol, g: Symbol, c: Symbol) -> Symbol:
        """Motor angle theta = (l - l_0) / k [rad]; paper 002 (2), (3)."""
        gain, zero = g[-2], g[-1]
        return (_distance(x, g) - _distance(c, g) - zero) / gain

    def lengths(self, x: Array, g: Array) -> Array:
        """Distance between anchor and platform joint of each cable, (n, m) [m]."""
        every = (len(x), self.joints, 3)
        ends = np.broadcast_to(self._joints(g), every).reshape(-1, 3)
        ends = self.points(np.repeat(x, self.joints, axis=0), ends).reshape(every)
        return np.asarray(np.linalg.norm(self._cables(g)[..., :3] - ends, axis=-1))

    def directions(self, x: Array, g: Array) -> Array:
        """Unit vectors u along the cables from platform to anchor, (n, m, 3)."""
        return -self.closure_by_pose(self._still(x), x, g)[:, :, :3]

    def require_taut(self, tension: Array, lowest: float = 0.0, what: str = "pose") -> None:
        """Refuse poses at which a cable hangs loose; `what` names a pose.

        Raises:
            ReachError: names the first pose and cable under `lowest` [N].
        """
        bad = np.argwhere(~(tension > lowest))
        if len(bad):
            pose, cable = bad[0].tolist()
            raise ReachError(
                f"{what} {pose + 1}: cable_{cable + 1} is slack: {tension[pose, cable]:.4g} N at "
                f"a pretension of {self.dimensions.pretension:g} N, more than {lowest:g} N is "
                "needed"
            )

    def borne(self, x: Array, g: Array, load: Array) -> NDArray[np.bool_]:
        """Whether every cable pulls, (n,)."""
        return np.asarray((self.tensions(x, g, load) > 0.0).all(axis=1))

    def require_borne(self, x: Array, g: Array, load: Array, what: str) -> None:
        """Refuse poses at which a cable hangs loose.

        Raises:
            ReachError: names the first pose; the cable and its pull, or says that no tensions of
                the cables hold the platform there.
        """
        bad = np.flatnonzero(~self.borne(x, g, load))
        if not bad.size:
            return
        from scipy.optimize import nnls  # slow to load, and rarely needed

        row = slice(bad[0], bad[0] + 1)
        structure = self.closure_by_pose(self._still(x[row]), x[row], g)[0].T
        missed = nnls(structure, -load[bad[0]])[1]  # [N, N m]
        if missed > _BORNE * np.linalg.norm(load[bad[0]]):
            raise ReachError(
                f"{what} {bad[0] + 1}: no tension of the {self.joints} cables can hold the "
                "platform in this pose"
            )
        tension = np.ones((len(x), self.joints))
        tension[row] = self.tensions(x[row], g, load[row])
        self.require_taut(tension, what=what)

    def _cables(self, g: Array) -> Array:
        """Reshape the parameters by cable: (..., p) -> (..., m, size)."""
        return g.reshape((*g.shape[:-1], self.joints, self._size))

    def _joints(self, g: Array) -> Array:
        return self._cables(g)[..., 3:6] if self._is_body else self.dimensions.joints

    def _still(self, x: Array) -> Array:
        """Zero joint angles, (n, m): the derivative of the closure by the pose ignores them."""
        return np.zeros((len(x), self.joints))

    @property
    def pretension(self) -> float:
        """Tension near which the drives keep every cable [N]."""
        return self.dimensions.pretension

    def _cable_parameters(self, row: int) -> list[Parameter]:
        d, t = self.dimensions, self.tolerances
        number, gain = row + 1, float(d.gain[row])
        rest: dict[str, Any] = {"location": f"cable_{number}"}

        def place(part: str, at: Array, prior: float, cause: str) -> list[Parameter]:
            return [
                Parameter(f"{part}_{axis}_{number}", "m", float(value), prior, cause, **rest)
                for axis, value in zip(_AXES, at, strict=True)
            ]

        parameters = place("anchor", d.anchors[row], t.anchor, "base_joint_position")
        if self._is_body:
            cause = "platform_joint_position"
            parameters += place("platform", d.joints[row], t.joint, cause)
        parameters.append(
            Parameter(f"gain_{number}", "m/rad", gain, t.gain * gain, "drum_scale", **rest)
        )
        if t.zero is not None:
            parameters.append(
                Parameter(f"zero_{number}", "m", 0.0, t.zero, "joint_zero_offset", **rest)
            )
        return parameters


def _distance(x: Symbol, g: Symbol) -> Symbol:
    """|a - P - R(w) b| [m]; for a point b = 0."""
    turned = rotation(x[3:6]) @ g[3:6] if x.shape[0] == 6 else 0.0
    return norm(g[0:3] - x[0:3] - turned)
