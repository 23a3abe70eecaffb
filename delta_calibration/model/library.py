"""Lookup of the generated file of a law: in the package, or in a folder of the user.

Laws of the package have theirs in `generated/`, written by `make laws`. Those of other mechanisms
and effects are generated when they are first used and kept in a folder of the user, under a name
that changes with the law's sources.
"""

from __future__ import annotations

import ast
import os
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from functools import cache, partial
from hashlib import blake2s
from importlib import import_module, util
from pathlib import Path
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from delta_calibration.model.law import Law

GENERATED = "delta_calibration.model.generated"
_PACKAGE = "delta_calibration"
_VOCABULARY = (f"{_PACKAGE}.model.law", f"{_PACKAGE}.model.symbols")
_SITES = frozenset(("site-packages", "dist-packages"))
_VALUES = (bool, int, float, str, type(None))  # types whose values are equal if their text is
# parts of the package that laws are made of; the rest of it does not change them
_PARTS = tuple(f"{_PACKAGE}.{part}" for part in ("mechanisms", "effects", "model"))


def module_of(law: Law) -> Any:
    """The compiled file of a law; generated now if there is none.

    Raises:
        ConfigError: it has to be generated, and CasADi is not installed.
    """
    full = f"{GENERATED}.{law.name}"
    own = str(_origin(law).__module__).startswith(f"{_PACKAGE}.")
    if own and util.find_spec(full) is not None:
        module = import_module(full)
        if law.layout == module.LAYOUT:  # differs for a subclass with limbs of another size
            return module
    return _own(law)


def cache_folder() -> Path:
    """Where generated laws of users' own mechanisms and effects are kept.

    A temporary folder of this process if the user has none that can be written.
    """
    root = os.environ.get("XDG_CACHE_HOME")
    try:
        folder = (Path(root) if root else Path.home() / ".cache") / _PACKAGE / "laws"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: a user without a home
        return _temporary()
    return folder if os.access(folder, os.W_OK | os.X_OK) else _temporary()


@cache
def _temporary() -> Path:
    """A folder that nobody else can write into, removed at the end of the process."""
    folder = tempfile.TemporaryDirectory(prefix=f"{_PACKAGE}_laws_")
    _FOLDERS.append(folder)
    return Path(folder.name)


_FOLDERS: list[tempfile.TemporaryDirectory[str]] = []


def _own(law: Law) -> Any:
    name = f"{law.name}_{_key(law)}"
    path = cache_folder() / f"{name}.py"
    if not path.exists():
        text = law.source()
        try:
            _write(text, path)
        except OSError:  # the disk is full, say
            path = _temporary() / path.name
            _write(text, path)
    return _loaded(name, path)


def _write(text: str, path: Path) -> None:
    """Write a file whole or not at all, as other processes may look for it now."""
    descriptor, beside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}_")
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
        Path(beside).replace(path)
    except OSError:
        Path(beside).unlink(missing_ok=True)
        raise


@cache
def _loaded(name: str, path: Path) -> Any:
    spec = util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _origin(law: Law) -> Any:
    """The function that defines the law, without the partial functions around it."""
    function = law.express
    while isinstance(function, partial):
        function = next(filter(callable, function.args), function.func)
    return function


def _key(law: Law) -> str:
    """Digest of the law's sources; changes with each edit of them.

    If a law depends on more than the text of files (typed in at a prompt, a method of an object,
    an array that a function was made with), it is generated, and the digest includes its code.
    """
    function, known = _origin(law), [*_carried(law.express, set())]
    parts = [repr((law.name, law.layout, getattr(function, "__qualname__", "")))]
    homes = {str(f.__module__) for f in known if _is_plain(f)}
    in_files = all(_file_of(home) is not None for home in homes)
    values = [value for value in known if not _is_plain(value)]
    if in_files and all(isinstance(value, _VALUES) for value in values):
        parts.append(repr(values))
    else:
        parts.append(law.source())
    names = {*_VOCABULARY}.union(*map(_reached, homes))
    texts = [_text(name) for name in sorted(names)]
    return blake2s("\0".join(parts + texts).encode(), digest_size=8).hexdigest()


def _is_plain(value: Any) -> bool:
    return isinstance(value, FunctionType)


def _carried(value: Any, seen: set[int]) -> Iterator[Any]:
    """Yield a function and what it carries besides its text: other functions and values."""
    if id(value) in seen:
        return
    if isinstance(value, partial):
        parts: tuple[Any, ...] = (value.func, *value.args, *value.keywords.values())
    elif isinstance(value, FunctionType):
        seen.add(id(value))
        yield value
        cells = (cell.cell_contents for cell in value.__closure__ or ())
        parts = (*cells, *(value.__defaults__ or ()), *(value.__kwdefaults__ or {}).values())
    elif isinstance(value, tuple):
        parts = value
    else:
        yield value
        return
    for part in parts:
        yield from _carried(part, seen)


def _reached(first: str) -> set[str]:
    """Modules that a law may depend on: its own, those that its own names, and so on."""
    found: set[str] = set()
    todo = [first]
    while todo:
        name = todo.pop()
        if name in found or not _counts(name, first):
            continue
        found.add(name)
        todo.extend(_named(name))
        if not name.startswith(f"{_PACKAGE}."):
            todo.extend(_imported(name))
    return found


def _counts(name: str, first: str) -> bool:
    """Whether a module is the user's own, or a part of the package that laws are made of."""
    top = name.partition(".")[0]
    if top == _PACKAGE:
        return name.startswith(_PARTS) and not name.startswith(GENERATED)
    if top in sys.stdlib_module_names:
        return False
    file = _file_of(name)
    return file is not None and (top == first.partition(".")[0] or not _is_installed(file))


def _is_installed(file: Path) -> bool:
    """Whether a file belongs to the standard library, or was installed by pip or the system."""
    folders = not _SITES.isdisjoint(file.parts)
    return folders or any(file.is_relative_to(folder) for folder in _installed())


@cache
def _installed() -> tuple[Path, ...]:
    paths = sysconfig.get_paths()
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    return tuple(Path(paths[name]) for name in names)


def _file_of(name: str) -> Path | None:
    """The source file of a module, which need not be imported yet; None without one."""
    module = sys.modules.get(name)
    if module is None:
        try:
            spec = util.find_spec(name)
        except (ImportError, AttributeError, ValueError):  # not a module, but a name in one
            return None
        file = spec.origin if spec is not None else None
    else:
        file = getattr(module, "__file__", None)
    return Path(file) if file is not None and file.endswith(".py") else None


def _named(name: str) -> Iterator[str]:
    """Yield the modules that define the objects which a module has names for."""
    module = sys.modules.get(name)
    for value in list(vars(module).values()) if module is not None else ():
        home = value.__name__ if isinstance(value, ModuleType) else _home_of(value)
        if isinstance(home, str):
            yield home


def _imported(name: str) -> Iterator[str]:
    """Yield the modules that a file imports, as an imported number does not tell its module."""
    file, parents = _file_of(name), name.split(".")
    if file is not None and file.stem != "__init__":
        parents = parents[:-1]
    for node in ast.walk(ast.parse(_text(name))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = parents[: len(parents) + 1 - node.level] if node.level else []
            home = ".".join([*above, *filter(None, [node.module])])
            yield home
            yield from (f"{home}.{alias.name}" for alias in node.names)


def _home_of(value: Any) -> Any:
    return getattr(value, "__module__", None) if callable(value) else None


@cache
def _text(name: str) -> str:
    path = _file_of(name)
    return "" if path is None else path.read_text(encoding="utf-8")
