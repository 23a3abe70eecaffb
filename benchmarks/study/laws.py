"""Compares the law that a diagnosis reports for an unknown structure with what was hidden.

A law is one of `unknown_structure.laws`: a dictionary with `stage, part, variables, equation,
values`. The first one, which is the most probable, is evaluated.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.truth import DRIVE, Truth
from study.equation import Equation, EquationError, equations

Array = NDArray[np.float64]
Said = Mapping[str, Any]

_DRAWN = 4000  # number of input samples
_FORM = 0.95  # smallest R^2 of a right form
_STRAIGHT = 0.05  # largest share of variance off the best straight line of a straight law
_MOST = 0.5  # largest share of a shift that the equations may miss
# Ranges in a rich session of the blind generator, by the first word of a variable.
RANGES: dict[str, tuple[float, float] | tuple[str, tuple[float, ...]]] = {
    "q": (-0.5, 1.13),  # [rad]
    "rate": (-1.0, 1.0),  # [rad/s]
    "acceleration": (-5.0, 5.0),  # [rad/s^2]
    "direction": ("one of", (-1.0, 1.0)),
    "travel": (0.0, 0.6),  # [rad]
    "torque": (-13.0, 2.0),  # [N m]
    "force": (-15.0, 25.0),  # [N]
    "payload": ("one of", (0.0, 2.0)),  # [kg]
    "temperature": (20.0, 33.0),  # [deg C]
    "time": (0.0, 7500.0),  # [s]
    "x": (-0.4, 0.4),  # [m]
    "y": (-0.4, 0.4),
    "z": (-0.86, -0.62),
    "tilt": (0.0, 0.004),  # [rad]
    "speed": (0.0, 0.5),  # [m/s]
}
_NARROW = {"temperature_base": (20.0, 23.4), "temperature_forearm": (20.0, 28.0)}
_JOINTS = ("q", "rate", "acceleration", "direction", "travel", "torque")
_ROD = re.compile(r"force_([1-6])")  # rods by number: 1a, 1b, 2a, ...
# Names of parts, in the order in which they are tried.
_CALLED = {
    "rod": r"rod|forearm",
    "arm": r"arm",
    "hinge": r"hinge",
    "joint": r"joint|drive|gear|motor",
    "base": r"base|frame|foundation|mount",
    "platform": r"platform|tool|flange",
    "tracker": r"tracker|reflector|reading|measurement",
}


def judge_law(
    truth: Truth | None, laws: Sequence[Said], ranges: Mapping[str, Any] = RANGES
) -> dict[str, Any]:
    """Determine which parts of the most probable law are right; ready for JSON.

    A form is right if its equations agree with the true ones, up to a factor, over inputs drawn at
    random: R^2 > 0.95 after subtracting what is linear in the variables from both, or without
    subtraction if the true law is linear itself. A law of the drives is compared joint by joint.
    For laws of lengths and places the directions are not compared, because frames differ.

    Args:
        truth: of what is hidden; None if nothing is.
        laws: most probable first; may be empty.
        ranges: of the inputs, by the first word of a variable.

    Returns:
        `said`: whether there is a law; `stage`, `part`, `variables`, `form`: whether each is right
        (`form` is None where the truth has none); `right`: all of them; `r2` of the form;
        `problem` of an equation that cannot be read.
    """
    if not laws or truth is None:
        wrong = dict.fromkeys(("stage", "part", "variables", "form", "right"), False)
        return {"said": bool(laws), **wrong, "r2": None, "problem": ""}
    said = _of_all_limbs(laws)
    every = [_held_against(one, said, ranges) for one in truth.fair]
    keys = ("right", "variables", "form", "stage", "part")
    return max(every, key=lambda one: [bool(one[key]) for key in keys])


def _of_all_limbs(laws: Sequence[Said]) -> Said:
    """The most probable law for all limbs: a verdict lists it for each joint, arm or rod moved."""
    first = laws[0]
    by_part = {law["part"]: law for law in reversed(laws) if _same(law, first)}
    alike = list(reversed(by_part.values()))
    if len(alike) == 1:
        return first
    kind = str(first["part"]).partition("_")[0]
    return {
        **first,
        "part": f"{kind}s",
        "equation": "; ".join(str(law["equation"]) for law in alike),
        "variables": [name for law in alike for name in law["variables"]],
        "values": {name: value for law in alike for name, value in law["values"].items()},
    }


def _same(law: Said, first: Said) -> bool:
    """Whether it is the same law of another limb: same probability, stage and kind of part."""
    kinds = [re.sub(r"_?\d+[ab]?$", "", str(one["part"])) for one in (law, first)]
    return kinds[0] == kinds[1] and all(
        law.get(key) == first.get(key) for key in ("stage", "probability")
    )


def _held_against(truth: Truth, said: Said, ranges: Mapping[str, Any]) -> dict[str, Any]:
    problem, r2, law = "", None, None
    try:
        law = _law(said)
        r2 = None if truth.law is None else _agreement(truth, law, _Drawn(ranges))
    except EquationError as error:
        problem = str(error)
    form = None if truth.form is None or truth.law is None else r2 is not None and r2 > _FORM
    result = {
        "stage": said.get("stage") in truth.stages,
        "part": law is not None and _part_is_right(truth, said, law),
        "variables": law is not None and _variables(law, said) == truth.variables,
        "form": form,
    }
    right = all(value is not False for value in result.values())
    return {"said": True, **result, "right": right, "r2": r2, "problem": problem}


@dataclass(frozen=True)
class _Law:
    equations: tuple[Equation, ...]
    values: Mapping[str, float]

    def of(self, seen: Mapping[str, Array]) -> dict[str, Array]:
        """Values of its left sides; several equations of the same left side are summed."""
        known = _Known(self.values, seen)
        shape = next(iter(seen.values())).shape if seen else (_DRAWN,)
        result: dict[str, Array] = {}
        for equation in self.equations:
            column = np.broadcast_to(equation.of(known), shape)
            result[equation.left] = result.get(equation.left, 0.0) + column
        return result

    def variables(self, equation: Equation) -> set[str]:
        """Names in an equation that are not values of the law."""
        return {name for name in equation.names if _value_of(self.values, name) is None}


def _law(said: Said) -> _Law:
    """The equations of a law; one written for joint j or rod i is repeated for all of them."""
    text = str(said.get("equation", ""))
    if re.search(r"_j\b", text.partition("=")[0]):
        text = "; ".join(re.sub(r"_j\b", f"_{joint}", text) for joint in (1, 2, 3))
    if re.search(r"_i\b", text.partition("=")[0]):
        text = "; ".join(re.sub(r"_i\b", f"_{rod}", text) for rod in range(1, 7))
    given = said.get("values") or {}
    values = {
        name: float(one["value"] if isinstance(one, Mapping) else one)
        for name, one in given.items()
    }
    return _Law(equations(text), values)


def _value_of(values: Mapping[str, float], name: str) -> float | None:
    """Value by its name, or by the general name for all joints or rods."""
    general = (re.sub(r"_\d$", end, name) for end in ("_j", "_i"))
    return next((values[n] for n in (name, *general) if n in values), None)


class _Known(Mapping[str, Array]):
    """Values of the law; inputs where it has no value."""

    def __init__(self, values: Mapping[str, float], seen: Mapping[str, Array]) -> None:
        self._values, self._seen = values, seen

    def __getitem__(self, name: str) -> Array:
        value = _value_of(self._values, name)
        return self._seen[name] if value is None else np.asarray(value)

    def __contains__(self, name: object) -> bool:
        return _value_of(self._values, str(name)) is not None or name in self._seen

    def __iter__(self) -> Iterator[str]:
        yield from (*self._values, *self._seen)

    def __len__(self) -> int:
        return len(self._values) + len(self._seen)


class _Drawn(Mapping[str, Array]):
    """Random inputs, drawn when first used and seeded by their name, independent of the order."""

    def __init__(self, ranges: Mapping[str, Any]) -> None:
        self._ranges = ranges
        self.known: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        name = (
            _ROD.sub(lambda m: f"force_{_rod(int(m[1]))}", name) if _ROD.fullmatch(name) else name
        )
        if name not in self.known:
            rng = np.random.default_rng(zlib.crc32(name.encode()))
            low, high = _NARROW.get(name) or self._ranges[name.partition("_")[0]]
            drawn = rng.choice(high, _DRAWN) if low == "one of" else rng.uniform(low, high, _DRAWN)
            self.known[name] = drawn
        return self.known[name]

    def __contains__(self, name: object) -> bool:
        word, _, which = str(name).partition("_")
        if word in _JOINTS:
            return which in ("1", "2", "3")
        if word == "force":
            return bool(re.fullmatch(r"[1-6]|[123][ab]", which))
        return word in self._ranges and (word == "temperature") == bool(which)

    def __iter__(self) -> Iterator[str]:
        yield from self.known

    def __len__(self) -> int:
        return len(self.known)


def _rod(number: int) -> str:
    return f"{(number + 1) // 2}{'ba'[number % 2]}"


def _agreement(truth: Truth, law: _Law, drawn: _Drawn) -> float:
    """R^2 between the true and the reported equations."""
    assert truth.law is not None
    true = truth.law(drawn)
    said = law.of(drawn)
    if not all(np.isfinite(column).all() for column in said.values()):
        raise EquationError("not a number, or without end, within the session's range")
    inputs = list(drawn.known.values())
    straight = np.stack([np.ones(_DRAWN), *inputs], axis=1)
    level = straight[:, :1]
    wanted = np.stack(list(true.values()), axis=1)
    bent, whole = _off(wanted, straight), _off(wanted, level)
    off = straight if np.sum(bent**2) > _STRAIGHT * np.sum(whole**2) else level
    true = {name: _off(column[:, None], off)[:, 0] for name, column in true.items()}
    said = {name: _off(column[:, None], off)[:, 0] for name, column in said.items()}
    return _by_joint(true, said) if DRIVE in truth.stages else _by_span(true, said)


def _off(columns: Array, straight: Array) -> Array:
    """Residuals of the best fit of some columns to others."""
    fitted = np.linalg.lstsq(straight, columns, rcond=None)[0]
    return np.asarray(columns - straight @ fitted)


def _by_joint(true: Mapping[str, Array], said: Mapping[str, Array]) -> float:
    """R^2 of each joint's own equation, weighted by the size of the true one."""
    by_joint = {left[-1]: column for left, column in said.items()}
    if len(true) == len(said) == 1:  # of one joint, whatever its name
        by_joint = dict(zip((name[-1] for name in true), said.values(), strict=True))
    explained = whole = 0.0
    for name, column in true.items():
        size = float(column @ column)
        other = by_joint.get(name[-1], np.zeros_like(column))
        alike = float(column @ other) ** 2 / max(float(other @ other), 1e-300)
        explained, whole = explained + alike, whole + size
    return explained / max(whole, 1e-300)


def _by_span(true: Mapping[str, Array], said: Mapping[str, Array]) -> float:
    """Share of the reported law in the span of the true one; 0 if most of a shift is missed."""
    wanted, given = (np.stack(list(columns.values()), axis=1) for columns in (true, said))
    scale = np.abs(wanted).max(), np.abs(given).max()
    if min(scale) < 1e-15:
        return 0.0
    wanted, given = wanted / scale[0], given / scale[1]
    within = 1 - float(np.sum(_off(given, wanted) ** 2) / np.sum(given**2))
    missed = float(np.sum(_off(wanted, given) ** 2) / np.sum(wanted**2))
    shift = set(true) <= {"dx", "dy", "dz"}
    return 0.0 if shift and missed > _MOST else within


def _part_is_right(truth: Truth, said: Said, law: _Law) -> bool:
    """Whether the part is named correctly; for a joint, the equations must be of the same one."""
    called = _called(str(said.get("part", "")))
    joints = {equation.left[-1] for equation in law.equations if equation.left[-1:].isdigit()}
    if called.startswith("joint") and said.get("stage") == DRIVE and joints:
        of = "joints" if len(joints) > 1 else f"joint_{joints.pop()}"
        return called in truth.parts and of == called
    return called in truth.parts


def _called(part: str) -> str:
    """Standard name of a part: `joint_2`, or `joints` for all or several of a kind."""
    part = part.lower()
    kind = next((kind for kind, words in _CALLED.items() if re.search(words, part)), part)
    which = re.findall(r"(?<![\d.])([1-6][ab]?)(?![\d.])", part)
    if len(set(which)) == 1:
        return f"{kind}_{which[0]}"
    return f"{kind}s" if kind in ("rod", "arm", "hinge", "joint") else kind


def _variables(law: _Law, said: Said) -> set[str]:
    """Variables of the equations, with relative joints; empty if the law's own list differs."""
    used = {
        _relative(name, _index(equation.left, said))
        for equation in law.equations
        for name in law.variables(equation)
    }
    listed = {_word(str(name)) for name in said.get("variables", ())}
    return used if listed == {_word(name) for name in used} else set()


def _word(name: str) -> str:
    """First word of a name, or the whole name of a temperature such as `temperature_arm`."""
    return name if name.startswith("temperature") else name.partition("_")[0]


def _index(left: str, said: Said) -> str:
    """Joint or rod of an equation, from its left side or the law's part: `2`, `1a`, or none."""
    for text in (left, str(said.get("part", ""))):
        found = re.search(r"_([1-6][ab]?)$", text)
        if found:
            return found[1]
    return ""


def _relative(name: str, of: str) -> str:
    """`q_3` in a law of joint 2 is `q_j+1`; unchanged if name or law belongs to no joint."""
    word, _, which = name.partition("_")
    if word == "force" and of:
        same = which == of or (which[0] == of[0] and (which[1:] == "") != (of[1:] == ""))
        return "force_j" if same else name
    if word not in _JOINTS or not of:
        return name
    offset = (int(which) - int(of[0])) % 3
    return f"{word}_j+{offset}" if offset else f"{word}_j"
