"""A verb of the command line, which never writes over what it reads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import combinations, product
from pathlib import Path
from typing import Any

import click

from delta_calibration.cli.replacing import require_same_kind
from delta_calibration.errors import InputError

_FORCED = f"{__name__}.force"
_BAG = {".mcap", ".db3", ".zstd"}  # files that a folder of a session consists of
_ABOUT = {"metadata.yaml", "metadata.json"}


class Output(click.Path):
    """Type of the arguments that name a file or a folder to write."""


class NewFolder(Output):
    """Type of the arguments that name a session's folder, which is never written over."""


OUTPUT = Output(path_type=Path)
NEW_FOLDER = NewFolder(path_type=Path)
OUTPUT_OR_PRINTED = Output()  # a text: the name of a file, or a mark
OUTPUTS = Output(path_type=Path, file_okay=False)  # a folder, which several options may fill


class Verb(click.Command):
    """A verb that protects files: its inputs, those of another kind, and its own results.

    It refuses to write over what it reads, or over an existing file of another kind (unless
    `--force` is given), or two results to one file. Missing folders of its outputs are made.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        replaced = any(_is_file(parameter.type) for parameter in self.params)
        if replaced and not any("--force" in parameter.opts for parameter in self.params):
            self.params.append(_force())

    def invoke(self, ctx: click.Context) -> Any:
        """Run the verb.

        Raises:
            InputError: a file to write is also a file to read, is to be written twice, or exists
                and is of another kind; or its folder cannot be made.
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
        if not forced(ctx):
            for name, path in _files(ctx, _is_file):
                require_same_kind(self.name or "", name, path)
        with _folders_of(path for _, path in outputs):
            return super().invoke(ctx)


class VerbGroup(click.Group):
    """A verb with verbs of its own."""

    command_class = Verb


def verb(name: str, **options: Any) -> Callable[[Callable[..., Any]], Verb]:
    """Decorator that makes a verb of a function."""
    return click.command(name, cls=Verb, **options)


def forced(ctx: click.Context | None = None) -> bool:
    """Whether `--force` was given to the verb that runs."""
    ctx = ctx or click.get_current_context()
    return bool(ctx.params.get("force") or ctx.meta.get(_FORCED))


def _force() -> click.Option:
    """`--force` of a verb that writes files; asked for by `forced`."""
    return click.Option(
        ["--force"],
        is_flag=True,
        expose_value=False,
        callback=lambda ctx, _, value: ctx.meta.update({_FORCED: value}),
        help="Replace an existing file of another kind.",
    )


def _is_file(kind: Any) -> bool:
    """Whether an argument of this type names a file that is written."""
    return isinstance(kind, Output) and not isinstance(kind, NewFolder) and kind.file_okay


@contextmanager
def _folders_of(outputs: Iterable[Path]) -> Iterator[None]:
    """Make the folders of outputs; at the end those in which nothing was written are removed.

    Raises:
        InputError: a folder cannot be made.
    """
    made: list[Path] = []
    try:
        for path in outputs:
            _make(path, made)
        yield
    finally:
        for folder in reversed(made):
            with suppress(OSError):  # it has content
                folder.rmdir()


def _make(path: Path, made: list[Path]) -> None:
    """Make the folders above an output, each added to `made`."""
    try:
        if path.parent.exists() and not path.parent.is_dir():
            raise NotADirectoryError(f"{path.parent} is not a folder")
        for folder in reversed([f for f in path.parents if not f.exists()]):
            folder.mkdir(exist_ok=True)
            made.append(folder)
    except (OSError, ValueError) as error:  # ValueError: a text that is no name of a file
        said = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: the folder {path.parent} cannot be made: {said}") from error


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
