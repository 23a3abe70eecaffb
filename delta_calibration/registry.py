"""Registry of classes by name: those of the package, and those that installed packages add.

A package adds its own in an entry-point group, `delta_calibration.effects` or
`delta_calibration.mechanisms`: the entry's name is the name that the class states, its value
`module:Class`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from delta_calibration.errors import ConfigError
from delta_calibration.lazy import cached_property

Kind = TypeVar("Kind")


class Registry(Mapping[str, type[Kind]], Generic[Kind]):
    """Mapping from name to class; classes of other packages are loaded at the first access.

    Not earlier, so that a module of another package can import this one first.
    """

    def __init__(self, base: type[Kind], key: str, group: str, own: Iterable[type[Kind]]) -> None:
        """Begin with the package's own classes.

        Args:
            base: class from which each class has to be derived.
            key: class variable that holds the name.
            group: entry-point group of the added classes.
            own: classes of this package.
        """
        self._base, self._key, self._group = base, key, group
        self._own = {str(getattr(kind, key)): kind for kind in own}

    def __getitem__(self, name: str) -> type[Kind]:
        return self._own[name] if name in self._own else self._added[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**self._own, **self._added})

    def __len__(self) -> int:
        return len({**self._own, **self._added})

    @cached_property
    def _added(self) -> dict[str, type[Kind]]:
        return {entry.name: self._loaded(entry) for entry in entry_points(group=self._group)}

    def _loaded(self, entry: EntryPoint) -> type[Kind]:
        """Load the class of an entry point.

        Raises:
            ConfigError: it cannot be imported, is not derived from the base, states another name,
                or the name is taken.
        """
        where = f"entry point {self._group}: {entry.name} = {entry.value}"
        if entry.name in self._own:
            raise ConfigError(f"{where}: the package already has a {entry.name}; use another name")
        try:
            kind = entry.load()
        except Exception as error:  # whatever a foreign module does when it is imported
            raise ConfigError(f"{where}: cannot be loaded: {error}") from error
        if not (isinstance(kind, type) and issubclass(kind, self._base)):
            raise ConfigError(f"{where}: is not a class derived from {self._base.__name__}")
        name = getattr(kind, self._key, None)
        if name != entry.name:
            raise ConfigError(f"{where}: its {self._key} is {name!r}, not the entry's name")
        return kind
