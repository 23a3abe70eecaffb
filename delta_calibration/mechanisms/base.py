"""A mechanism is its closure equation f(q, x, g) = 0; everything else follows from it.

q: joint coordinates (n, m), as the drives read them; x: pose (n, k); g: geometry, (p,) for all
samples or (n, p) where it changes from sample to sample (temperature, load). A mechanism defines f
once, in symbols, for one sample of one of its limbs (`equation`), in its own joints (drives.py),
and states which joints, dimensions and rows of f each limb has. From f the package generates and
compiles (see `model`) forward and inverse kinematics and, by the implicit function theorem,

    dx/dq = -f_x^-1 f_q   (velocity Jacobian)        dx/dg = -f_x^-1 f_g   (identification
    Jacobian)

in the least-squares sense where f has more rows than x has coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ReachError
from delta_calibration.geometry import rotations
from delta_calibration.lazy import cached_property
from delta_calibration.mechanisms.drives import Drives
from delta_calibration.model import symbols
from delta_calibration.model.chain_constants import SIDES, STRAY
from delta_calibration.model.law import Law
from delta_calibration.parameters import ParameterSet

if TYPE_CHECKING:
    from delta_calibration.model.loads import Loads

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Own = TypeVar("Own", bound="Mechanism")

_STAGES = 4  # from home to the joints in forward kinematics, if the mechanism has no opening
_UNREACHED = 1e-12  # largest closure of a solution of damped inverse kinematics [m, rad]

# Shares of a uniform rod's mass at either end and in its middle: such point masses have its
# weight, its centre and its inertia exactly (Simpson's rule).
ROD_END, ROD_MIDDLE = 1 / 6, 2 / 3


@dataclass(frozen=True)
class Limb:
    """Joints, dimensions, closure rows and constants of one limb; all limbs share one law.

    `dimensions` are indices into the mechanism's parameters, followed by its `fixed` numbers,
    which come from the drawing and are not identified.
    """

    joints: tuple[int, ...]
    dimensions: tuple[int, ...]
    rows: tuple[int, ...]  # of the closure
    constants: tuple[float, ...] = ()


class _Compiled(NamedTuple):
    """A mechanism in the form that the compiled loops take."""

    limbs: Any  # model.kernels.Limbs
    size: int  # of a limb's workspace


class Mechanism(ABC):
    """Base of all mechanisms.

    The pose x is the platform centre's position [m], followed by a rotation vector [rad] if the
    platform turns. A mechanism with other pose coordinates overrides `point`, which alone defines
    their meaning.
    """

    name: ClassVar[str]
    # sections of the robot file that describe the mechanism, see sections.py
    Dimensions: ClassVar[type[Any]]
    Tolerances: ClassVar[type[Any]]
    Masses: ClassVar[type[Any] | None] = None
    masses_needed: ClassVar[bool] = True  # whether a robot file must state the masses
    joint_unit: ClassVar[str] = "rad"  # or "m" if the joints slide
    limb: ClassVar[str] = "joint"  # word for a location, followed by its number: "joint_1"
    commanded: ClassVar[str] = ""  # simpler model that its controller uses, if not this one
    detailed: ClassVar[str] = ""  # most detailed model of the same drawing, if not this one
    pulls: ClassVar[bool] = False  # whether its limbs can only pull: see `borne`

    home_is: ClassVar[str] = "zero of every joint"  # entry of the robot file that defines home

    joint_size: float = 1.0  # [rad or m] joint motion that moves it as far as 1 rad does a Delta
    joints: int  # m
    pose_size: int  # k: 3, or 6 with a rotation vector behind the position
    task_size: int  # number of pose coordinates, from the first, that the joints command
    variant: str = ""  # suffix of the law's name, if the law differs between machines of this name
    exact: ClassVar[bool] = False  # whether `opening` is the solution of forward kinematics itself
    damped: ClassVar[bool] = False  # whether inverse kinematics start far from their solution

    parameters: ParameterSet
    _drives: Drives | None = None

    @abstractmethod
    def __init__(self, dimensions: Any, tolerances: Any) -> None:
        """From the drawing and the expected errors of the parts."""

    # --- what a mechanism defines, in the vocabulary of model/symbols.py -------------------------

    @staticmethod
    @abstractmethod
    def equation(q: Any, x: Any, g: Any, c: Any) -> Any:
        """Closure of one limb, a column of its rows; zero if joints, pose and dimensions fit.

        Args:
            q: joints of the limb in the mechanism's own convention, not the drives' readings.
            x: pose of the platform (k).
            g: dimensions of the limb.
            c: constants of the limb.
        """

    # opening(q, g, c): a pose near the wanted assembly mode, from joints, dimensions and constants
    # of every limb (lists, in order); without it forward kinematics start at `home_pose`.
    opening: ClassVar[Any] = None
    # reaching(x, g, c): joints of a limb near the wanted working mode, from pose, dimensions and
    # constants as in `equation`; without it inverse kinematics start at `home`.
    reaching: ClassVar[Any] = None

    # nearby(d, o, x, a, q, g, c): position of the platform's point o [m] at joints q + d, d up to
    # `symbols.LITTLE`, from the pose x at q, the inverse a of f_x there, and joints, dimensions
    # and constants of every limb (lists) as in `opening`. A swarm evaluates it for all its
    # particles at once, so of d it should use no functions but roots.
    nearby: ClassVar[Any] = None

    @staticmethod
    def point(x: Any, o: Any) -> Any:
        """Position in the base [m] of a point fixed to the platform at o (3), at pose x."""
        if x.shape[0] == 3:
            return x + o
        return x[0:3] + symbols.rotation(x[3:6]) @ o

    # masses(x, q, g, c): positions of all masses but the payload, one after the other (3 numbers
    # each) [m], from the pose, and joints, dimensions and constants of every limb (lists); without
    # it all mass is at the platform's centre.
    masses: ClassVar[Any] = None

    def weights(self, masses: Any) -> Array:
        """Robot's own point masses [kg]; by default one, at the platform's centre."""
        return np.array([0.0 if masses is None else masses.on_platform])

    def moving(self, masses: Any) -> Array:
        """Share of each point mass that acts as inertia when accelerated; 1 by default."""
        return np.ones(len(self.weights(masses)))

    @property
    def levers(self) -> Array:
        """Constant offset of each mass from its position in `masses`, (masses, 3) [m]."""
        return np.zeros((len(self.weights(None)), 3))

    @property
    def pivots(self) -> Array:
        """Points at which the share of each mass that is not `moving` rests, (masses, 3) [m]."""
        return np.zeros((len(self.weights(None)), 3))

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """The limbs; by default a single one with all joints, dimensions and closure rows."""
        every = tuple(range(len(self.parameters) + len(self.fixed)))
        return (Limb(tuple(range(self.joints)), every, tuple(range(self.pose_size))),)

    @property
    def fixed(self) -> Array:
        """Numbers of the drawing that the equation needs besides the parameters, (c,)."""
        return np.zeros(0)

    @property
    def weighed(self) -> bool:
        """Whether a robot file states its masses, and its limbs push as well as pull."""
        return self.Masses is not None and not self.pulls

    def heavy(self, masses: Any) -> bool:
        """Whether the weight of its parts is known, and loads its drives on either side.

        Args:
            masses: of the robot file; None if it states none in a table of their own.
        """
        return not self.pulls and bool(np.any(self.weights(masses)))

    @property
    def base_lengths(self) -> Array:
        """Length of the base that each dimension contains and grows with, else 0, (p,) [m].

        By default the coordinates of the joints on the base, about the base frame's origin.
        """
        own = [p.cause == "base_joint_position" and p.unit == "m" for p in self.parameters]
        return np.where(own, self.parameters.nominal, 0.0)

    @property
    def home_pose(self) -> Array:
        """A pose in the middle of the workspace, (k,)."""
        return np.zeros(self.pose_size)

    @property
    def home(self) -> Array:
        """Drive readings in the middle of the workspace, (m,)."""
        return self.drives.read(np.zeros(self.joints))

    @property
    def most_misfit(self) -> Array:
        """Largest closure of each row at which the machine can be assembled, (R,)."""
        return np.full(self._closures, np.inf)

    def __getstate__(self) -> dict[str, Any]:
        """State without cached properties: addresses of code are valid in one process only."""
        kind = type(self)
        return {
            name: value
            for name, value in vars(self).items()
            if not isinstance(getattr(kind, name, None), cached_property)
        }

    # --- what follows from these -----------------------------------------------------------------

    @property
    def drives(self) -> Drives:
        """Sense and zero of the drives; by default they read the mechanism's own joints."""
        return Drives.alike(self.joints) if self._drives is None else self._drives

    def driven(self: Own, drives: Drives) -> Own:
        """Copy of the mechanism with other drives."""
        other = copy(self)
        other._drives = drives
        return other

    def closure(self, q: Array, x: Array, g: Array) -> Array:
        """Closure f, (n, R); zero if joints, pose and geometry fit together."""
        return self._closed(q, x, g, derivatives=False)[0]

    def closure_by_pose(self, q: Array, x: Array, g: Array) -> Array:
        """df/dx, (n, R, k)."""
        return self._closed(q, x, g, derivatives=False)[1]

    def closure_by_joints(self, q: Array, x: Array, g: Array) -> Array:
        """df/dq, (n, R, m)."""
        return self._closed(q, x, g, derivatives=True)[2]

    def closure_by_geometry(self, q: Array, x: Array, g: Array) -> Array:
        """df/dg, (n, R, p)."""
        return self._closed(q, x, g, derivatives=True)[3]

    def start(self, q: Array, g: Array) -> Array:
        """Starting pose of forward kinematics, near the wanted assembly mode, (n, k)."""
        x = np.tile(np.asarray(self.home_pose, dtype=float), (len(q), 1))
        if self._opening is not None:
            every = self.limbs
            joints, dimensions = (
                [number for limb in every for number in getattr(limb, name)]
                for name in ("joints", "dimensions")
            )
            constants = np.array([c for limb in every for c in limb.constants], dtype=float)
            own = self.drives.own(q)[:, joints]
            _started(self._opening, own, self._known(g)[:, dimensions], constants, x)
        return x

    def start_joints(self, task: Array, g: Array) -> Array:
        """Starting joints of inverse kinematics, near the wanted working mode, (n, m)."""
        if self.reaching is None:
            return np.tile(self.home, (len(task), 1))
        x = np.tile(np.asarray(self.home_pose, dtype=float), (len(task), 1))
        x[:, : self.task_size] = task
        return self._reached(x, g)

    def forward(self, q: Array, g: Array, guess: Array | None = None) -> Array:
        """Pose of the platform at joints q, (n, k); NaN rows where it cannot be assembled.

        Newton's method starts at `guess`, which should be of the same assembly mode, or at
        `start`. Without a guess and an `opening` it goes in stages from home. `exact` mechanisms
        ignore `guess`.
        """
        near = guess is not None and not self.exact
        x = np.array(guess if near else self.start(q, g), dtype=float, order="C")
        stages = 1 if near or self.opening is not None else _STAGES
        c, home = self._compiled, self._home_joints
        q, x, g = self._samples(q, x, g)
        _kernels().poses(c.limbs, c.size, home, stages, q, g, x, STRAY)
        return x

    @cached_property
    def _home_joints(self) -> Array:
        return np.array(self.home, dtype=float)

    def inverse(self, task: Array, g: Array, guess: Array | None = None) -> Array:
        """Joints that bring the commanded coordinates to `task`, (n, m); NaN rows out of reach.

        Newton's method starts at `start_joints`; at `guess` only if the mechanism is `damped` or
        has no `reaching`.
        """
        near = guess is not None and (self.damped or self.reaching is None)
        q = np.array(guess if near else self.start_joints(task, g), dtype=float, order="C")
        q = _rows(q, self.joints)
        whole = self.task_size == self.pose_size
        x = np.array(task, dtype=float, order="C") if whole else self.forward(q, g)
        c, stray = self._compiled, _UNREACHED if self.damped else STRAY
        task, g = _rows(task, self.task_size, len(q)), self._geometry(g, len(q))
        _kernels().joints_for(c.limbs, c.size, task, g, q, x, stray, self.damped)
        return q

    def velocity_jacobian(self, q: Array, x: Array, g: Array) -> Array:
        """dx/dq, (n, k, m) [m/rad, rad/rad]."""
        return self.moved_by(q, x, g, self._every_coordinate(len(q)))[0]

    def identification_jacobian(self, q: Array, x: Array, g: Array) -> Array:
        """dx/dg, (n, k, p), at constant joints."""
        return self.moved_by(q, x, g, self._every_coordinate(len(q)))[1]

    def moved_by(self, q: Array, x: Array, g: Array, by_pose: Array) -> tuple[Array, Array]:
        """Derivatives of functions of the pose by joints, (n, c, m), and geometry, (n, c, p).

        `by_pose` (n, c, k) holds their derivatives by the pose. The results equal its products
        with the two Jacobians, but need c solved systems for each sample instead of m + p.
        """
        c, q, x, g = self._compiled, *self._samples(q, x, g)
        slopes = np.require(by_pose, np.float64, ["C", "A", "W"])
        if slopes.shape[::2] != (len(q), self.pose_size) or slopes.shape[1] > SIDES:
            raise ValueError(
                f"by_pose of shape {slopes.shape} is not allowed; ({len(q)}, up to {SIDES},"
                f" {self.pose_size})"
            )
        by_q, by_g = _kernels().slopes(c.limbs, c.size, q, x, g, slopes)
        return by_q, by_g

    def _samples(self, q: Array, x: Array, g: Array) -> tuple[Array, Array, Array]:
        """Joints, poses and dimensions, checked here because the compiled loops check nothing."""
        q = _rows(q, self.joints)
        return q, _rows(x, self.pose_size, len(q)), self._geometry(g, len(q))

    def _geometry(self, g: Array, n: int) -> Array:
        """Dimensions, one row for all samples or one row each."""
        shared = np.ndim(g) == 1 or len(g) == 1
        return _rows(g, len(self.parameters), 1 if shared else n)

    def _every_coordinate(self, n: int) -> Array:
        return np.tile(np.eye(self.pose_size), (n, 1, 1))

    def _closed(
        self, q: Array, x: Array, g: Array, derivatives: bool
    ) -> tuple[Array, Array, Array, Array]:
        c = self._compiled
        found = _kernels().closures(c.limbs, c.size, *self._samples(q, x, g), derivatives)
        f, by_x, by_q, by_g = found
        return f, by_x, by_q, by_g

    @cached_property
    def _closures(self) -> int:
        return 1 + max(row for limb in self.limbs for row in limb.rows)

    @property
    def law_name(self) -> str:
        """Name of the generated files."""
        return self.name + self.variant

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """All laws that are generated: those of forward kinematics, `reaching` and `nearby`."""
        every = *self.laws_forward, self._reaching, self._nearby
        return tuple(law for law in every if law)

    @property
    def laws_forward(self) -> tuple[Law, ...]:
        """Laws of forward kinematics: closure, starting pose, point of the platform, masses."""
        every = self._closure, self._opening, self._point, self._masses
        return tuple(law for law in every if law)

    @cached_property
    def _groups(self) -> tuple[tuple[str, int], ...]:
        one = self.limbs[0]
        sizes = len(one.joints), self.pose_size, len(one.dimensions), len(one.constants)
        return tuple(zip("qxgc", sizes, strict=True))

    @cached_property
    def _closure(self) -> Law:
        rows = len(self.limbs[0].rows)
        fixed, near = ("g", "c"), ("x", "q")
        return Law(self.law_name, self._groups, rows, self.equation, fixed, ("x",), near, ("g",))

    @cached_property
    def _opening(self) -> Law | None:
        own = type(self).opening
        if own is None:
            return None
        count = len(self.limbs)
        groups = tuple((name, count * size) for name, size in self._groups if name != "x")
        law = partial(_of_limbs, own, groups, count)
        return Law(f"{self.law_name}_opening", groups, self.pose_size, law, ("g", "c"))

    @cached_property
    def _nearby(self) -> Law | None:
        own = type(self).nearby
        if own is None:
            return None
        count = len(self.limbs)
        known = tuple((name, count * size) for name, size in self._groups if name != "x")
        k = self.pose_size
        about = ("t", 3), ("o", 3), ("x", k), ("a", k * k)
        groups = (("d", self.joints), *about, *known)
        joints = tuple(limb.joints for limb in self.limbs)
        law = partial(_distance_nearby, own, known, joints)
        fixed = tuple(name for name, _ in groups[1:])
        return Law(f"{self.law_name}_nearby", groups, 1, law, fixed, lanes="d")

    @cached_property
    def _reaching(self) -> Law | None:
        own = type(self).reaching
        if own is None:
            return None
        name, joints = f"{self.law_name}_reaching", len(self.limbs[0].joints)
        return Law(name, self._groups[1:], joints, own, ("g", "c"))

    @cached_property
    def _point(self) -> Law:
        shared = type(self).point is Mechanism.point
        name = f"point_{self.pose_size}" if shared else f"{self.law_name}_point"
        groups = (("x", self.pose_size), ("o", 3))
        return Law(name, groups, 3, type(self).point, (), ("x",), (), ("x", "o"))

    @cached_property
    def _masses(self) -> Law:
        own, count = type(self).masses, len(self.weights(None))
        if own is None:
            groups: tuple[tuple[str, int], ...] = (("x", self.pose_size), ("q", 0), ("g", 0))
            law, name = partial(_at_centre, type(self).point), f"{self._point.name}_centre"
            return Law(name, groups, 3, law, (), (), (), ("x", "q"))
        limbs = len(self.limbs)
        sizes = tuple((name, limbs * size) for name, size in self._groups if name != "x")
        law = partial(_of_limbs_and_pose, own, sizes, limbs)
        groups = (("x", self.pose_size), *sizes)
        return Law(f"{self.law_name}_masses", groups, 3 * count, law, (), (), (), ("x", "q"))

    def _known(self, g: Array) -> Array:
        """Dimensions followed by the fixed numbers, (n or 1, p + c)."""
        rows = _rows(g, len(self.parameters))
        return np.hstack([rows, np.tile(self.fixed, (len(rows), 1))])

    @cached_property
    def _compiled(self) -> _Compiled:
        closure, each = self._closure, self.limbs
        offsets, law = closure.offsets, closure.compiled
        places = [offsets[name] for name in ("q", "x", "g", "c", "f", "f_x", "f_q", "f_g")]
        sizes = self.joints, self.pose_size, len(self.parameters), self._closures, self.task_size
        limbs = _kernels().Limbs(
            law=np.array(law.addresses),
            at=np.array([*places, *law.shared]),
            joints=np.array([limb.joints for limb in each], dtype=np.int64),
            params=np.array([limb.dimensions for limb in each], dtype=np.int64),
            rows=np.array([limb.rows for limb in each], dtype=np.int64),
            consts=np.array([limb.constants for limb in each], dtype=float),
            fixed=np.array(self.fixed, dtype=float),
            sizes=np.array(sizes),
            most=np.array(self.most_misfit, dtype=float),
            sense=np.array(self.drives.sense, dtype=float),
            zero=np.array(self.drives.zero, dtype=float),
        )
        return _Compiled(limbs, law.size)

    def _reached(self, x: Array, g: Array) -> Array:
        """Drive readings from `reaching`, limb by limb, (n, m)."""
        assert self._reaching is not None
        q, known = np.empty((len(x), self.joints)), self._known(g)
        for limb in self.limbs:
            found = np.empty((len(x), len(limb.joints)))
            constants = np.array(limb.constants, dtype=float)
            _started(self._reaching, x, known[:, list(limb.dimensions)], constants, found)
            q[:, list(limb.joints)] = found
        return self.drives.read(q)

    def loads(
        self,
        masses: Any,
        asked: int,
        q: Array,
        x: Array,
        g: Array,
        rate: Array,
        acceleration: Array,
        payload: Array,
        centre: Array,
    ) -> Loads:
        """Forces that the machine carries, see model/loads.py; zeros for those not asked for.

        Args:
            masses: masses of the robot.
            asked: sum of the flags of the wanted loads.
            q: joints, (n, m).
            x: poses, (n, k).
            g: dimensions, (p,) or (n, p).
            rate: rates of the joints [rad/s or m/s], (n, m).
            acceleration: accelerations of the joints [rad/s^2 or m/s^2], (n, m).
            payload: mass of the payload [kg], (n,).
            centre: centre of the payload in the platform's frame [m], (n, 3).
        """
        c, bearing = self._compiled, self.bearing(masses)
        n, m = len(q), self.joints
        found: Loads = _loads().every(
            c.limbs,
            c.size,
            bearing,
            asked,
            *self._samples(q, x, g),
            _rows(rate, m, n),
            _rows(acceleration, m, n),
            _rows(payload[:, None], 1, n)[:, 0],
            _rows(centre, 3, n),
        )
        return found

    def tensions(self, x: Array, g: Array, load: Array) -> Array:
        """Pulls of the limbs that balance a load, (n, R) [N]: those nearest to the pretension.

        By virtual work, see model/loads.py; negative where a cable would have to push. A force
        control may keep another distribution: this one deviates least, in squares, from an equal
        pull in all limbs. NaN where there is no pose.

        Args:
            x: poses, (n, k).
            g: geometry.
            load: dU/dx of all weights on the platform, (n, k) [N, N m]; z is up.
        """
        c, bearing = self._compiled, self.bearing(None)
        x = _rows(x, self.pose_size)
        load, g = _rows(load, self.pose_size, len(x)), self._geometry(g, len(x))
        return np.asarray(_loads().pulls(c.limbs, c.size, bearing, x, g, load))

    def body(self, masses: Any) -> Any:
        """The mechanism in the form that the compiled chain takes (model/stand.py)."""
        c, opening = self._compiled, self._of_every_limb(self._opening)
        bearing, home = self.bearing(masses), self._home_joints
        return _stand().Body(c.limbs, c.size, bearing, opening, home, _STAGES)

    def around(self, reach: float) -> Any:
        """Law of the squared distance near a command, in the form that the compiled swarm takes.

        Its first inputs are the changes of the joints and the target of the distance. Empty if
        the mechanism has no `nearby` law, or if `reach` [rad or m] exceeds `symbols.LITTLE`.
        """
        return self._of_every_limb(self._nearby if reach <= symbols.LITTLE else None)

    def _of_every_limb(self, law: Law | None) -> Any:
        """A law of joints, dimensions and constants of all limbs, see `Opening` of model/stand.py.

        Empty if `law` is None.
        """
        none, opening = np.zeros(0, dtype=np.int64), _stand().Opening
        if law is None:
            return opening(none, np.zeros(5, dtype=np.int64), none, none, np.zeros(0))
        each, places = self.limbs, [law.offsets[name] for name in "qgcf"]
        return opening(
            np.array(law.compiled.addresses),
            np.array([*places, law.compiled.size]),
            np.array([j for limb in each for j in limb.joints], dtype=np.int64),
            np.array([d for limb in each for d in limb.dimensions], dtype=np.int64),
            np.array([v for limb in each for v in limb.constants], dtype=float),
        )

    def bearing(self, masses: Any) -> Any:
        """Masses and their positions in the form that the compiled loops take (model/loads.py)."""
        point, mass = self._point, self._masses
        every = self.limbs if type(self).masses is not None else ()
        dims = [number for limb in every for number in limb.dimensions]
        of_point = [point.offsets[name] for name in ("x", "o", "f", "f_x", "f_o")]
        of_mass = [mass.offsets[name] for name in ("x", "q", "g", "f", "f_x", "f_q")]
        return _loads().Bearing(
            np.array(point.compiled.addresses),
            np.array([*of_point, point.compiled.size]),
            np.array(mass.compiled.addresses),
            np.array([*of_mass, mass.compiled.size]),
            np.array(dims, dtype=np.int64),
            np.array(self.weights(masses), dtype=float),
            np.array(self.moving(masses), dtype=float),
            np.array(self.levers, dtype=float),
            np.array(self.pivots, dtype=float),
            np.array(self.home_pose, dtype=float),
            float(self.pretension),
            np.array([c for limb in every for c in limb.constants], dtype=float),
            self._joints_of_masses,
            *self._slopes_of_masses,
        )

    @cached_property
    def _joints_of_masses(self) -> Index:
        """Joints (j,) in the order in which the law of the masses takes them."""
        every = self.limbs if type(self).masses is not None else ()
        return np.array([j for limb in every for j in limb.joints], dtype=np.int64)

    @cached_property
    def _slopes_of_masses(self) -> tuple[Index, Index]:
        """`by_pose` (s, 3) and `by_joint` (t, 3) of `Bearing`: slopes that the law writes."""
        law, joints = self._masses, self._joints_of_masses
        addresses = np.array(law.compiled.addresses)
        written = _loads().stored(addresses, law.compiled.size, law.offsets["f"])

        def slopes(group: str, columns: Index) -> Index:
            place = law.offsets[f"f_{group}"] + np.arange(law.outputs * len(columns))
            row, column = np.divmod(np.arange(len(place)), max(1, len(columns)))
            found = np.stack([place, row, columns[column]], axis=1)
            return np.ascontiguousarray(found[written[place] > 0], dtype=np.int64)

        return slopes("x", np.arange(self.pose_size)), slopes("q", joints)

    @property
    def pretension(self) -> float:
        """Pull that the drives keep in every limb that can only pull [N]."""
        return 0.0

    def condition(self, q: Array, x: Array, g: Array) -> Array:
        """Condition number of each pose, (n,); 1 at best, infinite where it is singular.

        The largest singular value of the commanded part of the velocity Jacobian over the
        smallest, with the mean gain at home counted among the values. So it grows where the
        platform gains a freedom (f_x singular), where it loses one (f_q singular), and also where
        it loses all at once, which the plain condition number does not show.
        """
        typical = self.typical_gain
        gains = self._singular_values(self.velocity_jacobian(q, x, g))
        most, least = np.fmax(gains[:, 0], typical), np.fmin(gains[:, -1], typical)
        return np.divide(most, least, out=np.full_like(most, np.inf), where=least > 0)

    @cached_property
    def typical_gain(self) -> float:
        """Geometric mean gain [m/rad] of the nominal machine at home, reference of `condition`."""
        home, nominal = self.home[None], self.parameters.nominal
        slope = self.velocity_jacobian(home, self.forward(home, nominal), nominal)
        gains = self._singular_values(slope)
        return float(np.exp(np.log(gains).mean())) if gains.all() else 0.0

    def _singular_values(self, slope: Array) -> Array:
        """Singular values of the commanded part of a Jacobian, (n, min(m, task)), largest first.

        0 where no Jacobian exists.
        """
        task = slope[:, : self.task_size]
        finite = np.isfinite(task).all(axis=(1, 2))
        values = np.zeros((len(task), min(task.shape[1:])))
        values[finite] = np.linalg.svd(task[finite], compute_uv=False)
        return values

    def position(self, x: Array) -> Array:
        """Platform's centre in the base, (n, 3) [m]."""
        return self.points(x, np.zeros(3))

    def rotation(self, x: Array) -> Array:
        """Platform's orientation in the base, (n, 3, 3)."""
        return self._of_point("f_o", x, np.zeros(3)).reshape(-1, 3, 3)

    def points(self, x: Array, offset: Array) -> Array:
        """Points fixed to the platform at `offset`, (3,) or (n, 3), in the base, (n, 3) [m]."""
        return self._of_point("f", x, offset)

    def task(self, position: Array, turn: Array) -> Array:
        """Commanded coordinates of a position (n, 3) [m] and a turn (n, 3) [rad], (n, task_size).

        The turn is a rotation vector, or the mechanism's own angles about x, y and z.
        """
        return np.concatenate([position, turn], axis=1)[:, : self.task_size]

    def point_by_pose(self, x: Array, offset: Array) -> Array:
        """d(point)/dx of a point fixed to the platform at `offset`, (3,) or (n, 3), (n, 3, k)."""
        return self._of_point("f_x", x, offset).reshape(-1, 3, self.pose_size)

    def _of_point(self, what: str, x: Array, offset: Array) -> Array:
        """An output of the law of a point, (n, 3), or its derivative, (n, 3 times inputs)."""
        x, by = _rows(x, self.pose_size), {"f_x": self.pose_size, "f_o": 3}
        found = np.empty((len(x), 3 * by.get(what, 1)))
        _started(self._point, x, np.atleast_2d(offset), np.zeros(0), found, what)
        return found

    def turn(self, x: Array) -> Array:
        """Turn (n, 3) [rad] of the orientation at poses x (n, k), as `task` takes it."""
        none = np.zeros((len(x), 3))
        none[:, : max(0, self.pose_size - 3)] = x[:, 3:6]
        return none

    @property
    def freedoms(self) -> tuple[int, ...]:
        """Commanded freedoms: 0 to 2 are the position's x, y, z; 3 to 5 turns about x, y, z."""
        return tuple(range(self.task_size))

    def borne(self, x: Array, g: Array, load: Array) -> NDArray[np.bool_]:
        """Whether the limbs bear a load at poses x, (n,); always if they can push as well.

        Args:
            x: poses, (n, k).
            g: geometry, (p,) or (n, p).
            load: dU/dx of all weights on the platform, (n, k) [N, N m]; z is up.
        """
        del g, load
        return np.ones(len(x), dtype=np.bool_)

    def require_borne(self, x: Array, g: Array, load: Array, what: str) -> None:
        """Refuse a batch with a pose at which the limbs do not bear a load; `what` names a pose.

        Raises:
            ReachError: names the first such pose and the reason.
        """
        del x, g, load, what

    def turn_by_pose(self, x: Array) -> Array:
        """Derivative of the platform's small turn, in axes of the base, by the pose, (n, 3, k).

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
            solution: solutions, (n, ...); NaN where there is none.
            wanted: values that they were sought for, (n, ...).
            what: word for a row of `wanted`.
            unit: unit of `wanted`; by default that of the joints.

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


def solve(matrix: Array, right: Array) -> Array:
    """Solve matrix @ y = right for each sample, by least squares if there are more rows.

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


def _of_limbs(
    law: Callable[[Any, Any, Any], Any],
    groups: tuple[tuple[str, int], ...],
    count: int,
    *every: Any,
) -> Any:
    """Call a law that takes lists, one entry a limb, with symbols that hold all limbs in a row."""
    parts = []
    for values, (_, size) in zip(every, groups, strict=True):
        own = size // count
        parts.append([values[own * limb : own * (limb + 1)] for limb in range(count)])
    return law(*parts)


def _of_limbs_and_pose(
    law: Callable[..., Any], groups: tuple[tuple[str, int], ...], count: int, x: Any, *every: Any
) -> Any:
    """Call a law that takes the pose, then lists by limb: see `_of_limbs`."""
    return _of_limbs(partial(law, x), groups, count, *every)


def _distance_nearby(
    law: Callable[..., Any],
    groups: tuple[tuple[str, int], ...],
    joints: tuple[tuple[int, ...], ...],
    d: Any,
    t: Any,
    o: Any,
    x: Any,
    a: Any,
    *every: Any,
) -> Any:
    """Squared distance of a platform point o from t, by the `nearby` law at a pose x."""
    changes = [symbols.column(*(d[joint] for joint in own)) for own in joints]
    near = partial(law, changes, o, x, symbols.matrix(a, x.shape[0]))
    return symbols.square(_of_limbs(near, groups, len(joints), *every) - t)


def _at_centre(point: Callable[[Any, Any], Any], x: Any, q: Any, g: Any) -> Any:
    """Position of a single mass at the platform's centre."""
    del q, g
    return point(x, symbols.column(0, 0, 0))


def _started(law: Law, q: Array, g: Array, c: Array, found: Array, what: str = "f") -> None:
    """Evaluate a law of joints or poses, dimensions and, if it has any, constants.

    The output named `what` (f or one of its derivatives) goes into `found` (n, ...).
    """
    sizes = [count for _, count in law.groups]
    begins = [law.offsets[name] for name, _ in law.groups]
    places = np.array([*begins[:2], begins[-1], law.offsets[what]])
    code, size, n = np.array(law.compiled.addresses), law.compiled.size, len(found)
    known = _rows(g, sizes[1], 1 if len(g) == 1 else n)
    _kernels().started(code, places, size, c, _rows(q, sizes[0], n), known, found)


def _rows(values: Array, size: int, n: int | None = None) -> Array:
    """Values (n, size), or (size,) as one row, in the memory layout of the compiled loops.

    Raises:
        ValueError: the shape is another; compiled loops would read beyond the array.
    """
    rows = np.require(values, np.float64, ["C", "A", "W"])
    rows = rows[None] if rows.ndim == 1 else rows
    if rows.ndim != 2 or rows.shape[1] != size or (n is not None and len(rows) != n):
        some = "n" if n is None else n
        raise ValueError(f"values of shape {np.shape(values)} are not allowed; ({some}, {size})")
    return rows


def _loads() -> Any:
    """Module of the compiled forces; imported late."""
    from delta_calibration.model import loads

    return loads


def _stand() -> Any:
    """Module of the compiled chain; imported late."""
    from delta_calibration.model import stand

    return stand


def _kernels() -> Any:
    """Module of the compiled loops; imported late."""
    from delta_calibration.model import kernels

    return kernels
