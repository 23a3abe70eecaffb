"""Entries of robot files with their meaning, from the schema: questions, comments, reference."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import StringIO
from textwrap import wrap
from typing import Any

from jsonschema import Draft202012Validator
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from delta_calibration.documents import Document
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.robot import known_robots, load_robot, robot_document, robot_schema

_WORDS = {
    "mm": "mm",
    "um": "um",
    "um_per_m": "um/m",
    "mm_per_s": "mm/s",
    "deg": "degrees",
    "deg_per_s": "degrees/s",
    "mrad": "mrad",
    "urad": "urad",
    "kg": "kg",
    "n": "N",
    "percent": "%",
    "turns_per_m": "turns/m",
    "px": "px",
}
_GIVEN = ("schema", "name", "mechanism")
# Optional entries that are asked for all the same, with the value they have if left out.
OFFERED: Mapping[tuple[str, ...], str] = {
    ("geometry", "azimuths_deg"): "0, 120, 240",
    ("geometry", "convention"): "modified",
    ("joints", "passed_through"): "none",
    ("joints", "sign"): "1 for all",
    ("joints", "zero_deg"): "0 for all",
    ("joints", "zero_mm"): "0 for all",
    ("workspace", "centre_mm"): "none",
    ("geometry", "links[]", "zero_deg"): "0",
    ("geometry", "links[]", "parallel"): "false",
    ("geometry", "links[]", "mass_kg"): "0",
}
_LARGEST = sys.float_info.max
_WIDTH, _INDENT, _COLUMN = 110, 2, 40
_HOW_JOINTS_READ = """
## How joint readings are defined

A drive's reading is `sign` times the mechanism's own joint value, plus `zero_deg` (`zero_mm` for
sliding joints). The mechanism's own joint value is defined as follows:

| Mechanism | Own joint value |
|---|---|
| `rotary_delta`, `six_rod_delta` | 0 with the arm level, outward; increases downward |
| `linear_delta` | 0 at the endstop; increases downward |
| `cable_robot` | 0 at home; increases as cable is let out |
| `five_axis` | height of the slider |
| `serial_arm` | q of the link's transform, right-handed about its axis |

Example: a motor that reads 90 degrees with the arm level, and less as the arm goes down, has
`sign: -1` and `zero_deg: 90`. Everything else in the package uses readings: limits, `home_deg`,
topics, tables, commands and corrections, plots, URDF, exported C, and the phase and sign of a
cause that depends on a joint's angle. Only the joint zeros among the identified dimensions
(`joint_zero_1`) refer to the mechanism's own joint value.

`azimuths_deg` of a rotary Delta and `angles_deg` of a linear one give the direction of each leg;
legs may be numbered clockwise or counter-clockwise.

## Axes that are passed through

`passed_through` names axes that the model does not know, such as the fourth axis of a Delta, which
turns the tool. Commands, states and trajectories contain either all of these axes or none. Their
values are passed on unchanged, after the robot's joints in the order of the file, and are held
together with the joints. If a controller's `command_joints` contain them, it only receives
commands that contain them. The targets of `compensate` may have a column for such an axis
(`joint_4`, with or without a unit suffix), which is copied. Fits, diagnoses and exported C ignore
these axes, a calibration does not depend on them, and the URDF does not show them, because the
file does not say how they move.

## Links of a serial arm, modified or standard

The default is `convention: modified` (Craig, proximal): the transform of row i goes to its axis
and then along it. In `convention: standard` (distal, as in Spong and the tables of many
manufacturers) it turns about its axis and goes on to the next.

| Convention | Transform of row i |
|---|---|
| modified | R_x(twist) T_x(length) R_z(q_i + zero) T_z(offset) |
| standard | R_z(q_i + zero) T_z(offset) T_x(length) R_x(twist) |

The same arm has the same `zero_deg` and `offset_mm` in both conventions; `twist_deg` and
`length_mm` are one row later in the modified table. Those of the last standard row define the
frame in which `tool_mm` and `mount_deg` are given. In both, `parallel` compares a row's axis with
the previous one. Standard rows are converted to modified ones when the file is read: identified
parameters (`twist_2`) are modified, and `delta-cal export --format dh` writes both tables.

The links decide which coordinates of the tool an arm is commanded by: x and y with two joints, or
if all axes are parallel, whatever their number; the whole pose with six or seven joints; the
position otherwise. A planar arm of three joints has one joint more than x and y need: a correction
brings the tool to x and y by a small change of the joints and of the tool's turn, which is not
corrected itself. The parallel axes of a planar arm may not be level in the base frame (`twist_deg`
of the first link 90 or -90), because x and y then determine no place.
""".rstrip().splitlines()


@dataclass(frozen=True)
class Entry:
    """One entry of a robot file.

    Attributes:
        path: keys, beginning with the section.
        about: description; empty if the schema has none.
        schema: JSON schema of the value.
        required: whether every file must have the entry.
        within: optional section that must have this entry if it is present; empty if none.
    """

    path: tuple[str, ...]
    about: str
    schema: Mapping[str, Any]
    required: bool
    within: str = ""

    @property
    def name(self) -> str:
        """Name of the entry in messages, such as `geometry.arm_mm`."""
        return ".".join(self.path)

    @property
    def unit(self) -> str:
        """Unit in words, from the suffix of the key; empty if it has none."""
        ends = (unit for unit in sorted(_WORDS, key=len, reverse=True))
        return next((_WORDS[u] for u in ends if self.path[-1].endswith(f"_{u}")), "")

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return allowed(self.schema)

    def read(self, text: str) -> Any:
        """Read a value that a user typed: YAML, or numbers separated by commas.

        Raises:
            InputError: the value is not allowed; the message says what is.
        """
        many = self.schema.get("type") == "array" and not text.lstrip().startswith("[")
        try:
            value = YAML(typ="safe", pure=True).load(f"[{text}]" if many else text)
        except YAMLError as error:
            raise InputError(f"{self.name}: {text!r} cannot be read; {self.allowed}") from error
        if not (_finite(value) and Draft202012Validator(self.schema).is_valid(value)):
            raise InputError(f"{self.name}: {text} is not allowed; {self.allowed}")
        return value


def _finite(value: Any) -> bool:
    """Whether all numbers in a value are finite: no bound of a schema refuses `.nan`."""
    if isinstance(value, list):
        return all(map(_finite, value))
    return not isinstance(value, int | float) or abs(value) <= _LARGEST


_KINDS = {"number": "number", "string": "text", "object": "section"}
_BOUNDS = {"exclusiveMinimum": "above", "minimum": "at least", "maximum": "at most"}


def allowed(schema: Mapping[str, Any]) -> str:
    """Allowed values of a schema, in words: `3 numbers, each above 0`."""
    kind = str(schema.get("type"))
    if kind == "array":
        return _listed(schema, schema["items"])
    if kind == "boolean":
        return "true or false"
    limits = _limits(schema)
    return limits if "enum" in schema else f"a {_KINDS[kind]}" + (f", {limits}" if limits else "")


def _listed(schema: Mapping[str, Any], item: Mapping[str, Any]) -> str:
    if item.get("type") == "array":
        return f"a list; each entry: {allowed(item)}"
    fixed = schema.get("minItems") == schema.get("maxItems")
    many = f"{schema['minItems']}" if fixed else "a list of"
    limits = _limits(item)
    kind = _KINDS.get(str(item.get("type")), "value")
    return f"{many} {kind}s" + (f", each {limits}" if limits else "")


def _limits(schema: Mapping[str, Any]) -> str:
    """Values of an enumeration, or bounds of a number, in words; empty if there are none."""
    if "enum" in schema:
        return " or ".join(map(str, schema["enum"]))
    bounds = (f"{word} {schema[key]:.10g}" for key, word in _BOUNDS.items() if key in schema)
    return " and ".join(bounds)


def entries(mechanism: str) -> Iterator[Entry]:
    """Yield all entries of a mechanism's robot file, in the order of the file.

    Raises:
        InputError: no mechanism of that name.
    """
    if mechanism not in MECHANISMS:
        known = ", ".join(MECHANISMS)
        raise InputError(f"no mechanism {mechanism!r}; there are: {known}")
    schema = robot_schema(mechanism)
    for name, section in schema["properties"].items():
        if name not in _GIVEN:
            needed = name in schema["required"]
            yield from _entries(section, (name,), needed, "" if needed else name)


def _entries(
    schema: Mapping[str, Any], path: tuple[str, ...], needed: bool, within: str
) -> Iterator[Entry]:
    if schema.get("type") != "object":
        yield Entry(path, schema.get("description", ""), schema, needed, within)
        return
    for key, item in schema["properties"].items():
        there = key in schema["required"]
        yield from _entries(item, (*path, key), needed and there, within if there else "")


def model_for(mechanism: str) -> dict[str, Any]:
    """Content of a robot file of the package for this mechanism, as an example to start from.

    Raises:
        InputError: there is none.
    """
    for name in known_robots():
        if _drawn_as(name, mechanism):
            return {**robot_document(name)[1], "mechanism": mechanism}
    raise InputError(
        f"no robot of mechanism {mechanism} comes with the package as a start; give one with "
        "--like FILE"
    )


def value_at(data: Document, path: tuple[str, ...]) -> Any:
    """Value under these keys in a robot file; None if there is none."""
    inside: Any = data
    for key in path:
        if not isinstance(inside, Mapping) or key not in inside:
            return None
        inside = inside[key]
    return inside


def with_value(data: Document, path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """Copy of a robot file with another value under these keys."""
    first, *rest = path
    inside = data.get(first, {})
    return {**data, first: with_value(inside, tuple(rest), value) if rest else value}


def commented(data: Document, notes: Iterable[str] = ()) -> str:
    """Robot file as YAML text: notes, then entries with their descriptions as comments."""
    made = _with_comments(data, robot_schema(str(data["mechanism"])), 0)
    for key in list(made)[len(_GIVEN) :]:
        made.yaml_set_comment_before_after_key(key, before="\n")
    yaml, text = YAML(), StringIO()
    yaml.width = _WIDTH
    yaml.indent(mapping=2, sequence=4, offset=2)
    yaml.dump(made, text)
    lines = [line for note in notes for line in wrap(f"note: {note}", _WIDTH - 2)]
    return "".join(f"# {line}\n" for line in lines) + text.getvalue()


def _with_comments(value: Any, schema: Mapping[str, Any], indent: int) -> Any:
    """Add comments to a value: lists of numbers are on one line, comments after or above."""
    if isinstance(value, Mapping):
        of = schema.get("properties", {})
        made = CommentedMap(
            {k: _with_comments(v, of.get(k, {}), indent + _INDENT) for k, v in value.items()}
        )
        for key, item in value.items():
            about = of.get(key, {}).get("description", "")
            if about and isinstance(item, list):
                made.yaml_set_comment_before_after_key(key, before=about, indent=indent)
            elif about:
                made.yaml_add_eol_comment(about, key, column=_COLUMN)
        return made
    if not isinstance(value, list):
        return value
    items = schema.get("items", {})
    plain = {} if value and isinstance(value[0], Mapping) else items
    made_list = CommentedSeq(
        _with_comments(item, items if row == 0 else plain, indent + _INDENT)
        for row, item in enumerate(value)
    )
    if not any(isinstance(item, Mapping | list) for item in value):
        made_list.fa.set_flow_style()
    return made_list


def reference() -> str:
    """Reference page of all entries of all mechanisms, as Markdown."""
    own = ("geometry", "tolerances", "masses")
    lines = [
        "# Robot files, entry by entry",
        "",
        "A robot file describes a robot: dimensions, tolerances, joints, masses, tracker, limits.",
        "`delta-cal robot new` writes a file by asking questions, `robot check` checks it, and",
        "`robot draw` draws the robot. `delta-cal robot reference` prints this page.",
        "",
        "A file begins with `schema: 1`, `name` (a lower-case letter, then lower-case letters,",
        "digits and `_`) and `mechanism`. Sections follow. The suffix of a key is the unit of its",
        "number. `geometry.arm_mm` is the entry `arm_mm` of section `geometry`; `links[]` is one",
        "section of a list.",
        *_HOW_JOINTS_READ,
    ]
    for mechanism in MECHANISMS:
        lines += ["", f"## `mechanism: {mechanism}`", "", *_introduced(mechanism), ""]
        lines += _table([e for e in entries(mechanism) if e.path[0] in own])
    turning, sliding = _by_joints()
    for title, name in (("joints that turn", turning), ("joints that slide", sliding)):
        lines += ["", f"## All robots: {title}", ""]
        lines += (
            ["As in the table before, except for these entries:", ""] if name == sliding else []
        )
        rest = [e for e in entries(name) if e.path[0] not in own]
        shared = {entry.path for entry in entries(turning)} if name == sliding else set()
        lines += _table([e for e in rest if e.path not in shared])
    return "\n".join(lines) + "\n"


def _introduced(mechanism: str) -> list[str]:
    """Summary of a mechanism, and the robot files of the package that use it."""
    kind = MECHANISMS[mechanism]
    summary = (inspect.getdoc(kind) or "").partition("\n")[0]
    there = [name for name in known_robots() if _drawn_as(name, mechanism)]
    examples = ", ".join(f"`config/{name}.yaml`" for name in there)
    return [summary, "", f"Robots of the package with these dimensions: {examples}."]


def _drawn_as(name: str, mechanism: str) -> bool:
    """Whether a robot of the package has the dimensions of a mechanism."""
    return isinstance(load_robot(name).dimensions, MECHANISMS[mechanism].Dimensions)


def _by_joints() -> tuple[str, str]:
    """Names of a mechanism with revolute joints and of one with prismatic joints."""
    first = {kind.joint_unit: name for name, kind in reversed(list(MECHANISMS.items()))}
    return first["rad"], first["m"]


def _table(rows: Iterable[Entry]) -> list[str]:
    lines = ["| Entry | What it is | Allowed |", "|---|---|---|"]
    for entry in (part for row in rows for part in _with_parts(row)):
        lines.append(f"| `{entry.name}` | {entry.about}{_left_out(entry)} | {entry.allowed} |")
    return lines


def _with_parts(entry: Entry) -> Iterator[Entry]:
    """Yield an entry and, if it is a list of sections, the entries of such a section."""
    yield entry
    yield from parts_of(entry)


def parts_of(entry: Entry) -> Iterator[Entry]:
    """Yield the entries of a section in a list of sections; none for other entries."""
    item = entry.schema.get("items", {})
    if item.get("type") == "object":
        *before, last = entry.path
        yield from _entries(item, (*before, f"{last}[]"), True, "")


def _left_out(entry: Entry) -> str:
    if entry.required:
        return ""
    if entry.within:
        return f" (needed if there is a section `{entry.within}`)"
    return " (may be left out)"
