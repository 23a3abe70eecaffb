"""Group the columns of a table that belong together, by the words in their names.

Names of a group are the same but for the axis (`X_cmd`, `Y_cmd`, `Z_cmd`) or the joint (`J1 act`,
`J2 act`, `J3 act`). The other words tell intended values from measured ones.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from delta_calibration.recording.table_found import FoundTable
from delta_calibration.recording.table_names import bare_name

INTENDED, READ, OPEN = "intended", "read", ""  # kinds of a group: intended, measured, not told

_INTENDED = re.compile(
    r"cmds?|commands?|commanded|soll(?:wert|position|pos|lage)?|ziel|targets?|nom|nominal|nenn|"
    r"desired|des|ref|reference|set|setpoint|goal|plan|planned|calc|calculated|computed|fk|model|"
    r"theo|theoretical|intended|programmed"
)
_INSTRUMENT = re.compile(
    r"meas|measure|measured|measurements?|gemessen|mess(?:wert|ung)?|track|tracked|tracker|"
    r"lasertracker|leica|faro|laser|obs|observed"
)
_READ = re.compile(
    rf"{_INSTRUMENT.pattern}|ist(?:wert|position|pos|lage)?|act|actual|attained|real"
)
_READ_JOINT = re.compile(rf"{_READ.pattern}|enc|encoders?|geber|state")
_POINT = re.compile(r"pos|position|point|punkt|coord|coordinate|wert|value|p|t|tcp|mm")
_JOINT = re.compile(
    r"joint|axis|axe|achse|motor|theta|angle|winkel|pos|position|drive|rax|phi|q|j|a|e|m|t|d|s|"
    r"wert|value|deg|rad"
)
_NO_POINT = re.compile(  # differences, deviations, rotations and rates
    r"d|delta|diff?|difference|err|error|dev|deviation|std|stdev|stddev|sigma|rms|unc|"
    r"uncertainty|var|cov|rot|rotation|q|quat|quaternion|orientation|vel|velocity|omega|acc|accel|"
    r"force|torque|tilt|tol|tolerance|temp|scale|limit|min|max"
)
_NO_AXIS = re.compile(r"[adefijknqrsuvw]\*")  # an axis after a letter: `vx`, but not `x_v`
_TURNS = (  # names of columns of a rotation
    ("qw", "qx", "qy", "qz"),
    ("q0", "q1", "q2", "q3"),
    ("q1", "q2", "q3", "q4"),
    ("roll", "pitch", "yaw"),
    ("rx", "ry", "rz"),
    ("a", "b", "c"),
    ("w", "p", "r"),
    tuple(f"r{row}{column}" for row in "012" for column in "012"),
    tuple(f"r{row}{column}" for row in "123" for column in "123"),
)
_UNIT_LENGTH = 1e-3  # deviation of a quaternion from unit length
_WORD = re.compile(r"[^\W\d_]+")
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")  # between the words of `TargetPosX`


@dataclass(frozen=True)
class Group:
    """Columns of one point, or of all joints in the robot's order."""

    columns: tuple[str, ...]
    kind: str  # INTENDED, READ or OPEN
    plain: bool  # whether all words in the names are usual ones
    own: bool = False  # whether the names contain the joints' names


def point_groups(names: Sequence[str]) -> list[Group]:
    """Columns whose names differ only in x, y and z, with usual words first."""
    parts: dict[str, dict[str, str]] = {}
    for name in names:
        text = _text(name)
        for match in re.finditer("[xyz]", text):
            key = f"{text[: match.start()]}*{text[match.end() :]}"
            parts.setdefault(key, {}).setdefault(match[0], name)
    found = [
        Group(tuple(part[axis] for axis in "xyz"), _kind(words, _READ), _usual(words, _POINT))
        for key, part in parts.items()
        if len(part) == 3
        and not _NO_AXIS.fullmatch(key)
        and not any(map(_NO_POINT.fullmatch, words := _words(key)))
    ]
    return sorted(found, key=lambda group: not group.plain)


def measured_first(groups: Iterable[Group]) -> list[Group]:
    """Groups of the most promising kind: measured, otherwise not told, otherwise intended."""
    by_kind = {kind: [g for g in groups if g.kind == kind] for kind in (READ, OPEN, INTENDED)}
    return next((found for found in by_kind.values() if found), [])


def joint_groups(names: Sequence[str], joints: Sequence[str]) -> list[Group]:
    """Columns of all joints, by the joints' names or numbers: commands first, measured last."""
    groups = [*_own(names, joints), *_numbered(names, len(joints))]
    order = (INTENDED, OPEN, READ)
    return sorted(groups, key=lambda group: (order.index(group.kind), not group.own))


def kind_of(name: str) -> str:
    """Whether a column's name speaks of intended or of measured values."""
    return _kind(_words(_text(name)), _READ_JOINT)


def rotation_columns(table: FoundTable, names: Sequence[str]) -> list[str]:
    """Columns among `names` that hold a rotation by their names or, without names, by numbers."""
    if not table.named:
        return _unit_quaternion(table, names)
    own = {re.sub(r"[^a-z0-9]", "", _text(name)): name for name in names}
    return next(([own[key] for key in keys] for keys in _TURNS if set(keys) <= set(own)), [])


def _unit_quaternion(table: FoundTable, names: Sequence[str]) -> list[str]:
    """Four columns side by side whose numbers form quaternions of unit length, or none."""
    for k in range(len(names) - 3):
        four = list(names[k : k + 4])
        length = np.linalg.norm([table.column(name) for name in four], axis=0)
        moves = any(np.ptp(table.column(name)) > 0.0 for name in four)
        if moves and bool((np.abs(length - 1.0) < _UNIT_LENGTH).all()):
            return four
    return []


def by_instrument(name: str) -> bool:
    """Whether a column's name says that an instrument measured it; a controller may compute."""
    words = _words(_text(name))
    return kind_of(name) == READ and any(map(_INSTRUMENT.fullmatch, words))


def _own(names: Sequence[str], joints: Sequence[str]) -> Iterator[Group]:
    """Groups whose names contain the joints' names, such as `J1 cmd`."""
    parts: dict[str, dict[str, str]] = {}
    for joint in joints:
        pattern = re.compile(rf"(?<![a-z0-9]){re.escape(_split(joint))}(?![0-9])")
        for name in names:
            text = _text(name)
            for match in pattern.finditer(text):
                key = f"{text[: match.start()]}*{text[match.end() :]}"
                parts.setdefault(key, {}).setdefault(joint, name)
    for key, part in parts.items():
        words = _words(key)
        if len(part) == len(joints) and _usual(words, _JOINT, _READ_JOINT):
            columns = tuple(part[joint] for joint in joints)
            yield Group(columns, _kind(words, _READ_JOINT), plain=True, own=True)


def _numbered(names: Sequence[str], wanted: int) -> Iterator[Group]:
    """Groups numbered like joints, from 0 or 1."""
    parts: dict[str, dict[int, str]] = {}
    for name in names:
        text = _text(name)
        digits = re.findall(r"\d+", text)
        before = text.partition(digits[0])[0] if digits else ""
        if len(digits) == 1 and len(digits[0]) == 1 and _words(before):
            key = text.replace(digits[0], "*")
            parts.setdefault(key, {}).setdefault(int(digits[0]), name)
    for key, part in parts.items():
        words = _words(key)
        for first in (0, 1):
            numbers = range(first, first + wanted)
            if set(numbers) <= set(part) and _usual(words, _JOINT, _READ_JOINT):
                columns = tuple(part[k] for k in numbers)
                yield Group(columns, _kind(words, _READ_JOINT), plain=True)
                break


def _text(name: str) -> str:
    """Name of a column without its unit, in small letters, with its words apart."""
    return bare_name(_HUMP.sub("_", name))[0]


def _split(name: str) -> str:
    return _HUMP.sub("_", name.strip()).lower()


def _words(text: str) -> list[str]:
    return _WORD.findall(text.replace("*", " "))


def _kind(words: Iterable[str], read: re.Pattern[str]) -> str:
    """Kind that the words tell; OPEN if they tell none or both."""
    meant = any(map(_INTENDED.fullmatch, words))
    if meant == any(map(read.fullmatch, words)):
        return OPEN
    return INTENDED if meant else READ


def _usual(words: Iterable[str], known: re.Pattern[str], read: re.Pattern[str] = _READ) -> bool:
    """Whether each word is known, or is two known words written together."""

    def is_known(word: str) -> bool:
        return any(pattern.fullmatch(word) for pattern in (known, _INTENDED, read))

    return all(
        is_known(word)
        or any(is_known(word[:k]) and is_known(word[k:]) for k in range(1, len(word)))
        for word in words
    )
