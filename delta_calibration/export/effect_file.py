"""Write a law that a diagnosis found as a Python file of a new effect, for the entry-point group.

The file has the form that the tutorial on effects writes by hand: stage and signals of the law,
its values with their typical sizes, and its shape with the bounds it was searched in. Once the
file is installed, simulator, fit, diagnosis and nodes use it like any other effect.
"""

from __future__ import annotations

import keyword
from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

from delta_calibration.diagnosis.law_search import Guess
from delta_calibration.diagnosis.law_words import equation
from delta_calibration.effects import EFFECTS
from delta_calibration.effects.found_law import (
    ACROSS,
    FORCE,
    TEMPERATURE,
    FoundLaw,
    Quantity,
    of_all,
)
from delta_calibration.effects.law_forms import ALONE, FORMS
from delta_calibration.effects.signals import NOTHING
from delta_calibration.errors import InputError

_FUNCTIONS = ("absolute", "cos", "exp", "maximum", "minimum", "sign", "sin", "tanh")
_PROJECT = """[project]
name = "{package}"
version = "1.0"
dependencies = ["delta_calibration"]

[project.entry-points."delta_calibration.effects"]
{cause} = "{cause}:{name}"

[tool.setuptools]
py-modules = ["{cause}"]
"""
_FILE = '''"""{title}

{equations}

{seen}
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import cos as cosine
from math import sin as sine
from typing import ClassVar

from delta_calibration.effects.base import Effect, Interval, Stage
from delta_calibration.effects.signals import Places
from delta_calibration.model.symbols import {functions}
from delta_calibration.model.terms import Term
from delta_calibration.parameters import Parameter, ParameterSet

# name of a value, its unit, its typical size, where it is
VALUES = (
{values}
)
# of each number that is moved: which, how much of it, its values, joint of its signals, its shape
MOVED = (
{moved}
)


@dataclass(frozen=True)
class {name}(Effect):
    """{title}"""

    cause: ClassVar[str] = "{cause}"
    kind: ClassVar[str] = "{kind}"
    stage: ClassVar[Stage] = Stage.{stage}
    needs: ClassVar[tuple[str, ...]] = {needs}
    takes: ClassVar[tuple[str, ...]] = {takes}
    sensors: ClassVar[tuple[str, ...]] = {sensors}
    told: ClassVar[Mapping[str, tuple[str, str]]] = {told}

{fields}
    @property
    def suits(self) -> bool:
        """It was found on a machine of this kind."""
        return self.mechanism.name == "{mechanism}"

    @property
    def parameters(self) -> ParameterSet:
        """Its values, about zero."""
        return ParameterSet(
            tuple(Parameter(n, unit, 0.0, size, self.cause, at) for n, unit, size, at in VALUES)
        )

    def intervals(self) -> tuple[Interval, ...]:
        """Where its shape was searched."""
        return {intervals}

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """What one term adds to its stage."""
        u = ({argument} - c[0]) * c[1]
        return c[2] * ({sum})

    def terms(self, places: Places) -> Iterator[Term]:
        """One for each number that is moved."""
        shapes = {shapes}
        for row, share, values, joint, shape in MOVED:
            middle, scale, bearing = shapes[shape]
            yield Term(
                {signals},
                values,
                (row,),
                (middle, scale, share, cosine(bearing), sine(bearing)),
            )
'''


def effect_file(guess: Guess, cause: str, seen: str) -> str:
    """Text of the effect's Python file.

    Args:
        guess: the found law with its shape.
        cause: name of the effect, which is the file name without suffix.
        seen: sentence that says where the law was found.
    """
    parts, first = guess.with_sizes(), guess.parts[0]
    title = f"Found in a session: {spoken_law(guess)}."
    text = _FILE.format(
        title="\n".join(wrap(title, 98)),
        equations="\n".join(f"    {line}" for line in equations(guess)),
        seen="\n".join(wrap(seen, 98)),
        functions=", ".join(("Symbol", *_used(first))),
        values="\n".join(_values(parts)),
        moved="\n".join(_moved(parts)),
        name=class_name(cause),
        cause=cause,
        kind=first.kind,
        stage=first.stage.name,
        needs=repr(first.needs),
        sensors=repr(first.sensors),
        takes=_items([repr(name) for name in first.takes if name != NOTHING], 4),
        told=_told(parts),
        fields=_fields(parts),
        mechanism=first.mechanism.name,
        intervals=_intervals(parts),
        argument=_argument(first.of),
        sum=_sum(first),
        shapes=_shapes(parts),
        signals=_signals(first),
    )
    return text


def project_file(cause: str) -> str:
    """Text of the `pyproject.toml` that registers the effect."""
    return _PROJECT.format(package=cause.replace("_", "-"), cause=cause, name=class_name(cause))


def equations(guess: Guess) -> list[str]:
    """Equation of each number that the law changes."""
    apart = len(guess.parts) > 1
    return [equation(law, target, apart) for law in guess.parts for target in law.targets]


def spoken_law(guess: Guess) -> str:
    """Function, quantities and kind of the law, in words."""
    law = guess.parts[0]
    by = [quantity.name for quantity in (law.of, law.by) if quantity is not None]
    return f"{law.function} of {' and '.join(by)}, in the {law.kind}"


def class_name(cause: str) -> str:
    """Class name of an effect: its cause in capitalised words."""
    return "".join(word.capitalize() for word in cause.split("_") if word)


def require_effect_name(path: Path) -> None:
    """Refuse a file name that cannot be that of a new effect.

    Raises:
        InputError: it is not a valid module name, or is the name of an existing effect.
    """
    cause = path.stem
    good = cause.isidentifier() and not keyword.iskeyword(cause) and cause.islower()
    if path.suffix != ".py" or not good:
        raise InputError(
            f"{path}: not a name for an effect's file; small letters, digits and _ with .py are "
            "allowed"
        )
    if cause in EFFECTS:
        raise InputError(f"{path}: there is an effect {cause!r}; choose another name")


def _used(law: FoundLaw) -> list[str]:
    words = " ".join(FORMS[kind].coded for kind in law.kinds)
    return [name for name in _FUNCTIONS if f"{name}(" in words]


def _values(parts: Sequence[FoundLaw]) -> list[str]:
    items = [p for part in parts for p in part.parameters]
    return [f"    ({p.name!r}, {p.unit!r}, {p.prior:.3g}, {p.location!r})," for p in items]


def _moved(parts: Sequence[FoundLaw]) -> list[str]:
    lines, value = [], 0
    for shape, law in enumerate(parts):
        for target in law.targets:
            own = tuple(range(value, value + len(law.kinds)))
            value += len(law.kinds)
            for row, share in target.rows:
                lines.append(f"    ({row}, {share!r}, {own}, {target.joint}, {shape}),")
    return lines


def _searched(parts: Sequence[FoundLaw]) -> list[tuple[str, str, FoundLaw, float, float]]:
    """Searched shape values: field name in the file, field name in the law, law, and bounds."""
    found = []
    for number, law in enumerate(parts, start=1):
        tag = f"_{number}" if len(parts) > 1 else ""
        found += [(f"{name}{tag}", name, law, low, high) for name, low, high in law.searched]
    return found


def _told(parts: Sequence[FoundLaw]) -> str:
    unit = parts[0].unit_of_quantity(parts[0].of)
    units = {"middle": unit, "scale": f"1/{unit}" if unit else "1", "bearing": "rad"}
    items = [f"{own!r}: ({own!r}, {units[name]!r})" for own, name, *_ in _searched(parts)]
    return _items(items, 4, "{}")


def _items(items: Sequence[str], depth: int, brackets: str = "()") -> str:
    """Print a collection, one item per line; `depth` is the indent of the line it begins in."""
    begin, end = brackets[0], brackets[1]
    lines = "".join(f"{' ' * (depth + 4)}{item},\n" for item in items)
    return f"{begin}\n{lines}{' ' * depth}{end}" if items else brackets


def _fields(parts: Sequence[FoundLaw]) -> str:
    lines = [
        f"    {own}: float = {getattr(law, name)!r}" for own, name, law, *_ in _searched(parts)
    ]
    return "".join(f"{line}\n" for line in lines)


def _intervals(parts: Sequence[FoundLaw]) -> str:
    items = [f"({own!r}, {low!r}, {high!r})" for own, _, _, low, high in _searched(parts)]
    return _items(items, 8)


def _shapes(parts: Sequence[FoundLaw]) -> str:
    searched = {(id(law), name): own for own, name, law, *_ in _searched(parts)}

    def value(law: FoundLaw, name: str) -> str:
        own = searched.get((id(law), name))
        plain = repr(getattr(law, name)) if own is None else f"self.{own}"
        offset = law.of.middle if name == "middle" else 0.0
        return f"{plain} + {offset!r}" if offset else plain

    each = [
        f"({', '.join(value(law, name) for name in ('middle', 'scale', 'bearing'))})"
        for law in parts
    ]
    return _items(each, 8)


def _argument(of: Quantity) -> str:
    if of.name == ACROSS:
        return "c[3] * s[0] + c[4] * s[1]"
    return "s[0] + s[1]" if len(of.signals) > 1 else "s[0]"


def _sum(law: FoundLaw) -> str:
    """The law's functions, each with its value and the second quantity if it has one."""
    second = _second(law)
    return " + ".join(
        f"v[{i}] * {FORMS[kind].coded}" + ("" if kind == ALONE else second)
        for i, kind in enumerate(law.kinds)
    )


def _second(law: FoundLaw) -> str:
    if law.by is None:
        return ""
    at = 2 if law.of.name == ACROSS or len(law.of.signals) > 1 else 1
    own = f"s[{at}]"
    return f" * ({own} - {law.by.middle!r})" if law.by.middle else f" * {own}"


def _signals(law: FoundLaw) -> str:
    places = [_places(law.of, law)]
    if law.by is not None:
        places.append(_places(law.by, law))
    return f"({', '.join(places)},)"


def _places(quantity: Quantity, law: FoundLaw) -> str:
    if quantity.of_joints:
        joints = law.mechanism.joints
        at = f"(joint + {quantity.ahead}) % {joints}" if quantity.ahead else "joint"
        return ", ".join(f'places.begin("{name}") + {at}' for name in quantity.signals)
    if quantity.name == ACROSS:
        return 'places.begin("pose"), places.begin("pose") + 1'
    if quantity.name == FORCE:
        return 'places.begin("load") + row'
    if quantity.name == TEMPERATURE:
        return f'places.temperature("{quantity.part}")'
    name, number = of_all(quantity.name)
    return f'places.begin("{name}") + {number}' if number else f'places.begin("{name}")'
