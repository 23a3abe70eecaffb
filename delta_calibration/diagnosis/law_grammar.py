"""Which laws are tried on structure that no effect explains.

A law moves something (a joint behind its drive, a dimension, the base, the platform, the tracker's
readings) by a function of a quantity of the sample, times a second quantity or nothing. What did
not change in the session is in no law; nor is what the mechanism has no signal of. Orders,
thresholds and time constants are tried on grids and made finer in a fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
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
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_ORDERS = (1.0, 2.0, 4.0)  # of a wave over a turn of the joint
_SEARCHED_ORDERS = tuple(np.arange(3.0, 13.0, 1.0).tolist())  # and between those
_FINE_ORDERS = tuple(np.arange(13.0, 241.0, 2.0).tolist())  # of the joint's own gears
_THRESHOLDS = (0.15, 0.3, 0.45, 0.6, 0.75)  # quantiles of a quantity, where a function begins
_WIDTHS = (0.05, 0.15, 0.4)  # of a saturation, over the range of what it is of
_TIMES = (600.0, 1500.0, 4000.0)  # [s] of a settling
_FADES = (0.01, 0.05)  # [rad of a Delta] of travel after a turn
_BEARINGS = 8  # of half a circle
_WAVES = (4.0, 6.0, 8.0, 10.0)  # [rad/m] over the workspace
_EXACT = 0.02  # of a displacement that dimensions of the machine have to make to stand for it
_SMALL = 1e-3  # of the largest weight, under which a dimension takes no part
_FARTHEST = 50.0  # tolerances; a dimension that needs more to show carries no law
_COORDINATES = 3
_MOVED = 1e-9  # of its unit, that a quantity has to change by

PLATFORM, BASE, TRACKER = "platform", "base", "tracker"
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Function:
    """A function of a quantity in one shape."""

    name: str
    middle: float = 0.0
    scale: float = 1.0
    bearing: float = 0.0
    searched: tuple[tuple[str, float, float], ...] = ()


@dataclass(frozen=True)
class Grammar:
    """The laws that a session can tell."""

    robot: Robot
    evidence: LinearizedModel
    signals: Signals  # of the machine as it stands

    def laws(self) -> Iterator[FoundLaw]:
        """All of them; those of all joints or numbers together, and of each alone."""
        yield from self._drives()
        yield from self._dimensions()
        yield from self._bodies()
        yield from self._readings()

    # --- what they move ----------------------------------------------------------------------

    def _drives(self) -> Iterator[FoundLaw]:
        targets = [
            Target(self._limb(j), f"dq_{j + 1}", ((j, 1.0),), self._unit, j)
            for j in range(self._joints)
        ]
        for of, function, by in self._of_drives():
            yield from self._each(Stage.DRIVE, targets, of, function, by)

    def _dimensions(self) -> Iterator[FoundLaw]:
        """Dimensions of a kind in all limbs, and each; what zeros of joints do, drives do."""
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
        """The platform moved as a whole, along or about the base's axes."""
        moved = self._shifts
        if moved:
            for of, function, by in self._of_shifts():
                yield from self._each(Stage.STRUCTURE, moved, of, function, by)
        turned = self._turns
        if turned:
            for of, function, by in self._of_turns():
                yield from self._each(Stage.STRUCTURE, turned, of, function, by)

    def _readings(self) -> Iterator[FoundLaw]:
        """The tracker's readings, as they drift."""
        targets = [Target(TRACKER, f"d{a}_tracker", ((i, 1.0),), "m") for i, a in enumerate(_AXES)]
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
        yield law
        if len(targets) > 1:
            for target in targets:
                yield replace(law, targets=(target,))

    # --- what they are functions of ------------------------------------------------------------

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
            for f in self._begins(other):
                yield other, f, None
            yield angle, Function("line"), other
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
        """Of what is the same for the whole machine."""
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
        for axis in _AXES:
            place = Quantity(axis)
            for f in (Function("quadratic"), Function("cubic"), *self._waves(place)):
                yield place, f, None
            for by in (*self._known("payload"), *self._temperatures):
                for f in (Function("line"), Function("quadratic"), *self._waves(place)):
                    yield place, f, by

    def _of_turns(self) -> Iterator[tuple[Quantity, Function, Quantity | None]]:
        yield from ((of, f, by) for of, f, by in self._of_conditions() if of.name != "time")
        if not self._pose_is_place:
            return
        for axis in _AXES:
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
        """Waves of whole orders; of a slider there is no turn."""
        if self._unit != "rad":
            return ()
        return tuple(Function("wave", scale=order) for order in _ORDERS)

    def _orders(self, orders: Sequence[float], near: float = 1.0) -> tuple[Function, ...]:
        """Waves of any order, each searched as far as `near` to either side."""
        ends = ((n, (n - near) / self._size, (n + near) / self._size) for n in orders)
        return tuple(
            Function("wave", scale=n / self._size, searched=(("scale", low, high),))
            for n, low, high in ends
        )

    def _waves(self, place: Quantity) -> tuple[Function, ...]:
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
        """A kink at one of some places."""
        values = np.quantile(self._values(of), _THRESHOLDS)
        step = float(np.diff(values).max())
        for value in values.tolist():
            near = (("middle", value - step, value + step),)
            yield Function("beyond", value, searched=near)

    def _clips(self, of: Quantity) -> Iterator[Function]:
        """A ramp between two places: it begins at one, and is over at the other."""
        low, high = self._range(of)
        step = 0.2 * (high - low)
        for value, width in product(np.linspace(low, high, 6)[1:-2].tolist(), (0.2, 0.4)):
            scale = 1 / (width * (high - low))
            near = (("middle", value - step, value + step), ("scale", scale / 2, 2 * scale))
            yield Function("ramp", value, scale, searched=near)

    def _soft(self, of: Quantity, centred: bool = False) -> Iterator[Function]:
        """A saturation about some places, or about nothing, of some widths."""
        low, high = self._range(of)
        if high <= low:
            return
        values = [0.0] if centred else np.quantile(self._values(of), (0.3, 0.5, 0.7)).tolist()
        for value, width in product(values, _WIDTHS[:2]):
            scale, step = 1 / (width * (high - low)), 0.2 * (high - low)
            near = [("scale", scale / 3, 3 * scale)]
            near += [] if centred else [("middle", value - step, value + step)]
            yield Function("saturation", value, scale, searched=tuple(near))

    # --- what the session has of them -----------------------------------------------------------

    def _known(self, name: str) -> tuple[Quantity, ...]:
        """A quantity, if it changed in this session; nothing else."""
        quantity = Quantity(name)
        return (quantity,) if self._varies(quantity) else ()

    @property
    def _temperatures(self) -> tuple[Quantity, ...]:
        parts = (Quantity(TEMPERATURE, part=p) for p in self.evidence.at.temperature_parts)
        return tuple(q for q in parts if self._varies(q))

    def _varies(self, quantity: Quantity) -> bool:
        values = self._values(quantity)
        return bool(np.isfinite(values).all() and np.ptp(values) > _MOVED)

    def _range(self, quantity: Quantity) -> tuple[float, float]:
        values = self._values(quantity)
        return float(values.min()), float(values.max())

    def _values(self, quantity: Quantity) -> Array:
        """Of all joints that have it; loads of a dimension by those of all."""
        at = self.signals.places
        if quantity.name == TEMPERATURE:
            return self.evidence.at.of_part(quantity.part)
        if quantity.name in _AXES:
            return self.signals.of("pose")[:, _AXES.index(quantity.name)]
        if quantity.of_joints and quantity.ahead == 0 and quantity.name != TORQUE:
            return self.signals.of(quantity.signals[0]).ravel()
        if quantity.of_joints:
            every = np.stack([self.signals.of(name) for name in quantity.signals])
            return np.asarray(every.sum(axis=0).ravel())
        return self.signals.rows[:, at.slices[quantity.signals[0]]].ravel()

    # --- the machine ---------------------------------------------------------------------------

    @property
    def _pose_is_place(self) -> bool:
        """Whether a pose begins with the platform's place."""
        pose = self.evidence.pose
        place = self.evidence.chain.mechanism.position(pose)
        return pose.shape[1] >= _COORDINATES and bool(np.array_equal(place, pose[:, :3]))

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
        """The platform along each axis of the base, by dimensions that carry it there."""
        turn = self._frame.rotation
        ways = [np.tile(turn[:, i], (len(self._still), 1)) for i in range(3)]
        return self._carried(ways, [f"d{a}" for a in _AXES], "m", PLATFORM)

    @cached_property
    def _turns(self) -> list[Target]:
        """The same about each axis through the base's origin."""
        frame, seen = self._frame, self.evidence.seen.reading[self._still]
        place = (seen - frame.translation) @ frame.rotation
        ways = [np.cross(axis, place) @ frame.rotation.T for axis in np.eye(3)]
        return self._carried(ways, [f"dturn_{a}" for a in _AXES], "rad", BASE)

    @property
    def _frame(self) -> Frame:
        return self.evidence.chain.split(self.evidence.theta)[2]

    def _shows(self, dimension: int, tolerance: float) -> bool:
        """Whether a part so far off that nobody would mount it moves readings as a law does."""
        rows = self._still
        moved = self.evidence.metres(self.evidence.by_geometry[rows, :, dimension], rows)
        shift = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        return _FARTHEST * tolerance * shift > TYPICAL_SHIFT

    @cached_property
    def _still(self) -> NDArray[np.intp]:
        """Poses that count."""
        return np.flatnonzero(self.evidence.believed[: self.evidence.poses])

    def _carried(
        self, ways: Sequence[Array], names: Sequence[str], unit: str, part: str
    ) -> list[Target]:
        """Displacements (n, 3) that changes of the dimensions make; none where they cannot."""
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
