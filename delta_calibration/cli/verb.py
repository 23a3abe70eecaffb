"""A verb of the command line, which never writes over what it reads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations, product
from pathlib import Path
from typing import Any

import click

from delta_calibration.errors import InputError

_BAG = {".mcap", ".db3", ".zstd"}  # files that a folder of a session consists of
_ABOUT = {"metadata.yaml", "metadata.json"}


class Output(click.Path):
    """Type of the arguments that name a file or a folder to write."""


OUTPUT = Output(path_type=Path)
OUTPUT_OR_PRINTED = Output()  # a text: the name of a file, or a mark
OUTPUTS = Output(path_type=Path, file_okay=False)  # a folder, which several options may fill


class Verb(click.Command):
    """A verb that refuses to write over its inputs, or two results to one file."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the verb.

        Raises:
            InputError: a file to write is also a file to read, or is to be written twice.
        """
        outputs = list(_files(ctx, lambda kind: isinstance(kind, Output)))
        inputs = _files(ctx, lambda kind: not isinstance(kind, Output))
        existing = [(name, path) for name, path in inputs if _exists(path)]
        files = _files(ctx, lambda kind: isinstance(kind, Output) and kind.file_okay)
        for (name, path), (other, source) in product(outputs, existing):
            if _replaces(path, source):
                raise InputError(
                    f"{name} {path}: would write over {_source(other, source)}; give another name"
                )
        for (name, path), (other, same) in combinations(files, 2):
            if path.resolve() == same.resolve():
                raise InputError(f"{name} {path}: {other} writes to the same file; name another")
        return super().invoke(ctx)


class VerbGroup(click.Group):
    """A verb with verbs of its own."""

    command_class = Verb


def verb(name: str, **options: Any) -> Callable[[Callable[..., Any]], Verb]:
    """Decorator that makes a verb of a function."""
    return click.command(name, cls=Verb, **options)


def _files(ctx: click.Context, wanted: Callable[[Any], bool]) -> Iterator[tuple[str, Path]]:
    """Names and paths of the arguments whose type is wanted; texts count as paths."""
    for parameter in ctx.command.params:
        if not wanted(parameter.type) or parameter.name is None:
            continue
        name = parameter.opts[0] if parameter.param_type_name == "option" else parameter.name
        given = ctx.params.get(parameter.name)
        for value in given if isinstance(given, tuple | list) else (given,):
            if isinstance(value, Path | str):
                yield name, Path(value)


def _source(name: str, path: Path) -> str:
    """What an argument names, in words: an option by its name, an argument by its path."""
    return f"what {name} reads" if name.startswith("-") else f"{path}, which is read"


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a text that is no name of a file
        return False


def _replaces(path: Path, source: Path) -> bool:
    """Whether a file to write is a source, or one of the files of a source's folder."""
    if not _exists(path):
        return False
    if path.samefile(source):
        return True
    inside = source.is_dir() and path.resolve().parent == source.resolve()
    return inside and (path.suffix in _BAG or path.name in _ABOUT)
