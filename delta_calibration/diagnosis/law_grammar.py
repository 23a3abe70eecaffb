"""Candidate laws for structure in the residuals that no known effect explains.

A law moves a target (a joint behind its drive, a dimension, the base, the platform, the tracker's
readings) by a function of a quantity of the sample, optionally times a second quantity. No law
uses a quantity that did not change in the session, or for which the mechanism has no signal.
Orders, thresholds and time constants are tried on grids and refined in a fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.constants import TYPICAL_SHIFT
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.effects.base import Stage
from delta_calibration.effects.found_law import (
    ACROSS,
    FORCE,
    TEMPERATURE,
    TORQUE,
    FoundLaw,
    Quantity,
    Target,
)
from delta_calibration.effects.signals import Signals
from delta_calibration.geometry import Frame
from delta_calibration.lazy import cached_property
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

COORDINATES = 3  # of a reading that says where a reflector is; laws move places
_ORDERS = (1.0, 2.0, 4.0)  # periods of a wave in one turn of the joint
_SEARCHED_ORDERS = tuple(np.arange(3.0, 13.0, 1.0).tolist())  # and between those
_FINE_ORDERS = tuple(np.arange(13.0, 241.0, 2.0).tolist())  # of the joint's own gears
_THRESHOLDS = (0.15, 0.3, 0.45, 0.6, 0.75)  # quantiles of a quantity, where a function begins
_WIDTHS = (0.05, 0.15, 0.4)  # of a saturation, as shares of the quantity's range
_TIMES = (600.0, 1500.0, 4000.0)  # [s] time constants of a settling
_FADES = (0.01, 0.05)  # [rad of a Delta] of travel after a reversal
_BEARINGS = 8  # in half a circle
_WAVES = (4.0, 6.0, 8.0, 10.0)  # [rad/m] over the workspace
_EXACT = 0.02  # largest relative error of a displacement reproduced by dimensions
_SMALL = 1e-3  # share of the largest weight below which a dimension is left out
_FARTHEST = 50.0  # tolerances; a dimension that needs more to show carries no law
_MOVED = 1e-9  # least change of a quantity, in its unit
_SLIGHTLY = 1e-6  # the same at one joint, as a share of the change at all joints

_OF_POWERS = ("line", "quadratic", "cubic")

PLATFORM, BASE, TRACKER = "platform", "base", "tracker"
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Function:
    """A function of one quantity, with the numbers that determine its shape."""

    name: str
    middle: float = 0.0
    scale: float = 1.0
    bearing: float = 0.0
    searched: tuple[tuple[str, float, float], ...] = ()


def signals_of(evidence: LinearizedModel, robot: Robot) -> Signals:
    """What laws may depend on at each sample: joints, rates, times, temperatures and all loads."""
    return evidence.chain.signals(evidence.at, evidence.theta, evidence.pose, robot)


@dataclass(frozen=True)
class Grammar:
    """Generator of the laws that the data of a session can test."""

    robot: Robot
    evidence: LinearizedModel
    signals: Signals  # of the machine in its pose at each sample

    @classmethod
    def of(cls, evidence: LinearizedModel, robot: Robot) -> Grammar:
        """The grammar of a session; the terms beside which its laws are tried do not matter."""
        return cls(robot, evidence, signals_of(evidence, robot))

    @cached_property
    def every(self) -> tuple[FoundLaw, ...]:
        """All candidate laws, see `laws`."""
        return tuple(self.laws())

    def laws(self) -> Iterator[FoundLaw]:
        """All candidate laws: each for all its targets together, and for each target alone."""
        yield from self._drives()
        yield from self._dimensions()
        yield from self._bodies()
        yield from self._readings()

    # --- targets -----------------------------------------------------------------------------

    def _drives(self) -> Iterator[FoundLaw]:
        targets = [
            Target(self._limb(j), f"dq_{j + 1}", ((j, 1.0),), self._unit, j)
            for j in range(self._joints)
        ]
        for of, function, by in self._of_drives():
            yield from self._each(Stage.DRIVE, targets, of, function, by)

    def _dimensions(self) -> Iterator[FoundLaw]:
        """Laws of the dimensions of each kind; joint zeros are left to the laws of the drives."""
        kinds: dict[str, list[Target]] = {}
        for row, p in enumerate(self.evidence.chain.mechanism.parameters):
            if p.cause == "joint_zero_offset" or not self._shows(row, p.prior):
                continue
            number = p.name.rstrip("ab").rsplit("_", 1)[-1]
            joint = int(number) - 1 if p.location and number.isdigit() else 0
            stem = p.name.removesuffix(f"_{number}")
            target = Target(p.name, f"d{p.name}", ((row, 1.0),), p.unit, joint)
            kinds.setdefault(stem, []).append(target)
        for targets in kinds.values():
            lengths = targets[0].unit == "m"
            for of, function, by in self._of_dimensions(lengths):
                yield from self._each(Stage.STRUCTURE, targets, of, function, by)

    def _bodies(self) -> Iterator[FoundLaw]:
        """Laws that shift the platform as a whole along the base's axes, or turn it about them."""
        moved = self._shifts
        if moved:
            for of, function, by in self._of_shifts():
                yield from self._each(Stage.STRUCTURE, moved, of, function, by)
        turned = self._turns
        if turned:
            for of, function, by in self._of_turns():
                yield from self._each(Stage.STRUCTURE, turned, of, function, by)

    def _readings(self) -> Iterator[FoundLaw]:
        """Laws of drift of the tracker's readings."""
        targets = [Target(TRACKER, f"d{a}_tracker", ((i, 1.0),), "m") for i, a in enumerate(AXES)]
        for of in (*self._known("time"), *self._temperatures):
            for function in (Function("line"), *(self._settling if of.name == "time" else ())):
                yield from self._each(Stage.MEASUREMENT, targets, of, function, None)

    def _each(
        self,
        on: Stage,
        targets: Sequence[Target],
        of: Quantity,
        function: Function,
        by: Quantity | None,
    ) -> Iterator[FoundLaw]:
        """The law of all targets where its quantities change, and that of each of them alone."""
        every = [of] if by is None else [of, by]
        targets = [t for t in targets if all(self._changes(quantity, t) for quantity in every)]
        if not targets:
            return
        law = FoundLaw(
            self.robot,
            self.evidence.chain.mechanism,
            on,
            tuple(targets),
            of,
            function.name,
            by,
            function.middle,
            function.scale,
            function.bearing,
            searched=function.searched,
        )
        yield replace(law, middle=self._origin(law))
        if len(targets) > 1:
            for target in targets:
                alone = replace(law, targets=(target,))
                yield replace(alone, middle=self._origin(alone))

    def _origin(self, law: FoundLaw) -> float:
        """Value from which a power counts: the middle of a joint's readings if zero is far off.

        A line through a distant zero would need a constant as well, which the tolerances forbid.
        """
        joints = self._joints
        if law.of.name != "q" or law.by is not None or law.function not in _OF_POWERS:
            return law.middle
        own = [law.of.number(target.joint, joints) for target in law.targets]
        values = self.signals.of(law.of.signals[0])[:, own]
        low, high = float(values.min()), float(values.max())
        middle = (low + high) / 2
        return round(middle, 3) if abs(middle) > high - low else law.middle

    # --- quantities and functions --------------------------------------------------------------

    def _of_drives(self) -> Iterator[tuple[Quantity, Function, Quantity | None]]:
        angle, along = Quantity("q"), Quantity("direction")
        slow = [*self._known("payload"), *self._temperatures]
        own = (*self._orders(_SEARCHED_ORDERS), *self._orders(_FINE_ORDERS, 1.5))
        for f in (Function("line"), *self._powers, *own, *self._harmonics):
            yield angle, f, None
        for f in (*self._begins(angle), *self._clips(angle), *self._soft(angle)):
            yield angle, f, None
        for by in (*slow, *self._known("time"), *self._known("direction")):
            for f in (Function("line"), Function("quadratic"), *self._harmonics):
                yield angle, f, by
        for k in range(1, self._joints):
            other = Quantity("q", k)
            waves = (*self._orders(_SEARCHED_ORDERS), *self._harmonics)
            for f in (Function("line"), *self._powers, *waves):
                yield other, f, None
            for f in (*self._begins(other), *self._soft(other)):
                yield other, f, None
            yield angle, Function("line"), other
            yield angle, Function("bilinear"), other
            for further in range(k + 1, self._joints):
                yield other, Function("bilinear"), Quantity("q", further)
            for by in self._known("payload"):
                for f in (Function("line"), *self._harmonics):
                    yield other, f, by
            for name in ("direction", "rate", TORQUE):
                for quantity in self._known(name):
                    yield replace(quantity, ahead=k), Function("line"), None
        for name in ("rate", "acceleration", "direction", TORQUE):
            for quantity in self._known(name):
                yield quantity, Function("line"), None
                for by in slow:
                    yield quantity, Function("line"), by
        for quantity in self._known("rate"):
            for f in (Function("drag"), Function("sign"), *self._soft(quantity, centred=True)):
                yield quantity, f, None
        for quantity in self._known(TORQUE):
            for name in ("square", "cube", "drag", "sign"):
                yield quantity, Function(name), None
            yield from ((quantity, f, None) for f in self._soft(quantity, centred=True))
        if self._varies(along):
            for fade in _FADES:
                scale = 1 / (fade * self._size)
                near = (("scale", scale / 3, 3 * scale),)
                yield Quantity("travel"), Function("fading", scale=scale, searched=near), along
        yield from self._of_conditions()

    def _of_conditions(self) -> Iterator[tuple[Quantity, Function, Quantity | None]]:
        """Functions of payload, temperatures and time, which the whole machine shares."""
        for quantity in self._known("payload"):
            yield quantity, Function("line"), None
            if len(np.unique(np.round(self.evidence.at.payload, 3))) > 2:
                yield quantity, Function("square"), None
        for quantity in self._temperatures:
            for name in ("line", "quadratic"):
                yield quantity, Function(name), None
        for quantity in self._known("time"):
            for f in (Function("line"), Function("quadratic"), *self._settling):
                yield quantity, f, None

    def _of_dimensions(
        self, lengths: bool
    ) -> Iterator[tuple[Quantity, Function, Quantity | None]]:
        yield from self._of_conditions()
        loads = [*self._known(TORQUE), *(self._known(FORCE) if lengths else ())]
        for load in loads:
            for name in ("line", "sign", "cube"):
                yield load, Function(name), None
        for name in ("direction", "acceleration"):
            for quantity in self._known(name):
                yield quantity, Function("line"), None
        for f in (Function("line"), Function("quadratic"), *self._harmonics[:1]):
            for by in (None, *self._known("payload")):
                yield Quantity("q"), f, by

    def _of_shifts(self) -> Iterator[tuple[Quantity, Function, Quantity | None]]:
        yield from ((of, f, by) for of, f, by in self._of_conditions() if of.name != "time")
        if not self._pose_is_place:
            return
        for axis in AXES:
            place = Quantity(axis)
            for f in (Function("quadratic"), Function("cubic"), *self._waves):
                yield place, f, None
            for by in (*self._known("payload"), *self._temperatures):
                for f in (Function("line"), Function("quadratic"), *self._waves):
                    yield place, f, by

    def _of_turns(self) -> Iterator[tuple[Quantity, Function, Quantity | None]]:
        yield from ((of, f, by) for of, f, by in self._of_conditions() if of.name != "time")
        if not self._pose_is_place:
            return
        for axis in AXES:
            for by in (None, *self._known("payload")):
                yield Quantity(axis), Function("line"), by
        low, high = self._range(Quantity("x"))
        for bearing, width in product(
            (np.arange(_BEARINGS) * np.pi / _BEARINGS).tolist(), _WIDTHS
        ):
            scale, step = 1 / (width * (high - low)), np.pi / _BEARINGS
            near = (
                ("bearing", bearing - step, bearing + step),
                ("scale", scale / 3, 3 * scale),
            )
            soft = Function("saturation", scale=scale, bearing=bearing, searched=near)
            yield Quantity(ACROSS), soft, None

    # --- functions in their shapes ------------------------------------------------------------

    @property
    def _powers(self) -> tuple[Function, ...]:
        return Function("quadratic"), Function("cubic")

    @property
    def _harmonics(self) -> tuple[Function, ...]:
        """Waves of whole orders; none for a prismatic joint, which makes no turn."""
        if self._unit != "rad":
            return ()
        return tuple(Function("wave", scale=order) for order in _ORDERS)

    def _orders(self, orders: Sequence[float], near: float = 1.0) -> tuple[Function, ...]:
        """Waves of real orders, each searched up to `near` to either side."""
        ends = ((n, (n - near) / self._size, (n + near) / self._size) for n in orders)
        return tuple(
            Function("wave", scale=n / self._size, searched=(("scale", low, high),))
            for n, low, high in ends
        )

    @property
    def _waves(self) -> tuple[Function, ...]:
        return tuple(
            Function("wave", scale=n, searched=(("scale", n - 1.5, n + 1.5),)) for n in _WAVES
        )

    @property
    def _settling(self) -> tuple[Function, ...]:
        return tuple(
            Function("settling", scale=1 / t, searched=(("scale", 0.4 / t, 2.5 / t),))
            for t in _TIMES
        )

    def _begins(self, of: Quantity) -> Iterator[Function]:
        """Functions that are zero up to a threshold, one for each of several thresholds."""
        values = np.quantile(self._values(of), _THRESHOLDS)
        step = float(np.diff(values).max())
        if step <= 0:
            return
        for value in values.tolist():
            near = (("middle", value - step, value + step),)
            yield Function("beyond", value, searched=near)

    def _clips(self, of: Quantity) -> Iterator[Function]:
        """Ramps: zero before a first value of the quantity, constant after a second one."""
        low, high = self._range(of)
        step = 0.2 * (high - low)
        for value, width in product(np.linspace(low, high, 6)[1:-2].tolist(), (0.2, 0.4)):
            scale = 1 / (width * (high - low))
            near = (("middle", value - step, value + step), ("scale", scale / 2, 2 * scale))
            yield Function("ramp", value, scale, searched=near)

    def _soft(self, of: Quantity, centred: bool = False) -> Iterator[Function]:
        """Saturations of several widths, about several values of the quantity or about zero."""
        low, high = self._range(of)
        if high <= low:
            return
        values = [0.0] if centred else np.quantile(self._values(of), (0.3, 0.5, 0.7)).tolist()
        for value, width in product(values, _WIDTHS[:2]):
            scale, step = 1 / (width * (high - low)), 0.2 * (high - low)
            near = [("scale", scale / 3, 3 * scale)]
            near += [] if centred else [("middle", value - step, value + step)]
            yield Function("saturation", value, scale, searched=tuple(near))

    # --- quantities of the session --------------------------------------------------------------

    def _known(self, name: str) -> tuple[Quantity, ...]:
        """The quantity if it changed in this session; else an empty tuple."""
        quantity = Quantity(name)
        return (quantity,) if self._varies(quantity) else ()

    @property
    def _temperatures(self) -> tuple[Quantity, ...]:
        parts = (Quantity(TEMPERATURE, part=p) for p in self.evidence.at.temperature_parts)
        return tuple(q for q in parts if self._varies(q))

    def _varies(self, quantity: Quantity) -> bool:
        values = self._values(quantity)
        return bool(np.isfinite(values).all() and np.ptp(values) > _MOVED)

    def _changes(self, quantity: Quantity, target: Target) -> bool:
        """Whether the quantity changes at this target: an upright joint bears no weight."""
        places = quantity.places(self.signals.places, target, self._joints)
        here = max(_spread(column) for column in self.signals.rows[:, list(places)].T)
        return here > max(_MOVED, _SLIGHTLY * _spread(self._values(quantity)))

    def _range(self, quantity: Quantity) -> tuple[float, float]:
        values = self._values(quantity)
        return float(values.min()), float(values.max())

    def _values(self, quantity: Quantity) -> Array:
        """Values of a quantity at all samples, of all joints or dimensions that have it."""
        at = self.signals.places
        if quantity.name == TEMPERATURE:
            return self.evidence.at.of_part(quantity.part)
        if quantity.name in AXES:
            return self.signals.of("pose")[:, AXES.index(quantity.name)]
        if quantity.of_joints and quantity.ahead == 0 and quantity.name != TORQUE:
            return self.signals.of(quantity.signals[0]).ravel()
        if quantity.of_joints:
            every = np.stack([self.signals.of(name) for name in quantity.signals])
            return np.asarray(every.sum(axis=0).ravel())
        return self.signals.rows[:, at.slices[quantity.signals[0]]].ravel()

    # --- the machine ---------------------------------------------------------------------------

    @property
    def _pose_is_place(self) -> bool:
        """Whether the first three numbers of a pose are the platform's position."""
        pose = self.evidence.pose
        place = self.evidence.chain.mechanism.position(pose)
        return pose.shape[1] >= COORDINATES and bool(np.array_equal(place, pose[:, :3]))

    @property
    def _joints(self) -> int:
        return self.evidence.chain.mechanism.joints

    @property
    def _unit(self) -> str:
        return self.evidence.chain.mechanism.joint_unit

    @property
    def _size(self) -> float:
        return self.evidence.chain.mechanism.joint_size

    def _limb(self, joint: int) -> str:
        return f"{self.evidence.chain.mechanism.limb}_{joint + 1}"

    @cached_property
    def _shifts(self) -> list[Target]:
        """Shifts of the platform along each axis of the base, made by changes of dimensions."""
        turn = self._frame.rotation
        ways = [np.tile(turn[:, i], (len(self._still), 1)) for i in range(3)]
        return self._carried(ways, [f"d{a}" for a in AXES], "m", PLATFORM)

    @cached_property
    def _turns(self) -> list[Target]:
        """Turns about each axis through the base's origin, made by changes of dimensions."""
        frame, seen = self._frame, self.evidence.seen.reading[self._still]
        place = (seen - frame.translation) @ frame.rotation
        ways = [np.cross(axis, place) @ frame.rotation.T for axis in np.eye(3)]
        return self._carried(ways, [f"dturn_{a}" for a in AXES], "rad", BASE)

    @property
    def _frame(self) -> Frame:
        return self.evidence.chain.split(self.evidence.theta)[2]

    def _shows(self, dimension: int, tolerance: float) -> bool:
        """Whether the dimension, `_FARTHEST` tolerances off, moves readings by `TYPICAL_SHIFT`."""
        rows = self._still
        moved = self.evidence.metres(self.evidence.by_geometry[rows, :, dimension], rows)
        shift = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        return _FARTHEST * tolerance * shift > TYPICAL_SHIFT

    @cached_property
    def _still(self) -> NDArray[np.intp]:
        """Rows of the poses that are not set aside."""
        return np.flatnonzero(self.evidence.believed[: self.evidence.poses])

    def _carried(
        self, ways: Sequence[Array], names: Sequence[str], unit: str, part: str
    ) -> list[Target]:
        """Targets for displacements (n, 3) by changes of dimensions; none if one is impossible."""
        rows = self._still
        names_of = self.evidence.chain.mechanism.parameters.names
        ours = [i for i, n in enumerate(names_of) if n.startswith(("base", "hinge", "joint_zero"))]
        prior = self.evidence.chain.mechanism.parameters.prior
        slopes = self.evidence.by_geometry[rows, :3]
        targets = []
        for way, name in zip(ways, names, strict=True):
            wanted = np.einsum("nij,nj->ni", self.evidence.whiten[rows, :3, :3], way).ravel()
            found = None
            for chosen in (ours, list(range(len(names_of)))):
                if not chosen:
                    continue
                columns = (slopes[:, :, chosen] * prior[chosen]).reshape(len(wanted), -1)
                weights = np.linalg.lstsq(columns, wanted, rcond=1e-8)[0]
                weights[np.abs(weights) < _SMALL * np.abs(weights).max()] = 0.0
                if np.linalg.norm(columns @ weights - wanted) < _EXACT * np.linalg.norm(wanted):
                    found = [
                        (c, w * p) for c, w, p in zip(chosen, weights, prior[chosen], strict=True)
                    ]
                    break
            if found is None:
                return []
            own = tuple((int(c), float(w)) for c, w in found if w != 0.0)
            targets.append(Target(part, name, own, unit))
        return targets


def _spread(values: Array) -> float:
    """Range of a quantity where it is known: travel is not, before a joint's first reversal."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if known.size else 0.0
