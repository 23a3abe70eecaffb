"""Where the generated file of a law is: in the package, or in a folder of the user.

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
_VALUES = (bool, int, float, str, type(None))  # what is the same where it looks the same
# of the package, what laws are made of; the rest of it does not change what they say
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
        if law.layout == module.LAYOUT:  # not so of a subclass with limbs of another size
            return module
    return _own(law)


def cache_folder() -> Path:
    """Where generated laws of users' own mechanisms and effects are kept.

    A folder of this process where the user has none that can be written.
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
    """Whole or not at all, for other processes that look for it now."""
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
    """The function that says the law: what a partial function wraps."""
    function = law.express
    while isinstance(function, partial):
        function = next(filter(callable, function.args), function.func)
    return function


def _key(law: Law) -> str:
    """Of the law's sources; changes with each edit of them.

    Where a law goes by more than the text of files (typed in at a prompt, a method of an object,
    an array that a function was made with), by what it says: it is generated to know.
    """
    function, known = _origin(law), [*_carried(law.express, set())]
    parts = [repr((law.name, law.layout, getattr(function, "__qualname__", "")))]
    homes = [sys.modules.get(name) for name in {f.__module__ for f in known if _is_plain(f)}]
    in_files = all(home is not None and _file_of(home) is not None for home in homes)
    values = [value for value in known if not _is_plain(value)]
    if in_files and all(isinstance(value, _VALUES) for value in values):
        parts.append(repr(values))
    else:
        parts.append(law.source())
    names = {*_VOCABULARY}.union(*(_reached(home) for home in homes if home is not None))
    texts = [_text(name) for name in sorted(names)]
    return blake2s("\0".join(parts + texts).encode(), digest_size=8).hexdigest()


def _is_plain(value: Any) -> bool:
    return isinstance(value, FunctionType)


def _carried(value: Any, seen: set[int]) -> Iterator[Any]:
    """A function, and what it brings along besides its text: its functions, and other values."""
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


def _reached(first: ModuleType) -> set[str]:
    """Modules that a law may take something from: its own, those that one names, and so on."""
    found: set[str] = set()
    todo = [first.__name__]
    while todo:
        name = todo.pop()
        module = sys.modules.get(name)
        if name in found or module is None or not _counts(name, module, first):
            continue
        found.add(name)
        todo.extend(_named(module))
        if not name.startswith(f"{_PACKAGE}."):
            todo.extend(_imported(module))
    return found


def _counts(name: str, module: ModuleType, first: ModuleType) -> bool:
    """Whether a module is the user's own, or a part of the package that laws are made of."""
    if name.partition(".")[0] == _PACKAGE:
        return name.startswith(_PARTS) and not name.startswith(GENERATED)
    file, top = _file_of(module), first.__name__.partition(".")[0]
    return file is not None and (name.partition(".")[0] == top or not _is_installed(file))


def _is_installed(file: Path) -> bool:
    return any(file.is_relative_to(folder) for folder in _installed())


@cache
def _installed() -> tuple[Path, ...]:
    """Folders of the standard library and of what pip installs."""
    paths = sysconfig.get_paths()
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    return tuple(Path(paths[name]) for name in names)


def _file_of(module: ModuleType) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file) if file is not None and file.endswith(".py") else None


def _named(module: ModuleType) -> Iterator[str]:
    for value in list(vars(module).values()):
        name = value.__name__ if isinstance(value, ModuleType) else _home_of(value)
        if isinstance(name, str):
            yield name


def _imported(module: ModuleType) -> Iterator[str]:
    """Modules that a file imports, whatever it takes of them: numbers do not say where from."""
    for node in ast.walk(ast.parse(_text(module.__name__))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = (module.__package__ or "").split(".")[: 1 - node.level or None]
            home = ".".join(filter(None, [*(above if node.level else ()), node.module]))
            yield home
            yield from (f"{home}.{alias.name}" for alias in node.names)


def _home_of(value: Any) -> Any:
    return getattr(value, "__module__", None) if callable(value) else None


@cache
def _text(name: str) -> str:
    path = _file_of(sys.modules[name])
    return "" if path is None else path.read_text(encoding="utf-8")
