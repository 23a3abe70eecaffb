"""Sections of a user's file as frozen dataclasses: a field's unit is the end of its key.

    base_radius: float = length()       base_radius_mm in the file, metres inside

The fields define both the schema that checks a file and the object that a valid file becomes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

import numpy as np

from delta_calibration.errors import ConfigError

Kind = TypeVar("Kind")
Shape = tuple[int | None, ...]

SI = {
    "mm": 1e-3,
    "um": 1e-6,
    "um_per_m": 1e-6,
    "mm_per_s": 1e-3,
    "deg": np.pi / 180,
    "deg_per_s": np.pi / 180,
    "mrad": 1e-3,
    "urad": 1e-6,
    "kg": 1.0,
    "n": 1.0,
    "percent": 1e-2,
    "turns_per_m": 2 * np.pi,
    "px": 1.0,
    "": 1.0,
}


@dataclass(frozen=True)
class _Entry:
    """How a field is written in the file."""

    schema: Mapping[str, Any]
    unit: str | None = None  # of a number or an array of numbers; None: not a number
    key: str | None = None  # if it differs from the field's name with the unit appended
    part: type[Any] | None = None  # class of each section, if the field is a list of sections
    about: str = ""  # description for the author of a file


def quantity(
    unit: str = "",
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    shape: Shape = (),
    key: str | None = None,
    default: Any = MISSING,
    about: str = "",
) -> Any:
    """A field that holds a number, or an array of numbers.

    Args:
        unit: unit in the file, one of `SI`; the field itself is in SI units.
        above: exclusive lower bound.
        least: inclusive lower bound.
        most: inclusive upper bound.
        shape: shape of the array; `None` for a length that the file decides.
        key: key in the file, if it differs from the field's name with the unit appended.
        default: value if the file has no such entry; without a default the entry is required.
        about: description for the author of a file.
    """
    bounds = {"exclusiveMinimum": above, "minimum": least, "maximum": most}
    number = {"type": "number", **{k: v for k, v in bounds.items() if v is not None}}
    return _field(_Entry(_array(number, shape), unit, key, about=about), default)


def length(**options: Any) -> Any:
    """A length of a part [mm in the file]."""
    return quantity("mm", above=0.0, most=10000.0, **options)


def place(**options: Any) -> Any:
    """A coordinate, or an array of coordinates [mm in the file]."""
    return quantity("mm", least=-10000.0, most=10000.0, **options)


def angle(**options: Any) -> Any:
    """An angle, or an array of angles [deg in the file]."""
    return quantity("deg", least=-360.0, most=360.0, **options)


def mass(**options: Any) -> Any:
    """A mass [kg]."""
    return quantity("kg", above=0.0, most=1e5, **options)


def tolerance(unit: str = "mm", **options: Any) -> Any:
    """A tolerance: standard deviation of a dimension about its nominal value."""
    return quantity(unit, above=0.0, most=100.0, **options)


def choice(*values: str, default: Any = MISSING, about: str = "") -> Any:
    """A text that must be one of the given values."""
    return _field(_Entry({"enum": list(values)}, about=about), default)


def names(default: Any = MISSING, about: str = "") -> Any:
    """A list of different texts, at least one."""
    word = {"type": "string", "minLength": 1}
    return _field(_Entry({**_array(word, (None,)), "uniqueItems": True}, about=about), default)


def senses(about: str = "") -> Any:
    """An array of signs, 1 or -1; None if the file has no such entry."""
    return _field(_Entry(_array({"enum": [1, -1]}, (None,)), "", about=about), None)


def flag(default: bool, about: str = "") -> Any:
    """True or false."""
    return _field(_Entry({"type": "boolean"}, about=about), default)


def parts(kind: type[Any], about: str = "") -> Any:
    """A list of sections of one class."""
    return _field(_Entry(_array(schema_of(kind), (None,)), part=kind, about=about))


def schema_of(kind: type) -> dict[str, Any]:
    """JSON schema of a section."""
    hints = get_type_hints(kind)
    return {
        "type": "object",
        "additionalProperties": False,
        "required": [key_of(f) for f in fields(kind) if f.default is MISSING],
        "properties": {key_of(f): _schema(f, hints[f.name]) for f in fields(kind)},
    }


def built(kind: type[Kind], section: Mapping[str, Any]) -> Kind:
    """Build the object of a section that follows its schema, with values in SI units.

    Raises:
        ConfigError: entries that contradict each other; names their path in the section.
    """
    hints = get_type_hints(kind)
    given = [f for f in fields(kind) if key_of(f) in section]  # type: ignore[arg-type]
    return kind(**{f.name: _value(f, hints[f.name], section[key_of(f)]) for f in given})


def part_of(where: str, kind: type[Kind], section: Mapping[str, Any]) -> Kind:
    """Build the object of a section within another; errors name its path, `where`.

    Raises:
        ConfigError: entries that contradict each other.
    """
    try:
        return built(kind, section)
    except ConfigError as error:
        raise ConfigError(f"{where}.{error}") from error


def refused(section: Any, name: str, allowed: str) -> ConfigError:
    """Error about a field: its key and value as the file has them, and the allowed values."""
    item = next(f for f in fields(section) if f.name == name)
    entry: _Entry = item.metadata["entry"]
    value = getattr(section, name)
    said = f"{value}" if entry.unit is None else as_written(value, entry.unit)
    return ConfigError(f"{key_of(item)}: {said} is not allowed; {allowed}")


def as_written(value: Any, unit: str) -> str:
    """Format a number in SI units, or an array of numbers, in the unit of a file."""
    if np.ndim(value):
        return f"[{', '.join(as_written(one, unit) for one in value)}]"
    return f"{float(value) / SI[unit]:.10g}"


def key_of(item: Field[Any]) -> str:
    """A field's key in the file."""
    entry: _Entry | None = item.metadata.get("entry")
    if entry is None or not (entry.key or entry.unit):
        return item.name
    return entry.key or f"{item.name}_{entry.unit}"


def _field(entry: _Entry, default: Any = MISSING) -> Any:
    return field(default=default, metadata={"entry": entry})


def _array(schema: dict[str, Any], shape: Shape) -> dict[str, Any]:
    for size in reversed(shape):
        few = {"minItems": 1} if size is None else {"minItems": size, "maxItems": size}
        schema = {"type": "array", **few, "items": schema}
    return schema


def _schema(item: Field[Any], kind: Any) -> Mapping[str, Any]:
    if is_dataclass(kind):
        return schema_of(kind)  # type: ignore[arg-type]
    entry: _Entry = item.metadata["entry"]
    return {**entry.schema, **({"description": entry.about} if entry.about else {})}


def _value(item: Field[Any], kind: Any, value: Any) -> Any:
    if is_dataclass(kind):
        return part_of(key_of(item), kind, value)  # type: ignore[arg-type]
    entry: _Entry = item.metadata["entry"]
    if entry.part is not None:
        where = key_of(item)
        return tuple(part_of(f"{where}[{k}]", entry.part, one) for k, one in enumerate(value))
    if entry.unit is None:
        return tuple(value) if isinstance(value, list) else value
    in_si = np.asarray(value, dtype=float) * SI[entry.unit]
    return in_si if in_si.ndim else float(in_si)
