"""Reads and writes YAML documents; refuses invalid ones with the path of the wrong entry."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError, best_match
from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.constructor import ConstructorError, SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    ScalarEvent,
)
from ruamel.yaml.nodes import ScalarNode

from delta_calibration.errors import ConfigError, ContentError
from delta_calibration.files import written_whole
from delta_calibration.texts import read_text

Document = Mapping[str, Any]
Schema = Mapping[str, Any]

_LONGEST = 400_000  # bytes: takes seconds to read; a calibration of 100 parameters has 80 000
_DEEPEST = 40  # levels; no document of the package has more than 6
_MOST_ENTRIES = 50_000  # a document of this length has no more entries without aliases


def read_document(path: Path, schema_for: Callable[[Document], Schema]) -> dict[str, Any]:
    """Read a YAML file as plain data that follow a schema.

    Args:
        path: the file.
        schema_for: returns the schema of a document, which may depend on its content.

    Raises:
        ConfigError: no such file or no regular one, not YAML, or an entry that is missing, unknown
            or out of range; the message names the file, the entry's path, the value and what is
            allowed.
    """
    data = parse_yaml(read_text(path, ConfigError, _LONGEST), str(path))
    _require_mapping(data, str(path))
    check_document(data, schema_for(data), str(path))
    return dict(data)


def parse_yaml(text: str, source: str) -> Any:
    """Parse a YAML text to plain data, which cannot be much larger than the text.

    Raises:
        ContentError: not YAML, nested too deep, or with aliases that stand for too many entries.
    """
    try:
        if "*" in text and "&" in text:
            _require_small(text)
        return _reader().load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = _line(str(error.problem))
        raise ContentError(f"{source}: not valid YAML: {where}{problem}") from error
    except (YAMLError, ValueError) as error:
        raise ContentError(f"{source}: not valid YAML: {_line(str(error))}") from error
    except RecursionError as error:
        raise ContentError(f"{source}: not valid YAML: nested too deep") from error


def _require_small(text: str) -> None:
    """Refuse aliases by which a short text stands for millions of entries."""
    sizes: dict[str, int] = {}  # number of entries of each anchor, aliases expanded
    open_at: list[tuple[str | None, int]] = []  # anchors of open collections, count before each
    count = 0
    for event in YAML(typ="safe", pure=True).parse(text):
        if isinstance(event, AliasEvent):
            if event.anchor not in sizes:
                raise ValueError(f"alias *{event.anchor} is used inside its own definition")
            count += sizes[event.anchor]
        elif isinstance(event, CollectionStartEvent):
            open_at.append((event.anchor, count))
            count += 1
        elif isinstance(event, CollectionEndEvent):
            anchor, before = open_at.pop()
            if anchor is not None:
                sizes[anchor] = count - before
        elif isinstance(event, ScalarEvent):
            count += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
        if count > _MOST_ENTRIES:
            raise ValueError(f"aliases that expand to more than {_MOST_ENTRIES} entries")


def _reader() -> YAML:
    """YAML reader for plain data that refuses numbers with underscores and deep nesting."""

    class Constructor(SafeConstructor):
        """A class of its own, because constructors are registered by class."""

    class Shallow(Composer):
        """Composes nodes to a limited depth; older versions of the library have no limit."""

        level = 0

        def compose_node(self, parent: Any, index: Any) -> Any:
            """Compose a node and its children."""
            self.level += 1
            if self.level > _DEEPEST:
                mark = self.parser.peek_event().start_mark
                problem = f"nested too deep: at most {_DEEPEST} levels are allowed"
                raise ComposerError(None, None, problem, mark)
            node = super().compose_node(parent, index)
            self.level -= 1
            return node

    for kind in ("int", "float"):
        Constructor.add_constructor(f"tag:yaml.org,2002:{kind}", _number)
    Constructor.add_constructor("tag:yaml.org,2002:timestamp", _date)
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer, yaml.Constructor = Shallow, Constructor
    return yaml


def _number(constructor: SafeConstructor, node: ScalarNode) -> Any:
    """The number of a node; refuses 31_49.0, which YAML reads as 3149 and is a typing error."""
    if "_" in node.value:
        problem = f"{node.value} is not a number: no _ between digits"
        raise ConstructorError(None, None, problem, node.start_mark)
    if str(node.tag).endswith(":int"):
        return constructor.construct_yaml_int(node)
    return constructor.construct_yaml_float(node)


def _date(constructor: SafeConstructor, node: ScalarNode) -> Any:
    """A date as the text that was written, because entries with dates are texts."""
    return constructor.construct_scalar(node)


def check_document(data: Any, schema: Schema, source: str) -> None:
    """Refuse data that do not follow the schema.

    Raises:
        ConfigError: names `source`, the entry's path, the value and what is allowed.
    """
    _require_mapping(data, source)
    _refuse_another_kind(data, schema, source)
    errors = list(Draft202012Validator(schema).iter_errors(data))
    # Another schema version is reported first, whatever else differs.
    error = next((e for e in errors if e.validator == "const"), None) or best_match(errors)
    if error is not None:
        raise ContentError(f"{source}: {_explain(error)}")
    _require_finite(data, source, "")


def write_document(path: Path, data: Document) -> None:
    """Write YAML atomically: into a temporary file, which then replaces the old one.

    Raises:
        ConfigError: the folder cannot be written.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 110
    with (
        written_whole(path, ConfigError, lasting=True) as beside,
        beside.open("w", encoding="utf-8") as file,
    ):
        yaml.dump(dict(data), file)


def content_hash(data: Document) -> str:
    """SHA-256 of a document's content, independent of comments, order and format of numbers."""
    text = json.dumps(_plain(data), sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Convert integers to floats, so that `1` and `1.0` are the same value."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) + 0.0 if number else value  # + 0.0: -0.0 is 0.0


def _require_mapping(data: Any, source: str) -> None:
    if not isinstance(data, Mapping):
        kind = {str: "text", bool: "true or false", list: "a list", type(None): "nothing"}
        found = kind.get(type(data), "a number" if isinstance(data, int | float) else "a value")
        raise ContentError(f"{source}: a mapping of keys to values is expected, found {found}")


def _refuse_another_kind(data: Document, schema: Schema, source: str) -> None:
    """Refuse a file of another kind by naming both kinds, not by listing all differences."""
    wanted, found = _kind(schema.get("required", ())), _kind(data)
    if found and wanted and found != wanted:
        raise ConfigError(f"{source}: is a {found}; a {wanted} is expected")


def _kind(keys: Iterable[str]) -> str:
    """Kind of file that has these keys; empty if they do not tell."""
    there = set(keys)
    return next((kind for kind, marks in _MARKS.items() if marks <= there), "")


# Sets of keys that only this kind of file has together.
_MARKS = {
    "robot file": {"name", "mechanism", "tracker"},
    "calibration file": {"parameters", "observability", "residuals"},
    "verdict": {"findings", "cannot_tell", "calibrated"},
    "mapping of a table": {"rows", "commands", "position"},
}


def load_schema(name: str) -> dict[str, Any]:
    """A schema of the package, by its name without `.json`."""
    folder = resources.files("delta_calibration").joinpath("schemas")
    schema: dict[str, Any] = json.loads(folder.joinpath(f"{name}.json").read_text("utf-8"))
    return schema


def _require_finite(value: Any, source: str, path: str) -> None:
    if isinstance(value, Mapping):
        for key, item in value.items():
            _require_finite(item, source, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for row, item in enumerate(value):
            _require_finite(item, source, f"{path}[{row}]")
    elif isinstance(value, int | float) and not abs(value) <= sys.float_info.max:
        raise ContentError(f"{source}: {path}: {value} is not a finite number")


def _explain(error: ValidationError) -> str:
    """One line for one violation: path, value, what is allowed."""
    path = error.json_path.removeprefix("$").removeprefix(".")
    at = f"{path}: " if path else ""
    rule: Any = error.validator_value
    found: Any = error.instance
    schema: Any = error.schema
    match error.validator:
        case "additionalProperties":
            known = ", ".join(schema["properties"])
            unknown = ", ".join(sorted(map(str, set(found) - set(schema["properties"]))))
            return f"{at}unknown key {unknown}; allowed: {known}"
        case "required":
            missing = ", ".join(key for key in rule if key not in found)
            return f"{at}missing key {missing}"
        case "enum":
            return f"{at}{found!r} is not allowed; choose from: {', '.join(map(str, rule))}"
        case "const":
            return f"{at}{found!r} is not allowed; it must be {rule!r}"
        case "type":
            kinds = [rule] if isinstance(rule, str) else list(rule)
            number = "string" in kinds and isinstance(found, int | float)
            quoted = "; put it in quotes" if number else ""
            expected = " or ".join(_KINDS[kind] for kind in kinds)
            return f"{at}{found!r} is not allowed; {expected} is expected{quoted}"
        case "minimum" | "exclusiveMinimum" | "maximum" | "exclusiveMaximum":
            bound = _BOUNDS[str(error.validator)]
            return f"{at}{found!r} is not allowed; {bound} {rule:g} is expected"
        case "minItems" | "maxItems":
            return f"{at}{len(found)} values found, {rule} are expected"
        case "uniqueItems":
            return f"{at}{found!r} is not allowed; each value only once is expected"
        case "anyOf" | "oneOf":  # explain by the alternative that has the type of the value
            near = [e for e in error.context or () if e.validator != "type"]
            return _explain(near[0]) if near else f"{at}{error.message}"
        case "pattern" if "description" in schema:
            return f"{at}{found!r} is not allowed; {schema['description']} is expected"
        case "not":  # of a constant
            return f"{at}{found!r} is not allowed; anything but {rule['const']!r} is expected"
        case _:
            return f"{at}{error.message}"


_BOUNDS = {
    "minimum": "at least",
    "exclusiveMinimum": "more than",
    "maximum": "at most",
    "exclusiveMaximum": "less than",
}


_KINDS = {
    "object": "a mapping of keys to values",
    "array": "a list",
    "string": "a text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}


def _line(text: str) -> str:
    return " ".join(text.split())
