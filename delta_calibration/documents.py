"""YAML documents of a user: read, checked by a schema, refused with the path of what is wrong."""

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

_LONGEST = 400_000  # bytes: seconds of reading; a calibration of 100 parameters has 80 000
_DEEPEST = 40  # levels; no document of the package has more than 6
_MOST_ENTRIES = 50_000  # that a document of this length can have without aliases


def read_document(path: Path, schema_for: Callable[[Document], Schema]) -> dict[str, Any]:
    """A YAML file as plain data, valid under a schema.

    Args:
        path: the file.
        schema_for: the schema of a document, which may go by what the document says.

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
    """Plain data of a YAML text, which cannot be much larger than the text.

    Raises:
        ContentError: not YAML, nested too deep, or with aliases that stand for too much.
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
    sizes: dict[str, int] = {}  # entries that an anchor stands for, those of its aliases counted
    open_at: list[tuple[str | None, int]] = []  # anchors of what is open, and the count before
    count = 0
    for event in YAML(typ="safe", pure=True).parse(text):
        if isinstance(event, AliasEvent):
            if event.anchor not in sizes:
                raise ValueError(f"alias *{event.anchor} stands within what it stands for")
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
            raise ValueError(f"aliases that stand for more than {_MOST_ENTRIES} entries")


def _reader() -> YAML:
    """For plain data, with numbers as people write them."""

    class Constructor(SafeConstructor):
        """Its own, as constructors are registered by class."""

    class Shallow(Composer):
        """Puts nodes together to a depth; older versions of the library have no bound of it."""

        level = 0

        def compose_node(self, parent: Any, index: Any) -> Any:
            """A node and those below it."""
            self.level += 1
            if self.level > _DEEPEST:
                mark = self.parser.peek_event().start_mark
                problem = f"nested too deep: {_DEEPEST} levels may be"
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
    """The number of a node; 31_49.0, which YAML takes for 3149, is a slip."""
    if "_" in node.value:
        problem = f"{node.value} is no number: digits take no _"
        raise ConstructorError(None, None, problem, node.start_mark)
    if str(node.tag).endswith(":int"):
        return constructor.construct_yaml_int(node)
    return constructor.construct_yaml_float(node)


def _date(constructor: SafeConstructor, node: ScalarNode) -> Any:
    """A date as the text that was written: entries that hold one are texts."""
    return constructor.construct_scalar(node)


def check_document(data: Any, schema: Schema, source: str) -> None:
    """Refuse data that do not follow the schema.

    Raises:
        ConfigError: names `source`, the entry's path, the value and what is allowed.
    """
    _require_mapping(data, source)
    _refuse_another_kind(data, schema, source)
    errors = list(Draft202012Validator(schema).iter_errors(data))
    # A file of another version first says so, whatever else is different in it.
    error = next((e for e in errors if e.validator == "const"), None) or best_match(errors)
    if error is not None:
        raise ContentError(f"{source}: {_explain(error)}")
    _require_finite(data, source, "")


def write_document(path: Path, data: Document) -> None:
    """Write YAML whole or not at all: into a file beside, then in place of the old one.

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
    """SHA-256 of what a document says, whatever its comments, order and spelling of numbers."""
    text = json.dumps(_plain(data), sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Integers as floats, so that `1` and `1.0` are the same value."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) + 0.0 if number else value  # + 0.0: -0.0 is 0.0


def _require_mapping(data: Any, source: str) -> None:
    if not isinstance(data, Mapping):
        found = "nothing" if data is None else type(data).__name__
        raise ContentError(f"{source}: a mapping of keys to values is expected, found {found}")


def _refuse_another_kind(data: Document, schema: Schema, source: str) -> None:
    """A file that is whole, but of another kind, says which, not what all is different in it."""
    wanted, found = _kind(schema.get("required", ())), _kind(data)
    if found and wanted and found != wanted:
        raise ConfigError(f"{source}: is a {found}; a {wanted} is expected")


def _kind(keys: Iterable[str]) -> str:
    """What a file with these keys is; empty where it may be anything."""
    there = set(keys)
    return next((kind for kind, marks in _MARKS.items() if marks <= there), "")


# The keys that no other kind of file has together.
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
            number = rule == "string" and isinstance(found, int | float)
            quoted = "; put it in quotes" if number else ""
            return f"{at}{found!r} is not allowed; {_KINDS.get(rule, rule)} is expected{quoted}"
        case "minimum" | "exclusiveMinimum" | "maximum" | "exclusiveMaximum":
            bound = _BOUNDS[str(error.validator)]
            return f"{at}{found!r} is not allowed; {bound} {rule:g} is expected"
        case "minItems" | "maxItems":
            return f"{at}{len(found)} values found, {rule} are expected"
        case "uniqueItems":
            return f"{at}{found!r} is not allowed; each value only once is expected"
        case "anyOf" | "oneOf":  # what is wrong by the form that has the kind of value found
            near = [e for e in error.context or () if e.validator != "type"]
            return _explain(near[0]) if near else f"{at}{error.message}"
        case "pattern" if "description" in schema:
            return f"{at}{found!r} is not allowed; {schema['description']} is expected"
        case "not":  # of a constant
            return f"{at}{found!r} is not allowed; anything but {rule['const']!r} is"
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
}


def _line(text: str) -> str:
    return " ".join(text.split())
