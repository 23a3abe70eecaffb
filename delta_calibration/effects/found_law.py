"""Law found in data without a known cause: functions of one or two quantities of a sample.

    dy_t = w_t sum_b v_tb f_b((u - middle) scale) (s - s_0)        for each target t

with y a joint angle, a dimension or a coordinate of the reading; u a quantity (joint angle, rate,
torque, payload, ...), f_b a few functions (`law_forms.py`), s an optional second quantity, and
w_t the weights with which the target's numbers move together. The laws that a diagnosis tries have
this form (`diagnosis/law_grammar.py`); an accepted one is stored as an effect of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from delta_calibration.effects import signals
from delta_calibration.effects.base import Array, Effect, Interval, Setting, Stage
from delta_calibration.effects.law_forms import ALONE, FORMS, FUNCTIONS
from delta_calibration.effects.remedy import COMPENSATE, Remedy
from delta_calibration.effects.signals import NOTHING, Places
from delta_calibration.effects.thermal_growth import REFERENCE
from delta_calibration.errors import InputError
from delta_calibration.lazy import cached_property
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model import symbols
from delta_calibration.model.symbols import Symbol, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import Robot

FOUND_LAW = "found_law"
ACROSS = "across"  # position along a bearing in the xy plane, from the two numbers x and y
FORCE, TORQUE, TEMPERATURE = "force", "torque", "temperature"

Taken = tuple[tuple[int, ...], tuple[float, ...]]  # signals and constants of a function
KINDS = {
    Stage.DRIVE: "drive",
    Stage.STRUCTURE: "structure",
    Stage.BASE: "structure",
    Stage.REFLECTOR: "measurement",
    Stage.MEASUREMENT: "measurement",
}
_QUANTITY = re.compile(r"(?P<name>[a-z]+)(?:\+(?P<ahead>\d{1,3}))?(?::(?P<part>\w+))?")

_OF_JOINTS: Mapping[str, tuple[str, ...]] = {
    "q": (signals.JOINT,),
    "rate": (signals.RATE,),
    "acceleration": (signals.ACCELERATION,),
    "direction": (signals.DIRECTION,),
    "travel": (signals.TRAVEL,),
    TORQUE: (signals.GRAVITY, signals.INERTIA),
}
_OF_ALL: Mapping[str, tuple[str, int]] = {
    "payload": (signals.PAYLOAD, 0),
    "time": (signals.TIME, 0),
    "x": (signals.POSE, 0),
    "y": (signals.POSE, 1),
    "z": (signals.POSE, 2),
}


def of_all(name: str) -> tuple[str, int]:
    """Signal of a quantity that the whole machine shares, and the index of its number."""
    return _OF_ALL[name]


@dataclass(frozen=True)
class Quantity:
    """A quantity of a sample.

    Attributes:
        name: name of the quantity, without the number of a joint.
        ahead: for a joint's quantity, the offset from the target's own joint to that joint.
        part: for a temperature, the part of the machine.
    """

    name: str
    ahead: int = 0
    part: str = ""

    @property
    def of_joints(self) -> bool:
        """Whether each joint has its own."""
        return self.name in _OF_JOINTS

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that the quantity is computed from."""
        if self.of_joints:
            return _OF_JOINTS[self.name]
        if self.name == ACROSS:
            return (signals.POSE,)
        own = {FORCE: signals.LOAD, TEMPERATURE: signals.TEMPERATURE}
        return (own.get(self.name) or _OF_ALL[self.name][0],)

    @property
    def middle(self) -> float:
        """Value at which the quantity counts as zero."""
        return REFERENCE if self.name == TEMPERATURE else 0.0

    def number(self, joint: int, joints: int) -> int:
        """Index of the quantity's joint, from 0, for the index of the target's joint."""
        return (joint + self.ahead) % joints

    def places(self, at: Places, target: Target, joints: int) -> tuple[int, int]:
        """Indices of its one or two numbers in a sample's row of signals."""
        nothing = at.begin(NOTHING)
        if self.of_joints:
            here = self.number(target.joint, joints)
            own = [at.begin(name) + here for name in self.signals]
            return (own[0], own[1]) if len(own) > 1 else (own[0], nothing)
        if self.name == ACROSS:
            return at.begin(signals.POSE), at.begin(signals.POSE) + 1
        if self.name == FORCE:
            return at.begin(signals.LOAD) + target.rows[0][0], nothing
        if self.name == TEMPERATURE:
            return at.temperature(self.part), nothing
        name, number = _OF_ALL[self.name]
        return at.begin(name) + number, nothing


@dataclass(frozen=True)
class Target:
    """Target of one equation: numbers of the stage that move together.

    Attributes:
        part: part of the machine.
        moved: symbol of the moved quantity in the equation.
        rows: indices of the numbers in the stage, each with its weight.
        unit: unit of the moved quantity.
        joint: index of the joint whose quantities the equation takes, from 0.
    """

    part: str
    moved: str
    rows: tuple[tuple[int, float], ...]
    unit: str
    joint: int = 0

    @property
    def tag(self) -> str:
        """Suffix that distinguishes its values from those of other targets: 1, x, dx."""
        last = self.moved.rsplit("_", 1)[-1]
        return self.moved.removeprefix("d").split("_")[0] if last == "tracker" else last


@dataclass(frozen=True)
class FoundLaw(Effect):
    """One law at several targets; each target has its own value for each function."""

    cause: ClassVar[str] = FOUND_LAW
    called: ClassVar[str] = "law without a name"
    remedy: ClassVar[Remedy] = Remedy(
        COMPENSATE,
        "machine",
        "compensate with the law, within the measured range",
        "make the measurement that distinguishes it from its rival",
    )

    on: Stage = Stage.DRIVE
    targets: tuple[Target, ...] = ()
    of: Quantity = Quantity("q")
    function: str = "line"
    by: Quantity | None = None
    middle: float = 0.0
    scale: float = 1.0
    bearing: float = 0.0  # [rad] of `ACROSS`
    typical: tuple[float, ...] = ()  # expected size of each value, in its unit; 1 if not given
    searched: tuple[Interval, ...] = ()  # searched fields, with their intervals

    @property
    def stage(self) -> Stage:  # type: ignore[override]
        """Stage at which the law adds."""
        return self.on

    @property
    def kind(self) -> str:  # type: ignore[override]
        """Kind of the effect, as reported."""
        return KINDS[self.on]

    @property
    def settings(self) -> dict[str, Setting]:
        """Settings as stored in a calibration file; the searched intervals are not stored."""
        targets = (
            f"{t.part} {t.moved} {t.unit} {t.joint} "
            + " ".join(f"{row}:{share!r}" for row, share in t.rows)
            for t in self.targets
        )
        return {
            "on": self.on.name.lower(),
            "targets": "; ".join(targets),
            "of": _said(self.of),
            "function": self.function,
            "by": _said(self.by),
            "middle": self.middle,
            "scale": self.scale,
            "bearing": self.bearing,
            "typical": self.typical,
        }

    @classmethod
    def shaped(
        cls, robot: Robot, mechanism: Mechanism, settings: Mapping[str, Setting]
    ) -> FoundLaw:
        """Create the law from the settings of a file.

        Raises:
            InputError: a setting does not have its form.
        """
        shape: dict[str, Any] = dict(settings)
        on = str(shape.get("on", "drive"))
        if on.upper() not in Stage.__members__:
            allowed = ", ".join(name.lower() for name in Stage.__members__)
            raise InputError(f"on: {on!r} is not allowed; one of {allowed}")
        shape["on"] = Stage[on.upper()]
        shape["of"] = _quantity(str(shape.get("of", "q")), "of")
        by = str(shape.get("by", ""))
        shape["by"] = _quantity(by, "by") if by else None
        texts = [text for text in str(shape.get("targets", "")).split(";") if text.strip()]
        shape["targets"] = tuple(_target(text) for text in texts)
        return cls(robot, mechanism, **shape)

    def wrong(self) -> str:
        """Check that function, numbers, rows and joints exist on this mechanism."""
        if self.function not in FUNCTIONS:
            return f"function: {self.function!r} is not allowed; one of {', '.join(FUNCTIONS)}"
        if ALONE in self.kinds and self.by is None:
            return f"by: {self.function!r} needs a second quantity"
        if self.by is not None and self.by.name in (TORQUE, ACROSS):
            return f"by: {self.by.name!r} is not allowed; a quantity of one number is expected"
        if "" in self.sensors:
            return f"{TEMPERATURE!r} is not allowed; the part is expected: {TEMPERATURE}:arm"
        numbers = (self.middle, self.scale, self.bearing, *self.typical)
        if not np.isfinite(numbers).all() or any(size <= 0 for size in self.typical):
            return "middle, scale, bearing, typical: finite numbers are expected"
        if self.typical and len(self.typical) != len(self.targets) * len(self.kinds):
            return f"typical: {len(self.typical)} numbers; one for each value is expected"
        for target in self.targets:
            rows = [row for row, _ in target.rows]
            if not rows or not all(0 <= row < self.stage_size for row in rows):
                return f"targets: {rows} is not allowed; numbers 0 to {self.stage_size - 1}"
            if not 0 <= target.joint < self.mechanism.joints:
                return (
                    f"targets: joint {target.joint}; 0 to {self.mechanism.joints - 1} is allowed"
                )
        return ""

    @property
    def bound_to_session(self) -> bool:
        """Whether the law takes time, the clock of its session."""
        return "time" in (self.of.name, "" if self.by is None else self.by.name)

    @property
    def kinds(self) -> tuple[int, ...]:
        """Functions for each of which a target has a value."""
        return FUNCTIONS[self.function]

    @property
    def parameters(self) -> ParameterSet:
        """A value for each target and function."""
        return self._parameters

    @cached_property
    def _parameters(self) -> ParameterSet:
        count = len(self.targets) * len(self.kinds)
        sizes = self.typical or (1.0,) * count
        letters = "abcdefgh"
        limb = self.mechanism.limb
        items = []
        for t, target in enumerate(self.targets):
            where = target.part if target.part.startswith(f"{limb}_") else None
            for i, kind in enumerate(self.kinds):
                name = f"{letters[i]}_{target.tag}"
                size = sizes[t * len(self.kinds) + i]
                unit = self.value_unit(target, kind)
                items.append(Parameter(name, unit, 0.0, size, FOUND_LAW, where))
        return ParameterSet(tuple(items))

    def value_unit(self, target: Target, kind: int) -> str:
        """Unit of a value: unit of the moved quantity over those of the law's quantities."""
        below = [(self.unit_of_quantity(self.of), FORMS[kind].power)]
        if self.by is not None and kind != ALONE:
            below.append((self.unit_of_quantity(self.by), 1))
        return _over(target.unit, below)

    def unit_of_quantity(self, quantity: Quantity) -> str:
        """Unit of a quantity on this mechanism; empty if it has none."""
        joint = self.mechanism.joint_unit
        return {
            "q": joint,
            "rate": f"{joint}/s",
            "acceleration": f"{joint}/s^2",
            "travel": joint,
            "direction": "",
            TORQUE: "N m" if joint == "rad" else "N",
            FORCE: "N" if self.targets[0].unit == "m" else "N m",
            "payload": "kg",
            "time": "s",
            TEMPERATURE: "K",
        }.get(quantity.name, "m")

    def intervals(self) -> tuple[Interval, ...]:
        """Searched fields, with intervals between neighbouring points of the search."""
        return self.searched

    @property
    def takes(self) -> tuple[str, ...]:
        """Signals of both quantities."""
        both = self.of.signals + (() if self.by is None else self.by.signals)
        return tuple(dict.fromkeys((*both, NOTHING)))

    @property
    def needs(self) -> tuple[str, ...]:
        """Payload, for loads too; direction and temperature, if the law takes them."""
        names = {self.of.name, "" if self.by is None else self.by.name}
        loads = ("payload",) if names & {"payload", TORQUE, FORCE} else ()
        return loads + tuple(name for name in ("direction", TEMPERATURE) if name in names)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Parts whose temperatures the law takes."""
        both = (q for q in (self.of, self.by) if q is not None and q.name == TEMPERATURE)
        return tuple(dict.fromkeys(quantity.part for quantity in both))

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """w v f((u - middle) scale) (s - s_0); without the last factor if c[5] is 0."""
        u = _of(s, c)
        f = 0.0
        for kind, form in FORMS.items():
            f = f + where(c[2] == kind, form.of(u, symbols), 0.0)
        return v[0] * c[7] * f * where(c[5] > 0, s[2] - c[6], 1.0)

    def terms(self, places: Places) -> Iterator[Term]:
        """One term for each value and each number that it moves."""
        for t, target in enumerate(self.targets):
            for i, kind in enumerate(self.kinds):
                taken, constants = self.factor(places, target, kind)
                for row, weight in target.rows:
                    value = t * len(self.kinds) + i
                    yield Term(taken, (value,), (row,), (*constants, weight))

    def factor(self, places: Places, target: Target, kind: int) -> Taken:
        """Signals and constants of one function at a target, without the row's weight."""
        joints = self.mechanism.joints
        first = self.of.places(places, target, joints)
        weights = (1.0, float(len(self.of.signals) > 1))
        if self.of.name == ACROSS:
            weights = float(np.cos(self.bearing)), float(np.sin(self.bearing))
        if self.by is None or kind == ALONE:
            second, offset, counts = places.begin(NOTHING), 0.0, 0.0
        else:
            second = self.by.places(places, target, joints)[0]
            offset, counts = self.by.middle, 1.0
        middle = self.middle + self.of.middle
        return (*first, second), (*weights, float(kind), middle, self.scale, counts, offset)


def function_of(taken: Taken, rows: Array) -> Array:
    """One function at each sample, (n,), by numpy: a search needs thousands, each only once.

    Args:
        taken: result of `FoundLaw.factor`.
        rows: signals of the samples, (S, n).
    """
    (first, other, second), c = taken
    f = FORMS[int(c[2])].of(_of((rows[first], rows[other]), c), np)
    return np.asarray(f * (rows[second] - c[6]) if c[5] > 0 else f)


def _of(s: Any, c: Any) -> Any:
    """Scaled quantity (u - middle) scale."""
    return (c[0] * s[0] + c[1] * s[1] - c[3]) * c[4]


def _said(quantity: Quantity | None) -> str:
    """Text of a quantity in a file: `torque`, `q+1`, `temperature:base`; empty for None."""
    if quantity is None:
        return ""
    ahead = f"+{quantity.ahead}" if quantity.ahead else ""
    return f"{quantity.name}{ahead}" + (f":{quantity.part}" if quantity.part else "")


def _quantity(text: str, setting: str) -> Quantity:
    found = _QUANTITY.fullmatch(text)
    known = (*_OF_JOINTS, *_OF_ALL, ACROSS, FORCE, TEMPERATURE)
    if found is None or found["name"] not in known:
        raise InputError(f"{setting}: {text!r} is not allowed; one of {', '.join(known)}")
    return Quantity(found["name"], int(found["ahead"] or 0), found["part"] or "")


def _target(text: str) -> Target:
    """Parse a target from `part moved unit joint row:share row:share ...`."""
    try:
        part, moved, unit, joint, *rows = text.split()
        pairs = [row.split(":") for row in rows]
        shares = tuple((int(row), float(share)) for row, share in pairs)
        return Target(part, moved, shares, unit, int(joint))
    except ValueError as error:
        raise InputError(
            f"targets: {text!r} is not allowed; part, what is moved, its unit, a joint's number "
            "and row:share of each number of the stage are expected"
        ) from error


def _over(unit: str, below: list[tuple[str, int]]) -> str:
    """A unit over powers of others: "rad/kg", "1/rad", "m/(N m)^2"; equal ones are cancelled."""
    powers: dict[str, int] = {}
    for name, power in below:
        powers[name] = powers.get(name, 0) + power
    above = unit
    if powers.get(unit, 0) > 0:
        above, powers[unit] = "1", powers[unit] - 1
    parts = []
    for name, power in powers.items():
        if name and power:
            whole = f"({name})" if " " in name or "/" in name else name
            parts.append(whole if power == 1 else f"{whole}^{power}")
    if not parts:
        return above
    under = parts[0] if len(parts) == 1 else f"({' '.join(parts)})"
    return f"{above}/{under}"
